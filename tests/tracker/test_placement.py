"""Default placement of a recorded hand: near the parts, and touching them."""

import make
import numpy as np
import pytest

from proximity.errors import PoseError, SceneError
from proximity.pose import Pose
from proximity.recording import Recording
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid
from proximity.tracker.placement import fitted_pose, turn_about_axes

RADIUS = 0.005
FINGERS = ((0, 1), (0, 2))


@pytest.fixture(scope="module")
def scene():
    """The box [0, 40] x [0, 30] x [0, 20] mm."""
    return Scene([Solid(*make.box(), name="box")])


def scattered(count, size, *, seed=5):
    """Return a recording of a point at random positions, *size* metres wide."""
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 1, 3)) * size + [3.0, -2.0, 1.0]
    return Recording(np.arange(count) * 10_000_000, points, ((0, 0),))


def touching_share(scene, recording, pose, scale=1.0):
    return (scene.signed_distance(recording.placed(pose, scale).positions) <= RADIUS).mean()


def test_hand_of_fitting_size_goes_to_the_middle(scene):
    recording = scattered(500, 0.1)

    pose = fitted_pose(scene, recording, RADIUS)

    lower, upper = recording.placed(pose).middle()
    np.testing.assert_allclose(0.5 * (lower + upper), [0.020, 0.015, 0.010], atol=1e-12)
    assert 0.02 < touching_share(scene, recording, pose) <= 0.1


def test_hand_inside_a_large_part_is_raised_until_a_tenth_touches():
    large = Scene([Solid(*make.box(upper=(1.0, 1.0, 1.0)), name="large")])
    recording = scattered(500, 0.1)

    pose = fitted_pose(large, recording, RADIUS, scale=0.5)

    assert 0.09 <= touching_share(large, recording, pose, 0.5) <= 0.1
    assert recording.placed(pose, 0.5).positions[..., 2].max() > 1.0


def test_hand_around_a_small_part_is_brought_to_it():
    small = Scene([Solid(*make.box(upper=(0.001, 0.001, 0.001)), name="small")])
    angles = np.linspace(0.0, 6.0, 50)
    ring = 0.05 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    recording = Recording(np.arange(50) * 10_000_000, ring[:, None], ((0, 0),))

    pose = fitted_pose(small, recording, RADIUS)

    distances = small.signed_distance(recording.placed(pose).positions)
    assert distances.min() == pytest.approx(0.5 * RADIUS, rel=1e-9)


def test_hand_that_rests_on_a_part_is_pressed_in(scene):
    """A finger at rest touches in all samples or none; raised until a tenth touch, it would never touch."""
    resting = Recording(np.arange(50) * 10_000_000, np.zeros((50, 1, 3)), ((0, 0),))

    pose = fitted_pose(scene, resting, RADIUS)

    distances = scene.signed_distance(resting.placed(pose).positions)
    np.testing.assert_allclose(distances, 0.5 * RADIUS, rtol=1e-9)


def test_hand_is_not_fitted_to_parts_that_are_hidden(scene):
    hidden = Scene([Part("box", scene.parts[0].solid, Pose(), np.arange(12), is_hidden=True)])

    with pytest.raises(SceneError, match="all parts are hidden, expected one that a recording can be fitted"):
        fitted_pose(hidden, scattered(50, 0.1), RADIUS)


def test_fitted_hand_keeps_its_attitude(scene):
    turn = turn_about_axes((90.0, 0.0, 0.0))

    pose = fitted_pose(scene, scattered(200, 0.3), RADIUS, rotation=turn)

    np.testing.assert_array_equal(pose.rotation, turn)


def test_turns_are_about_x_then_y_then_z():
    turned = Pose(turn_about_axes((90.0, 90.0, 0.0))).point([0.0, 1.0, 0.0])

    np.testing.assert_array_equal(turned, [1.0, 0.0, 0.0])  # y to z by the first, z to x by the second
    np.testing.assert_array_equal(turn_about_axes((0.0, 0.0, 0.0)), np.eye(3))
    np.testing.assert_allclose(
        turn_about_axes((0.0, 0.0, 30.0)) @ [1.0, 0.0, 0.0], [np.sqrt(0.75), 0.5, 0.0], atol=1e-15
    )


def test_turn_that_is_none_is_refused():
    with pytest.raises(PoseError, match="a rotation of nan degrees about y, expected finite numbers"):
        turn_about_axes((0.0, np.nan, 0.0))
