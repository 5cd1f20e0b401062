"""Shapes of CAD surfaces and curves, in metres, and of surfaces that a curve sweeps."""

from dataclasses import dataclass, field

import numpy as np

_ALIGNED = 1e-10
"""Maximum sine between parallel directions, and distance of lines that meet as a share of coordinates."""
_TURN = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], np.float64)
"""Corners and middles of the sides of a square around a circle: its control points."""
_TURN_KNOTS = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], np.float64)


@dataclass(slots=True, eq=False)
class Spline:
    """A B-spline surface, or a curve, which is a surface of degree 0 along its second parameter."""

    degrees: tuple[int, int]
    knots: tuple[np.ndarray, np.ndarray]
    control: np.ndarray  # (m, n, 4), m, multiplied by the weights in the last column
    direction: np.ndarray | None = None  # (3,) unit; the surface is the curve moved along this perpendicular


@dataclass(slots=True, eq=False)
class Shape:
    """A surface or a curve of elementary form, or a spline."""

    kind: str  # plane, cone (or cylinder), sphere, torus, line, circle, ellipse, spline, other
    record: str  # name in the file, for messages
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # unit; direction of a line
    along: np.ndarray = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0])
    )  # unit, of the first semi-axis
    size: float = 0.0  # m, radius; major radius; first semi-axis
    second: float = 0.0  # tangent of a cone; minor radius or second semi-axis, m
    spline: Spline | None = None


def extruded(profile: Shape, direction: np.ndarray, record: str) -> Shape | None:
    """Return the surface of a curve that is moved along a unit vector; None if it is not read."""
    if profile.kind == "line":
        normal = np.cross(profile.axis, direction)
        length = float(np.linalg.norm(normal))
        return Shape("plane", record, profile.origin, normal / length) if length > _ALIGNED else None
    if profile.kind == "circle" and np.linalg.norm(np.cross(profile.axis, direction)) <= _ALIGNED:
        return Shape("cone", record, profile.origin, profile.axis, profile.along, profile.size)
    if (spline := _as_spline(profile)) is None:
        return None
    control = spline.control.copy()
    control[..., :3] -= (control[..., :3] @ direction)[..., None] * direction
    return Shape("spline", record, spline=Spline(spline.degrees, spline.knots, control, direction))


def revolved(profile: Shape, origin: np.ndarray, axis: np.ndarray, record: str) -> Shape | None:
    """Return the surface of a curve that is turned about an axis; None if it is not read."""
    offset = profile.origin - origin
    height = float(offset @ axis)
    outward = offset - height * axis
    small = _ALIGNED * float(np.linalg.norm(profile.origin) + np.linalg.norm(origin) + profile.size)
    if profile.kind == "line":
        return _revolved_line(profile, origin, axis, small, record)
    is_in_plane = (
        profile.kind == "circle"
        and abs(float(profile.axis @ axis)) <= _ALIGNED
        and abs(float(profile.axis @ offset)) <= small
    )
    middle, major = origin + height * axis, float(np.linalg.norm(outward))
    if is_in_plane and major <= small:
        return Shape("sphere", record, middle, axis, size=profile.size)
    if is_in_plane and major >= profile.size:
        return Shape("torus", record, middle, axis, size=major, second=profile.size)
    if (spline := _as_spline(profile)) is None:
        return None
    points, weights = spline.control[:, 0, :3] / spline.control[:, 0, 3:], spline.control[:, 0, 3]
    heights = (points - origin) @ axis
    middles = origin + heights[:, None] * axis
    x = points - middles
    control = _full_turn(middles, x, np.cross(axis, x)) * weights[:, None]
    return Shape(
        "spline", record, spline=Spline((2, spline.degrees[0]), (_TURN_KNOTS, spline.knots[0]), control)
    )


def _revolved_line(
    line: Shape, origin: np.ndarray, axis: np.ndarray, small: float, record: str
) -> Shape | None:
    """Return the cone, the cylinder or the plane of a line; None if it has no common plane with the axis."""
    offset = line.origin - origin
    height, rise = float(offset @ axis), float(line.axis @ axis)
    outward, run = offset - height * axis, line.axis - rise * axis
    radius, slope = float(np.linalg.norm(outward)), float(np.linalg.norm(run))
    if abs(rise) <= _ALIGNED:
        return Shape("plane", record, line.origin, axis)
    if slope <= _ALIGNED:
        return Shape("cone", record, origin, axis, size=radius) if radius > small else None
    along = run / slope
    if np.linalg.norm(np.cross(outward, along)) > small:
        return None
    # The nappe is that of the line's origin.
    sign = -1.0 if float(outward @ along) < 0.0 else 1.0
    tangent = sign * slope / rise
    return Shape("cone", record, origin + height * axis, axis, size=radius, second=tangent)


def _as_spline(curve: Shape) -> Spline | None:
    """Return a curve as a B-spline; None for a line or a curve that is not read."""
    if curve.kind in ("circle", "ellipse"):
        second = curve.size if curve.kind == "circle" else curve.second
        x, y = curve.size * curve.along, second * np.cross(curve.axis, curve.along)
        control = _full_turn(curve.origin[None], x[None], y[None])
        return Spline((2, 0), (_TURN_KNOTS, np.array([0.0, 1.0])), control)
    return curve.spline


def _full_turn(middles: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the control points of ellipses, (9, N, 4), from their middles and semi-axes, (N, 3) m."""
    corners = middles + _TURN[:, None, :1] * x + _TURN[:, None, 1:] * y
    weights = np.where(np.arange(9) % 2, np.sqrt(0.5), 1.0)[:, None, None]
    return np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2) * weights
