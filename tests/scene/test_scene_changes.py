"""Parts that are added, removed and hidden, and change their contact properties."""

import gc
import re
import weakref

import judging
import numpy as np
import pytest
import shapes
from scene_parts import (
    anew,
    answers,
    assert_answers_alike,
    assert_right_by_brute_force,
    part_of,
    some_parts,
    some_pose,
    some_questions,
)

from proximity.errors import ArgumentError, SceneError
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


def assert_nothing_is_there(scene):
    points, others = some_questions(np.random.default_rng(1), 60)
    for count in (1, 60):
        hit = scene.closest(points[:count])
        assert (hit.signed_distance == np.inf).all() and (hit.face_id == -1).all() and (hit.part == -1).all()
        assert np.isnan(hit.point).all() and not hit.is_signed.any()
        assert (scene.signed_distance(points[:count]) == np.inf).all()
        assert (scene.distance(points[:count]) == np.inf).all()
        assert not scene.contains(points[:count]).any()
        rays = scene.cast(points[:count], -points[:count])
        assert (rays.distance == np.inf).all() and (rays.face_id == -1).all() and (rays.part == -1).all()
        connection = scene.closest_to_segments(points[:count], others[:count])
        assert (connection.distance == np.inf).all() and (connection.face_id == -1).all()
        dots = scene.closest_to_segments(points[:count], points[:count])
        assert (dots.distance == np.inf).all() and (dots.part == -1).all()
    assert np.isnan(scene.signed_distance((np.nan, 0.0, 0.0)))


@pytest.mark.parametrize("is_loose", [False, True], ids=["still", "moved"])
@pytest.mark.parametrize("count", [1, 9])
def test_scene_with_every_part_hidden_answers_that_nothing_is_there(count, is_loose):
    parts = some_parts(count)
    scene = Scene(parts)
    points, others = some_questions(np.random.default_rng(2), 30)
    if is_loose:
        scene.move_many([part.name for part in parts], [Pose(shapes.rotation(3))] * count)
    before = answers(scene, points, others)

    for part in parts:
        scene.hide(part.name)

    assert_nothing_is_there(scene)
    assert_nothing_is_there(anew(scene))
    for part in parts:
        scene.show(part.name)
    for found, expected in zip(answers(scene, points, others), before, strict=True):
        assert judging.same_bits(found, expected)


@pytest.mark.parametrize("is_loose", [False, True], ids=["still", "moved"])
def test_hidden_part_is_found_by_no_question_and_indices_stay(is_loose):
    scene = Scene(some_parts(9))
    rng = np.random.default_rng(3)
    points, others = some_questions(rng, 100)
    if is_loose:
        scene.move_many(["part 2", "part 5"], [some_pose(rng, 3.0) for _ in range(2)])

    for name in ("part 2", "part 5"):
        scene.hide(name)

    assert_right_by_brute_force(scene, points)
    without = Scene([part for part in scene.parts if not part.is_hidden])
    kept = np.array([0, 1, 3, 4, 6, 7, 8])
    hit, expected = scene.closest(points), without.closest(points)
    assert judging.same_bits(hit.signed_distance, expected.signed_distance)
    assert np.array_equal(hit.part, kept[expected.part])
    rays, first = scene.cast(points, others), without.cast(points, others)
    assert judging.same_bits(rays.distance, first.distance)
    assert np.array_equal(rays.part, np.where(first.part < 0, -1, kept[first.part]))
    assert [part.is_hidden for part in scene.parts] == [row in (2, 5) for row in range(9)]
    assert scene.part("part 2").solid.distance((0.0, 0.0, 0.0)) < np.inf


def test_part_may_move_while_it_is_hidden():
    scene = Scene(some_parts(5))
    rng = np.random.default_rng(4)
    points, others = some_questions(rng, 60)
    scene.hide("part 1")
    scene.distance(points)

    scene.move("part 1", some_pose(rng, 3.0))

    assert_answers_alike(scene, anew(scene), points, others)
    scene.show("part 1")
    assert_answers_alike(scene, anew(scene), points, others)
    assert_right_by_brute_force(scene, points)


def test_hiding_what_is_hidden_changes_nothing():
    scene = Scene(some_parts(3))
    assert scene.epoch == 0
    scene.show("part 1")
    assert scene.epoch == 0

    scene.hide("part 1")
    model = scene.snapshot()
    scene.hide("part 1")

    assert scene.snapshot() is model
    assert scene.epoch == model.epoch == 1
    scene.show("part 1")
    assert scene.epoch == scene.snapshot().epoch == 2


def test_bounds_are_those_of_hidden_parts_too():
    scene = Scene(some_parts(5))
    before = scene.bounds

    scene.hide("part 4")

    assert judging.same_bits(np.array(scene.bounds), np.array(before))


def test_added_part_is_found_and_others_stay_as_they_are():
    scene = Scene(some_parts(6))
    rng = np.random.default_rng(5)
    points, others = some_questions(rng, 60)
    scene.move("part 2", some_pose(rng, 3.0), velocity=(1.0, 2.0, 3.0))
    scene.hide("part 3")
    scene.set_surface("part 4", stiffness=100.0, damping=1.0)

    scene.add(part_of(shapes.torus(), "ring", some_pose(rng, 2.0), velocity=(0, 0, 1), stiffness=5.0))

    assert [part.name for part in scene.parts] == [f"part {row}" for row in range(6)] + ["ring"]
    assert_answers_alike(scene, anew(scene), points, others)
    assert_right_by_brute_force(scene, points)
    model = scene.snapshot()
    assert np.flatnonzero(model.parts["is_dynamic"][:-1]).tolist() == [2]
    assert np.flatnonzero(model.parts["is_hidden"][:-1]).tolist() == [3]
    assert model.frames["velocity"][2].tolist() == [1, 2, 3]
    assert model.frames["velocity"][6].tolist() == [0, 0, 1]
    assert model.frames["stiffness"][[4, 6]].tolist() == [100.0, 5.0]
    assert scene.epoch == model.epoch == 2


