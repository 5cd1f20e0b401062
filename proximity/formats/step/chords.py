"""Sides of triangles at the edges of CAD faces, and bounds of their distance from the curves of the edges."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from proximity.formats.step.cad_faces import CadFace
from proximity.formats.step.shapes import Shape

Pair = tuple[np.ndarray, np.ndarray]
"""Distances of the ends of chords from curves, and bounds of the distance of the arcs between, m."""

_MAX_ANGLE = 2.0 * np.pi / 3.0
"""Maximum angle of the arc of a chord. A larger one cannot be distinguished from the rest of the circle."""
_COAXIAL = 1e-6
"""Maximum distance of a circle from a surface of revolution about its axis, as a share of its radius."""


class Chords(NamedTuple):
    """Sides of triangles between faces, with the curves that they may approximate."""

    ends: np.ndarray  # (C, 2, 3) m
    groups: np.ndarray  # (C, 2) rows of the faces on both sides; equal if there is one
    rows: np.ndarray  # (P,) chord of each pair of a chord and a curve
    curves: np.ndarray  # (P,) curve of each pair


@dataclass(slots=True, eq=False)
class Curves:
    """Curves of the edges of a solid, with the faces at each."""

    shapes: list[Shape]
    faces: list[list[int]]  # rows of the faces of each edge

    @classmethod
    def of(cls, faces: list[CadFace]) -> "Curves":
        """Return the curves of faces."""
        rows: dict[str, tuple[Shape, list[int]]] = {}
        for row, face in enumerate(faces):
            for number, shape in face.edges.items():
                rows.setdefault(number, (shape, []))[1].append(row)
        return cls([shape for shape, _ in rows.values()], [own for _, own in rows.values()])


def merged_vertices(vertices: np.ndarray) -> np.ndarray:
    """Return the row of the first vertex at the position of each vertex."""
    words = np.ascontiguousarray(vertices + 0.0).view(np.uint64)
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    mixed = (words * factors).sum(axis=1, dtype=np.uint64)
    mixed ^= mixed >> np.uint64(29)
    _, first, inverse = np.unique(mixed, return_index=True, return_inverse=True)
    rows = first[inverse.reshape(-1)]
    if (vertices[rows] != vertices).any():  # two positions with one sum
        _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
        rows = first[inverse.reshape(-1)]
    return np.asarray(rows)


def find_chords(vertices: np.ndarray, triangles: np.ndarray, groups: np.ndarray, curves: Curves) -> Chords:
    """Return the sides of triangles at the edges of faces, with the curves between the same faces.

    *groups*: (F,) face of each triangle. A side between other faces is paired with all their curves.
    """
    corners = merged_vertices(vertices)[triangles]
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    group_count = int(groups.max(initial=0)) + 1
    sides = low * np.int64(len(vertices)) + high
    is_side = low < high
    keys, counts = np.unique((sides * group_count + np.repeat(groups, 3))[is_side], return_counts=True)
    keys = keys[counts % 2 == 1]  # the others are inside a face, or at its seam
    sides, own = keys // group_count, keys % group_count
    _, starts, counts = np.unique(sides, return_index=True, return_counts=True)
    is_pair = np.repeat(counts == 2, counts)  # more than two faces at one side are taken one by one
    is_second = np.ones(len(sides), bool)
    is_second[starts] = False
    firsts = np.flatnonzero(~(is_pair & is_second))
    others = firsts + is_pair[firsts]
    pairs = np.stack([own[firsts], own[others]], axis=1).astype(np.int64)
    points = np.stack([sides[firsts] // len(vertices), sides[firsts] % len(vertices)], axis=1)
    return Chords(vertices[points], pairs, *_candidates(pairs, group_count, curves))


def _candidates(pairs: np.ndarray, group_count: int, curves: Curves) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of a chord and a curve between its faces."""
    between: dict[int, list[int]] = {}
    of_face: dict[int, list[int]] = {}
    for row, faces in enumerate(curves.faces):
        for face in faces:
            of_face.setdefault(face, []).append(row)
        if len(faces) == 2:
            between.setdefault(min(faces) * group_count + max(faces), []).append(row)
    order = np.argsort(pairs[:, 0] * group_count + pairs[:, 1], kind="stable")
    keys, starts = np.unique((pairs[:, 0] * group_count + pairs[:, 1])[order], return_index=True)
    rows, numbers = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    ends = [*starts[1:].tolist(), len(order)]
    for key, start, end in zip(keys.tolist(), starts.tolist(), ends[: len(keys)], strict=True):
        chords = order[start:end]
        first, second = divmod(key, group_count)
        found = between.get(key) or [*{*of_face.get(first, ()), *of_face.get(second, ())}]
        rows.append(np.repeat(chords, len(found)))
        numbers.append(np.tile(found, len(chords)).astype(np.int64))
    return np.concatenate(rows), np.concatenate(numbers)


