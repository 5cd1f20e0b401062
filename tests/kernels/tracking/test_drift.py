"""Velocities of parts, and bounds of their displacement, compared with formulas and sampling."""

import numpy as np
import pytest
import shapes
from scene_parts import part_of

from proximity.kernels.geometry.frames import velocity_at
from proximity.kernels.layout import LANES, columns_of
from proximity.kernels.tracking.part_drift import (
    POSE_COLUMNS,
    Drift,
    Movers,
    contact_free_time,
    displacement_of_parts,
    gather_movers,
    gather_near,
    movers_workspace,
    part_travel,
)
from proximity.pose import Pose
from proximity.scene.scene import Scene

pytestmark = pytest.mark.internals

TIGHT = 1.0 + 1e-11


def scene_of(motions, corner=0.0):
    """Cubes with lower corners at *corner*, named by number, each at its own pose with velocities."""
    return Scene(
        [
            part_of(
                shapes.moved(shapes.cube(), [corner] * 3), f"{row}",
                Pose(shapes.rotation(row), (3.0 * row, 1.0, -2.0)),
                velocity=np.array(v, float), angular_velocity=np.array(w, float),
            )
            for row, (v, w) in enumerate(motions)
        ]
    )  # fmt: skip


def movers_of(scene):
    """The moving parts."""
    model = scene.snapshot()
    movers = movers_workspace(len(model.parts) - 1)
    return Movers(movers, *gather_movers(model.frames, model.parts, movers))


def near_of(scene, u=(0.0, 0.0, 0.0), x=(0.0, 0.0, 0.0), off=0.0, speed=0.0, unit=1.0, extent=1e9):
    """The drift of parts that may come near."""
    movers = movers_of(scene)
    numbers = map(float, (off, speed, unit, extent))
    near, _ = gather_near(movers, tuple(map(float, u)), tuple(map(float, x)), *numbers)
    return Drift(movers.rows, near, float(np.linalg.norm(u)) if movers.any_stands else 0.0)


def drift(scene, u=(0.0, 0.0, 0.0)):
    """Upper bound of the speed of all parts."""
    return part_travel(near_of(scene, u), 0.0, 1e9)[0]


def fastest_corner(scene, u):
    """Largest sampled speed relative to *u* of all corners of all parts at many later times."""
    rng, fastest = np.random.default_rng(1), 0.0
    for part in scene.parts:
        arms = part.pose.matrix[:3, :3] @ part.solid.mesh.vertices.T
        # Over time an arm rotates about the angular velocity; any such rotation is valid.
        axis = part.angular_velocity / max(np.linalg.norm(part.angular_velocity), 1e-300)
        for angle in rng.uniform(0, 2 * np.pi, 200):
            turned = (
                arms * np.cos(angle)
                + np.cross(axis, arms.T).T * np.sin(angle)
                + np.outer(axis, axis @ arms) * (1 - np.cos(angle))
            )
            speeds = part.velocity + np.cross(part.angular_velocity, turned.T) - u
            fastest = max(fastest, np.linalg.norm(speeds, axis=1).max())
    return fastest


def test_velocity_of_a_point_is_that_of_the_origin_and_of_turning_about_it():
    v, w = (0.3, -0.2, 0.1), (1.0, -2.0, 0.5)
    scene, point = scene_of([((0, 0, 0), (0, 0, 0)), (v, w)]), np.array([3.4, 1.2, -1.0])
    frames = scene.snapshot().frames

    assert velocity_at(frames[0], *point) == (0.0, 0.0, 0.0)
    expected = v + np.cross(w, point - (3.0, 1.0, -2.0))
    assert velocity_at(frames[1], *point) == pytest.approx(expected, rel=1e-14)


def test_parts_with_any_velocity_are_gathered_and_hidden_ones_left_out():
    scene = scene_of(
        [((0, 0, 0), (0, 0, 0)), ((0, 0, 1e-9), (0, 0, 0)), ((0, 0, 0), (0, 1, 0)), ((1, 0, 0),) * 2]
    )
    scene.hide("3")
    movers, count, stands = movers_of(scene)

    assert (count, stands) == (2, True)
    lowers = movers["lower"].reshape(-1, 3, LANES).swapaxes(1, 2).reshape(-1, 3)[:count]
    for name, lower in zip("12", lowers, strict=True):
        part = scene.part(name)
        corners = part.solid.mesh.vertices @ part.pose.rotation.T + part.pose.translation
        assert lower == pytest.approx(corners.min(axis=0), abs=1e-12)
    scene.hide("0")
    assert movers_of(scene)[1:] == (2, False)


