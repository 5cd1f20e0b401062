"""Scenes whose answers are digested: files, and random scenes of boxes, balls and soups; metres."""

import tempfile
import zlib
from pathlib import Path

import numpy as np

import proximity
from proximity import Part, Pose, Scene, Solid

Mesh = tuple[np.ndarray, np.ndarray]
RANDOM_SCENES = (
    # number of parts, size of a part in m, distance of the scene from the origin in m
    (1, 0.1, 0.0),
    (3, 0.1, 0.0),
    (7, 1e-3, 0.0),
    (12, 0.05, 1e4),
    (40, 0.03, 0.0),
    (120, 10.0, 1e3),
)
BOX_FACES = [
    [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
    [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
]  # fmt: skip
SOUP_FACES = 60


def generator(name: str) -> np.random.Generator:
    """Return a generator seeded by *name* alone, so that no case changes another."""
    return np.random.default_rng(zlib.crc32(name.encode()))


def open_saved(scene: Scene) -> Scene:
    """Return *scene* written to a file and opened again."""
    with tempfile.TemporaryDirectory(prefix="proximity_digest_") as folder:
        path = Path(folder) / "scene.prox"
        scene.save(path)
        return proximity.load(path)


def box(size: tuple[float, float, float]) -> Mesh:
    """Return a box around the origin, 12 faces."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], dtype=np.float64)
    return (corners - 0.5) * size, np.array(BOX_FACES)


def ball(radius: float, around: int, up: int) -> Mesh:
    """Return a ball of rings of *around* vertices, *up* of them between the poles; closed."""
    height = np.cos(np.pi * np.arange(1, up + 1) / (up + 1))[:, None]
    turn = 2.0 * np.pi * np.arange(around) / around
    width = np.sqrt(1.0 - height * height)
    rings = np.stack(np.broadcast_arrays(width * np.cos(turn), width * np.sin(turn), height), axis=-1)
    vertices = radius * np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    column = np.arange(around)
    following = (column + 1) % around
    north, south, last = around * up, around * up + 1, around * (up - 1)
    faces = [np.stack([np.full(around, north), column, following], axis=1)]
    for first in range(0, last, around):
        a, b, c, d = first + column, first + following, first + around + column, first + around + following
        faces += [np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)]
    faces.append(np.stack([np.full(around, south), last + following, last + column], axis=1))
    return vertices, np.concatenate(faces)


def soup(size: float, rng: np.random.Generator) -> Mesh:
    """Return independent triangles, without an inside."""
    middles = rng.uniform(-0.5 * size, 0.5 * size, (SOUP_FACES, 1, 3))
    corners = middles + rng.normal(0.0, 0.1 * size, (SOUP_FACES, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * SOUP_FACES).reshape(-1, 3)


def hollow_ball(radius: float) -> Scene:
    """Return a ball with a hollow; all faces of the hollow are about equally far from the origin."""
    outer, inner = ball(1.2 * radius, 24, 12), ball(radius, 120, 60)
    faces = np.concatenate([outer[1], inner[1][:, ::-1] + len(outer[0])])
    return Scene.from_mesh(np.concatenate([outer[0], inner[0]]), faces, name="hollow ball")


def random_pose(rng: np.random.Generator, reach: float, offset: float = 0.0) -> Pose:
    """Return a pose with a random orientation, within *reach* of a point *offset* from the origin."""
    return Pose(random_rotation(rng), offset + rng.uniform(-reach, reach, 3))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a rotation matrix, from a random unit quaternion."""
    w, x, y, z = rng.normal(size=4)
    length = np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def random_scene(
    rng: np.random.Generator, part_count: int, size: float, offset: float = 0.0, *, has_soups: bool = True
) -> Scene:
    """Return boxes, balls and soups with random poses; they may overlap."""
    parts, reach = [], 1.2 * size * part_count ** (1.0 / 3.0)
    for number in range(part_count):
        kind = number % (3 if has_soups else 2)
        if kind == 0:
            mesh = box(tuple(size * rng.uniform(0.2, 1.0, 3)))
        elif kind == 1:
            mesh = ball(
                0.5 * size * rng.uniform(0.4, 1.0), int(rng.integers(6, 30)), int(rng.integers(3, 15))
            )
        else:
            mesh = soup(size, rng)
        solid = Solid(*mesh, name=f"solid {number}")
        rows = np.arange(solid.mesh.face_count, dtype=np.int32)
        parts.append(Part(f"part {number}", solid, random_pose(rng, reach, offset), rows))
    return Scene(parts)


def change_scene(scene: Scene, rng: np.random.Generator, size: float) -> None:
    """Deform one part, move one with a velocity, and hide one if others remain."""
    names = [part.name for part in scene.parts]
    bend_part(scene, names[0], 0.05 * size, 7.0 / size)
    moved = scene.part(names[len(names) // 2])
    step = rng.uniform(-0.3 * size, 0.3 * size, 3)
    pose = Pose(random_rotation(rng), moved.pose.translation + step)
    scene.move(moved.name, pose, velocity=step, angular_velocity=rng.normal(size=3))
    if len(names) > 2:
        scene.hide(names[-1])


def bend_part(scene: Scene, name: str, height: float, wave: float) -> None:
    """Deform a part: a wave along x moves its vertices in y."""
    vertices = scene.part(name).solid.mesh.vertices.copy()
    vertices[:, 1] += height * np.sin(wave * vertices[:, 0])
    scene.deform(name, vertices)