def chord_bounds(shapes: list[Shape], curves: np.ndarray, chords: np.ndarray, fit: float) -> np.ndarray:
    """Return upper bounds of the distance of chords from curves and back, and inf if there is none.

    *curves*: (N,) rows of *shapes*; *chords*: (N, 2, 3) m. A chord approximates the shorter arc between its
    ends. The distance of its ends from the curve is included; if it exceeds *fit*, m, the bound is infinite.
    """
    bounds = np.full(len(chords), np.inf)
    kinds = np.array([shape.kind for shape in shapes])[curves]
    for kind, function in (("line", _line_bounds), ("circle", _circle_bounds), ("ellipse", _ellipse_bounds)):
        rows = np.flatnonzero(kinds == kind)
        if len(rows):
            residual, sagitta = function([shapes[curve] for curve in curves[rows]], chords[rows])
            bounds[rows] = np.where(residual <= fit, residual + sagitta, np.inf)
    splines = np.flatnonzero(kinds == "spline")
    if len(splines):
        try:
            from proximity.formats.step import spline_distance
        except ImportError:  # without SciPy there is no bound
            return bounds
        for curve in np.unique(curves[splines]):
            rows = splines[curves[splines] == curve]
            spline = shapes[curve].spline
            assert spline is not None, "a shape of the kind spline has one"
            shape = spline_distance.shape_of(spline)
            bounds[rows] = spline_distance.chord_bounds(shape, chords[rows], fit)
    return bounds


def _columns(shapes: list[Shape], *names: str) -> list[np.ndarray]:
    return [np.array([getattr(shape, name) for shape in shapes]) for name in names]


def _line_bounds(shapes: list[Shape], chords: np.ndarray) -> Pair:
    origin, axis = (column[:, None] for column in _columns(shapes, "origin", "axis"))
    offset = chords - origin
    across = offset - (offset * axis).sum(axis=2, keepdims=True) * axis
    return np.linalg.norm(across, axis=2).max(axis=1), np.zeros(len(chords))


def _circle_bounds(shapes: list[Shape], chords: np.ndarray) -> Pair:
    origin, axis, size = _columns(shapes, "origin", "axis", "size")
    offset = chords - origin[:, None]
    height = (offset * axis[:, None]).sum(axis=2)
    radius = np.linalg.norm(offset - height[..., None] * axis[:, None], axis=2)
    residual = np.hypot(radius - size[:, None], height).max(axis=1)
    half = 0.5 * np.linalg.norm(chords[:, 1] - chords[:, 0], axis=1) + residual
    sagitta = half * half / (size + np.sqrt(np.maximum(size * size - half * half, 0.0)))
    return residual, np.where(half <= np.sin(_MAX_ANGLE / 2.0) * size, sagitta, np.inf)


def _ellipse_bounds(shapes: list[Shape], chords: np.ndarray) -> Pair:
    origin, axis, along, first, second = _columns(shapes, "origin", "axis", "along", "size", "second")
    across = np.cross(axis, along)
    offset = chords - origin[:, None]
    x, y = (offset * along[:, None]).sum(axis=2), (offset * across[:, None]).sum(axis=2)
    height = (offset * axis[:, None]).sum(axis=2)
    first, second = first[:, None], second[:, None]
    angle = np.arctan2(y / second, x / first)
    for _ in range(3):  # Newton steps to the nearest point; any angle gives a bound
        cosine, sine = np.cos(angle), np.sin(angle)
        slope = (first * cosine - x) * -first * sine + (second * sine - y) * second * cosine
        bend = (first * sine) ** 2 + (second * cosine) ** 2
        angle = angle - slope / bend
    residual = np.hypot(np.hypot(first * np.cos(angle) - x, second * np.sin(angle) - y), height).max(axis=1)
    turn = np.abs(angle[:, 1] - angle[:, 0]) % (2.0 * np.pi)
    turn = np.minimum(turn, 2.0 * np.pi - turn)
    # The second derivative at an angle is as long as the semi-diameter there.
    most = np.maximum(first, second)[:, 0]
    reach = np.minimum(
        most, np.hypot(first * np.cos(angle), second * np.sin(angle)).max(axis=1) + most * turn / 2
    )
    return residual, np.where(turn <= _MAX_ANGLE, reach * turn * turn / 8.0, np.inf)


