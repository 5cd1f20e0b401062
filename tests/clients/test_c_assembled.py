"""Scenes with added and removed parts in the C library: bit-identical to Python."""

from dataclasses import replace

import judging
import mutated_scenes
import numpy as np
import pytest
import scene_parts
import shapes
from project import MESHES

import proximity
from benchmarks.digest.library import LibraryScene, LibraryTracker, through_library
from proximity import ArgumentError, Pose, PoseError, Scene, Solid
from proximity.core import library_in_c
from proximity.native import IS_AHEAD

pytestmark = [
    pytest.mark.filterwarnings("ignore::proximity.UnitsWarning"),
    pytest.mark.skipif(
        not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
        reason="the library is compiled with the kernels",
    ),
]
MS = 1_000_000
START = 1000 * MS


def answers(asked, seed=3, count=200):
    """Return the answers to queries near a scene, as bytes."""
    rng = np.random.default_rng(seed)
    lower, upper = asked.bounds
    points = rng.uniform(lower - 0.02, np.minimum(upper, lower + 0.4) + 0.02, (count, 3))
    return [
        np.array(asked.bounds).tobytes(),
        asked.closest(points)._table.tobytes(),
        asked.signed_distance(points).tobytes(),
        asked.cast(points, points[::-1] + 0.01)._table.tobytes(),
        asked.closest_to_segments(points, points[::-1])._table.tobytes(),
    ]


def some_pose(rng):
    return Pose(shapes.rotation(int(rng.integers(100))), rng.uniform(-0.1, 0.1, 3))


@pytest.mark.parametrize("make", mutated_scenes.SCENES.values(), ids=mutated_scenes.SCENES)
def test_scene_put_together_from_others_answers_as_that_of_python(make):
    whole, parts = LibraryScene(), []
    for part in make().parts:
        mesh = part.solid.mesh
        parts.append(replace(part, solid=Solid(mesh.vertices, mesh.faces), is_hidden=False))
        alone = Scene([Solid(mesh.vertices, mesh.faces, name=part.name)])
        whole.add(through_library(alone), part.pose.matrix)

    assert whole.names == [part.name for part in parts]
    assert answers(whole) == answers(Scene(parts))


def test_parts_come_and_go_as_in_python_and_trackers_go_on():
    rng = np.random.default_rng(21)
    scene, copy = (proximity.load(MESHES / "assembly.glb") for _ in range(2))
    tracker, python = LibraryTracker(copy, fingers=3), proximity.Tracker(scene, fingers=3)
    library, added, tips = tracker._scene, 0, rng.uniform(-0.05, 0.05, (3, 3))
    for k in range(60):
        if k % 5 == 0:
            pose, added = some_pose(rng), added + 1
            solid = Solid(*shapes.torus(0.02, 0.007, 20, 12), name=f"ring {added}")
            library.add(through_library(Scene([solid])), pose.matrix)
            scene.add(replace(Scene([solid]).parts[0], pose=pose))
        if k % 7 == 6:
            name = library.names[int(rng.integers(len(library.names)))]
            library.remove(name)
            scene.remove(name)
        if k % 3 == 0:
            name, pose = library.names[int(rng.integers(len(library.names)))], some_pose(rng)
            library.move_many([name], [pose.matrix])
            scene.move(name, pose)
        tips += rng.uniform(-0.001, 0.001, (3, 3))
        now = START + k * MS
        assert library.names == [part.name for part in scene.parts]
        assert tracker.tick(tips, now, now).tobytes() == python.tick(tips, now, now).tobytes()
        assert answers(library, k) == answers(scene, k)


