"""A lower bound of the distances of faces through the material, over all their points.

A ray from a point x of a face T, against its normal n, leaves through a face Q only where x is in the
projection of Q along n. There the length is a linear function of x, since Q is flat. So its least value over
the common part of T and the projection, a convex polygon, is at a corner of the polygon: a corner of T, a
projected corner of Q, or a crossing of their edges. The least value over all pairs bounds every ray from
below.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from proximity.kernels.entries import morton_order
from proximity.scene.walls.thickness import DISTANCE_ROUNDING, face_areas, face_normals

BLOCK = 2048
"""Number of faces whose pairs are searched together."""
PAIRS = 1 << 16
"""Number of pairs that are tested together."""
NARROW = 1e-6
"""Width, as a share of the size of the part, of polygons that are left out: faces that are only in line."""
MAX_CANDIDATES = 64
EPSILON = 2.0**-52
EDGES = ((0, 1), (1, 2), (2, 0))


class Facing(NamedTuple):
    """Polygons of faces, with the smallest distance to the facing face; K rows, m."""

    distance: np.ndarray  # (K,) at the corner
    corner: np.ndarray  # (K, 3) corner of the polygon where the distance is smallest
    middle: np.ndarray  # (K, 3) a point within the polygon
    face_id: np.ndarray  # (K,)


def least_facing(corners: np.ndarray, limit: float, min_cosine: float) -> tuple[float, Facing]:
    """Return a lower bound of the distances of faces that face away from each other, and the nearest ones.

    *corners*: (F, 3, 3). *limit*: larger distances are not of interest. *min_cosine*: smallest cosine of the
    angle between one normal and the opposite of the other.
    """
    search = _FaceSearch(corners, min_cosine)
    none = Facing(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, np.int64))
    lower, nearest = limit, none
    for first in range(0, len(search.order), BLOCK):
        for pairs in search.pairs(search.order[first : first + BLOCK], lower):
            found, error = search.polygons(*pairs)
            lower = min(lower, float((found.distance - error).min(initial=lower)))
            together = Facing(*(np.concatenate(each) for each in zip(nearest, found, strict=True)))
            chosen = np.argsort(together.distance, kind="stable")[:MAX_CANDIDATES]
            nearest = Facing(*(each[chosen] for each in together))
    return max(lower, 0.0), nearest


class _FaceSearch:
    """Faces in the order of a tree of boxes: node i of a level has the nodes 2 i and 2 i + 1 of the next."""

    def __init__(self, corners: np.ndarray, min_cosine: float) -> None:
        self._corners, self._min_cosine = corners, min_cosine
        self._normals = face_normals(corners)
        self._extent = float(np.abs(corners).max())
        self._size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        edge = corners[:, 1] - corners[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            right = edge / np.linalg.norm(edge, axis=1, keepdims=True)
            # Frames of the faces: two directions within the face, and inward.
            self._frames = np.stack([right, np.cross(self._normals, right), -self._normals], axis=1)
            longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
            self._tilt = 8.0 * EPSILON * longest**2 / face_areas(corners)  # rounding error of a normal
        self._longest = longest
        has_area = np.isfinite(self._normals[:, 0]) & (self._tilt < 1e-3)
        order = morton_order(np.ascontiguousarray(corners.mean(axis=1)))
        self.order = order[has_area[order]]
        flat = self._in_frame(self.order, corners[self.order])
        self._flat_lower, self._flat_upper = np.full((2, len(corners), 3), np.nan)
        self._flat_lower[self.order], self._flat_upper[self.order] = flat.min(axis=1), flat.max(axis=1)
        lower, upper = corners[self.order].min(axis=1), corners[self.order].max(axis=1)
        self._levels = [(lower, upper)]
        while len(lower) > 1:
            starts = np.arange(0, len(lower), 2)
            lower, upper = np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)
            self._levels.append((lower, upper))

    def _in_frame(self, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return points, (K, n, 3), in the frames of faces; the first corner is the origin."""
        return np.einsum("kij,knj->kni", self._frames[faces], points - self._corners[faces, :1])

    def pairs(self, faces: np.ndarray, limit: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield pairs of *faces* and those faces that may be in front of them, inward, within *limit*."""
        stack = [(len(self._levels) - 1, faces, np.zeros(len(faces), np.int64))]
        while stack:
            level, first, node = stack.pop()
            if len(first) > PAIRS:
                cut = len(first) // 2
                stack += [(level, first[:cut], node[:cut]), (level, first[cut:], node[cut:])]
                continue
            lower, upper = self._levels[level]
            meets = self._meets(first, lower[node], upper[node], limit)
            first, node = first[meets], node[meets]
            if level:
                below = (2 * node[:, None] + [0, 1]).reshape(-1)
                exists = below < len(self._levels[level - 1][0])
                stack.append((level - 1, np.repeat(first, 2)[exists], below[exists]))
                continue
            second = self.order[node]
            cosine = -(self._normals[first] * self._normals[second]).sum(axis=1)
            faces_away = cosine >= self._min_cosine
            yield first[faces_away], second[faces_away]

    def _meets(self, faces: np.ndarray, lower: np.ndarray, upper: np.ndarray, limit: float) -> np.ndarray:
        """Return whether boxes, (K, 3) each, may meet the prisms below faces, of the height *limit*."""
        slack = DISTANCE_ROUNDING * self._extent
        frames = self._frames[faces]
        seen = np.einsum("kij,kj->ki", frames, 0.5 * (lower + upper) - self._corners[faces, 0])
        reach = np.einsum("kij,kj->ki", np.abs(frames), 0.5 * (upper - lower)) + slack
        most = self._flat_upper[faces]
        most[:, 2] = limit
        meets = (seen + reach >= self._flat_lower[faces]) & (seen - reach <= most)
        return np.asarray(meets[:, 0] & meets[:, 1] & meets[:, 2])  # faster than all(axis=1)

    def polygons(self, first: np.ndarray, second: np.ndarray) -> tuple[Facing, np.ndarray]:
        """Return the polygons of pairs whose projections overlap, and rounding errors of the distances."""
        own, other = (self._in_frame(first, self._corners[each]) for each in (first, second))
        a, b = own[:, :, :2], other[:, ::-1, :2]  # both counter-clockwise, as the second faces away
        slack = DISTANCE_ROUNDING * self._extent
        points = np.concatenate([a, b, *_edge_crossings(a, b)], axis=1)
        is_common = _is_within(points, a, slack) & _is_within(points, b, slack)
        normal = np.einsum("kij,kj->ki", self._frames[first], self._normals[second])
        slope = normal[:, None, :2] / normal[:, None, 2:]
        with np.errstate(invalid="ignore"):
            distance = other[:, :1, 2] - ((points - other[:, :1, :2]) * slope).sum(axis=2)
        high = np.where(is_common, distance, -np.inf).max(axis=1)
        # Pairs across a gap are behind the face.
        is_wall = (high > slack) & (_width(points, is_common, a, b) > NARROW * self._size)
        first, second, points, is_common, distance = (
            each[is_wall] for each in (first, second, points, is_common, distance)
        )
        distance = np.where(is_common, np.maximum(distance, 0.0), np.inf)
        nearest = distance.argmin(axis=1) if len(first) else np.empty(0, np.int64)
        rows = np.arange(len(first))
        counted = is_common[:, :, None]
        middle = np.where(counted, points, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        error = 2.0 * self._longest[second] * self._tilt[second] + self._size * self._tilt[first] + slack
        frames, origin = self._frames[first][:, :2], self._corners[first, 0]
        at_corner, within = (
            origin + np.einsum("ki,kij->kj", flat, frames) for flat in (points[rows, nearest], middle)
        )
        return Facing(distance[rows, nearest], at_corner, within, first), error


def _edge_crossings(a: np.ndarray, b: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the crossings of each edge of triangles *a* with each of *b*, (K, 1, 2); nan for none."""
    for start, end in EDGES:
        along = a[:, end] - a[:, start]
        for other_start, other_end in EDGES:
            across = b[:, other_end] - b[:, other_start]
            with np.errstate(invalid="ignore", divide="ignore"):
                share = _cross(b[:, other_start] - a[:, start], across) / _cross(along, across)
                share = np.where((share >= 0.0) & (share <= 1.0), share, np.nan)
                yield (a[:, start] + share[:, None] * along)[:, None]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _is_within(points: np.ndarray, triangle: np.ndarray, slack: float) -> np.ndarray:
    """Return which points, (K, n, 2), are in a counter-clockwise triangle, or as near to it as *slack*."""
    is_inside = np.ones(points.shape[:2], bool)
    for start, end in EDGES:
        along = (triangle[:, end] - triangle[:, start])[:, None]
        side = _cross(along, points - triangle[:, start][:, None])
        is_inside &= side >= -slack * np.linalg.norm(along, axis=2)  # nan fails
    return is_inside


def _width(points: np.ndarray, is_common: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the smallest width of polygons, which is across one of their edges; negative without points."""
    width = np.full(len(points), np.inf)
    for triangle in (a, b):
        for start, end in EDGES:
            along = triangle[:, end] - triangle[:, start]
            with np.errstate(invalid="ignore", divide="ignore"):
                along = along / np.linalg.norm(along, axis=1, keepdims=True)
                across = _cross(along[:, None], points)
                high = np.where(is_common, across, -np.inf).max(axis=1)
                low = np.where(is_common, across, np.inf).min(axis=1)
                width = np.fmin(width, high - low)
    return width
