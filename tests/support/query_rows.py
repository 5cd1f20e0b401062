"""Meshes and scenes, with points, rays and segments to query them."""

from functools import cache

import numpy as np
import shapes

from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid


def needles():
    """A fan of slivers around a point, closed by a second fan below: heights down to 1e-9."""
    angle = np.sort(np.random.default_rng(3).random(40)) * 2 * np.pi
    angle[20:] = angle[19] + np.arange(20) * 1e-9
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(40)], axis=1)
    i, j = np.arange(40), np.roll(np.arange(40), -1)
    up, down = np.stack([i, j, np.full(40, 40)], axis=1), np.stack([j, i, np.full(40, 41)], axis=1)
    return np.concatenate([ring, [[0.1, 0.2, 0.5], [0.1, 0.2, -0.25]]]), np.concatenate([up, down])


def rod():
    """A rod of 600 faces, each a thousand times as long as wide."""
    angle = 2 * np.pi * np.arange(150) / 150
    ring = np.stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), np.full(150, -0.2)], axis=1)
    vertices = np.concatenate([ring, ring + np.array([0.0, 0.0, 0.4]), [[0.0, 0.0, -0.2], [0.0, 0.0, 0.2]]])
    a, b = np.arange(150), np.roll(np.arange(150), -1)
    low, high = np.full(150, 300), np.full(150, 301)
    sides = [[a, b, b + 150], [a, b + 150, a + 150], [low, b, a], [high, a + 150, b + 150]]
    return vertices, np.concatenate([np.stack(side, axis=1) for side in sides])


def overlapping_cubes():
    """Two cubes that overlap at a corner, as one self-intersecting mesh."""
    return shapes.join(shapes.cube(1.0, (0.0, 0.0, 0.0)), shapes.cube(1.0, (0.6, 0.5, 0.4)))


def tray():
    """A low box without its lid."""
    vertices, faces = shapes.open_box()
    return vertices * [1.0, 1.0, 0.3], faces


def scattered_triangles():
    """Eighty triangles of random shapes and positions."""
    rng = np.random.default_rng(5)
    corners = rng.uniform(-1.0, 1.0, (80, 1, 3)) + rng.normal(size=(80, 3, 3)) * rng.choice(
        [1e-3, 0.3], (80, 1, 1)
    )
    return corners.reshape(-1, 3), np.arange(240).reshape(-1, 3)


CLOSED = {
    "tetrahedron": shapes.tetrahedron,
    "cube": shapes.cube,
    "hollow cube": shapes.hollow_cube,
    "octahedron": shapes.octahedron,
    "sphere": lambda: shapes.sphere(subdivisions=2),
    "torus": lambda: shapes.torus(n=16, m=8),
    "torus of loose faces": lambda: shapes.soup(*shapes.torus(n=16, m=8)),
    "rod": rod,
}
OPEN = {
    "tray": tray,
    "sheet": shapes.grid,
    "Moebius strip": lambda: shapes.strip(16, half_turns=1),
    "scattered triangles": scattered_triangles,
}
# Closed, but the needles have nearly equal vertices, and the cubes intersect.
MESHES = CLOSED | OPEN | {"needles": needles, "overlapping cubes": overlapping_cubes}
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


def some_points(name, count, seed=7):
    """Points far from, around, near and on the surface, including edges and corners."""
    return points_near(*mesh_of(name), count, seed)


def points_near(vertices, faces, count, seed=7):
    """Points as of `some_points`, for any mesh."""
    rng = np.random.default_rng(seed)
    size = np.ptp(vertices, axis=0).max()
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    weights[rng.random(count) < 0.2] = (0.0, 0.5, 0.5)
    weights[rng.random(count) < 0.2] = (0.0, 0.0, 1.0)
    on_surface = (vertices[faces[rng.integers(len(faces), size=count)]] * weights[:, :, None]).sum(axis=1)
    step = rng.choice([0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 0.3, 1.0, 30.0], (count, 1))
    return on_surface + size * step * rng.normal(size=(count, 3))


def some_rays(name, count, seed=7):
    """Rays from around and inside, aimed at faces, edges and corners, or past them."""
    vertices, faces = mesh_of(name)
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    weights[rng.random(count) < 0.3] = (0.0, 0.5, 0.5)
    weights[rng.random(count) < 0.3] = (0.0, 0.0, 1.0)
    aims = (vertices[faces[rng.integers(len(faces), size=count)]] * weights[:, :, None]).sum(axis=1)
    aims += rng.choice([0.0, 1e-9, 0.3], (count, 1)) * rng.normal(size=(count, 3))
    origins = rng.uniform(-3.0, 3.0, (count, 3))
    return origins, (aims - origins) * rng.choice([1e-6, 1.0, 1e6], (count, 1))


def some_segments(name, count, seed=7):
    """Long and short segments around, along, across and inside the surface."""
    vertices, faces = mesh_of(name)
    rng = np.random.default_rng(seed)
    corners = vertices[faces[rng.integers(len(faces), size=count)]]
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    weights[rng.random(count) < 0.3] = (0.0, 0.5, 0.5)
    weights[rng.random(count) < 0.3] = (0.0, 0.0, 1.0)
    starts = (corners * weights[:, :, None]).sum(axis=1)
    starts += rng.choice([0.0, 1e-9, 1e-3, 0.3, 2.0], (count, 1)) * rng.normal(size=(count, 3))
    ways = rng.choice([1e-12, 1e-6, 0.1, 1.0, 10.0], (count, 1)) * rng.normal(size=(count, 3))
    # Some run along an edge of a face, parallel to their closest feature.
    along = rng.random(count) < 0.25
    ways[along] = (corners[:, 1] - corners[:, 0])[along]
    return starts, starts + ways
