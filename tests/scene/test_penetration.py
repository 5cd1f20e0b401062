"""The displacement that frees a part from another: bounds, directions and invariances."""

import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st

from proximity import ArgumentError, PartTracker, Pose, Scene, SceneError, Solid
from proximity.scene.pairs import Relation

FREE = (Relation.APART, Relation.TOUCHING)


def boxes(offset, *, divisions: int = 0) -> Scene:
    """Two cubes with sides of 0.1 m, the second at an offset."""
    cube = shapes.cube(0.1, (0.0, 0.0, 0.0))
    for _ in range(divisions):
        cube = shapes.quartered(*cube)
    return Scene([Solid(*cube, name="a"), Solid(np.asarray(cube[0]) + np.asarray(offset), cube[1], name="b")])


def moved_relation(scene: Scene, direction: np.ndarray, length: float) -> Relation:
    """The relation of the first part to the second after a displacement."""
    scene.move("a", Pose(None, length * np.asarray(direction)))
    relation = scene.clearance("a", "b").relation
    scene.move("a", Pose())
    return relation


@pytest.mark.parametrize("divisions", [0, 2])
@pytest.mark.parametrize(
    ("direction", "depth"),
    [((-1, 0, 0), 0.03), ((1, 0, 0), 0.17), ((0, 0, -2), 0.09), ((-1, -1, 0), 0.03 * 2**0.5)],
)
def test_a_cube_is_as_deep_in_another_as_its_sides_say(divisions, direction, depth):
    found = boxes((0.07, 0.02, 0.01), divisions=divisions).penetration("a", "b", direction=direction)
    assert found.lower <= depth * (1.0 + 1e-12)
    assert found.depth >= depth * (1.0 - 1e-12)
    assert found.depth - found.lower <= 0.01 * found.depth
    assert np.allclose(found.direction, np.array(direction) / np.linalg.norm(direction))


def test_the_direction_found_is_the_shortest_of_a_cube_and_of_a_ball():
    assert boxes((0.07, 0.02, 0.01)).penetration("a", "b").depth == pytest.approx(0.03, rel=1e-9)
    ball = shapes.sphere(0.05, 4)
    apart = np.array([0.03, 0.04, 0.05])
    scene = Scene([Solid(*ball, name="a"), Solid(ball[0] + apart, ball[1], name="b")])
    found = scene.penetration("a", "b")
    assert found.depth == pytest.approx(0.1 - np.linalg.norm(apart), rel=0.02)
    assert found.direction @ (apart / np.linalg.norm(apart)) < -0.99


def test_bars_of_which_no_corner_is_inside_the_other():
    bar = shapes.cube(1.0, (0.0, 0.0, 0.0))
    scene = Scene(
        [
            Solid(bar[0] * [1.0, 0.1, 0.1], bar[1], name="a"),
            Solid(bar[0] * [0.1, 1.0, 0.1], bar[1], name="b"),
        ]
    )
    found = scene.penetration("a", "b")
    assert found.depth == pytest.approx(0.1, rel=1e-9)
    assert abs(found.direction[2]) == 1.0


def test_a_part_inside_another_comes_out_by_the_nearest_side():
    cube = shapes.cube(0.1, (0.0, 0.0, 0.0))
    scene = Scene([Solid(cube[0] * 0.2 + [0.01, 0, 0], cube[1], name="a"), Solid(*cube, name="b")])
    assert scene.penetration("a", "b").depth == pytest.approx(0.05, rel=1e-9)
    found = scene.penetration("a", "b", direction=(-1, 0, 0))
    assert found.lower <= 0.07 * (1.0 + 1e-12)
    assert found.depth == pytest.approx(0.07, rel=0.01)


def test_the_first_way_out_counts_where_there_is_a_second_obstacle():
    wall = shapes.cube(1.0, (0.0, 0.0, 0.0))
    walls = [(wall[0] * [0.02, 1, 1] + [x, 0, 0], wall[1]) for x in (0.0, 0.1)]
    both = (
        np.concatenate([vertices for vertices, _ in walls]),
        np.concatenate([wall[1], wall[1] + len(wall[0])]),
    )
    scene = Scene([Solid(wall[0] * 0.04 + [0.02, 0, 0], wall[1], name="a"), Solid(*both, name="b")])
    found = scene.penetration("a", "b", direction=(1, 0, 0))
    assert found.lower <= 0.01 * (1.0 + 1e-12)
    assert found.depth == pytest.approx(0.01, rel=0.02)


def test_parts_that_are_apart_or_touch_are_not_deep():
    for offset in ((0.2, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0.1)):
        found = boxes(offset).penetration("a", "b")
        assert (found.depth, found.lower) == (0.0, 0.0)


