"""Distance of the images of chords on a surface from the curve of an edge, by points along the chords.

At each point of a chord the vector to the curve is split into its part normal to the surface, which the image
does not keep, and the part along it. Between points the vector changes linearly, except for the sagitta of
the piece, and the normal turns by at most the curvature times the length.
"""

from typing import NamedTuple

import numpy as np

from proximity.formats.step.shapes import Shape

_PIECES = 8
"""Number of pieces of a chord."""


class _Points(NamedTuple):
    """Points near a surface or on a curve, for each chord and each end of a piece."""

    positions: np.ndarray  # (N, K, 3) m
    excess: np.ndarray  # (N,) m, largest distance of a piece of the curve from its chord


class _Normals(NamedTuple):
    """Normals of a surface at points."""

    normals: np.ndarray  # (N, K, 3) unit
    residuals: np.ndarray  # (N,) m, distance of the points from the surface
    curvatures: np.ndarray  # (N,) 1/m, largest near the points; infinite if unknown


def sampled_bound(surface: Shape, curve: Shape, chords: np.ndarray) -> float:
    """Return a bound of the distance of the images of chords, (N, 2, 3) m, from a curve on a surface."""
    shares = np.linspace(0.0, 1.0, _PIECES + 1)[None, :, None]
    points = (1.0 - shares) * chords[:, :1] + shares * chords[:, 1:]
    feet = _circle_feet(curve, points) if curve.kind == "circle" else _spline_feet(curve, points)
    moves = points - feet.positions
    near = _spline_normals(surface, feet) if surface.kind == "spline" else _normals(surface, feet.positions)
    along = moves - (moves * near.normals).sum(axis=2, keepdims=True) * near.normals
    reach = np.linalg.norm(moves, axis=2).max(axis=1) + feet.excess
    steps = np.linalg.norm(np.diff(feet.positions, axis=1), axis=2).max(axis=1) + 2.0 * feet.excess
    share = near.curvatures * reach
    with np.errstate(invalid="ignore"):
        own = np.linalg.norm(along, axis=2).max(axis=1) + feet.excess
        turned = reach * near.curvatures * (steps + reach / (1.0 - share))
        bounds = np.where(share < 0.5, (own + turned) / (1.0 - share) + near.residuals, np.inf)
    return float(bounds.max(initial=0.0))


def _circle_feet(curve: Shape, points: np.ndarray) -> _Points:
    offset = points - curve.origin
    flat = offset - (offset @ curve.axis)[..., None] * curve.axis
    feet = curve.origin + curve.size * flat / np.linalg.norm(flat, axis=2, keepdims=True)
    half = 0.5 * np.linalg.norm(np.diff(feet, axis=1), axis=2).max(axis=1)
    return _Points(feet, curve.size - np.sqrt(np.maximum(curve.size**2 - half * half, 0.0)))


def _spline_feet(curve: Shape, points: np.ndarray) -> _Points:
    from proximity.formats.step.spline_distance import shape_of

    assert curve.spline is not None, "a shape of the kind spline has one"
    shape = shape_of(curve.spline)
    parameters = shape.joined(shape.nearest_parameters(points.reshape(-1, 3)).reshape(*points.shape[:2], 2))
    pieces = np.stack([parameters[:, :-1], parameters[:, 1:]], axis=2).reshape(-1, 2, 2)
    excess = shape.excess(pieces).reshape(len(points), -1).max(axis=1)
    return _Points(shape.points(parameters.reshape(-1, 2)).reshape(points.shape), excess)


def _normals(surface: Shape, points: np.ndarray) -> _Normals:
    """Return the normals of a cone, a sphere or a torus."""
    offset = points - surface.origin
    height = offset @ surface.axis
    flat = offset - height[..., None] * surface.axis
    radius = np.maximum(np.linalg.norm(flat, axis=2), np.finfo(float).tiny)
    outward = flat / radius[..., None]
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=1)
    inner = np.maximum(radius.min(axis=1) - steps, 0.0)
    with np.errstate(divide="ignore"):
        curvature = 1.0 / inner
    if surface.kind == "cone":
        normals = outward - surface.second * surface.axis
        residuals = (radius - surface.size - surface.second * height) / np.hypot(1.0, surface.second)
    elif surface.kind == "sphere":
        normals, residuals = offset, np.linalg.norm(offset, axis=2) - surface.size
        curvature = np.full(len(points), 1.0 / surface.size)
    else:
        normals = (radius - surface.size)[..., None] * outward + height[..., None] * surface.axis
        residuals = np.linalg.norm(normals, axis=2) - surface.second
        curvature = np.maximum(curvature, 1.0 / surface.second)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), np.finfo(float).tiny)
    return _Normals(normals, np.abs(residuals).max(axis=1), 2.0 * curvature)


def _spline_normals(surface: Shape, feet: _Points) -> _Normals:
    """Return the normals of a spline.

    The curvature is at most the second derivatives over the square of the smallest first derivative.
    """
    from proximity.formats.step.spline_distance import shape_of

    assert surface.spline is not None, "a shape of the kind spline has one"
    shape = shape_of(surface.spline)
    points = shape.flattened(feet.positions)
    parameters = shape.joined(shape.nearest_parameters(points.reshape(-1, 3)).reshape(*points.shape[:2], 2))
    found, slopes = shape.points_and_slopes(parameters.reshape(-1, 2))
    residuals = np.linalg.norm(found.reshape(points.shape) - points, axis=2).max(axis=1)
    slopes = slopes.reshape(*points.shape[:2], 2, 3)
    if shape.direction is not None:
        slopes[:, :, 1] = shape.direction
    normals = np.cross(slopes[:, :, 0], slopes[:, :, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), np.finfo(float).tiny)
    lower, upper = parameters.min(axis=1), parameters.max(axis=1)
    uu, uv, vv = shape.second_bounds(lower, upper).T
    steps = np.abs(np.diff(parameters, axis=1)).max(axis=1)
    turns = np.stack([uu * steps[:, 0] + uv * steps[:, 1], uv * steps[:, 0] + vv * steps[:, 1]], axis=1)
    lengths = np.linalg.norm(slopes, axis=3)
    with np.errstate(divide="ignore", invalid="ignore"):
        least = lengths.min(axis=1) - turns
        cosines = np.abs((slopes[:, :, 0] * slopes[:, :, 1]).sum(axis=2) / lengths.prod(axis=2)).max(axis=1)
        apart = 1.0 - cosines - (turns / least).sum(axis=1)
        bend = uu / least[:, 0] ** 2 + 2.0 * uv / (least[:, 0] * least[:, 1]) + vv / least[:, 1] ** 2
        is_regular = (least > 0.0).all(axis=1) & (apart > 0.0) & (shape.jumps(lower, upper)[0] == 0.0)
        curvature = np.where(is_regular, 2.0 * bend / apart, np.inf)
    return _Normals(normals, residuals, curvature)