def test_parts_are_ignored_as_in_python_while_they_come_and_go():
    rng = np.random.default_rng(22)
    scene, copy = (proximity.load(MESHES / "assembly.glb") for _ in range(2))
    tracker, python = LibraryTracker(copy, fingers=4), proximity.Tracker(scene, fingers=4)
    library, added, tips = tracker._scene, 0, rng.uniform(-0.05, 0.05, (4, 3))
    for k in range(200):
        if k % 5 == 0:
            pose, added = some_pose(rng), added + 1
            solid = Solid(*shapes.torus(0.02, 0.007, 20, 12), name=f"ring {added}")
            library.add(through_library(Scene([solid])), pose.matrix)
            scene.add(replace(Scene([solid]).parts[0], pose=pose))
        names = library.names
        for _ in range(rng.integers(4)):
            finger, name, is_ignored = int(rng.integers(4)), str(rng.choice(names)), bool(rng.integers(2))
            tracker.ignore(finger, name, is_ignored)
            python.ignore(finger, name, is_ignored)
        if k % 5 == 3:
            name = str(rng.choice(names))
            library.remove(name)
            scene.remove(name)
        if k % 3 == 0:
            name, pose = str(rng.choice(library.names)), some_pose(rng)
            library.move_many([name], [pose.matrix], [[0.1, 0.0, 0.2]], [[0.0, 1.0, 0.0]])
            scene.move(name, pose, velocity=[0.1, 0.0, 0.2], angular_velocity=[0.0, 1.0, 0.0])
        tips += rng.uniform(-0.001, 0.001, (4, 3))
        now = START + k * MS
        assert tracker.tick(tips, now, now).tobytes() == python.tick(tips, now, now).tobytes()
        ignored = [str(name) for name in rng.permutation(library.names)[: rng.integers(5)]]
        points, others = rng.uniform(-0.1, 0.1, (2, 60, 3))
        for found, expected in zip(
            scene_parts.answers(library, points, others, ignore=ignored),
            scene_parts.answers(scene, points, others, ignore=ignored),
            strict=True,
        ):
            assert judging.same_bits(found, expected)


def test_what_is_not_there_cannot_be_ignored():
    tracker = LibraryTracker(Scene([Solid(*shapes.cube(0.1, (0, 0, 0)), name="box")]), fingers=2)

    with pytest.raises(ArgumentError, match="there is no part -1, expected 0 to 0"):
        tracker.ignore(0, "lid")
    with pytest.raises(ArgumentError, match="there is no such tracker or finger"):
        tracker.ignore(2, "box")
    with pytest.raises(ArgumentError, match="there is no part -1, expected 0 to 0"):
        tracker._scene.distance([[0.0, 0, 0]], ignore=["lid"])
    assert tracker._scene.distance([[0.0, 0, 0]], ignore=["box"]) == np.inf


def test_empty_scene_is_refused_until_a_part_is_there():
    library = LibraryScene()
    with pytest.raises(ArgumentError, match="the scene has no parts, expected at least one"):
        library.signed_distance([[0.0, 0, 0]])

    library.add(through_library(Scene([Solid(*shapes.cube(0.1, (0, 0, 0)), name="box")])))

    assert library.names == ["box"]
    assert library.signed_distance([[0.0, 0, 0]])[0] < 0


@pytest.mark.parametrize(
    ("change", "error", "sentence"),
    [
        (lambda one, other: one.add(other), ArgumentError, "the scene has a part named 'box'"),
        (lambda one, other: one.add(one), ArgumentError, "expected two scenes"),
        (
            lambda one, other: one.add(LibraryScene()),
            ArgumentError,
            "expected two scenes, the added one with parts",
        ),
        (lambda one, other: one.remove("box"), ArgumentError, "it is the only part"),
        (lambda one, other: one.remove("gear"), ArgumentError, "there is no part -1, expected 0 to 0"),
    ],
)
def test_changes_that_cannot_be_made_are_refused_and_leave_everything(change, error, sentence):
    one, other = (through_library(Scene([Solid(*shapes.cube(0.1, (0, 0, 0)), name="box")])) for _ in range(2))
    before = answers(one)

    with pytest.raises(error, match=sentence):
        change(one, other)

    assert (one.names, answers(one)) == (["box"], before)


def test_added_part_needs_a_rigid_pose():
    one, other = (
        through_library(Scene([Solid(*shapes.cube(0.1, (0, 0, 0)), name=name)])) for name in ("box", "lid")
    )

    with pytest.raises(PoseError, match="part 'lid': the matrix scales by 1000"):
        one.add(other, np.diag([1000.0, 1000, 1000, 1]))

    assert one.names == ["box"]
