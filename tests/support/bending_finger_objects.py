"""The five objects of the paper's contact prediction, and the bend at which a finger touches each."""

import numpy as np
import shapes
from ticking import solid


def half_space(normal, offset):
    """A large block below the plane normal · x = offset, for points (x, y, z)."""
    n = np.append(np.asarray(normal, float) / np.linalg.norm(normal), 0.0)
    turn = np.stack([n, (-n[1], n[0], 0.0), (0.0, 0.0, 1.0)], axis=1)
    vertices, faces = shapes.box((-0.1, -0.3, -0.1), (0.0, 0.3, 0.1))
    return solid(((vertices - (-offset, 0, 0)) @ turn.T, faces), "half-space")


def disc(radius, center, count=2000):
    """A long prism about z, a disc to a finger in the plane z = 0; its vertices lie on the circle."""
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)], axis=1)
    low, high = (np.column_stack([ring, np.full(count, z)]) for z in (-0.05, 0.05))
    a, c = np.arange(count), np.arange(count) + count
    b, d = np.roll(a, -1), np.roll(c, -1)
    sides = [np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]
    lids = [
        np.stack([np.full(count, 2 * count), b, a], axis=1),
        np.stack([np.full(count, 2 * count + 1), c, d], axis=1),
    ]
    middles = np.array([[*center, -0.05], [*center, 0.05]])
    return solid((np.concatenate([low, high, middles]), np.concatenate(sides + lids)), "disc")


THINGS = {
    "disc R 10": (disc(0.010, (0.048, -0.052)), 0.285802722),
    "disc R 20": (disc(0.020, (0.045, -0.055)), 0.241103082),
    "disc R 40": (disc(0.040, (0.040, -0.075)), 0.210338488),
    "plane y = -45": (half_space((0, 1), -0.045), 0.174204922),
    "plane x+y = -20 sqrt 2": (half_space((1, 1), -0.020), 0.374750685),
}
"""Reference values: the object, and the bend at which the pad of a bending finger touches it."""
