"""The yardstick of the gate: a plain tree and plain formulas, timed in the same run as our kernels.

Scalar textbook code: a binary tree by medians, float64 boxes, one triangle at a time. It is frozen: an edit
changes every ratio in ``gate.toml``. It is independent of the package, so that no change there makes it
faster or slower; compiled by the same numba and for the same mesh, it is slowed by a busy machine like the
kernels.

Tried and dropped (2026-11): embreex for rays and SciPy's tree for points. Their ratios spread as widely
(0.90 to 1.10 and 0.84 to 1.15 times the median on a busy machine), but a new version of theirs moves them.

Source: Ericson, Real-Time Collision Detection, 5.1.5 and 5.3.3; Möller & Trumbore 1997 for the ray.
"""

from dataclasses import dataclass

import numba
import numpy as np

LEAF = 4  # triangles at most
DEPTH = 64
INNER = -1


@dataclass(frozen=True, slots=True, eq=False)
class Yardstick:
    """A mesh that answers distances of points and first hits of rays."""

    triangles: np.ndarray  # (F, 9) float64, corners a, b, c in the order of the leaves
    boxes: np.ndarray  # (M, 6) float64, lower and upper
    links: np.ndarray  # (M, 2) int64: first triangle and count; of an inner node its second child and -1

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Unsigned distances of (N, 3) points."""
        return _distances(self.triangles, self.boxes, self.links, points)

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Lengths of rays to the first hit, inf where there is none."""
        return _first_hits(self.triangles, self.boxes, self.links, origins, directions)


def build(vertices: np.ndarray, faces: np.ndarray) -> Yardstick:
    """Make the tree."""
    return Yardstick(*_grown(vertices[faces].reshape(-1, 9)))


_compiled = numba.njit(cache=True, nogil=True)


