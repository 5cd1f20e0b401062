"""Predictions of a tick, against closed forms: the distance when the controller acts, and time to contact."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, block, contact, line, moving_block, near, plate, sheet, solid, tick_path

from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker


def test_distance_is_predicted_for_when_the_controller_acts():
    """The pose is 4 ms old, the controller acts 3 ms later; a finger decelerates a little, at most 4 %."""
    tracker = Tracker(Scene([plate()]), fingers=1, latency=0.003)
    found = tracker.tick([(0, 0, 0.05)], 6 * MS, 10 * MS, velocities=[(0, 0, -1.0)])[0]

    assert found["predicted_ns"] == 13 * MS
    assert 0.043 - 0.007 <= found["predicted_distance"] <= 0.043 - 0.96 * 0.007
    room = 0.5 * 120.0 * 0.007**2 - 1e-12  # effect of the acceleration, less rounding
    assert found["predicted_lower"] <= 0.036 - room and 0.036 + room <= found["predicted_upper"]
    assert found["predicted_upper"] - found["predicted_lower"] < 2 * room + 0.002


def test_pose_from_after_the_controller_acts_is_predicted_for_its_own_instant():
    """The tracker's clock is ahead: a prediction backwards would only lose precision."""
    tracker = Tracker(Scene([plate()]), fingers=2, latency=0.003)
    tips = [(0, 0, 0.05), (0.02, 0, 0.05)]
    found = tracker.tick(tips, [20 * MS, 10 * MS], 10 * MS, velocities=[(0, 0, -1.0)] * 2)

    assert found["predicted_ns"].tolist() == [20 * MS, 13 * MS]
    ahead = found["predicted_ns"] - found["pose_ns"]
    assert ahead.tolist() == [0, 3 * MS]
    assert found["predicted_distance"][0] == found["predicted_lower"][0] == found["signed_distance"][0]
    assert found["predicted_distance"][1] < found["signed_distance"][1]


@pytest.mark.parametrize(
    ("settings", "gap", "age"),
    [({}, 0.1, 0.001), ({}, 0.06, 0.01), ({"max_speed": 1.0, "max_acceleration": 500.0}, 0.0085, 0.001)],
)
def test_a_finger_that_turns_round_between_its_first_poses_stays_within_its_bounds(settings, gap, age):
    """At the latest instant and the highest speed: the mean velocity is opposite to the actual one."""
    limits = {"max_speed": 3.0, "max_acceleration": 120.0} | settings
    speed, acceleration = limits["max_speed"], limits["max_acceleration"]
    turning = 2.0 * speed / acceleration  # s, for reversing at full speed

    def place(t):
        late = max(t - (gap - turning), 0.0)
        slower = min(late, turning)
        return speed * (t - late) + (speed - 0.5 * acceleration * slower) * slower - speed * (late - slower)

    scene = Scene([block("block", (0, 0, 0))])
    tracker = Tracker(scene, fingers=1, radius=0.0, latency=age, **settings)
    for t in (0.0, gap):
        instant = round(1e9 * t)
        found = tracker.tick([(-2.0 + place(t), 0, 0)], instant, instant)[0]
    true = float(scene.signed_distance([-2.0 + place(gap + age), 0.0, 0.0]))

    assert found["flags"] & ContactFlag.PREDICTED
    assert found["predicted_lower"] <= true <= found["predicted_upper"]


@pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")  # fifty metres from a block of ten centimetres
@pytest.mark.parametrize("velocity", [None, 4.0, 7.0])
def test_a_finger_faster_than_it_should_be_stays_within_bounds_if_it_goes_on(velocity):
    """Poses 1 ms apart may be 5 mm farther apart than the speed allows; a given velocity is trusted."""
    speed, scene = velocity or 4.0, Scene([block("block", (0, 0, 0))])
    tracker = Tracker(scene, fingers=1, radius=0.0, latency=0.3)
    told = None if velocity is None else [(velocity, 0.0, 0.0)]
    for k in range(20):
        found = tracker.tick([(-50.0 + speed * 1e-3 * k, 0, 0)], k * MS, k * MS, velocities=told)[0]
    true = float(scene.signed_distance([-50.0 + speed * (0.019 + 0.3), 0.0, 0.0]))

    assert not found["flags"] & ContactFlag.JUMPED
    assert found["predicted_lower"] <= true <= found["predicted_upper"]


def test_bounds_of_a_prediction_widen_with_the_age_of_the_pose():
    scene = Scene([plate()])
    widths = []
    for age in (0, 5, 10, 40, 100):
        tracker = Tracker(scene, fingers=1)
        found = tracker.tick([(0, 0, 0.05)], 0, age * MS, velocities=[(0, 0, -0.1)])[0]
        widths.append(found["predicted_upper"] - found["predicted_lower"])

    assert (np.diff(widths) > 0.0).all()