def lateral_bound(surface: Shape, curve: Shape, sagitta: float, depth: float, chords: np.ndarray) -> float:
    """Return a bound of the distance of the images of chords on a surface from the curve of an edge, m.

    *sagitta*: of `chord_bounds`; *depth*: largest distance of the chords from the surface, m; *chords*:
    (N, 2, 3) m. In general the image is no farther from the chord than its depth, and than its curve. Points
    of a chord of a circle about the axis of a surface stay in their plane through the axis, so that only the
    part of the sagitta along the surface counts. Otherwise that part is measured at points of the chords.
    """
    bound = sagitta + min(sagitta, depth)
    share = _share_along(surface, curve, sagitta)
    if share is not None:
        return min(bound, share[0] * sagitta + share[1])
    if curve.kind in ("circle", "spline"):
        from proximity.formats.step import lateral  # for few edges

        return min(bound, lateral.sampled_bound(surface, curve, chords))
    return bound


def radial_bound(surface: Shape, curve: Shape, sagitta: float) -> float:
    """Return the bound of `lateral_bound` for images perpendicular to the axis of a cone, or infinity.

    These images of a chord are on its generator, or on its circle about the axis.
    """
    if surface.kind != "cone" or curve.kind not in ("line", "circle"):
        return np.inf
    if curve.kind == "line":
        return 2.0 * sagitta
    share = _share_along(surface, curve, sagitta)
    is_coaxial = share is not None and abs(float(curve.axis @ surface.axis)) > 1.0 - _COAXIAL
    return share[1] if share is not None and is_coaxial else np.inf


def _share_along(surface: Shape, curve: Shape, sagitta: float) -> tuple[float, float] | None:
    """Return the share of the sagitta along a surface, and the distance from a circle about its axis, m."""
    if surface.kind == "plane":
        return 1.0, 0.0
    if curve.kind not in ("circle", "ellipse"):
        return None
    offset = curve.origin - surface.origin
    if surface.kind == "sphere":
        height = abs(float(offset @ curve.axis))
        apart = float(np.linalg.norm(offset - (offset @ curve.axis) * curve.axis))
        if curve.kind != "circle" or surface.size <= sagitta or apart > _COAXIAL * surface.size:
            return None
        return height / (surface.size - sagitta), apart
    along = float(offset @ surface.axis)
    apart = float(np.linalg.norm(offset - along * surface.axis))
    cosine = abs(float(curve.axis @ surface.axis))
    sine = float(np.linalg.norm(np.cross(curve.axis, surface.axis)))
    if surface.kind == "cone" and surface.second == 0.0 and cosine > 0.1:
        return sine / cosine, 0.0  # in its plane, a chord moves along the cylinder as much
    if curve.kind != "circle":
        return None
    error = apart + sine * curve.size
    if error <= _COAXIAL * curve.size:
        if surface.kind == "cone":
            return abs(surface.second) / float(np.hypot(1.0, surface.second)), error
        if surface.kind == "torus" and surface.second > sagitta:
            return min(abs(along) / (surface.second - sagitta), 1.0), error
    elif surface.kind == "torus" and apart > 0.0:
        # A circle of the tube: its plane contains the axis, and its middle is on the circle of middles.
        outward = (offset - along * surface.axis) / apart
        error = (
            abs(along)
            + abs(apart - surface.size)
            + curve.size * float(np.hypot(curve.axis @ surface.axis, curve.axis @ outward))
        )
        if error <= _COAXIAL * curve.size and abs(curve.size - surface.second) <= _COAXIAL * curve.size:
            return 0.0, error + abs(curve.size - surface.second)
    return None
