"""Queries that ignore parts: to the bit what a scene answers that has not got them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import judging
import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_parts import answers, assert_answers_alike, part_of, some_parts, some_pose, some_questions

from proximity.errors import ArgumentError, NotWatertightError, SceneError
from proximity.kernels.layout import NO_PART
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


def without(scene, names):
    """A scene made of the other parts, as they are now."""
    return Scene([part for part in scene.parts if part.name not in names])


def with_hidden(scene, names):
    return Scene([replace(part, is_hidden=part.is_hidden or part.name in names) for part in scene.parts])


def assert_as_without(scene, names, points, others):
    """The numbers of parts are those of the scene that has all of them."""
    assert_answers_alike(scene, with_hidden(scene, names), points, others, ignore=names)
    if not any(part.solid.has_inside for part in scene.parts if part.name not in names):
        return  # such a scene refuses `contains`, or has no parts
    kept = [row for row, part in enumerate(scene.parts) if part.name not in names]
    rows = np.array([*kept, NO_PART])
    expected = answers(without(scene, names), points, others)
    for one, two in zip(answers(scene, points, others, ignore=names), expected, strict=True):
        if hasattr(two, "part"):
            assert np.array_equal(one.part, rows[two.part])
            fields = [name for name in type(two)._fields if name != "part"]
            assert all(judging.same_bits(getattr(one, name), getattr(two, name)) for name in fields)
        else:
            assert judging.same_bits(one, two)


def some_of(rng, names):
    return [str(name) for name in rng.permutation(names)[: rng.integers(len(names) + 1)]]


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), count=st.integers(2, 14))
def test_answers_are_those_of_a_scene_without_the_parts(seed, count):
    """Of parts that overlap, stand still or move, are turned or not, and some of them hidden."""
    rng = np.random.default_rng(seed)
    scene = Scene(some_parts(count, seed=seed, is_turned=bool(seed % 2)))
    points, others = some_questions(rng, 40, 4.0)
    for _ in range(4):
        names = [part.name for part in scene.parts]
        assert_as_without(scene, some_of(rng, names), points, others)
        scene.move(str(rng.choice(names)), some_pose(rng, 3.0))
        name = str(rng.choice(names))
        scene.hide(name) if rng.integers(3) == 0 else scene.show(name)


@pytest.mark.parametrize("moved", [0, 3, 12])
def test_bodies_of_one_mesh_are_left_out_of_their_common_tree(moved):
    """Leaves of the scene's tree are nodes and blocks of parts."""
    bodies = [shapes.moved(shapes.torus(n=16, m=8), (3.0 * (k % 4), 3.0 * (k // 4), 0.0)) for k in range(16)]
    bodies += [shapes.moved(shapes.tetrahedron(), (1.5 + 3.0 * k, 1.5, 0.0)) for k in range(3)]
    scene = Scene.from_mesh(*shapes.join(*bodies))
    assert scene.snapshot().parts["is_fused"][:-1].all()
    rng = np.random.default_rng(moved)
    names = [part.name for part in scene.parts]
    for name in names[:moved]:
        scene.move(name, some_pose(rng, 5.0))
    points, others = rng.uniform(-3.0, 12.0, (2, 200, 3))
    for _ in range(5):
        assert_as_without(scene, some_of(rng, names), points, others)
    assert_as_without(scene, names, points, others)
    assert_as_without(scene, names[1:], points, others)


def nested(count=4):
    """Boxes in boxes, and a sheet through all of them."""
    boxes = [part_of(shapes.cube(2.0**-k, (0.0, 0.0, 0.0)), f"box {k}") for k in range(count)]
    vertices, faces = shapes.grid(1, 1)
    return Scene([*boxes, part_of(((vertices - 0.5) * (4.0, 4.0, 0.0), faces), "sheet")])


def test_parts_that_contain_others_are_left_out():
    scene, rng = nested(), np.random.default_rng(6)
    points, others = rng.uniform(-1.0, 1.0, (2, 300, 3))
    points[:20] = np.round(points[:20] * 4.0) / 4.0  # on faces, edges and corners
    names = [part.name for part in scene.parts]
    for chosen in range(2 ** len(names)):
        assert_as_without(scene, [name for k, name in enumerate(names) if chosen >> k & 1], points, others)

    assert scene.signed_distance([0.3, 0.0, 0.0], ignore=["box 0"]) == pytest.approx(0.0, abs=0.06)
    assert not scene.contains([0.4, 0.0, 0.0], ignore="box 0")


def test_only_part_may_be_ignored():
    scene = Scene([Solid(*shapes.cube(), name="box")])
    points, others = some_questions(np.random.default_rng(7), 50)

    assert_as_without(scene, ["box"], points, others)
    assert scene.distance(points[0], ignore="box") == np.inf


def test_parts_are_named_or_numbered_and_nothing_is_ignored_by_none():
    scene = Scene(some_parts(6))
    points, others = some_questions(np.random.default_rng(8), 60)
    expected = scene.distance(points, ignore=["part 1", "part 4"])

    assert judging.same_bits(scene.distance(points, ignore=(1, 4)), expected)
    assert judging.same_bits(scene.distance(points, ignore={"part 4", 1}), expected)
    assert judging.same_bits(scene.distance(points, ignore=iter(np.array([4, 1]))), expected)
    assert judging.same_bits(scene.distance(points, ignore=4), scene.distance(points, ignore="part 4"))
    assert_answers_alike(scene, scene, points, others, ignore=[])
    with pytest.raises(SceneError, match="no part is named 'part 9'; did you mean"):
        scene.closest(points, ignore=["part 9"])
    with pytest.raises(SceneError, match="no part is named -1"):
        scene.cast(points, others, ignore=-1)
    with pytest.raises(ArgumentError, match="ignore is 0, but a solid has no parts"):
        scene.parts[0].solid.distance(points, ignore=0)


def test_without_any_inside_nothing_is_contained_whoever_is_ignored():
    scene = Scene([nested().parts[-1], part_of(shapes.tetrahedron(), "solid")])

    assert not scene.contains([0.1, 0.1, 0.1], ignore="solid")
    with pytest.raises(NotWatertightError):
        Scene([nested().parts[-1]]).contains([0.0, 0.0, 0.0], ignore="sheet")


def test_many_rows_are_answered_on_threads_as_few():
    scene = Scene(some_parts(9))
    points, others = some_questions(np.random.default_rng(9), 5000)
    for workers in (1, 2):
        found = answers(scene, points, others, ignore=["part 2", "part 3"], workers=workers)
        few = answers(scene, points[:7], others[:7], ignore=["part 2", "part 3"])
        for one, two in zip(found[1:4], few[1:4], strict=True):
            assert judging.same_bits(one[:7], two)


def test_threads_ignore_different_parts_of_a_scene_that_moves():
    """The memory of a model is written anew once nobody has it: who ignores parts of it has it."""
    scene = Scene(some_parts(8))
    points, _ = some_questions(np.random.default_rng(10), 400)
    names = [part.name for part in scene.parts]
    expected = {name: scene.closest(points, ignore=[name, "part 0"])._table for name in names}
    rng = np.random.default_rng(11)

    def ask(name):
        return all(
            judging.same_bits(scene.closest(points, ignore=[name, "part 0"])._table, expected[name])
            for _ in range(60)
        )

    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(ask, name) for name in names]
        while not all(each.done() for each in asked):
            scene.move("part 0", some_pose(rng, 5.0))
            scene.distance(points[0])
    assert all(each.result() for each in asked)