def test_sheets_have_no_depth_that_is_known_from_below():
    sheet = shapes.cube(0.1, (0.0, 0.0, 0.0))
    scene = Scene([Solid(sheet[0], sheet[1][:2], name="a"), Solid(sheet[0] + 0.01, sheet[1][4:6], name="b")])
    found = scene.penetration("a", "b")
    assert found.lower == 0.0 <= found.depth < np.inf


@given(
    st.integers(0, 2**32 - 1), st.floats(0.2, 0.9), st.sampled_from([None, (1.0, 0.3, -0.2), (0.0, 0.0, 1.0)])
)
def test_moved_by_the_depth_parts_are_free_and_by_less_than_the_lower_bound_they_are_not(
    seed, share, direction
):
    rng = np.random.default_rng(seed)
    ball = shapes.sphere(0.05, 2)
    parts = []
    for name in "ab":
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        stretched = ball[0] * rng.uniform(0.3, 1.5, 3) @ (turn * np.linalg.det(turn)).T
        parts.append(Solid(stretched + rng.uniform(-0.02, 0.02, 3), ball[1], name=name))
    scene = Scene(parts)
    found = scene.penetration("a", "b", direction=direction)
    assert 0.0 <= found.lower <= found.depth < np.inf
    assert moved_relation(scene, found.direction, found.depth * (1.0 + 1e-9) + 1e-9) in FREE
    for part in (share, 0.999):
        if found.lower > 1e-9:
            assert moved_relation(scene, found.direction, part * found.lower) not in FREE


def test_a_tracked_part_that_crosses_another_says_how_deep_and_which_way():
    scene = boxes((0.0, 0.0, 0.12))
    tracker = PartTracker(scene, "b")
    for tick in range(60):
        pose = Pose(None, [0.0003 * tick, 0.0, -0.001 * tick])
        record = tracker.tick(pose, 10**9 + 10**6 * tick, 10**9 + 10**6 * tick)[0]
        depth = max(0.001 * tick - 0.02, 0.0)
        assert record["depth_lower"] <= depth + 1e-12
        assert record["depth"] == pytest.approx(depth, rel=0.02, abs=1e-12)
        assert record["normal"] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_a_tracked_part_inside_another_is_led_to_the_nearest_side():
    around, inside = shapes.cube(0.1, (0.0, 0.0, 0.0)), shapes.cube(0.02, (0.02, 0.0, 0.0))
    tracker = PartTracker(Scene([Solid(*around, name="a"), Solid(*inside, name="b")]), "b")
    for tick in range(3):
        pose = Pose(None, [1e-4 * tick, 0.0, 0.0])
        record = tracker.tick(pose, 10**9 + 10**6 * tick, 10**9 + 10**6 * tick)[0]
        depth = 0.04 - 1e-4 * tick
        assert record["depth_lower"] <= depth * (1.0 + 1e-9)
        assert record["depth"] == pytest.approx(depth, rel=0.02)
        assert record["normal"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_a_tracked_part_that_touches_is_free_to_leave_and_not_to_enter():
    tracker = PartTracker(boxes((0.0, 0.0, 0.1)), "b")
    for velocity, is_free in (([0, 0, 0.1], True), ([0, 0, -0.1], False), ([0.1, 0, 0.1], True)):
        tracker.reset()
        record = tracker.tick(Pose(), 10**9, 10**9, velocity=velocity, angular_velocity=[0, 0, 0])[0]
        assert (tracker.free_time > 0.0) == is_free
        assert record["distance"] == 0.0
        assert record["normal"].tolist() == [0.0, 0.0, 1.0]
        assert (record["time_to_contact"] == np.inf) == is_free


@pytest.mark.parametrize("budget", [None, 1])
def test_a_part_that_touches_from_within_is_not_free(budget):
    scene = Scene(
        [
            Solid(*shapes.box((0, 0, 0), (4, 4, 4)), name="a"),
            Solid(*shapes.box((1, 1, 0), (2, 2, 1)), name="b"),
        ]
    )
    tracker = PartTracker(scene, "b", budget=budget)
    record = tracker.tick(Pose(), 10**9, 10**9, velocity=[0, 0, 0.1], angular_velocity=[0, 0, 0])[0]
    assert record["time_to_contact_lower"] == tracker.free_time == 0.0


@pytest.mark.parametrize("direction", [(0, 0, 0), (1, 2), (np.nan, 0, 0), (np.inf, 0, 0)])
def test_a_direction_that_is_none_is_refused(direction):
    with pytest.raises(ArgumentError, match="direction"):
        boxes((0.07, 0.0, 0.0)).penetration("a", "b", direction=direction)


def test_a_part_is_not_deep_in_itself():
    with pytest.raises(SceneError, match="itself"):
        boxes((0.07, 0.0, 0.0)).penetration("a", "a")
