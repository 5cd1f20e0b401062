"""Pairing of the faces around an edge. Each face is paired with the face across its wedge of material."""

from math import atan2, pi, sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.mesh.edges import ends_of, sort_run
from proximity.native import kernel

POSITION_ROUNDING = 2.0**-22
"""Rounding of positions in files, relative to the largest coordinate.

It is the rounding of float32, by which coincident faces may differ. Smaller angles at an edge are
meaningless.
"""
BACKWARD = 2**32
"""Added to the key of a backward half-edge, so that forward faces come first among those at one angle."""


class Wedges(NamedTuple):
    """The half-edges of one edge that need a partner, and scratch memory. Each array has at least M rows."""

    half_edges: np.ndarray  # int32
    is_forward: np.ndarray  # bool, from the lower corner to the higher, after turning
    partner: np.ndarray  # int64, result: row of the partner of a forward half-edge, or -1
    angles: np.ndarray  # float64
    other_angles: np.ndarray
    keys: np.ndarray  # int64
    other_keys: np.ndarray
    rows: np.ndarray  # int64
    other_rows: np.ndarray


@kernel
def pair_around_edge(corners, points, wedges, count):
    """Pair *count* half-edges of one edge. Return whether the two of a pair have the same direction.

    Only a single pair may have the same direction, if one of its faces is flipped. Otherwise the numbers of
    forward and backward half-edges must be equal.
    """
    forward_count = 0
    for row in range(count):
        wedges.partner[row] = -1
        forward_count += wedges.is_forward[row]
    if count == 2 and forward_count != 1:
        wedges.partner[0] = 1
        return True
    if count > 0 and 2 * forward_count == count:
        noise = _fill_angles(corners, points, wedges, count)
        _sort_by_angle(wedges, count, noise)
        _match_wedges(wedges, count)
    return False


@kernel
def _fill_angles(corners, points, wedges, count):
    """Write the angle of each face about its edge, relative to the first face.

    Return the largest rounding error.
    """
    start, end = ends_of(corners, wedges.half_edges[0])
    foot, tip = min(start, end), max(start, end)
    x, y, z = points[foot, 0], points[foot, 1], points[foot, 2]
    ux, uy, uz = points[tip, 0] - x, points[tip, 1] - y, points[tip, 2] - z
    length = sqrt(dot(ux, uy, uz, ux, uy, uz))
    if length > 0.0:
        ux, uy, uz = ux / length, uy / length, uz / length
    bx, by, bz, noise = 0.0, 0.0, 0.0, 0.0
    for row in range(count):
        corner = corners[wedges.half_edges[row] // 3, (wedges.half_edges[row] + 2) % 3]
        ax, ay, az = points[corner, 0] - x, points[corner, 1] - y, points[corner, 2] - z
        along = dot(ax, ay, az, ux, uy, uz)
        ax, ay, az = ax - along * ux, ay - along * uy, az - along * uz
        if row == 0:
            bx, by, bz = ax, ay, az
        nx, ny, nz = cross(bx, by, bz, ax, ay, az)
        angle = atan2(dot(nx, ny, nz, ux, uy, uz), dot(bx, by, bz, ax, ay, az))
        wedges.angles[row] = angle + 2.0 * pi if angle < 0.0 else angle
        height = sqrt(dot(ax, ay, az, ax, ay, az))
        noise = max(noise, POSITION_ROUNDING / max(height, POSITION_ROUNDING))
    return noise


@kernel
def _sort_by_angle(wedges, count, noise):
    """Sort the faces around an edge by their angle, counter-clockwise along the edge from its lower corner.

    In this view a forward face has its material before it and a backward face behind it. Of faces at one
    angle the forward ones come first, because the material of one ends where the material of the next begins.
    """
    angles, rows, keys = wedges.angles, wedges.other_keys, wedges.keys
    for row in range(count):
        rows[row] = row
    sort_run(angles, rows, 0, count, wedges.other_angles, wedges.other_rows)
    # Cut the circle at its widest gap, so that no cluster of equal angles is cut.
    widest, first = angles[0] + 2.0 * pi - angles[count - 1], 0
    for position in range(1, count):
        if angles[position] - angles[position - 1] >= widest:
            widest, first = angles[position] - angles[position - 1], position
    cluster = 0
    for n in range(count):
        position = (first + n) % count
        before = angles[position - 1] if position > 0 else angles[count - 1] - 2.0 * pi
        if n > 0 and angles[position] - before > noise:
            cluster += 2 * BACKWARD
        # Overlapping bodies with coplanar sides leave the assignment of faces open. Files list a body's faces
        # together: nesting those of one end in the file is the best guess.
        half_edge = np.int64(wedges.half_edges[rows[position]])
        is_forward = wedges.is_forward[rows[position]]
        keys[n] = cluster + (BACKWARD - 1 - half_edge if is_forward else BACKWARD + half_edge)
        wedges.rows[n] = rows[position]
    sort_run(keys, wedges.rows, 0, count, wedges.other_keys, wedges.other_rows)


@kernel
def _match_wedges(wedges, count):
    """Pair the faces around an edge like brackets.

    Material begins at a backward face and ends at a forward face. The second round pairs faces whose material
    began before the cut.
    """
    waiting, depth = wedges.other_rows, 0
    for turn in range(2):
        for n in range(count):
            row = wedges.rows[n]
            if not wedges.is_forward[row]:
                if turn == 0:
                    waiting[depth] = row
                    depth += 1
            elif wedges.partner[row] < 0 and depth > 0:
                depth -= 1
                wedges.partner[row] = waiting[depth]
