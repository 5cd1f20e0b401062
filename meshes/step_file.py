"""Write a small assembly as STEP (ISO 10303-21, AP214): prisms with plane faces, placed by an assembly.

A STEP file is a list of numbered records that refer to each other. Only what this needs is here: products,
boundary representations with planes and lines, and placements. Lengths are millimetres, and the file says so.

The assembly: ``base``, a block [0, 60] × [0, 40] × [0, 12] with a groove 20 ≤ y ≤ 30, z ≥ 6 along all of
it; ``lid``, a plate 4 thick, turned upside down and laid on it; ``pin_left`` and ``pin_right``, two uses of
one hexagonal prism, 12 high, standing on the lid at x = 8 and x = 52, y = 20. Touching parts share whole
areas. The highest points are at z = 28; (30, 25, 9) in the groove is 3 outside.
"""

import numpy as np

HEADER = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('sample assembly of prisms'),'2;1');
FILE_NAME('assembly.step','2025-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""
FOOTER = "ENDSEC;\nEND-ISO-10303-21;\n"
UP, AHEAD = (0, 0, 1), (1, 0, 0)


def assembly_bytes() -> bytes:
    """The whole file."""
    hexagon = [(3 * np.cos(angle), 3 * np.sin(angle)) for angle in np.pi / 3 * np.arange(6)]
    groove = [(0, 0), (40, 0), (40, 12), (30, 12), (30, 6), (20, 6), (20, 12), (0, 12)]
    file = _StepFile()
    base = file.part("base", _lying(groove, 60))
    lid = file.part("lid", _standing([(0, 0), (60, 0), (60, 40), (0, 40)], 4))
    pin = file.part("pin", _standing(hexagon, 12))
    file.assembly(
        "assembly",
        [
            ("base", base, file.axes((0, 0, 0))),
            ("lid", lid, file.axes((0, 40, 16), up=(0, 0, -1))),
            ("pin_left", pin, file.axes((8, 20, 16))),
            ("pin_right", pin, file.axes((52, 20, 16))),
        ],
    )
    return file.text().encode("ascii")


def _standing(outline, height):
    """Corner loops (two, bottom and top, counter-clockwise from above) of a prism along z."""
    bottom = [(x, y, 0) for x, y in outline]
    return bottom, [(x, y, height) for x, y, _ in bottom]


def _lying(outline, length):
    """The same for a prism along x over an outline in y and z."""
    back = [(0, y, z) for y, z in outline]
    return back, [(length, y, z) for _, y, z in back]


class _StepFile:
    """Records, and the numbers by which they refer to each other."""

    def __init__(self):
        self.records = []
        context = self.add("APPLICATION_CONTEXT('automotive design')")
        self.add(
            f"APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,{context})"
        )
        self.product_context = self.add(f"PRODUCT_CONTEXT('',{context},'mechanical')")
        self.design_context = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{context},'design')")
        length = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        solid_angle = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        accuracy = self.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),{length},'accuracy','')")
        self.space = self.add(
            f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({accuracy}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))REPRESENTATION_CONTEXT('',''))"
        )
        self.origin = self.axes((0, 0, 0))

    def add(self, record):
        """Append a record; the reference to it."""
        self.records.append(record)
        return f"#{len(self.records)}"

    def text(self):
        lines = [f"#{number}={record};\n" for number, record in enumerate(self.records, start=1)]
        return HEADER + "".join(lines) + FOOTER

    # products

    def part(self, name, loops):
        """A product that is one prism; references to its definition and its shape."""
        shell = self.add(f"CLOSED_SHELL('',{_list(self.faces(*loops))})")
        solid = self.add(f"MANIFOLD_SOLID_BREP('{name}',{shell})")
        shape = self.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('{name}',({self.origin},{solid}),{self.space})")
        return self.product(name, shape), shape

    def assembly(self, name, occurrences):
        """A product made of placed parts: (name, part, axes) each."""
        axes = [placed for _, _, placed in occurrences]
        shape = self.add(f"SHAPE_REPRESENTATION('{name}',{_list([self.origin, *axes])},{self.space})")
        whole = self.product(name, shape)
        for use, (part, part_shape), placed in occurrences:
            occurrence = self.add(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{use}','{use}','',{whole},{part},$)")
            owner = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{occurrence})")
            move = self.add(f"ITEM_DEFINED_TRANSFORMATION('','',{self.origin},{placed})")
            relation = self.add(
                f"(REPRESENTATION_RELATIONSHIP('','',{part_shape},{shape})"
                f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION({move})SHAPE_REPRESENTATION_RELATIONSHIP())"
            )
            self.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{owner})")

    def product(self, name, shape):
        product = self.add(f"PRODUCT('{name}','{name}','',({self.product_context}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{self.design_context})")
        owner = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({owner},{shape})")
        return definition

    # geometry

    def axes(self, place, up=UP, ahead=AHEAD):
        """A frame: its origin, its z axis and its x axis."""
        return self.add(
            f"AXIS2_PLACEMENT_3D('',{self.point(place)},{self.direction(up)},{self.direction(ahead)})"
        )

    def point(self, place):
        return self.add(f"CARTESIAN_POINT('',{_numbers(place)})")

    def direction(self, way):
        return self.add(f"DIRECTION('',{_numbers(np.divide(way, np.linalg.norm(way)))})")

    def faces(self, first, second):
        """Two ends and as many sides as the outline has, all turned outwards."""
        corners = [np.array(loop, dtype=np.float64) for loop in (first, second)]
        vertices = [[self.add(f"VERTEX_POINT('',{self.point(c)})") for c in loop] for loop in corners]
        count, edges = len(first), {}

        def face(path):
            used = [
                self.edge(edges, corners, vertices, a, b)
                for a, b in zip(path, path[1:] + path[:1], strict=True)
            ]
            loop = self.add(f"EDGE_LOOP('',{_list(used)})")
            bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
            points = np.array([corners[end][k] for end, k in path])
            plane = self.add(f"PLANE('',{self.axes(points[0], _normal(points), points[1] - points[0])})")
            return self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)")

        ends = [[(0, k) for k in reversed(range(count))], [(1, k) for k in range(count)]]
        sides = [[(0, k), (0, (k + 1) % count), (1, (k + 1) % count), (1, k)] for k in range(count)]
        return [face(path) for path in ends + sides]

    def edge(self, edges, corners, vertices, a, b):
        """The edge from corner *a* to corner *b*, each (end, number); both its faces use one curve."""
        if (b, a) in edges:
            return self.add(f"ORIENTED_EDGE('',*,*,{edges[b, a]},.F.)")
        start, way = corners[a[0]][a[1]], corners[b[0]][b[1]] - corners[a[0]][a[1]]
        vector = self.add(f"VECTOR('',{self.direction(way)},1.)")
        line = self.add(f"LINE('',{self.point(start)},{vector})")
        ends = f"{vertices[a[0]][a[1]]},{vertices[b[0]][b[1]]}"
        edges[a, b] = self.add(f"EDGE_CURVE('',{ends},{line},.T.)")
        return self.add(f"ORIENTED_EDGE('',*,*,{edges[a, b]},.T.)")


def _normal(points):
    """Direction of the area that a plane loop encloses."""
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


def _list(references):
    return f"({','.join(references)})"


def _numbers(values):
    """Coordinates with the decimal point that STEP demands; no digits that are rounding."""
    rounded = [round(float(value), 12) + 0.0 for value in values]
    return f"({','.join(repr(value).replace('e', 'E') for value in rounded)})"
