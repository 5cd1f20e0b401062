"""Detection of folded faces, which are slivers that overlap their neighbours and face backwards.

A surface with such a sliver is closed, and every edge has two faces. But over the sliver, the nearest face
gives the wrong sign. The winding number decides it there.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES
from proximity.kernels.mesh.faces import face_normal, thin_faces
from proximity.kernels.mesh.positions import AHEAD, fetch_corners
from proximity.kernels.sign.winding_number import winding_number
from proximity.native import allocating_kernel, kernel
from proximity.native.simd import prefetch

SHARPEST_COSINE = -0.9
"""Cosine between the normals of two faces across an edge below which both faces are tested.

It is an edge of 26 degrees. Folded faces have -1; few edges of real parts are this sharp.
"""
NEAR_CORNER = 0.8
"""Weight of a corner at the sample points of a face, in addition to its centroid."""
MAX_STEP, STEP_SHARE = 1e-6, 1e-3
"""Limits of the distance of samples to either side of a face, in the local frame.

The second is relative to the root of the area of the face.
"""
MAX_LOOKED_AT = 4096
"""Maximum number of faces that are tested in a part. Further sharp faces count as folded."""


@allocating_kernel
def folded_faces(corners, faces, neighbors, slot_faces, reals, words, root, moments):
    """Return a mask of the slots whose faces are folded, or adjacent to a folded face, (blocks,) uint8.

    Adjacent faces are included because a fold has at least two layers, and layers in one plane are equally
    near.

    *corners*: (K, 3), *faces*: (F, 3), in the local frame. *neighbors*: (F, 3), the face across each edge, or
    negative. *reals*, *words*, *root*, *moments*: the part's tree.
    """
    is_over = np.zeros(len(faces), np.bool_)
    looked_at = 0
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        if face + 2 * AHEAD < len(faces):
            for k in range(3):
                prefetch(faces, 3 * max(np.int64(neighbors[face + 2 * AHEAD, k]), 0))
                other = max(np.int64(neighbors[face + AHEAD, k]), 0)
                for corner in range(3):
                    prefetch(corners, 3 * np.int64(faces[other, corner]))
        if not _is_sharp(corners, faces, neighbors, face):
            continue
        looked_at += 1
        if looked_at > MAX_LOOKED_AT or faces_wrong(corners, faces, face, reals, words, root, moments):
            is_over[face] = True
    return marked_slots(is_over, neighbors, slot_faces)


@allocating_kernel
def beside_thin_faces(corners, faces, slot_faces, height):
    """Return a mask of the slots whose faces are thin, or share a corner with a thin face, (blocks,) uint8.

    A face is thin if it is at most *height* high over its longest side. The normal of such a face is
    dominated by rounding, and so are the pseudo-normals of its edges and corners: the winding number decides
    the sign there. Tessellation closes a surface with such faces if two adjacent sides were meshed
    separately.
    """
    marks, is_beside = thin_faces(corners, faces, height), np.zeros(len(corners), np.bool_)
    for face in range(len(faces)):
        if marks[face]:
            is_beside[faces[face, 0]] = is_beside[faces[face, 1]] = is_beside[faces[face, 2]] = True
    for face in range(len(faces)):
        marks[face] = is_beside[faces[face, 0]] or is_beside[faces[face, 1]] or is_beside[faces[face, 2]]
    return slots_of(marks, slot_faces)


@allocating_kernel
def slots_of(marks, slot_faces):
    """Return a mask of the slots whose faces are marked, (blocks,) uint8."""
    slots = np.zeros(len(slot_faces) // LANES, np.uint8)
    for slot in range(len(slot_faces)):
        if slot_faces[slot] >= 0 and marks[slot_faces[slot]]:
            slots[slot // LANES] |= np.uint8(1 << (slot % LANES))
    return slots


@allocating_kernel
def marked_slots(marks, neighbors, slot_faces):
    """Return a mask of the slots whose faces are marked, or adjacent to a marked face, (blocks,) uint8."""
    wider = np.empty(len(marks), np.bool_)
    for face in range(len(marks)):
        wider[face] = marks[face] or _is_beside(marks, neighbors, face)
    return slots_of(wider, slot_faces)


@kernel
def _is_beside(marks, neighbors, face):
    """Test whether a face across one of the edges is marked."""
    for k in range(3):
        other = neighbors[face, k]
        if other >= 0 and marks[other]:
            return True
    return False


@kernel
def _is_sharp(corners, faces, neighbors, face):
    """Test whether a face has an edge at which the cosine of the normals is below `SHARPEST_COSINE`."""
    nx, ny, nz = face_normal(corners, faces, face)
    own_sq = dot(nx, ny, nz, nx, ny, nz)
    for k in range(3):
        other = neighbors[face, k]
        if other >= 0:
            mx, my, mz = face_normal(corners, faces, other)
            other_sq = dot(mx, my, mz, mx, my, mz)
            cosine = dot(nx, ny, nz, mx, my, mz)
            if cosine < 0.0 and cosine < SHARPEST_COSINE * sqrt(own_sq) * sqrt(other_sq):
                return True
    return False


@kernel
def faces_wrong(corners, faces, face, reals, words, root, moments):
    """Test whether a sample above a face is inside the part, or a sample below it is not."""
    nx, ny, nz = face_normal(corners, faces, face)
    length = sqrt(dot(nx, ny, nz, nx, ny, nz))
    if not length > 0.0:
        return False
    step = min(MAX_STEP, STEP_SHARE * sqrt(length)) / length
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    for k in range(4):
        u = NEAR_CORNER if k == 1 else ((1.0 - NEAR_CORNER) / 2.0 if k else 1.0 / 3.0)
        v = NEAR_CORNER if k == 2 else ((1.0 - NEAR_CORNER) / 2.0 if k else 1.0 / 3.0)
        w = 1.0 - u - v
        x = u * corners[a, 0] + v * corners[b, 0] + w * corners[c, 0]
        y = u * corners[a, 1] + v * corners[b, 1] + w * corners[c, 1]
        z = u * corners[a, 2] + v * corners[b, 2] + w * corners[c, 2]
        above = winding_number(reals, words, root, moments, x + step * nx, y + step * ny, z + step * nz)
        below = winding_number(reals, words, root, moments, x - step * nx, y - step * ny, z - step * nz)
        if above > 0.5 or not below > 0.5:
            return True
    return False
