"""Scenes for ticks: parts by formula, in metres; seeds are fixed."""

from dataclasses import dataclass

import numpy as np

from benchmarks.queries.cases import Mesh
from benchmarks.support.project import project_module
from proximity import Pose, Scene, Solid
from proximity.scene.scene import Part

RADIUS = 0.007  # m, of a fingertip
PERIOD_NS = 1_000_000  # of a tick


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of the scenes."""

    plate: tuple[int, int]  # holes, sides of a hole
    freeform: tuple[int, int]  # quads around the ring and around the tube
    part_count: int
    moving_count: int
    kind: tuple[int, int]  # of a part among many: quads of a ring; the spheres have similar numbers
    kind_subdivisions: int
    skin_count: int
    skin_ground: tuple[int, int]
    cavity_subdivisions: int
    skin_plate: tuple[int, int]
    large_plate: tuple[int, int]


FULL = Sizes((225, 96), (320, 140), 200, 20, (50, 50), 4, 2000, (1000, 500), 8, (2604, 96), (784, 96))
SMALL = Sizes((4, 16), (24, 12), 20, 2, (8, 6), 1, 60, (40, 20), 3, (16, 16), (9, 16))
"""Sizes for the smoke test, whose figures are meaningless."""


def plate(counts: tuple[int, int]) -> Mesh:
    """Return a plate with *counts*: holes of 10 mm, and sides of each: needles, typical of CAD."""
    return project_module("meshes", "make").plate(*counts)


def freeform(counts: tuple[int, int], size: float = 0.15) -> Mesh:
    """Return a ring with bumps and hollows, *size* long: even triangles, curved everywhere."""
    ring = project_module("meshes", "make").torus(1.0, 0.4, *counts)
    vertices, faces = ring
    turn = np.arctan2(vertices[:, 1], vertices[:, 0])
    spine = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    out = (vertices - spine) / 0.4
    around = np.arctan2(out[:, 2], (out * spine).sum(axis=1))
    bumps = 1.0 + 0.2 * np.sin(3 * turn + 2 * around) + 0.1 * np.sin(8 * turn) * np.cos(3 * around)
    vertices = spine * (1.0 + 0.08 * np.cos(2 * turn))[:, None] + 0.4 * bumps[:, None] * out
    return vertices * (size / np.ptp(vertices[:, 0])), faces


def cavity(sizes: Sizes, radius: float = 0.1) -> Mesh:
    """Return a ball with a spherical hollow whose corners are all equally far from the centre."""
    shapes = project_module("tests/support", "shapes")
    hollow = shapes.inside_out(shapes.sphere(radius, sizes.cavity_subdivisions))
    return shapes.join(shapes.sphere(1.2 * radius, 3), hollow)


def face_count(scene: Scene) -> int:
    """Return the number of faces of all parts of a scene."""
    return sum(part.solid.mesh.face_count for part in scene.parts)


def scene_of(mesh: Mesh, name: str = "part") -> Scene:
    """Return a scene of one part; the mesh is a body without changes."""
    return Scene([Solid(*mesh, name=name)])


def many_parts(sizes: Sizes) -> Scene:
    """Return parts of three kinds, 50 mm long, randomly turned, on a lattice of 80 mm in two layers."""
    make = project_module("meshes", "make")
    turned = project_module("tests/support", "shapes").rotation
    solids = [
        Solid(*make.torus(0.018, 0.007, *sizes.kind), name="ring"),
        Solid(*freeform(sizes.kind, 0.05), name="bumps"),
        Solid(*make.sphere(0.020, sizes.kind_subdivisions), name="ball"),
    ]
    columns = int(np.ceil(np.sqrt(sizes.part_count / 2)))
    parts = []
    for row in range(sizes.part_count):
        position = 0.08 * np.array([row // 2 % columns, row // 2 // columns, row % 2], dtype=np.float64)
        solid = solids[row % len(solids)]
        rows = np.arange(solid.mesh.face_count, dtype=np.int32)
        parts.append(Part(f"part {row}", solid, Pose(turned(row), position), rows))
    return Scene(parts)
