"""Wall thickness at points of a part, along the inward normal and by the largest inscribed ball.

The balls that touch the surface at a point p with outward normal n, from inside, contain each other. A
surface point q with depth h = n (p - q) below the tangent plane limits their radius to |p - q|^2 / 2 h. The
ball shrinks to this limit for the surface point nearest to its center, until no surface point is inside.
"""

from math import inf
from typing import Any, NamedTuple

import numpy as np

from proximity.checks import as_points, not_negative
from proximity.errors import ArgumentError, NotWatertightError
from proximity.scene.queries.html_table import html_table
from proximity.scene.queries.results import NO_FACE
from proximity.scene.solid import Solid

TOLERANCE = 1e-6
"""Relative, between the bounds of the diameter of a ball."""
MIN_TOLERANCE = 1e-9
ROUNDING = 4e-15
"""Error of a position, as a share of the largest coordinate."""
DISTANCE_ROUNDING = 1e-12
"""Relative error of a distance, in addition."""
START = 1e-12
"""Distance before the surface at which a ray begins, as a share of the largest coordinate."""
SHIFT = 1e-9
"""Share of the distance to the middle of the face by which a ray on an edge is shifted."""
MAX_STEPS = 200


class Thickness(NamedTuple):
    """The thickness of a part at points of its surface, in the scene's frame; S is the shape of the points.

    ``ray`` is the length of the material from ``point``, against ``normal``, to ``opposite``; inf if it does
    not end. The largest ball that touches the surface at ``point`` from inside has a diameter between
    ``lower`` and ``upper``; ``center`` is the center of the one with the diameter ``lower``. ``face_id`` is
    the row of the part's faces. A point without an answer has nan and `NO_FACE`.
    """

    ray: np.ndarray  # S, m, from point along the inward normal to where the material ends; inf: no end
    lower: np.ndarray  # S, m, lower bound of the diameter of the largest ball
    upper: np.ndarray  # S, m, upper bound of that diameter
    point: np.ndarray  # S + (3,), m, point of the surface nearest to the given one
    normal: np.ndarray  # S + (3,), unit, outward normal of the face of point
    opposite: np.ndarray  # S + (3,), m, end of the ray
    center: np.ndarray  # S + (3,), m, center of the ball with the diameter lower
    face_id: np.ndarray  # S int32, row of the part's faces

    def _repr_html_(self) -> str:
        shape = np.shape(self.ray)
        rows = ([", ".join(map(str, at)), *(each[at] for each in self)] for at in np.ndindex(shape))
        return html_table("Thickness", ("", *self._fields), rows, int(np.prod(shape)))


class RayEnds(NamedTuple):
    """Ends of rays through the material; nan for a ray that does not enter it, inf for one without an end."""

    length: np.ndarray  # (N,) m
    point: np.ndarray  # (N, 3) m
    normal: np.ndarray  # (N, 3) outward normal of the face where the ray leaves


