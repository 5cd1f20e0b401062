"""CAD faces of the solids in a STEP file: their surfaces and edges, in metres.

A surface or curve that is not read has the kind "other": its faces have no bound.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.step.entities import Arguments, Entities
from proximity.formats.step.shapes import Shape, Spline, extruded, revolved
from proximity.formats.step.step_records import StepText

_BODIES = ("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "SHELL_BASED_SURFACE_MODEL", "FACETED_BREP")
_FACES = ("ADVANCED_FACE", "FACE_SURFACE")
_WRAPPERS = {
    "SURFACE_CURVE": 1,
    "SEAM_CURVE": 1,
    "INTERSECTION_CURVE": 1,
    "TRIMMED_CURVE": 1,
    "RECTANGULAR_TRIMMED_SURFACE": 1,
}
"""Records that contain a curve or a surface, with the position of that argument."""
_PREFIXES = {
    None: 1.0, ".DECI.": 1e-1, ".CENTI.": 1e-2, ".MILLI.": 1e-3, ".MICRO.": 1e-6, ".NANO.": 1e-9,
    ".KILO.": 1e3,
}  # fmt: skip
_DEFAULT_METRES = 1e-3
_DEPTH = 20
"""Maximum number of nested units, wrappers or shells."""


@dataclass(slots=True, eq=False)
class CadFace:
    """A face of a solid, and its edges by their numbers in the file."""

    number: str  # "#12"
    surface: Shape
    edges: dict[str, Shape]  # without seams
    is_bounded: bool  # whether the face has edges


@dataclass(slots=True, eq=False)
class CadBody:
    """Faces of a solid, or of all solids of one representation, in the order of the file."""

    faces: list[CadFace]


def read_bodies(text: StepText) -> list[list[CadBody]]:
    """Return the solids of each representation of a file, in metres."""
    entities = Entities(text)
    representations = []
    for record in text.records(r"\w*SHAPE_REPRESENTATION"):
        bodies = [item for item in record.references[:-1] if entities.kind(item) in _BODIES]
        if bodies:
            reader = _Reader(entities, *_units(entities, record.references[-1]))
            representations.append([CadBody(reader.faces(body)) for body in bodies])
    return representations


def _units(entities: Entities, context: str) -> tuple[float, float]:
    """Return the units of length and angle in a context, in metres and radians."""
    metres, radians = _DEFAULT_METRES, 1.0
    (units,) = entities.record(context).get("GLOBAL_UNIT_ASSIGNED_CONTEXT", [[]])[:1]
    for unit in units or []:
        record = entities.record(unit)
        if "LENGTH_UNIT" in record:
            metres = _factor(entities, unit, ".METRE.")
        elif "PLANE_ANGLE_UNIT" in record:
            radians = _factor(entities, unit, ".RADIAN.")
    return metres, radians


def _factor(entities: Entities, unit: Any, base: str, depth: int = 0) -> float:
    record = entities.record(unit)
    if "SI_UNIT" in record:
        prefix, name = record["SI_UNIT"][:2]
        if name == base and prefix in _PREFIXES:
            return _PREFIXES[prefix]
    elif "CONVERSION_BASED_UNIT" in record and depth < _DEPTH:
        measure = entities.record(record["CONVERSION_BASED_UNIT"][1])
        for value, smaller in (arguments[:2] for arguments in measure.values() if len(arguments) > 1):
            number = value[0] if isinstance(value, list) else value
            return float(number) * _factor(entities, smaller, base, depth + 1)
    raise MeshFormatError(f"unit {unit} is not read")


class _Reader:
    """Reads the faces of bodies in one unit."""

    def __init__(self, entities: Entities, metres: float, radians: float) -> None:
        self.entities, self.metres, self.radians = entities, metres, radians
        self._curves: dict[str, Shape] = {}

    def faces(self, body: str) -> list[CadFace]:
        """Return the faces of a body in the order of the file."""
        numbers: list[str] = []
        self._collect(body, numbers, 0)
        return [self._face(number) for number in numbers]

    def _collect(self, number: Any, found: list[str], depth: int) -> None:
        """Append the numbers of the faces below a body or a shell."""
        kind = self.entities.kind(number)
        if depth > _DEPTH:
            raise MeshFormatError(f"record {number} is part of itself")
        if kind in ("CLOSED_SHELL", "OPEN_SHELL"):
            found += self.entities.record(number)[kind][1]
            return
        for argument in self.entities.record(number)[kind]:
            for item in argument if isinstance(argument, list) else [argument]:
                if isinstance(item, str) and item.startswith("#"):
                    self._collect(item, found, depth + 1)

    def _face(self, number: str) -> CadFace:
        kind = self.entities.kind(number)
        if kind not in _FACES:
            return CadFace(number, Shape("other", kind), {}, True)
        _, bounds, surface = self.entities.record(number)[kind][:3]
        counts: Counter[str] = Counter()
        is_bounded = False
        for bound in bounds:
            loop = self.entities.arguments(bound, "FACE_BOUND", "FACE_OUTER_BOUND")[1]
            if self.entities.kind(loop) == "VERTEX_LOOP":
                continue
            is_bounded = True
            for oriented in self.entities.arguments(loop, "EDGE_LOOP")[1]:
                counts[self.entities.arguments(oriented, "ORIENTED_EDGE")[3]] += 1
        edges = {edge: self._edge(edge) for edge, count in counts.items() if count == 1}
        return CadFace(number, self._shape(surface), edges, is_bounded)

    def _edge(self, number: str) -> Shape:
        if number not in self._curves:
            curve = self.entities.arguments(number, "EDGE_CURVE")[3]
            self._curves[number] = self._shape(curve)
        return self._curves[number]

    def _shape(self, number: Any, depth: int = 0) -> Shape:
        """Return a surface or a curve."""
        record = self.entities.record(number)
        kind = self.entities.kind(number)
        if kind in _WRAPPERS and depth < _DEPTH:
            return self._shape(record[kind][_WRAPPERS[kind]], depth + 1)
        if any("B_SPLINE" in name for name in record):
            shown = "B_SPLINE_CURVE" if any("CURVE" in name for name in record) else "B_SPLINE_SURFACE"
            spline = _spline(self.entities, record, self.metres)
            return Shape("other" if spline is None else "spline", shown, spline=spline)
        read = getattr(self, f"_{kind.lower()}", None)
        shape: Shape | None = None if read is None else read(record[kind])
        return Shape("other", kind) if shape is None else shape

    def _placed(
        self, kind: str, record: str, placement: Any, size: float = 0.0, second: float = 0.0
    ) -> Shape:
        origin, axis, along = self._placement(placement)
        return Shape(kind, record, origin, axis, along, size, second)

    def _placement(self, number: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the origin, the axis and the first direction of a placement."""
        _, location, axis, along = (
            *self.entities.arguments(number, "AXIS2_PLACEMENT_3D", "AXIS1_PLACEMENT"), None, None,
        )[:4]  # fmt: skip
        z = _unit(self.entities.vector(axis)) if axis else np.array([0.0, 0.0, 1.0])
        x = self.entities.vector(along) if along else np.eye(3)[0]
        x = x - (x @ z) * z
        if np.linalg.norm(x) < 1e-9:
            x = np.eye(3)[int(np.abs(z).argmin())]
            x = x - (x @ z) * z
        return self.entities.vector(location) * self.metres, z, _unit(x)

    def _plane(self, arguments: Arguments) -> Shape:
        return self._placed("plane", "PLANE", arguments[1])

    def _cylindrical_surface(self, arguments: Arguments) -> Shape:
        return self._placed("cone", "CYLINDRICAL_SURFACE", arguments[1], arguments[2] * self.metres)

    def _conical_surface(self, arguments: Arguments) -> Shape:
        tangent = math.tan(arguments[3] * self.radians)
        return self._placed("cone", "CONICAL_SURFACE", arguments[1], arguments[2] * self.metres, tangent)

    def _spherical_surface(self, arguments: Arguments) -> Shape:
        return self._placed("sphere", "SPHERICAL_SURFACE", arguments[1], arguments[2] * self.metres)

    def _toroidal_surface(self, arguments: Arguments) -> Shape:
        radii = arguments[2] * self.metres, arguments[3] * self.metres
        return self._placed("torus", "TOROIDAL_SURFACE", arguments[1], *radii)

    def _degenerate_toroidal_surface(self, arguments: Arguments) -> Shape | None:
        return self._toroidal_surface(arguments) if arguments[4] == ".T." else None  # .F. is the inner part

    def _surface_of_linear_extrusion(self, arguments: Arguments) -> Shape | None:
        vector = self.entities.arguments(arguments[2], "VECTOR")[1]
        direction = _unit(self.entities.vector(vector))
        return extruded(self._shape(arguments[1]), direction, "SURFACE_OF_LINEAR_EXTRUSION")

    def _surface_of_revolution(self, arguments: Arguments) -> Shape | None:
        origin, axis, _ = self._placement(arguments[2])
        return revolved(self._shape(arguments[1]), origin, axis, "SURFACE_OF_REVOLUTION")

    def _line(self, arguments: Arguments) -> Shape:
        direction = self.entities.arguments(arguments[2], "VECTOR")[1]
        axis = _unit(self.entities.vector(direction))
        return Shape("line", "LINE", self.entities.vector(arguments[1]) * self.metres, axis)

    def _circle(self, arguments: Arguments) -> Shape:
        return self._placed("circle", "CIRCLE", arguments[1], arguments[2] * self.metres)

    def _ellipse(self, arguments: Arguments) -> Shape:
        axes = arguments[2] * self.metres, arguments[3] * self.metres
        return self._placed("ellipse", "ELLIPSE", arguments[1], *axes)


