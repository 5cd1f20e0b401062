"""Solids of unit cubes, whose overlap and separation displacement are computed exactly by cell.

Their faces are often coplanar.
"""

from dataclasses import dataclass

import numpy as np
import shapes
from shapes import Mesh

TURNS = (
    np.eye(3),
    np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    np.array([[3, -4, 0], [4, 3, 0], [0, 0, 5]]),
    np.array([[1, 2, 2], [2, 1, -2], [2, -2, 1]]),
    np.array([[2, 3, 6], [3, -6, 2], [6, 2, -3]]),
    np.array([[1, -4, 8], [4, -7, -4], [8, 4, 1]]),
)
"""Integer matrices that preserve angles."""


@dataclass(frozen=True, eq=False)
class Polycube:
    """Filled grid cells, as rows of their lowest corners, and their surface."""

    cells: np.ndarray  # (C, 3) int64
    mesh: Mesh


def polycube(rng: np.random.Generator) -> Polycube:
    """Choose a box, a prism over connected cells, or connected cells; some surfaces have large triangles."""
    kind = rng.integers(3)
    if kind == 0:
        size = rng.integers(1, 5, 3)
        filled = np.ones(size, bool)
        return Polycube(
            np.argwhere(filled), shapes.box((0, 0, 0), size) if rng.random() < 0.5 else shapes.voxels(filled)
        )
    filled = np.zeros((4, 4, 4), bool)
    at = np.array([1, 1, 1])
    for _ in range(rng.integers(2, 9)):
        filled[tuple(at)] = True
        axis = rng.integers(2 if kind == 1 else 3)
        at[axis] = np.clip(at[axis] + rng.choice([-1, 1]), 0, 3)
    if kind == 1:
        filled[...] = filled.any(axis=2, keepdims=True)
        filled[:, :, rng.integers(1, 4) :] = False
    filled = without_diagonals(filled)
    return Polycube(np.argwhere(filled), shapes.voxels(filled))


def without_diagonals(filled: np.ndarray) -> np.ndarray:
    """Fill the box around cells that meet only along an edge or at a corner."""
    pairs = np.argwhere(filled)
    steps = np.abs(pairs[:, None] - pairs)
    for one, other in np.argwhere((steps.max(axis=-1) == 1) & (steps.sum(axis=-1) > 1)):
        low, high = np.minimum(pairs[one], pairs[other]), np.maximum(pairs[one], pairs[other])
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
        is_path = [filled[tuple(corner)] for corner in corners]
        if sum(is_path) < 3:
            filled[low[0] : high[0] + 1, low[1] : high[1] + 1, low[2] : high[2] + 1] = True
            return without_diagonals(filled)
    return filled


def free_from(first: Polycube, second: Polycube, offset: np.ndarray, direction: np.ndarray) -> float:
    """Distance that the first, displaced by *offset*, moves along a direction until it is free."""
    apart = (second.cells[None] - first.cells[:, None]).reshape(-1, 3) - offset
    begin, end = np.full(len(apart), -np.inf), np.full(len(apart), np.inf)
    for axis in range(3):
        gap, step = apart[:, axis], direction[axis]
        if abs(step) < 1e-12:
            begin = np.where(np.abs(gap) < 1.0, begin, np.inf)
        else:
            begin = np.maximum(begin, (gap - np.sign(step)) / step)
            end = np.minimum(end, (gap + np.sign(step)) / step)
    free = 0.0
    for row in np.argsort(begin):
        if begin[row] >= free:
            break
        free = max(free, end[row]) if begin[row] < end[row] else free
    return float(free)


def overlap(first: Polycube, second: Polycube, offset: np.ndarray, shrink: float = 0.0) -> bool:
    """Test whether they share volume, the first displaced by *offset* and all cells narrower by *shrink*."""
    apart = np.abs(second.cells[None] - first.cells[:, None] - offset)
    return bool((apart < 1.0 - shrink).all(axis=-1).any())


def distance(first: Polycube, second: Polycube, offset: np.ndarray) -> float:
    """Distance between both, the first displaced by *offset*; 0 if they touch or overlap."""
    gaps = np.abs(second.cells[None] - first.cells[:, None] - offset) - 1.0
    return float(np.linalg.norm(np.maximum(gaps, 0.0), axis=-1).min())


def depth_in(solid: Polycube, points: np.ndarray) -> np.ndarray:
    """Depth of points inside; -1 outside, 0 on the surface."""
    a, b, c = np.moveaxis(solid.mesh[0][solid.mesh[1]], 1, 0)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    # Each triangle is half of a rectangle of the surface.
    gaps = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
    is_inside = (np.abs(points[:, None] - solid.cells - 0.5) <= 0.5 + 1e-12).all(axis=-1).any(axis=1)
    return np.where(is_inside, np.linalg.norm(gaps, axis=-1).min(axis=1), -1.0)