class ThicknessQueries:
    """Query of a scene about the thickness of its parts."""

    part: Any
    parts: Any

    def thickness(
        self,
        points: Any,
        *,
        part: str | int | None = None,
        tolerance: float = TOLERANCE,
        workers: int = 1,
    ) -> Thickness:
        """Return the thickness of a part at points of its surface, by ray and by inscribed ball.

        Parameters
        ----------
        points : (..., 3) float64, m, scene's frame
            Each is replaced by the nearest point of the part's surface. A row that is not finite answers nan.
        part : str or int
            Name or index of the part, hidden or not; may be omitted if the scene has one part.
        tolerance : float
            Relative difference allowed between the bounds of the ball's diameter.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        Thickness
            Arrays of the leading shape of *points*.

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), *tolerance* is out of range, or *part* is omitted
            and the scene has several.
        SceneError
            If the part does not exist.
        NotWatertightError
            If the part has no inside.

        Notes
        -----
        On the surface: on an edge, the normal is that of one of its faces.
        Degenerate: the ball shrinks to 0 towards each convex edge, also between the triangles of a round
        surface, since the face beyond the edge limits it. The ray has no such limit. A surface that enters
        the ball by less than 1e-12 of its size is not noticed. Surfaces of bodies that overlap limit the
        ball; the ray ends where it has left all of them. A ray on a convex edge is shifted into its face by
        1e-9.
        Cost: 10 to 30 µs a point.
        Source: shrinking ball, Ma, Bae, Choi 2012, "3D medial axis point approximation using nearest
        neighbors and the normal field"; ray and sphere, Inui, Umezu, Wakasaki, Sato 2015, "Thickness and
        clearance visualization based on distance field of 3D objects".
        """
        share = max(not_negative("tolerance", tolerance, "shares"), MIN_TOLERANCE)
        given: np.ndarray = as_points(points)
        if part is None and len(self.parts) > 1:
            raise ArgumentError(f"part is None, expected one of the {len(self.parts)} parts of the scene")
        chosen = self.part(0 if part is None else part)
        pose = chosen.pose
        rows = given.reshape(-1, 3)
        rows = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, np.nan)
        found = measure(chosen.solid, pose.inverse.point(rows), share, workers)
        shape = given.shape[:-1]
        moved = found._replace(
            normal=pose.direction(found.normal),
            **{name: pose.point(getattr(found, name)) for name in ("point", "opposite", "center")},
        )
        fields = [each.reshape((*shape, *each.shape[1:])) for each in moved]
        for each in fields:
            each.flags.writeable = False
        return Thickness(*(each if each.ndim else each[()] for each in fields))


def require_inside(solid: Solid) -> None:
    """Raise an error for a part without an inside, which has no thickness."""
    if not solid.has_inside:
        raise NotWatertightError(f"part {solid.name!r} has no thickness: {solid.sign_reason}")


def largest_coordinate(solid: Solid) -> float:
    """Return the largest absolute coordinate of a part, m, to which rounding errors are relative."""
    return float(np.abs(np.stack(solid.bounds)).max())