@_compiled
def _halve(order, keys, first, last):
    """Move the rows with the smaller keys to the first half; return the start of the second."""
    middle = (first + last) // 2
    low, high = first, last - 1
    while low < high:
        pivot = keys[order[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    return middle


@_compiled
def _grown(triangles):
    """Triangles in leaf order, boxes and links; a first child follows its parent."""
    count = len(triangles)
    boxes, links = np.empty((2 * count, 6)), np.empty((2 * count, 2), np.int64)
    order, keys = np.arange(count), np.empty(count)
    stack = np.empty((DEPTH, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, count, -1
    waiting, node = 1, 0
    while waiting:
        waiting -= 1
        first, last, parent = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2]
        if parent >= 0:
            links[parent, 0] = node
        widest, axis = -1.0, 0
        for k in range(3):
            lower, upper = np.inf, -np.inf
            for i in range(first, last):
                for corner in range(k, 9, 3):
                    lower = min(lower, triangles[order[i], corner])
                    upper = max(upper, triangles[order[i], corner])
            boxes[node, k], boxes[node, 3 + k] = lower, upper
            if upper - lower > widest:
                widest, axis = upper - lower, k
        if last - first <= LEAF:
            links[node, 0], links[node, 1] = first, last - first
        else:
            for i in range(first, last):
                row = triangles[order[i]]
                keys[order[i]] = row[axis] + row[axis + 3] + row[axis + 6]
            middle = _halve(order, keys, first, last)
            links[node, 1] = INNER
            stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = middle, last, node
            stack[waiting + 1, 0], stack[waiting + 1, 1], stack[waiting + 1, 2] = first, middle, -1
            waiting += 2
        node += 1
    return triangles[order], boxes[:node], links[:node]


@_compiled
def triangle_distance_sq(px, py, pz, corners):
    """Squared distance from a point to a triangle of nine numbers, by the regions about it."""
    ax, ay, az = px - corners[0], py - corners[1], pz - corners[2]
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    d1, d2 = ux * ax + uy * ay + uz * az, vx * ax + vy * ay + vz * az
    bx, by, bz = ax - ux, ay - uy, az - uz
    d3, d4 = ux * bx + uy * by + uz * bz, vx * bx + vy * by + vz * bz
    cx, cy, cz = ax - vx, ay - vy, az - vz
    d5, d6 = ux * cx + uy * cy + uz * cz, vx * cx + vy * cy + vz * cz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:  # corner a
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:  # corner b
        s, t = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:  # corner c
        s, t = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:  # edge ab
        s, t = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:  # edge ac
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:  # edge bc
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:  # interior
        whole = va + vb + vc
        s, t = vb / whole, vc / whole
    x, y, z = ax - s * ux - t * vx, ay - s * uy - t * vy, az - s * uz - t * vz
    return x * x + y * y + z * z


@_compiled
def box_distance_sq(x, y, z, box):
    """Squared distance from a point to a box of six numbers; 0 inside."""
    gap_x = max(box[0] - x, 0.0, x - box[3])
    gap_y = max(box[1] - y, 0.0, y - box[4])
    gap_z = max(box[2] - z, 0.0, z - box[5])
    return gap_x * gap_x + gap_y * gap_y + gap_z * gap_z


@_compiled
def _distances(triangles, boxes, links, points):
    found = np.empty(len(points))
    stack, bounds = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        best = np.inf
        stack[0], bounds[0], waiting = 0, 0.0, 1
        while waiting:
            waiting -= 1
            if bounds[waiting] >= best:  # prune
                continue
            node = stack[waiting]
            while links[node, 1] == INNER:
                near, far = node + 1, links[node, 0]
                near_sq, far_sq = box_distance_sq(x, y, z, boxes[near]), box_distance_sq(x, y, z, boxes[far])
                if far_sq < near_sq:
                    near, far, near_sq, far_sq = far, near, far_sq, near_sq
                stack[waiting], bounds[waiting] = far, far_sq
                waiting += 1
                node = near
            for i in range(links[node, 0], links[node, 0] + links[node, 1]):
                best = min(best, triangle_distance_sq(x, y, z, triangles[i]))
        found[row] = np.sqrt(best)
    return found


@_compiled
def box_entry(x, y, z, rate_x, rate_y, rate_z, box):
    """Parameter at which a ray enters a box of six numbers; inf where it misses. Rates: 1 / direction."""
    x1, x2 = (box[0] - x) * rate_x, (box[3] - x) * rate_x
    y1, y2 = (box[1] - y) * rate_y, (box[4] - y) * rate_y
    z1, z2 = (box[2] - z) * rate_z, (box[5] - z) * rate_z
    enter = max(min(x1, x2), min(y1, y2), min(z1, z2), 0.0)
    leave = min(max(x1, x2), max(y1, y2), max(z1, z2))
    return enter if enter <= leave else np.inf


@_compiled
def triangle_entry(x, y, z, dx, dy, dz, corners):
    """Parameter at which a ray meets a triangle of nine numbers; inf where it misses."""
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    px, py, pz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    volume = ux * px + uy * py + uz * pz
    if volume == 0.0:
        return np.inf
    ax, ay, az = x - corners[0], y - corners[1], z - corners[2]
    s = (ax * px + ay * py + az * pz) / volume
    qx, qy, qz = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
    t = (dx * qx + dy * qy + dz * qz) / volume
    length = (vx * qx + vy * qy + vz * qz) / volume
    return length if s >= 0.0 and t >= 0.0 and s + t <= 1.0 and length >= 0.0 else np.inf


@_compiled
def _first_hits(triangles, boxes, links, origins, directions):
    found = np.empty(len(origins))
    stack, bounds = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    for row in range(len(origins)):
        x, y, z = origins[row, 0], origins[row, 1], origins[row, 2]
        dx, dy, dz = directions[row, 0], directions[row, 1], directions[row, 2]
        rx, ry, rz = np.divide(1.0, dx), np.divide(1.0, dy), np.divide(1.0, dz)
        best = np.inf
        stack[0], bounds[0], waiting = 0, box_entry(x, y, z, rx, ry, rz, boxes[0]), 1
        while waiting:
            waiting -= 1
            if bounds[waiting] >= best:  # prune
                continue
            node = stack[waiting]
            while links[node, 1] == INNER:
                near, far = node + 1, links[node, 0]
                enter, later = (
                    box_entry(x, y, z, rx, ry, rz, boxes[near]),
                    box_entry(x, y, z, rx, ry, rz, boxes[far]),
                )
                if later < enter:
                    near, far, enter, later = far, near, later, enter
                if enter >= best:
                    break
                stack[waiting], bounds[waiting] = far, later
                waiting += 1
                node = near
            if links[node, 1] != INNER:
                for i in range(links[node, 0], links[node, 0] + links[node, 1]):
                    best = min(best, triangle_entry(x, y, z, dx, dy, dz, triangles[i]))
        found[row] = best
    return found
