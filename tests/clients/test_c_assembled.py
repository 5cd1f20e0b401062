"""Scenes with added and removed parts in the C library: bit-identical to Python."""

from dataclasses import replace

import mutated_scenes
import numpy as np
import pytest
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
