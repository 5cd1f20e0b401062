"""STEP files for tests, written by formula: boxes with flat faces, in any unit."""

import itertools

import numpy as np

_UNITS = {
    "mm": "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )",
    "m": "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) )",
    "in": "( CONVERSION_BASED_UNIT('INCH',{inch}) LENGTH_UNIT() NAMED_UNIT({dimensions}) )",
}


class _Lines:
    """Entities in order of their numbers."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1} = {text};")
        return f"#{len(self.lines)}"


def box_step(size: tuple[float, float, float], unit: str | None = "mm", name: str = "box") -> str:
    """Return a STEP file with one solid box from the origin to *size*, in *unit* (None: undeclared)."""
    out = _Lines()
    context = _context(out, unit)
    shell = _shell(out, np.array(size, dtype=float))
    frame = _frame(out, (0, 0, 0), (0, 0, 1), (1, 0, 0))
    return _file(out, context, frame, shell, name)


def _file(out: _Lines, context: str, frame: str, shell: str, name: str) -> str:
    """A file of one product with one solid."""
    solid = out.add(f"MANIFOLD_SOLID_BREP('{name}',{shell})")
    shape = out.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('{name}',({frame},{solid}),{context})")
    application = out.add("APPLICATION_CONTEXT('automotive design')")
    product_context = out.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = out.add(f"PRODUCT('{name}','{name}','',({product_context}))")
    formation = out.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = out.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    definition = out.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
    of_shape = out.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    out.add(f"SHAPE_DEFINITION_REPRESENTATION({of_shape},{shape})")
    header = (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
    )
    return header + "\n".join(out.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def _context(out: _Lines, unit: str | None) -> str:
    if unit is None:
        return out.add("( GEOMETRIC_REPRESENTATION_CONTEXT(3) REPRESENTATION_CONTEXT('','') )")
    inch = dimensions = ""
    if unit == "in":
        metre = out.add(_UNITS["m"])
        inch = out.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.0254),{metre})")
        dimensions = out.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
    length = out.add(_UNITS[unit].format(inch=inch, dimensions=dimensions))
    angle = out.add("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid_angle = out.add("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    return out.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle})) REPRESENTATION_CONTEXT('','') )"
    )


def _triple(values) -> str:
    return "(" + ",".join(repr(float(value)) for value in values) + ")"


def _direction(out: _Lines, values) -> str:
    return out.add(f"DIRECTION('',{_triple(values)})")


def _point(out: _Lines, values) -> str:
    return out.add(f"CARTESIAN_POINT('',{_triple(values)})")


def _frame(out: _Lines, origin, axis, along) -> str:
    parts = (_point(out, origin), _direction(out, axis), _direction(out, along))
    return out.add(f"AXIS2_PLACEMENT_3D('',{','.join(parts)})")


def _shell(out: _Lines, size: np.ndarray) -> str:
    corners = {c: np.array(c) * size for c in itertools.product((0, 1), repeat=3)}
    vertices = {c: out.add(f"VERTEX_POINT('',{_point(out, corners[c])})") for c in corners}
    edges: dict[tuple, str] = {}
    for a, b in itertools.combinations(corners, 2):
        if sum(abs(p - q) for p, q in zip(a, b, strict=True)) == 1:
            way = corners[b] - corners[a]
            length = float(np.linalg.norm(way))
            vector = out.add(f"VECTOR('',{_direction(out, way / length)},{length!r})")
            line = out.add(f"LINE('',{_point(out, corners[a])},{vector})")
            edges[a, b] = out.add(f"EDGE_CURVE('',{vertices[a]},{vertices[b]},{line},.T.)")
    faces = []
    for axis, side in itertools.product(range(3), (0, 1)):
        ring = _ring(axis, side)
        oriented = []
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            forward = (a, b) in edges
            edge = edges[a, b] if forward else edges[b, a]
            oriented.append(out.add(f"ORIENTED_EDGE('',*,*,{edge},.{'T' if forward else 'F'}.)"))
        loop = out.add(f"EDGE_LOOP('',({','.join(oriented)}))")
        bound = out.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        normal, along = np.zeros(3), np.zeros(3)
        normal[axis], along[(axis + 1) % 3] = 2 * side - 1, 1
        plane = out.add(f"PLANE('',{_frame(out, corners[ring[0]], normal, along)})")
        faces.append(out.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    return out.add(f"CLOSED_SHELL('',({','.join(faces)}))")


def _ring(axis: int, side: int) -> list[tuple[int, ...]]:
    """Corners of one side of the cube, counter-clockwise seen from outside."""
    ring = []
    for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
        corner = [0, 0, 0]
        corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = side, u, v
        ring.append(tuple(corner))
    return ring if side else ring[::-1]


def ball_step(radius: float, product: str = "ball") -> str:
    """Return a STEP file with one ball of that *radius*, mm, around the origin."""
    out = _Lines()
    context = _context(out, "mm")
    frame = _frame(out, (0, 0, 0), (0, 0, 1), (1, 0, 0))
    vertex = out.add(f"VERTEX_POINT('',{_point(out, (0, 0, -radius))})")
    loop = out.add(f"VERTEX_LOOP('',{vertex})")
    bound = out.add(f"FACE_BOUND('',{loop},.T.)")
    surface = out.add(f"SPHERICAL_SURFACE('',{frame},{float(radius)!r})")
    face = out.add(f"ADVANCED_FACE('',({bound}),{surface},.T.)")
    shell = out.add(f"CLOSED_SHELL('',({face}))")
    return _file(out, context, frame, shell, product)


def vase_step(profile: list[tuple[float, float]]) -> str:
    """Return a STEP file with a vase: a cubic Bézier curve turned about z, with flat ends.

    *profile*: four control points, distance from the axis and height, mm.
    """
    out = _Lines()
    context = _context(out, "mm")
    frame = _frame(out, (0, 0, 0), (0, 0, 1), (1, 0, 0))
    points = [_point(out, (radius, 0, height)) for radius, height in profile]
    curve = out.add(
        f"B_SPLINE_CURVE_WITH_KNOTS('',3,({','.join(points)}),.UNSPECIFIED.,.F.,.F.,(4,4),(0.,1.),.UNSPECIFIED.)"
    )
    ends = [out.add(f"VERTEX_POINT('',{points[row]})") for row in (0, 3)]
    seam = out.add(f"EDGE_CURVE('',{ends[0]},{ends[1]},{curve},.T.)")
    rings, faces = [], []
    for end, (radius, height), axis in zip(ends, (profile[0], profile[3]), (-1, 1), strict=True):
        middle = _frame(out, (0, 0, height), (0, 0, 1), (1, 0, 0))
        circle = out.add(f"CIRCLE('',{middle},{float(radius)!r})")
        rings.append(out.add(f"EDGE_CURVE('',{end},{end},{circle},.T.)"))
        plane = out.add(f"PLANE('',{_frame(out, (0, 0, height), (0, 0, axis), (1, 0, 0))})")
        faces.append(_face(out, [(rings[-1], axis > 0)], plane))
    line = out.add(f"AXIS1_PLACEMENT('',{_point(out, (0, 0, 0))},{_direction(out, (0, 0, 1))})")
    turned = out.add(f"SURFACE_OF_REVOLUTION('',{curve},{line})")
    faces.append(_face(out, [(rings[0], True), (seam, True), (rings[1], False), (seam, False)], turned))
    shell = out.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    return _file(out, context, frame, shell, "vase")


def _face(out: _Lines, edges: list[tuple[str, bool]], surface: str) -> str:
    """A face with one loop of edges, each with whether it is forward."""
    oriented = [
        out.add(f"ORIENTED_EDGE('',*,*,{edge},.{'T' if is_forward else 'F'}.)") for edge, is_forward in edges
    ]
    loop = out.add(f"EDGE_LOOP('',({','.join(oriented)}))")
    bound = out.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
    return out.add(f"ADVANCED_FACE('',({bound}),{surface},.T.)")