def test_finger_at_rest_near_a_part_that_comes_is_predicted_nearer():
    found = contact(moving_block((0, 0, 0.5)), (0, 0, 0.1), (0, 0, 0), latency=0.002)

    assert found["predicted_distance"] == near(0.05 - RADIUS - 0.001)
    assert found["predicted_lower"] <= found["predicted_distance"] <= found["predicted_upper"]


@pytest.mark.parametrize("angular_velocity", [(0, 0, 0), (1e9, -1e9, 1e9)])
@pytest.mark.parametrize("age", [0, 1, 2**62])
def test_as_fast_as_parts_may_be_nothing_is_promised_that_does_not_hold(angular_velocity, age):
    scene = Scene([plate(), solid(shapes.sphere(0.01, 1), "ball")])
    scene.move(
        "ball", Pose(translation=(0, 0, 1)), velocity=(1e9, 1e9, -1e9), angular_velocity=angular_velocity
    )
    tracker = Tracker(scene, fingers=2)
    for pose_ns in (-age, -age + 1):
        found = tracker.tick([(0, 0, 0.05), (0, 0, 0.95)], pose_ns, 0)

    assert (found["time_to_contact_lower"] <= 1e-9).all()
    # The ball may be anywhere by then; the plate is at rest.
    assert (found["predicted_lower"] <= 0.05 - RADIUS).all() and (found["predicted_upper"] >= 0.95).all()


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [
        ((0, 0, -1.0), 0.043),  # head-on
        ((0.6, 0, -0.8), 0.043 / 0.8),  # oblique
        ((0.4, 0, -0.2), 0.043 / 0.2),  # nearly tangential
        ((0, 0, 1.0), np.inf),  # leaving
        ((0.3, 0, 0.0), np.inf),  # tangential
        ((0, 0, 0), np.inf),  # at rest
        ((0, 0, -0.1), np.inf),  # not within the horizon
    ],
)
def test_time_to_contact_with_a_plate(velocity, expected):
    found = contact([plate(half=0.5)], (0, 0, 0.05), velocity)

    assert found["time_to_contact"] == pytest.approx(expected, rel=1e-3)
    assert found["time_to_contact_lower"] <= expected
    if np.isfinite(expected):
        assert found["time_to_contact_lower"] >= 0.9 * expected


def test_where_no_contact_comes_the_bound_is_the_time_looked_at():
    """The horizon, or the time to leave the working range if shorter; at least a tenth of the horizon."""
    at_rest = contact([plate()], (0, 0, 0.05), (0, 0, 0), horizon=0.2)
    leaving = contact([plate()], (0, 0, 0.05), (0, 0, 1.0), horizon=0.2)
    fast = contact([plate()], (0, 0, 0.05), (0, 0, 100.0), horizon=0.2)

    assert [each["time_to_contact"] for each in (at_rest, leaving, fast)] == [np.inf] * 3
    assert at_rest["time_to_contact_lower"] == 0.2
    assert leaving["time_to_contact_lower"] == pytest.approx(0.12)
    assert fast["time_to_contact_lower"] == pytest.approx(0.02)


def test_sphere_that_passes_a_corner_closely_does_not_touch_it_and_a_little_lower_does():
    parts = [block("block", (0, 0, 0))]
    for height, is_hit in ((0.05 + 1.001 * RADIUS, False), (0.05 + 0.999 * RADIUS, True)):
        found = contact(parts, (-0.1, 0, height), (1.0, 0, 0))
        drop = height - 0.05
        true = 0.05 - np.sqrt(RADIUS**2 - drop**2) if is_hit else np.inf
        assert found["time_to_contact_lower"] <= true
        assert found["time_to_contact_lower"] >= 0.03
        if is_hit:
            assert found["time_to_contact"] <= true + 1e-3


@pytest.mark.parametrize("speed", [1.0, 100.0])
@pytest.mark.parametrize("thing", [sheet(), plate(thickness=1e-6)])
def test_nothing_thin_is_passed_however_fast(speed, thing):
    found = contact([thing], (0.03, 0.01, 0.05), (0.0, 0, -speed), max_speed=200.0)

    assert found["time_to_contact_lower"] <= 0.043 / speed
    assert found["time_to_contact"] == pytest.approx(0.043 / speed, rel=1e-3)