def _crossed(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def face_areas(corners: np.ndarray) -> np.ndarray:
    """Return the areas of triangles, (N, 3, 3)."""
    return np.asarray(0.5 * np.linalg.norm(_crossed(corners), axis=1))


def face_normals(corners: np.ndarray) -> np.ndarray:
    """Return the unit normals of triangles, (N, 3, 3); nan without an area."""
    crossed = _crossed(corners)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals: np.ndarray = crossed / np.linalg.norm(crossed, axis=1, keepdims=True)
    return normals


def measure(solid: Solid, points: np.ndarray, tolerance: float, workers: int) -> Thickness:
    """Return the thickness at points, (N, 3), in the part's frame."""
    require_inside(solid)
    hit = solid.closest(points, workers=workers)
    known = np.flatnonzero(hit.face_id != NO_FACE)
    position, corners = hit.point[known], solid.mesh.vertices[solid.mesh.faces[hit.face_id[known]]]
    normals = face_normals(corners)
    is_flat = np.isnan(normals[:, 0])
    normals[is_flat] = hit.gradient[known][is_flat]  # of the edge or corner nearest to the point
    ends = ends_of_rays(solid, position, normals, workers)
    shifted = np.flatnonzero(np.isnan(ends.length))
    if len(shifted):
        # A ray on an edge may pass beside the part; it begins within the face.
        step = corners[shifted].mean(axis=1) - position[shifted]
        least = 16.0 * START * largest_coordinate(solid) / np.maximum(np.linalg.norm(step, axis=1), 1e-300)
        share = np.minimum(np.maximum(least, SHIFT), 1.0)[:, None]
        again = ends_of_rays(solid, position[shifted] + share * step, normals[shifted], workers)
        for all_rows, rows in zip(ends, again, strict=True):
            all_rows[shifted] = rows
    lower, upper = _ball_bounds(solid, position, normals, ends.point, tolerance, workers)
    no_entry = np.isnan(ends.length)
    lower[no_entry] = upper[no_entry] = np.nan
    center = position - 0.5 * lower[:, None] * normals

    def spread(values: np.ndarray) -> np.ndarray:
        rows = np.full((len(points), *values.shape[1:]), np.nan)
        rows[known] = values
        return rows

    fields = ends.length, lower, upper, position, normals, ends.point, center
    return Thickness._make([*map(spread, fields), np.array(hit.face_id)])


def ends_of_rays(solid: Solid, points: np.ndarray, normals: np.ndarray, workers: int) -> RayEnds:
    """Return where rays from surface points, (N, 3), against their normals leave the material."""
    count = len(points)
    length, end, normal = np.full(count, np.nan), np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    start = START * largest_coordinate(solid)
    aimed = np.flatnonzero(np.abs(normals).sum(axis=1) > 0.0)  # nan fails
    origins = points[aimed] + start * normals[aimed]
    rays = solid.cast_all(origins, -normals[aimed], min_distance=0.5 * start, workers=workers)
    first, distance = rays.offsets[:-1], rays.distance
    has_any = np.diff(rays.offsets) > 0
    enters = np.zeros(len(aimed), bool)
    at_first = first[has_any]
    enters[has_any] = rays.is_entering[at_first] & (distance[at_first] < 1.5 * start)
    length[aimed[enters]] = inf
    # The ray has left all bodies at the first crossing with as many exits as entries.
    depth = np.concatenate([[0], np.cumsum(np.where(rays.is_entering, 1, -1))])
    of_ray = rays.ray
    is_out = (depth[1:] == depth[first][of_ray]) & enters[of_ray]
    rows, chosen = np.unique(of_ray[is_out], return_index=True)
    chosen = np.flatnonzero(is_out)[chosen]
    length[aimed[rows]] = np.maximum(distance[chosen] - start, 0.0)
    end[aimed[rows]], normal[aimed[rows]] = rays.point[chosen], rays.normal[chosen]
    return RayEnds(length, end, normal)


def _ball_bounds(
    solid: Solid, points: np.ndarray, normals: np.ndarray, ends: np.ndarray, tolerance: float, workers: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds of the diameters of the largest balls that touch the surface at *points* from inside.

    *ends*: (N, 3), another surface point for each, or nan. Every upper bound belongs to a surface point. A
    lower bound belongs to a ball whose center is not nearer to the surface than its radius, within rounding.
    """
    lower_corner, upper_corner = solid.bounds
    widest = 0.5 * float((upper_corner - lower_corner).min()) * (1.0 + DISTANCE_ROUNDING)
    rounding = ROUNDING * largest_coordinate(solid)
    upper = np.fmin(_radius_limit(points, normals, ends, rounding), widest)
    lower, trial = np.zeros(len(points)), upper * (1.0 - 0.5 * tolerance)
    margin = np.full(len(points), 0.5 * tolerance)
    rows = np.flatnonzero(trial > 0.0)  # nan fails
    for _ in range(MAX_STEPS):
        if not len(rows):
            break
        radius, position, normal = trial[rows], points[rows], normals[rows]
        hit = solid.closest(position - radius[:, None] * normal, max_distance=radius, workers=workers)
        distance = np.abs(hit.signed_distance)  # inf: no surface is within the radius
        limit = _radius_limit(position, normal, hit.point, rounding)
        upper[rows] = np.fmin(upper[rows], limit)
        error = DISTANCE_ROUNDING * radius + rounding
        is_free = (distance >= radius - error) & ~(limit < radius)
        lower[rows[is_free]] = np.maximum(radius - 2.0 * error, 0.0)[is_free]
        # If rounding hides the limit, the radius is reduced in growing steps.
        margin[rows] = np.where(limit < radius, margin[rows], np.minimum(2.0 * margin[rows], 0.5))
        smaller = np.minimum(limit, radius) * (1.0 - margin[rows])
        trial[rows] = smaller
        rows = rows[~is_free & (smaller > 2.0 * error)]
    return 2.0 * lower, 2.0 * upper


def _radius_limit(points: np.ndarray, normals: np.ndarray, others: np.ndarray, rounding: float) -> np.ndarray:
    """Return an upper bound of the radius of a ball that touches at *points* and does not contain *others*.

    It is inf if the other point is not certainly below the tangent plane.
    """
    to_point = points - others
    length = np.linalg.norm(to_point, axis=1)
    depth = (to_point * normals).sum(axis=1) - rounding - DISTANCE_ROUNDING * length
    with np.errstate(invalid="ignore", divide="ignore"):
        limit: np.ndarray = (length + rounding) ** 2 / (2.0 * depth)
    return np.where(depth > 0.0, limit, inf)