def test_of_parts_that_only_go_straight_the_drift_is_the_largest_speed():
    scene = scene_of([((0.3, 0, 0), (0, 0, 0)), ((0, -0.5, 0), (0, 0, 0))])

    assert 0.5 <= drift(scene) <= 0.5 * TIGHT
    assert 0.8 <= drift(scene, (0, 0.3, 0)) <= 0.8 * TIGHT


def test_parts_that_stand_move_relative_to_one_that_goes():
    scene = scene_of([((0, 0, 0), (0, 0, 0)), ((0, 2.0, 0), (0, 0, 0))])

    assert 2.0 <= drift(scene, (0, 2.0, 0)) <= 2.0 * TIGHT
    scene.hide("0")
    assert drift(scene, (0, 2.0, 0)) == 0.0


@pytest.mark.parametrize(("corner", "farthest"), [(0.0, 1.0), (-0.7, 0.7), (-3.0, 3.0)])
def test_of_a_part_that_turns_the_drift_is_that_of_the_corner_farthest_from_its_origin(corner, farthest):
    speed = 3.0 * np.sqrt(3.0) * farthest

    assert speed * (1.0 - 1e-15) <= drift(scene_of([((0, 0, 0), (0, 0, 3.0))], corner)) <= speed * TIGHT


@pytest.mark.parametrize("seed", range(5))
def test_no_corner_is_ever_faster_than_the_drift(seed):
    rng = np.random.default_rng(seed)
    scene = scene_of(rng.normal(size=(4, 2, 3)) * rng.choice([0.0, 0.1, 3.0], (4, 2, 1)), -0.2 * seed)
    for _ in range(5):
        u = rng.normal(size=3)
        assert fastest_corner(scene, u) <= drift(scene, u)


def train(speeds, gap=1.0):
    """Cubes in a row along y from y = 1 on, *gap* apart, moving down."""
    return Scene(
        [
            part_of(shapes.cube(), f"{row}", Pose(np.eye(3), (0.0, 1.0 + gap * row, 0.0)),
                    velocity=np.array([0.0, -speed, 0.0]))
            for row, speed in enumerate(speeds)
        ]
    )  # fmt: skip


def test_a_part_counts_from_when_it_can_have_come():
    # 0.5 m and 1.5 m from a point at y = 0.5; the point moves toward both.
    scene = train([1.0, 4.0])
    near = near_of(scene, x=(0.5, 0.5, 0.5), speed=1.0)

    assert near.near_count == 2
    drift, faster = part_travel(near, 1.0, 0.0)
    assert drift == 0.0
    assert faster == pytest.approx(0.5 / 2.0)
    drift, faster = part_travel(near, 1.0, faster)
    assert 1.0 <= drift <= TIGHT
    assert faster == pytest.approx(1.5 / 5.0)
    assert part_travel(near, 1.0, faster) == (pytest.approx(4.0), np.inf)


def test_only_parts_that_may_come_in_time_are_gathered():
    scene = train(np.full(21, 1.0))

    for extent in (0.0, 0.1, 1.4, 3.4, 100.0):
        for off in (0.0, 0.2, 0.7):
            for unit in (0.5, 1.0):
                come = 0.5 + np.arange(21) - off <= (1.0 + unit) * extent
                near = near_of(scene, x=(0.5, 0.5, 0.5), off=off, speed=1.0, unit=unit, extent=extent)
                assert near.near_count == come.sum()