@pytest.mark.parametrize(
    ("finger", "part", "expected"),
    [
        ((0, 0, 0), (0, 0, 0.5), 0.043 / 0.5),  # the part approaches
        ((0, 0, -0.2), (0, 0, 0.3), 0.043 / 0.5),  # both
        ((0, 0, -0.5), (0, 0, -0.2), 0.043 / 0.3),  # the finger is faster
        ((0, 0, -0.2), (0, 0, -0.5), np.inf),  # the part is faster
        ((0, 0, 0), (0, 0, -0.5), np.inf),  # it leaves
        ((0, 0, -0.5), (0, 0, -0.5), np.inf),  # they move together
    ],
)
def test_time_to_contact_with_a_part_that_moves(finger, part, expected):
    found = contact(moving_block(part), (0, 0, 0.1), finger)

    assert found["time_to_contact"] == pytest.approx(expected, rel=1e-3)
    assert found["time_to_contact_lower"] <= expected
    assert found["time_to_contact_lower"] >= min(0.9 * expected, 0.12)


def test_arm_that_sweeps_round_is_certified_until_it_hits():
    """A bar along x rotates about z at 4 rad/s toward a finger at rest at 30 degrees, 0.2 m out."""
    bar = solid(shapes.box((-0.01, -0.005, -0.01), (0.3, 0.005, 0.01)), "bar")
    scene = Scene([bar, block("base", (0, -0.4, 0))])
    scene.move("bar", Pose(), angular_velocity=(0, 0, 4.0))
    angle, out = np.radians(30.0), 0.2
    found = contact(scene, (out * np.cos(angle), out * np.sin(angle), 0.0), (0, 0, 0))
    true = (angle - np.arcsin((0.005 + RADIUS) / out)) / 4.0

    assert 0.2 * true <= found["time_to_contact_lower"] <= true
    assert found["time_to_contact"] >= found["time_to_contact_lower"]


def test_a_part_that_is_not_the_nearest_but_faster_is_certified_too():
    scene = Scene([block("near", (0, 0, 0)), block("fast", (0, 0, 0.3))])
    scene.move("fast", Pose(), velocity=(0, 0, -2.0))
    found = contact(scene, (0, 0, 0.1), (0, 0, 0))
    true = (0.3 - 0.05 - 0.1 - RADIUS) / 2.0

    assert found["part"] == 0
    assert 0.0 < found["time_to_contact_lower"] <= true


@pytest.mark.parametrize("away", [0.5, 3.0])
@pytest.mark.parametrize("position", [(0, 0, 0.05)])
def test_what_is_too_far_to_come_in_time_takes_nothing_of_the_time(away, position):
    """A train at 2 m/s at least 0.4 m away does not arrive within 0.19 s."""
    still = Scene([plate(), block("train", (0, away, 0))])
    moving = Scene([plate(), block("train", (0, away, 0))])
    moving.move("train", Pose(translation=(0, 0, 0)), velocity=(0, -2.0, 0))
    alone, beside = contact(still, position, (0, 0, -0.25)), contact(moving, position, (0, 0, -0.25))

    assert alone["time_to_contact_lower"] >= 0.99 * (position[2] - RADIUS) / 0.25
    assert beside["time_to_contact_lower"] == pytest.approx(alone["time_to_contact_lower"], rel=1e-9)
    assert beside["time_to_contact"] == alone["time_to_contact"]


@pytest.mark.parametrize("speed", [2.0, 20.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_comes_from_afar_in_time_is_certified(speed, side):
    """A finger sinks to a plate; a train from the side arrives first."""
    train = solid(shapes.box((-0.05, side * 0.5 - 0.05, -0.02), (0.05, side * 0.5 + 0.05, 0.2)), "train")
    scene = Scene([plate(top=-0.05), train])
    scene.move("train", Pose(), velocity=(0, -side * speed, 0))
    found = contact(scene, (0, 0, 0.05), (0, 0, -0.1))
    true = (0.45 - RADIUS) / speed

    assert 0.9 * true <= found["time_to_contact_lower"] <= true


def test_what_touches_but_for_rounding_is_not_free_until_something_else_comes():
    train = solid(shapes.box((-0.05, 0.45, 0.0), (0.05, 0.55, 0.2)), "train")
    scene = Scene([plate(top=0.1), train])
    scene.move("train", Pose(), velocity=(0, -2.0, 0))
    found = contact(scene, (0, 0, np.nextafter(0.1, 1.0)), (0, 0, 0), radius=0.0)

    assert 0.0 < found["lower"] < 1e-15
    assert found["time_to_contact_lower"] == 0.0


def test_on_a_path_too_only_what_comes_in_time_counts():
    path = line((0, 0, 0.05), (0, 0, -0.05))
    for away, speed in ((3.0, 2.0), (0.5, 4.0)):
        scene = Scene([plate(), solid(shapes.box((-0.05, away - 0.05, -0.02), (0.05, away, 0.2)), "train")])
        scene.move("train", Pose(), velocity=(0, -speed, 0))
        found = tick_path(scene, path, velocity=(0, 0, -0.25))
        true = min(0.043 / 0.25, (away - 0.05 - RADIUS) / speed)

        assert 0.9 * true <= found["time_to_contact_lower"] <= true