def test_removed_part_goes_on_answering_and_may_come_back():
    scene = Scene(some_parts(6))
    rng = np.random.default_rng(6)
    points, others = some_questions(rng, 60)
    scene.move_many(["part 1", "part 4"], [some_pose(rng, 3.0) for _ in range(2)])
    before, part = answers(scene, points, others), scene.part("part 5")
    alone = part.solid.closest(points)

    scene.remove("part 5")

    assert [each.name for each in scene.parts] == [f"part {row}" for row in range(5)]
    assert np.flatnonzero(scene.snapshot().parts["is_dynamic"][:-1]).tolist() == [1, 4]
    assert_answers_alike(scene, anew(scene), points, others)
    assert judging.same_bits(part.solid.closest(points), alone)
    scene.remove("part 0")
    assert np.flatnonzero(scene.snapshot().parts["is_dynamic"][:-1]).tolist() == [0, 3]
    assert scene.part("part 1") is scene.parts[0]
    scene.add(part)
    assert judging.same_bits(scene.parts[-1].solid.closest(points), alone)
    assert_answers_alike(scene, anew(scene), points, others)
    assert scene.epoch == 3
    assert len(before) == 9


def test_removed_part_does_not_hold_on_to_the_scene():
    scene = Scene([Solid(*shapes.torus(n=60, m=40), name="large"), Solid(*shapes.cube(), name="small")])
    words = weakref.ref(scene.snapshot().words)
    small = scene.part("small").solid

    scene.remove("small")
    gc.collect()

    assert words() is None
    assert small.memory_bytes < 100_000
    assert small.distance((2.0, 0.5, 0.5)) == 1.0


def test_faces_are_told_right_when_a_part_that_moved_is_the_only_one_left():
    """Regression: the list of dynamic parts was written over the faces of a scene's only part."""
    solid = Solid(*shapes.cube(), name="cube")
    points = np.random.default_rng(7).uniform(-1.0, 2.0, (100, 3))
    before = solid.closest(points).face_id
    scene = Scene([solid, Solid(*shapes.torus(), name="other")])
    scene.move("cube", Pose(translation=(1.0, 0.0, 0.0)))
    assert np.array_equal(scene.part("cube").solid.closest(points).face_id, before)

    scene.remove("other")

    assert np.array_equal(scene.part("cube").solid.closest(points).face_id, before)
    shifted = points + np.array([1.0, 0.0, 0.0])
    assert np.array_equal(scene.closest(shifted).face_id, before)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda scene: scene.add(part_of(shapes.cube(), "part 1")),
         "a part is named 'part 1' already, expected another name"),
        (lambda scene: scene.add(part_of(shapes.cube(), 7)), "the part to add is named 7, expected text"),
        (lambda scene: scene.remove("lid"), "no part is named 'lid'; the scene has 'part 0', 'part 1'"),
        (lambda scene: scene.show(None), "no part is named None; the scene has 'part 0', 'part 1'"),
    ],
)  # fmt: skip
def test_change_that_does_not_fit_is_refused(change, message):
    scene = Scene(some_parts(2))

    with pytest.raises(SceneError, match=f"^{re.escape(message)}$"):
        change(scene)

    assert [part.name for part in scene.parts] == ["part 0", "part 1"]
    assert scene.epoch == 0


def test_last_part_cannot_be_removed():
    scene = Scene(some_parts(1))
    message = "part 'part 0' is the only one and cannot be removed: hide it instead"

    with pytest.raises(SceneError, match=f"^{re.escape(message)}$"):
        scene.remove("part 0")

    assert scene.distance((0.0, 0.0, 0.0)) < np.inf


def test_surface_is_rigid_unless_a_stiffness_is_given():
    scene = Scene([part_of(shapes.cube(), "a"), part_of(shapes.cube(), "b", stiffness=200.0, damping=0.5)])
    columns = ["surface", "stiffness", "damping"]
    assert scene.snapshot().frames[columns][:2].tolist() == [(1.0, 0.0, 0.0), (2.0, 200.0, 0.5)]

    scene.set_surface("a", stiffness=300.0)
    scene.set_surface("b")

    assert scene.snapshot().frames[columns][:2].tolist() == [(2.0, 300.0, 0.0), (1.0, 0.0, 0.0)]
    assert [(part.stiffness, part.damping) for part in scene.parts] == [(300.0, 0.0), (None, 0.0)]


@pytest.mark.parametrize(
    "values, message",
    [
        ({"stiffness": 0.0}, "stiffness of part 'a' is 0.0, expected a positive number of N/m, or None"),
        ({"stiffness": "soft"}, "stiffness of part 'a' is 'soft', expected a positive number of N/m"),
        ({"stiffness": 1.0, "damping": -1.0}, "damping of part 'a' is -1.0, expected a number of N s/m"),
        ({"damping": 1.0}, "part 'a' is rigid (no stiffness), but has a damping of 1 N s/m"),
    ],
)
def test_surface_that_is_none_is_refused(values, message):
    scene = Scene([part_of(shapes.cube(), "a")])

    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}"):
        scene.set_surface("a", **values)
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}"):
        Scene([part_of(shapes.cube(), "a", **values)])
