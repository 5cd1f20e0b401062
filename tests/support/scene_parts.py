"""Scenes for tests of changes between queries, and the queries."""

import judging
import numpy as np
import shapes

from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

KINDS = [shapes.tetrahedron, shapes.cube, shapes.octahedron, shapes.hollow_cube]


def part_of(mesh, name="part", pose=None, **values):
    solid = Solid(*mesh, name=name)
    rows = np.arange(solid.mesh.face_count, dtype=np.int32)
    return Part(name, solid, Pose() if pose is None else pose, rows, **values)


def some_pose(rng, spread):
    return Pose(shapes.rotation(int(rng.integers(2**31))), rng.uniform(-spread, spread, 3))


def some_parts(count, seed=1, *, is_turned=True):
    """Parts of several kinds and sizes, some of them fine, at random positions in a cube; they overlap."""
    rng = np.random.default_rng(seed)
    spread = 2.0 * count ** (1.0 / 3.0)
    parts = []
    for row in range(count):
        vertices, faces = shapes.torus() if row % 5 == 3 else KINDS[row % len(KINDS)]()
        mesh = vertices * rng.choice([0.1, 1.0, 2.0]), faces
        pose = some_pose(rng, spread)
        parts.append(part_of(mesh, f"part {row}", pose if is_turned else Pose(translation=pose.translation)))
    return parts


def some_questions(rng, count, spread=6.0):
    points, others = rng.uniform(-spread, spread, (2, count, 3))
    return points, others


def answers(scene, points, others, **how):
    """Run every query of a scene."""
    return [
        scene.closest(points, **how),
        scene.signed_distance(points, **how),
        scene.distance(points, **how),
        scene.contains(points, **how),
        scene.cast(points, others, **how),
        scene.cast_distance(points, others, **how),
        scene.closest_to_segments(points, others, **how),
        scene.signed_distance(points[:5], **how),
        scene.closest(points, max_distance=0.5, **how),
    ]


def assert_answers_alike(scene, other, points, others, **how):
    """*how*: the first of the scenes is asked."""
    found, expected = answers(scene, points, others, **how), answers(other, points, others)
    for number, (one, two) in enumerate(zip(found, expected, strict=True)):
        assert judging.same_bits(one, two), f"question {number}"


def assert_right_by_brute_force(scene, points):
    """Compare signed distances with the oracle's minimum over the visible parts."""
    each = np.full((len(scene.parts), len(points)), np.inf)
    for row, part in enumerate(scene.parts):
        if not part.is_hidden:
            mesh = part.solid.mesh
            own = part.pose.inverse.point(points)
            each[row] = judging.signed_distance(mesh.vertices, mesh.faces, own)
    room = 1e-12 * 100.0
    signed = scene.signed_distance(points)
    expected = each.min(axis=0)
    assert judging.is_near(signed, expected, room).all()
    assert judging.is_near(scene.distance(points), np.abs(each).min(axis=0), room).all()
    is_clear = np.abs(each).min(axis=0) > room
    assert np.array_equal(scene.contains(points)[is_clear], (each < 0.0).any(axis=0)[is_clear])


def anew(scene):
    """Make a scene of the current parts."""
    return Scene(scene.parts)