@pytest.mark.parametrize("seed", range(20))
def test_what_moves_is_never_nearer_than_gap_and_drift_allow(seed):
    """The remaining gap at any time, compared with the moved boxes."""
    rng = np.random.default_rng(seed)
    scene = scene_of(rng.normal(size=(19, 2, 3)) * rng.choice([0.0, 0.1, 3.0], (19, 2, 1)))
    x, u = rng.normal(size=3) * 10.0, rng.normal(size=3)
    near = near_of(scene, u, x, extent=1.0)
    for gone in np.append(0.0, rng.uniform(0.0, 1.0, 20)):
        drift, faster = part_travel(near, 0.0, gone)
        assert faster > gone
        for part in scene.parts:
            arms = part.pose.rotation @ part.solid.mesh.vertices.T
            middle, reach = part.pose.translation, np.linalg.norm(arms, axis=0).max()
            turn = reach * np.linalg.norm(part.angular_velocity)
            speed = np.linalg.norm(part.velocity - u) + turn
            # Parts that can arrive by then are counted; the others are still outside.
            lower, upper = (arms.T + middle).min(axis=0), (arms.T + middle).max(axis=0)
            gap = np.linalg.norm(np.maximum(np.maximum(lower - x, x - upper), 0.0))
            assert speed <= drift * TIGHT or gap >= speed * gone * (1.0 - 1e-9)


@pytest.mark.parametrize("count", [1, 8, 20])
def test_the_fastest_is_told_however_far_it_is(count):
    movers = movers_of(train(np.linspace(1.0, 3.0, count)))
    near, fastest = gather_near(movers, (0.0, 1.0, 0.0), (0.5, 0.5, 0.5), 0.0, 0.0, 0.5, 0.1)

    assert near == 0
    assert fastest == pytest.approx(0.5 * (1.0 + (3.0 if count > 1 else 1.0)))


def test_among_many_parts_none_is_lost():
    for count in (7, 8, 9, 40):
        assert near_of(train(np.linspace(1.0, 2.0, count)))[1] == count
        assert drift(train(np.linspace(1.0, 2.0, count))) == pytest.approx(2.0)


def test_a_clearance_lasts_until_what_has_come_by_then_may_use_it_up():
    near = near_of(train([1.0, 4.0]), x=(0.5, 0.5, 0.5), speed=1.0)

    for clearance, expected in (
        (0.1, 0.1),  # used up by the point itself
        (0.3, 0.25),  # the first part has arrived by then, and both may have used it up before
        (0.55, 0.275),  # both have used it up
        (0.7, 0.3),  # the second part arrives
        (2.0, 0.4),
    ):
        assert contact_free_time(near, 1.0, clearance) == pytest.approx(expected)
    nothing, slow = Drift(near.rows, 0, 0.0), Drift(near.rows, 0, 0.5)
    assert contact_free_time(nothing, 0.0, 0.1) == np.inf
    assert contact_free_time(nothing, 0.0, 0.0) == 0.0
    assert contact_free_time(slow, 0.5, 0.1) == pytest.approx(0.1)


def test_nothing_moves_nothing_counts():
    assert near_of(scene_of([((0, 0, 0), (0, 0, 0))] * 9))[1:] == (0, 0.0)
    assert part_travel(Drift(movers_workspace(9), 0, 0.25), 1.0, 1.0) == (0.25, np.inf)


def before(scene):
    model = scene.snapshot()
    return columns_of(model.frames)[:-1, :POSE_COLUMNS].copy()


def test_displacement_of_parts_is_how_far_the_farthest_corner_went_and_is_taken_once():
    scene = scene_of([((0, 0, 0), (0, 0, 0))] * 3)
    old = before(scene)
    poses = [Pose(shapes.rotation(9 + row), (3.0 * row, 1.5, -2.0)) for row in range(2)]
    expected = 0.0
    for part, pose in zip(scene.parts, poses, strict=False):
        corners = part.solid.mesh.vertices
        expected = max(expected, np.linalg.norm(pose.point(corners) - part.pose.point(corners), axis=1).max())
    scene.move_many(["0", "1"], poses)
    frames = scene.snapshot().frames

    assert expected <= displacement_of_parts(frames, old) <= expected * TIGHT
    assert displacement_of_parts(frames, old) == 0.0
    assert np.array_equal(old, before(scene))


def test_displacement_of_a_part_that_stands_is_nothing_and_of_a_step_its_length():
    scene = scene_of([((1, 2, 3), (4, 5, 6))])
    old = before(scene)
    assert displacement_of_parts(scene.snapshot().frames, old) == 0.0

    scene.move("0", Pose(shapes.rotation(0), (0.25, 1.0, -2.0)))
    assert 0.25 <= displacement_of_parts(scene.snapshot().frames, old) <= 0.25 * TIGHT
