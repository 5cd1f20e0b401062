"""How parts move at an instant, and how far any has moved since: by formula and by sampling."""

import numpy as np
import pytest
import shapes
from scene_parts import part_of

from proximity.kernels.drift import drift_from, gather_moving, velocity_of_part
from proximity.kernels.layout import ROTATION
from proximity.kernels.track import POSE_COLUMNS, way_of_parts
from proximity.pose import Pose
from proximity.scene import Scene

TIGHT = 1.0 + 1e-11


def scene_of(motions):
    """Cubes [0, 1]³ named by number, each turned and elsewhere, with velocity and angular velocity."""
    return Scene(
        [
            part_of(
                shapes.cube(), f"{row}", Pose(shapes.rotation(row), (3.0 * row, 1.0, -2.0)),
                velocity=np.array(v, float), angular_velocity=np.array(w, float),
            )
            for row, (v, w) in enumerate(motions)
        ]
    )  # fmt: skip


def drift(scene, u=(0.0, 0.0, 0.0)):
    model = scene._current()
    moving = np.full(len(model.parts) - 1, -7)
    count, stands = gather_moving(model.frames, model.parts, moving)
    return drift_from(model.frames, moving, count, stands, *map(float, u))


def fastest_corner(scene, u):
    """Of all corners of all parts at many instants to come, the largest speed relative to *u*."""
    rng, fastest = np.random.default_rng(1), 0.0
    for part in scene.parts:
        arms = part.pose.matrix[:3, :3] @ part.solid.mesh.vertices.T
        # As time goes on, an arm turns about the angular velocity; any such turn will do.
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
    frames = scene._current().frames

    assert velocity_of_part(frames, 0, *point) == (0.0, 0.0, 0.0)
    expected = v + np.cross(w, point - (3.0, 1.0, -2.0))
    assert velocity_of_part(frames, 1, *point) == pytest.approx(expected, rel=1e-14)


def test_parts_with_any_velocity_are_gathered_and_hidden_ones_left_out():
    scene = scene_of(
        [((0, 0, 0), (0, 0, 0)), ((0, 0, 1e-9), (0, 0, 0)), ((0, 0, 0), (0, 1, 0)), ((1, 0, 0),) * 2]
    )
    scene.hide("3")
    model, moving = scene._current(), np.full(4, -7)

    assert gather_moving(model.frames, model.parts, moving) == (2, True)
    assert moving.tolist() == [1, 2, -7, -7]
    scene.hide("0")
    model = scene._current()
    assert gather_moving(model.frames, model.parts, moving) == (2, False)


def test_of_parts_that_only_go_straight_the_drift_is_the_largest_speed():
    scene = scene_of([((0.3, 0, 0), (0, 0, 0)), ((0, -0.5, 0), (0, 0, 0))])

    assert 0.5 <= drift(scene) <= 0.5 * TIGHT
    assert 0.8 <= drift(scene, (0, 0.3, 0)) <= 0.8 * TIGHT


def test_parts_that_stand_move_relative_to_one_that_goes():
    scene = scene_of([((0, 0, 0), (0, 0, 0)), ((0, 2.0, 0), (0, 0, 0))])

    assert 2.0 <= drift(scene, (0, 2.0, 0)) <= 2.0 * TIGHT
    scene.hide("0")
    assert drift(scene, (0, 2.0, 0)) == 0.0


def test_of_a_part_that_turns_the_drift_is_that_of_the_corner_farthest_from_its_origin():
    scene = scene_of([((0, 0, 0), (0, 0, 3.0))])

    assert 3.0 * np.sqrt(3.0) <= drift(scene) <= 3.0 * np.sqrt(3.0) * TIGHT


@pytest.mark.parametrize("seed", range(5))
def test_no_corner_is_ever_faster_than_the_drift(seed):
    rng = np.random.default_rng(seed)
    scene = scene_of(rng.normal(size=(4, 2, 3)) * rng.choice([0.0, 0.1, 3.0], (4, 2, 1)))
    for _ in range(5):
        u = rng.normal(size=3)
        assert fastest_corner(scene, u) <= drift(scene, u)


def before(scene):
    model = scene._current()
    return model.frames[: len(model.parts) - 1, ROTATION : ROTATION + POSE_COLUMNS].copy()


def test_way_of_parts_is_how_far_the_farthest_corner_went_and_is_taken_once():
    scene = scene_of([((0, 0, 0), (0, 0, 0))] * 3)
    old = before(scene)
    poses = [Pose(shapes.rotation(9 + row), (3.0 * row, 1.5, -2.0)) for row in range(2)]
    expected = 0.0
    for part, pose in zip(scene.parts, poses, strict=False):
        corners = part.solid.mesh.vertices
        expected = max(expected, np.linalg.norm(pose.point(corners) - part.pose.point(corners), axis=1).max())
    scene.move_many(["0", "1"], poses)
    frames = scene._current().frames

    assert expected <= way_of_parts(frames, old) <= expected * TIGHT
    assert way_of_parts(frames, old) == 0.0
    assert np.array_equal(old, before(scene))


def test_way_of_a_part_that_stands_is_nothing_and_of_a_step_its_length():
    scene = scene_of([((1, 2, 3), (4, 5, 6))])
    old = before(scene)
    assert way_of_parts(scene._current().frames, old) == 0.0

    scene.move("0", Pose(shapes.rotation(0), (0.25, 1.0, -2.0)))
    assert 0.25 <= way_of_parts(scene._current().frames, old) <= 0.25 * TIGHT
