"""Relation of an edge of a body to its faces, and to another face: apart, crossing it, or on it.

*corners* (K, 3) float64 and *faces* (F, 3) as in `mesh.faces`; *depth*: the distance within which a corner
counts as in a plane.
"""

from math import frexp, ldexp, sqrt

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.mesh.faces import corner_distance_sq, face_normal
from proximity.native import inlined, kernel

SHORTEST_CONTACT = 1e4
"""Minimum length, in depths, of an edge's overlap with a face; a shorter one is two corners that touch."""
EDGE_FLAT, EDGE_CREASED, EDGE_UNCLEAR = 0, 1, 2
"""Edges: between adjacent faces in one plane; between faces in different planes; between faces that overlap,
or with a face thinner than *depth*."""


@inlined
def has_corner(faces, face, corner):
    return faces[face, 0] == corner or faces[face, 1] == corner or faces[face, 2] == corner


@kernel
def _plane(corners, faces, face, depth):
    """Return a normal of a face, and its length, or 0 for a face thinner than *depth*, without a plane."""
    nx, ny, nz = face_normal(corners, faces, face)
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    longest_sq = max(corner_distance_sq(corners, a, b), corner_distance_sq(corners, a, c))
    length_sq = dot(nx, ny, nz, nx, ny, nz)
    return nx, ny, nz, sqrt(length_sq) if length_sq > depth * depth * longest_sq else 0.0


@inlined
def _height(corners, faces, face, nx, ny, nz, corner):
    """Return the height of a corner above the plane of a face, times the length of the normal *n*."""
    a = faces[face, 0]
    return dot(
        nx, ny, nz, corners[corner, 0] - corners[a, 0], corners[corner, 1] - corners[a, 1],
        corners[corner, 2] - corners[a, 2],
    )  # fmt: skip


@kernel
def reaches_through(corners, faces, face, start, end, depth):
    """Test whether an edge that meets a face extends beyond it on both sides by more than *depth*."""
    nx, ny, nz, length = _plane(corners, faces, face, depth)
    if length == 0.0:
        return False
    least = depth * length
    first = _height(corners, faces, face, nx, ny, nz, start)
    last = _height(corners, faces, face, nx, ny, nz, end)
    return min(first, last) < -least and max(first, last) > least


@kernel
def lies_on(corners, faces, face, start, end, depth):
    """Test whether an edge in a face's plane overlaps the face by more than the minimum length.

    Includes the rim, unless they share a corner: near it, thin faces are close to their rims everywhere.
    """
    slack = -depth if has_corner(faces, face, start) or has_corner(faces, face, end) else depth
    nx, ny, nz, length = _plane(corners, faces, face, depth)
    if length == 0.0:
        return False
    px, py, pz = corners[start, 0], corners[start, 1], corners[start, 2]
    dx, dy, dz = corners[end, 0] - px, corners[end, 1] - py, corners[end, 2] - pz
    low, high = 0.0, 1.0
    for k in range(3):
        u, w = faces[face, k], faces[face, (k + 1) % 3]
        ex, ey, ez = (
            corners[w, 0] - corners[u, 0],
            corners[w, 1] - corners[u, 1],
            corners[w, 2] - corners[u, 2],
        )
        mx, my, mz = cross(nx, ny, nz, ex, ey, ez)
        within = dot(mx, my, mz, px - corners[u, 0], py - corners[u, 1], pz - corners[u, 2])
        within += slack * sqrt(dot(mx, my, mz, mx, my, mz))
        gain = dot(mx, my, mz, dx, dy, dz)
        if gain > 0.0:
            low = max(low, -within / gain)
        elif gain < 0.0:
            high = min(high, -within / gain)
        elif within < 0.0:
            return False
    return (high - low) * sqrt(dot(dx, dy, dz, dx, dy, dz)) > SHORTEST_CONTACT * depth


@kernel
def kind_of_edge(corners, faces, face, other, depth):
    """Return the kind of an edge from the relation of its two faces; *other* may be missing."""
    if other < 0:
        return EDGE_CREASED
    nx, ny, nz, length = _plane(corners, faces, face, depth)
    mx, my, mz, other_length = _plane(corners, faces, other, depth)
    if length == 0.0 or other_length == 0.0:
        return EDGE_UNCLEAR
    most = depth * length
    for k in range(3):
        if abs(_height(corners, faces, face, nx, ny, nz, faces[other, k])) > most:
            return EDGE_CREASED
    return EDGE_FLAT if dot(nx, ny, nz, mx, my, mz) > 0.0 else EDGE_UNCLEAR


@inlined
def edge_ray(corners, start, end):
    """Return an edge as a ray: start, direction with largest component near 1, and length.

    The length, in units of the direction, is 0 for a degenerate edge.
    """
    ox, oy, oz = corners[start, 0], corners[start, 1], corners[start, 2]
    dx, dy, dz = corners[end, 0] - ox, corners[end, 1] - oy, corners[end, 2] - oz
    most = max(abs(dx), abs(dy), abs(dz))
    _, power = frexp(most)
    share, length = ldexp(1.0, -power), ldexp(1.0, power) if most > 0.0 else 0.0
    return ox, oy, oz, dx * share, dy * share, dz * share, length