def _unit(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < math.inf:
        raise MeshFormatError(f"a direction is {vector.tolist()}, expected a finite one that is not 0")
    return vector / length


def _spline(entities: Entities, record: dict[str, Arguments], metres: float) -> Spline | None:
    """Return a B-spline, or None if its knots are not listed."""
    name = "B_SPLINE_SURFACE" if any("SURFACE" in part for part in record) else "B_SPLINE_CURVE"
    if f"{name}_WITH_KNOTS" not in record:
        return None
    count = 2 if name == "B_SPLINE_SURFACE" else 1
    knotted, is_simple = record[f"{name}_WITH_KNOTS"], name not in record
    # A simple record has the name and all arguments; a complex one has those of each type.
    shape = knotted[1:] if is_simple else record[name]
    knotted = knotted[4 + 2 * count :] if is_simple else knotted
    rows = shape[count] if count == 2 else [[point] for point in shape[count]]
    net = np.array([[entities.vector(point) * metres for point in row] for row in rows])
    (weights,) = record.get(f"RATIONAL_{name}", [None])[:1]
    scale = (
        np.ones(net.shape[:2]) if weights is None else np.array(weights, np.float64).reshape(net.shape[:2])
    )
    pairs = zip(knotted[:count], knotted[count : 2 * count], strict=True)
    knots = [np.repeat(np.array(values, np.float64), np.array(counts, np.int64)) for counts, values in pairs]
    degrees = [int(degree) for degree in shape[:count]]
    if count == 1:
        degrees, knots = [*degrees, 0], [*knots, np.array([0.0, 1.0])]
    control = np.concatenate([net * scale[..., None], scale[..., None]], axis=2)
    spline = Spline((degrees[0], degrees[1]), (knots[0], knots[1]), control)
    return spline if _is_sound(spline) else None


def _is_sound(spline: Spline) -> bool:
    """Return whether knots, degrees and control points fit together, and weights are positive."""
    counts = (len(knots) - degree - 1 for knots, degree in zip(spline.knots, spline.degrees, strict=True))
    return (
        tuple(counts) == spline.control.shape[:2]
        and all((np.diff(knots) >= 0.0).all() for knots in spline.knots)
        and bool(np.isfinite(spline.control).all())
        and bool((spline.control[..., 3] > 0.0).all())
    )
