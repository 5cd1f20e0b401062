"""Angle-weighted normals at the corners of a closed surface."""

from math import atan2, sqrt

from proximity.kernels.geometry.triangle import cross, dot
from proximity.native import entry


@entry("float64[:, 3], int32[:, 3], float64[:, 3]")
def add_corner_normals(corners, faces, normals):
    """Add to each corner the unit normals of its faces, weighted by the faces' angles there; make them unit.

    *corners* (K, 3) float64, *faces* (F, 3) int32, *normals* (K, 3) zeros. A face without area adds nothing.
    Source: Thürmer & Wüthrich 1998; Bærentzen & Aanæs 2005 for why these tell the side.
    """
    for face in range(len(faces)):
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
