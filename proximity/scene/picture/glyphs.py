"""Small shapes that mark points and connections."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from proximity.scene.picture.surface_image import Triangles

SIDES = 12  # of a tube


def merged(pieces: Sequence[Triangles]) -> Triangles:
    """Return triangles as one."""
    counts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return Triangles(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.faces + first for piece, first in zip(pieces, counts, strict=False)]),
        np.concatenate([piece.colors for piece in pieces]),
    )


def sphere(center: np.ndarray, radius: float, color: np.ndarray, detail: int) -> Triangles:
    """Return a sphere; each level of *detail* has four times as many faces, from 20 on."""
    vertices, faces = _unit_sphere(detail)
    return Triangles(center + radius * vertices, faces, np.broadcast_to(color, (len(faces), 3)))


def tube(start: np.ndarray, end: np.ndarray, radius: float, color: np.ndarray) -> Triangles:
    """Return an open tube between two points; without length it has no faces."""
    along = end - start
    length = np.linalg.norm(along)
    if not length > 0.0:
        return Triangles(np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty((0, 3)))
    along = along / length
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = radius * (np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * np.cross(along, side))
    rows = np.arange(SIDES)
    after = (rows + 1) % SIDES
    faces = np.concatenate(
        [np.stack([rows, after, rows + SIDES], 1), np.stack([after, after + SIDES, rows + SIDES], 1)]
    )
    return Triangles(
        np.concatenate([start + ring, end + ring]), faces, np.broadcast_to(color, (len(faces), 3))
    )


@lru_cache(maxsize=4)
def _unit_sphere(detail: int) -> tuple[np.ndarray, np.ndarray]:
    """An icosahedron, divided *detail* times."""
    golden = (1 + 5**0.5) / 2
    square = np.array([[-1.0, golden], [1.0, golden], [-1.0, -golden], [1.0, -golden]])
    flat = np.insert(square, 2, 0.0, axis=1)
    vertices = np.concatenate([np.roll(flat, shift, axis=1) for shift in range(3)])
    vertices /= np.linalg.norm(vertices[0])
    # Faces: all triples of vertices whose distances are the edge's length.
    near = np.linalg.norm(vertices[:, None] - vertices, axis=-1)
    edge = near[near > 1e-9].min() * 1.01
    triples = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if max(near[a, b], near[b, c], near[a, c]) < edge
    ]
    faces = np.array(
        [(a, b, c) if np.linalg.det(vertices[[a, b, c]]) > 0 else (a, c, b) for a, b, c in triples]
    )
    for _ in range(detail):
        a, b, c = (vertices[faces[:, corner]] for corner in range(3))
        middles = [(a + b) / 2, (b + c) / 2, (c + a) / 2]
        corners = np.concatenate([a, b, c, *middles])
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        rows = np.arange(len(faces)) + len(faces) * np.arange(6)[:, None]
        quarters = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]
        faces = np.concatenate([rows[list(quarter)].T for quarter in quarters])
        # Corners that faces share are one: shading is smooth across them.
        _, first, ids = np.unique(corners.round(9), axis=0, return_index=True, return_inverse=True)
        vertices, faces = corners[first], ids.reshape(-1)[faces]
    return vertices, faces
