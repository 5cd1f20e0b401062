"""Meshes and scenes that rays and segments are asked of."""

from functools import cache

import numpy as np
import shapes

from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

CLOSED = {
    "tetrahedron": shapes.tetrahedron,
    "cube": shapes.cube,
    "hollow cube": shapes.hollow_cube,
    "sphere": lambda: shapes.sphere(subdivisions=2),
    "torus": lambda: shapes.torus(n=16, m=8),
    "torus of loose faces": lambda: shapes.soup(*shapes.torus(n=16, m=8)),
}
MESHES = CLOSED | {
    "sheet": shapes.grid,
    "open box": shapes.open_box,
    "Moebius strip": lambda: shapes.strip(16, half_turns=1),
}
FAR = np.array([10_000.0, -7_000.0, 3_000.0])


@cache
def mesh_of(name):
    return MESHES[name]()


@cache
def solid_of(name):
    return Solid(*mesh_of(name))


def some_scene(count, *, is_turned=True, offset=(0.0, 0.0, 0.0), seed=1):
    rng = np.random.default_rng(seed)
    parts = []
    for row in range(count):
        vertices, faces = [shapes.tetrahedron, shapes.cube, shapes.octahedron][row % 3]()
        turn = shapes.rotation(int(rng.integers(2**31))) if is_turned else None
        pose = Pose(turn, rng.uniform(-4.0, 4.0, 3) + offset)
        rows = np.arange(len(faces), dtype=np.int32)
        parts.append(Part(f"part {row}", Solid(vertices, faces), pose, rows))
    return Scene(parts)
