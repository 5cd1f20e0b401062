"""Measures of faces and shells: area, thickness, enclosed volume, and normals at corners.

In all functions, *corners* is (K, 3) float64, and *faces* is (F, 3) integers, rows of *corners*.
"""

from math import atan2, sqrt

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.mesh.positions import fetch_corners
from proximity.kernels.thresholds import VOLUME_ROUNDING
from proximity.native import allocating_kernel, entry, inlined, kernel


@inlined
def _corner(corners, faces, face, k):
    """Return the position of corner *k* of a face."""
    corner = faces[face, k]
    return corners[corner, 0], corners[corner, 1], corners[corner, 2]


@kernel
def face_normal(corners, faces, face):
    """Return the normal of a face, with a length of twice its area."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
    bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2] - az
    cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2] - az
    return cross(bx, by, bz, cx, cy, cz)


@inlined
def corner_distance_sq(corners, one, other):
    """Return the squared distance between two corners."""
    x, y, z = (
        corners[other, 0] - corners[one, 0],
        corners[other, 1] - corners[one, 1],
        corners[other, 2] - corners[one, 2],
    )
    return dot(x, y, z, x, y, z)


@kernel
def double_area(corners, faces, face):
    """Return twice the area of a face."""
    nx, ny, nz = face_normal(corners, faces, face)
    return sqrt(dot(nx, ny, nz, nx, ny, nz))


@entry("float64[:, 3], int32[:, 3] -> float64[:]", makes_arrays=True)
def double_areas(corners, faces):
    """Return twice the area of each face, (F,)."""
    areas = np.empty(len(faces))
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        areas[face] = double_area(corners, faces, face)
    return areas


@entry("float64[:, 3], int32[:, 3], float -> bool[:]", makes_arrays=True)
def thin_faces(corners, faces, height):
    """Return a mask of the faces that are at most *height* high over their longest side, (F,) bool."""
    are_thin = np.empty(len(faces), np.bool_)
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        longest_sq = 0.0
        for k in range(3):
            side_sq = corner_distance_sq(corners, faces[face, k], faces[face, (k + 1) % 3])
            longest_sq = max(longest_sq, side_sq)
        are_thin[face] = double_area(corners, faces, face) <= height * sqrt(longest_sq)
    return are_thin


@entry("float64[:, 3], int32[:, 3] -> float", makes_arrays=True)
def signed_volume(vertices, faces):
    """Return six times the volume enclosed by the mesh, or 0 if rounding makes its sign uncertain.

    The mesh is scaled so that its box reaches to 1 from its middle; the divergence theorem is applied about
    this middle. *vertices*: (V, 3), of any size; unused rows may have any values. Source: Neumaier 1974 for
    the sum.
    """
    low_x, low_y, low_z, high_x, high_y, high_z = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for face in range(len(faces)):
        fetch_corners(vertices, faces, face)
        for k in range(3):
            x, y, z = _corner(vertices, faces, face, k)
            low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
            high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    mx, my, mz = 0.5 * low_x + 0.5 * high_x, 0.5 * low_y + 0.5 * high_y, 0.5 * low_z + 0.5 * high_z
    size = max(high_x - mx, high_y - my, high_z - mz)
    if not size > 0.0:
        return 0.0
    volume, lost, most = 0.0, 0.0, 0.0
    for face in range(len(faces)):
        fetch_corners(vertices, faces, face)
        ax, ay, az = _corner(vertices, faces, face, 0)
        bx, by, bz = _corner(vertices, faces, face, 1)
        cx, cy, cz = _corner(vertices, faces, face, 2)
        ax, ay, az = (ax - mx) / size, (ay - my) / size, (az - mz) / size
        bx, by, bz = (bx - mx) / size, (by - my) / size, (bz - mz) / size
        cx, cy, cz = (cx - mx) / size, (cy - my) / size, (cz - mz) / size
        nx, ny, nz = cross(bx, by, bz, cx, cy, cz)
        term = dot(ax, ay, az, nx, ny, nz)
        most += sqrt(dot(ax, ay, az, ax, ay, az)) * sqrt(dot(nx, ny, nz, nx, ny, nz))
        total = volume + term
        lost += (volume - total) + term if abs(volume) >= abs(term) else (term - total) + volume
        volume = total
    volume += lost
    return volume if abs(volume) > VOLUME_ROUNDING * most else 0.0


@entry("float64[:, 3], int32[:, 3], int64[:], int -> float64[:, :]", makes_arrays=True)
def shell_sizes(corners, faces, labels, count):
    """Return six times the signed volume, twice the area, and the reach of each shell, (3, count).

    *labels*: (F,) int64, the shell of each face; every shell has a face. Volume and reach are measured from
    the first corner of a shell's first face, so that a flat shell has no volume. The reach is the distance to
    the farthest first corner of a face.
    """
    sizes, first = np.zeros((3, count)), np.full(count, -1)
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        shell = labels[face]
        if first[shell] < 0:
            first[shell] = faces[face, 0]
        o, a, b, c = first[shell], faces[face, 0], faces[face, 1], faces[face, 2]
        ox, oy, oz = corners[o, 0], corners[o, 1], corners[o, 2]
        ax, ay, az = corners[a, 0] - ox, corners[a, 1] - oy, corners[a, 2] - oz
        bx, by, bz = corners[b, 0] - ox, corners[b, 1] - oy, corners[b, 2] - oz
        cx, cy, cz = corners[c, 0] - ox, corners[c, 1] - oy, corners[c, 2] - oz
        nx, ny, nz = cross(bx, by, bz, cx, cy, cz)
        sizes[0, shell] += dot(ax, ay, az, nx, ny, nz)
        nx, ny, nz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
        sizes[1, shell] += sqrt(dot(nx, ny, nz, nx, ny, nz))
        sizes[2, shell] = max(sizes[2, shell], sqrt(dot(ax, ay, az, ax, ay, az)))
    return sizes


@allocating_kernel
def enclosed_volumes(corners, faces, labels, count):
    """Return six times the signed volume of each shell, (count,), or 0 if rounding makes its sign uncertain.

    The volume is approximate for shells with small holes. The arguments are those of `shell_sizes`.
    """
    sizes, volumes = shell_sizes(corners, faces, labels, count), np.zeros(count)
    for shell in range(count):
        if abs(sizes[0, shell]) > VOLUME_ROUNDING * sizes[1, shell] * sizes[2, shell]:
            volumes[shell] = sizes[0, shell]
    return volumes


@allocating_kernel
def shell_boxes(corners, faces, labels, count):
    """Return the lower and upper corner of the box around each of *count* shells, (count, 6)."""
    boxes = np.empty((count, 6))
    for shell in range(count):
        for axis in range(3):
            boxes[shell, axis], boxes[shell, 3 + axis] = np.inf, -np.inf
    for face in range(len(faces)):
        shell = labels[face]
        for k in range(3):
            for axis in range(3):
                value = corners[faces[face, k], axis]
                boxes[shell, axis] = min(boxes[shell, axis], value)
                boxes[shell, 3 + axis] = max(boxes[shell, 3 + axis], value)
    return boxes


@entry("float64[:, 3], int32[:, 3], float64[:, 3]")
def add_corner_normals(corners, faces, normals):
    """Compute the normal at each corner, from the unit normals of its faces weighted by their angles there.

    *corners*: (K, 3) float64. *faces*: (F, 3) int32. *normals*: (K, 3), initially zero. A face without area
    adds zero. Source: Thürmer & Wüthrich 1998; Bærentzen & Aanæs 2005 for the proof that these normals decide
    the side.
    """
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        fetch_corners(normals, faces, face)
        for k in range(3):
            a, b, c = faces[face, k], faces[face, (k + 1) % 3], faces[face, (k + 2) % 3]
            ux, uy, uz = (
                corners[b, 0] - corners[a, 0],
                corners[b, 1] - corners[a, 1],
                corners[b, 2] - corners[a, 2],
            )
            vx, vy, vz = (
                corners[c, 0] - corners[a, 0],
                corners[c, 1] - corners[a, 1],
                corners[c, 2] - corners[a, 2],
            )
            nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
            length = sqrt(dot(nx, ny, nz, nx, ny, nz))
            if length > 0.0:
                weight = atan2(length, dot(ux, uy, uz, vx, vy, vz)) / length
                normals[a, 0] += weight * nx
                normals[a, 1] += weight * ny
                normals[a, 2] += weight * nz
    for corner in range(len(normals)):
        x, y, z = normals[corner]
        length = sqrt(x * x + y * y + z * z)
        if length > 0.0:
            normals[corner, 0] /= length
            normals[corner, 1] /= length
            normals[corner, 2] /= length
