"""Input of callers and sensors: rejected with an error, or its valid rows used."""

import copy
import pickle
import re

import numpy as np
import pytest
from odd_arrays import unaligned
from ticking import MS, RADIUS, block, flags_of, line, plate

from proximity.errors import ArgumentError, PoseError
from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

TIPS = np.array([(0, 0, 0.05), (0.02, 0, 0.04)])
PATHS = np.stack([line(tip, tip - (0, 0, 0.1), 3) for tip in TIPS])


@pytest.fixture
def tracker():
    return Tracker(Scene([plate()]), fingers=2)


@pytest.mark.parametrize("thing", [None, "part.stl", plate(), [plate()]])
def test_something_else_than_a_scene_is_refused(thing):
    with pytest.raises(ArgumentError, match=f"looks at a Scene, not at a {type(thing).__name__}"):
        Tracker(thing)


@pytest.mark.parametrize(
    ("setting", "value", "said"),
    [
        ("fingers", 0, "fingers is 0, expected a whole number of 1 or more"),
        ("fingers", True, "fingers is True, expected a whole number"),
        ("budget", 0, "budget is 0, expected a whole number of 1 or more"),
        ("budget", "all", "budget is 'all', expected a whole number"),
        ("radius", -0.001,
         "radius is -0.001, expected metres of 0 or more: one, or one for each of 3 fingers"),
        ("radius", 7, r"radius is 7 m \(7000 mm\), expected at most 0.1 m: was it meant in millimetres\?"),
        ("radius", [0.007, 0.1001, 0.008], r"radius is 0.1001 m \(100.1 mm\), expected at most 0.1 m"),
        ("radius", "thick", "expected one radius in metres, or one a finger"),
        ("period", 0.0, "period is 0.0, expected a positive number of seconds"),
        ("latency", -1e-9, "latency is -1e-09, expected a number of seconds of 0 or more"),
        ("working_range", -1, "working_range is -1, expected a number of metres of 0 or more"),
        ("working_range", 120, r"working_range is 120 m \(120000 mm\), expected at most 10 m: was it meant"),
        ("tolerance", -0.1, "tolerance is -0.1, expected a number of shares of 0 or more"),
        ("horizon", 0, "horizon is 0, expected a positive number of seconds"),
        ("latency", 20, "latency is 20, expected a number of seconds of 1 at most"),
        ("max_speed", -3.0, "max_speed is -3.0, expected a positive number of metres a second"),
        ("max_acceleration", None, "max_acceleration is None, expected a positive number of m/s²"),
    ],
)  # fmt: skip
def test_setting_that_cannot_be_used_is_named(setting, value, said):
    with pytest.raises(ArgumentError, match=said):
        Tracker(Scene([plate()]), **{"fingers": 3, setting: value})


def test_default_is_a_hand_at_1_khz():
    tracker = Tracker(Scene([plate()]))

    assert (tracker.period, tracker.latency, len(tracker.contacts)) == (0.001, 0.001, 5)
    assert repr(tracker) == "Tracker(Scene(1 parts, 12 faces), 5 fingers)"


def test_contacts_show_themselves_without_their_dtype():
    tracker = Tracker(Scene([plate()]), fingers=12)
    contacts = tracker.tick(np.full((12, 3), [0.0, 0.0, 0.05]), 0, 0)
    contacts["mode"][1] = 99  # of a later version

    text, one = repr(contacts), repr(contacts[0])

    assert one.startswith("Contact(finger=0, signed_distance=0.0")
    assert one.endswith(", mode=RETRACT, flags=TRACKED|EXACT|SIGNED|IN_RANGE)")
    assert "mode=99, " in repr(contacts[1])
    assert text.startswith(f"Contacts([{one},\n Contact(finger=1, ")
    assert text.endswith(",\n and 2 more])")
    assert "dtype" not in text + repr(contacts[2:4]) + repr(contacts.copy())
    assert "float64" not in text
    # Fields are those of a plain array.
    assert type(contacts["position"]) is np.ndarray
    assert type(contacts["signed_distance"][0]) is np.float64
    assert repr(contacts.reshape(3, 4)).startswith("array([[(")
    assert [contact["finger"] for contact in contacts] == list(range(12))


@pytest.mark.parametrize("setting", ["period", "latency", "scene"])
def test_setting_of_a_tracker_is_not_changed_to_no_effect(setting):
    """Regression: a changed latency was readable, but predictions used the former one."""
    with pytest.raises(AttributeError, match=f"property '{setting}' of 'Tracker' object has no setter"):
        setattr(Tracker(Scene([plate()])), setting, 0.05)


REFUSED = {
    "positions have shape (3,), expected (2, 3)": {"positions": (0, 0, 0.05)},
    "positions have shape (1, 2, 3), expected (2, 3)": {"positions": TIPS[None].tolist()},
    "values of positions hold None, which is not a number": {"positions": None},
    "values of positions have dtype <U4, expected numbers of shape (2, 3)": {"positions": "here"},
    "values of positions have rows of different lengths": {"positions": [(0, 0, 0), (0, 0)]},
    "t_pose_ns is None, expected whole nanoseconds, at most 2**62: one number, or one for each of 2": {
        "t_pose_ns": None
    },
    "t_pose_ns is 1.5, expected whole nanoseconds": {"t_pose_ns": 1.5},
    "t_pose_ns is [0, 1, 2], expected whole nanoseconds": {"t_pose_ns": [0, 1, 2]},
    "t_pose_ns is array([0., 1.]), expected whole nanoseconds": {"t_pose_ns": np.array([0.0, 1.0])},
    "t_pose_ns is an array of float64, shape (300,), expected whole nanoseconds": {
        "t_pose_ns": np.arange(300.0)
    },
    f"t_pose_ns is [{-(2**63)}, 0], expected whole nanoseconds": {"t_pose_ns": [-(2**63), 0]},
    f"t_pose_ns is [0, {-(2**62) - 1}], expected whole nanoseconds": {"t_pose_ns": [0, -(2**62) - 1]},
    f"t_pose_ns is {2**63}, expected whole nanoseconds": {"t_pose_ns": 2**63},
    "now_ns is None, expected whole nanoseconds, at most 2**62": {"now_ns": None},
    "now_ns is 0.001, expected whole nanoseconds": {"now_ns": 0.001},
    "now_ns is [0, 0], expected whole nanoseconds": {"now_ns": [0, 0]},
    f"now_ns is {2**63}, expected whole nanoseconds": {"now_ns": 2**63},
    "velocities have shape (3,), expected (2, 3)": {"velocities": (0, 0, 1)},
    "paths have shape (2, 1, 3), expected (2, K, 3) with K of 2 or more": {"paths": PATHS[:, :1]},
    "paths have shape (2, 3, 2), expected (2, K, 3)": {"paths": PATHS[:, :, :2]},
    "values of paths have dtype <U5, expected numbers of shape (2, K, 3) with K of 2 or more": {
        "paths": "ahead"
    },
    "values of paths have rows of different lengths": {"paths": [PATHS[0].tolist(), PATHS[1, :2].tolist()]},
    "path_bends have shape (2,), expected (3,)": {"paths": PATHS, "path_bends": [0, 1]},
    "path_bends do not increase, or are not finite, expected the bend at each corner": {
        "paths": PATHS,
        "path_bends": [0, 0, 1],
    },
    "bends have shape (), expected (2,)": {"paths": PATHS, "bends": 0.5},
}


@pytest.mark.parametrize("said", REFUSED)
def test_argument_that_does_not_fit_is_refused_with_a_sentence(tracker, said):
    Tracker(tracker.scene, fingers=2).tick(TIPS, 0, 0)  # from now on compiled code checks first
    arguments = {"positions": TIPS, "t_pose_ns": 0, "now_ns": 0} | REFUSED[said]
    with pytest.raises(ArgumentError, match=re.escape(said)):
        tracker.tick(**arguments)
    found = tracker.tick(TIPS, MS, MS)

    assert found.tobytes() == Tracker(tracker.scene, fingers=2).tick(TIPS, MS, MS).tobytes()


def test_positions_of_other_byte_order_are_read_as_what_they_are(tracker):
    """Regression: after an unaligned array, compiled code accepted one of the other byte order as native."""
    expected = Tracker(tracker.scene, fingers=2).tick(TIPS, 0, 0).tobytes()
    tracker.tick(unaligned(TIPS), 0, 0)
    tracker.reset()

    assert tracker.tick(TIPS.astype(">f8"), 0, 0).tobytes() == expected


def test_positions_may_be_those_of_the_last_tick(tracker):
    """Regression: a record was cleared before its position was read."""
    one = Tracker(tracker.scene, fingers=1)
    distance = one.tick(TIPS[:1], 0, 0)["signed_distance"][0]

    found = one.tick(one.contacts["position"], MS, MS)

    assert found["signed_distance"][0] == distance
    np.testing.assert_array_equal(found["position"], TIPS[:1])


def test_a_refused_tick_leaves_the_epoch_that_contacts_are_of(tracker):
    assert tracker.epoch == -1
    tracker.tick(TIPS, 0, 0)
    before = tracker.epoch
    tracker.scene.hide(tracker.scene.parts[0].name)

    with pytest.raises(ArgumentError):
        tracker.tick(TIPS[:1], MS, MS)
    assert tracker.epoch == before
    tracker.tick(TIPS, MS, MS)
    assert tracker.epoch == tracker.scene.snapshot().epoch > before


def as_masked(tips):
    return np.ma.masked_array(tips)


@pytest.mark.parametrize(
    "convert",
    [
        np.ndarray.tolist,
        np.asfortranarray,
        as_masked,
        lambda tips: tips.astype(">f8"),
        lambda tips: np.repeat(tips, 2, axis=0)[::2],
        lambda tips: tips.astype(object),
    ],
)
def test_positions_of_any_layout_are_the_same_positions(tracker, convert):
    expected = tracker.tick(TIPS, 0, 0).tobytes()

    assert Tracker(tracker.scene, fingers=2).tick(convert(TIPS), [0, 0], np.int32(0)).tobytes() == expected


HOUR = 3600 * 1000 * MS


@pytest.mark.parametrize(
    ("t_pose_ns", "now_ns", "which", "value"),
    [
        (0, 2, "now_ns", 2), (HOUR, 99_999, "now_ns", 99_999), (2, HOUR, "t_pose_ns", 2),
        ([3600, 3599], HOUR, "t_pose_ns", 3600),
    ],
)  # fmt: skip
def test_instants_that_are_plainly_seconds_are_refused(tracker, t_pose_ns, now_ns, which, value):
    before = tracker.tick(TIPS, 0, 0).tobytes()
    with pytest.raises(
        ArgumentError,
        match=rf"^{which} is {value}, expected nanoseconds, as time.monotonic_ns\(\) gives them: it looks ",
    ):
        tracker.tick(TIPS - 1e-3, t_pose_ns, now_ns)
    assert tracker.contacts.tobytes() == before


@pytest.mark.parametrize("begin", [200_000, 1_764_000_000])  # of a clock since boot, and of the calendar
def test_seconds_are_refused_at_the_latest_when_the_next_begins(tracker, begin):
    for _ in range(3):
        tracker.tick(TIPS, begin, begin)
    with pytest.raises(ArgumentError, match=f"now_ns is {begin + 1}, expected nanoseconds"):
        tracker.tick(TIPS, begin + 1, begin + 1)


@pytest.mark.parametrize("instant", [7.0, "7"])
def test_instants_that_are_not_whole_are_refused(tracker, instant):
    with pytest.raises(
        ArgumentError, match=r"now_ns is .*, expected whole nanoseconds, .* time.monotonic_ns\(\)"
    ):
        tracker.tick(TIPS, 0, instant)
    with pytest.raises(ArgumentError, match=r"t_pose_ns is .*, expected whole nanoseconds"):
        tracker.tick(TIPS, instant, 0)


def test_clocks_turned_by_hand_are_accepted(tracker):
    """From 0 on, constant, set back, with gaps, and with ticks of a loop in quick succession."""
    for now in (0, 0, MS // 2, MS, 0, 1000, 2000, 3000, 10**18, 10**18 + 1, -5, 0):
        assert np.isfinite(tracker.tick(TIPS, now, now)["signed_distance"]).all()
    tracker.tick(TIPS, [2, HOUR], HOUR)  # an error of the sensor, not of the caller
    for age in (0, 5, 99_999, 10**9):
        tracker.tick(TIPS, 10**18, 10**18 + age)


def test_float32_and_integers_are_taken_as_they_are(tracker):
    found = tracker.tick(TIPS.astype(np.float32), np.uint32([3 * MS, 4 * MS]), 5 * MS)

    assert np.array_equal(found["position"], TIPS.astype(np.float32))
    assert found["age_ns"].tolist() == [2 * MS, MS]
    assert tracker.tick([(0, 0, 1), (1, 0, 0)], 0, 0)["signed_distance"].tolist() == [
        1 - RADIUS,
        0.9 - RADIUS,
    ]


def test_masked_finger_is_not_tracked(tracker):
    found = tracker.tick(np.ma.masked_array(TIPS, [[False] * 3, [True] * 3]), 0, 0)

    assert [bool(flags) for flags in found["flags"] & ContactFlag.TRACKED] == [True, False]


@pytest.mark.parametrize("lost", [(np.nan,) * 3, (0, np.inf, 0), (1e200, 0, 0)])
def test_finger_that_is_lost_says_so_and_comes_back_while_the_other_goes_on(tracker, lost):
    """Positions beyond the computable range are lost ones."""
    alone = Tracker(tracker.scene, fingers=1)
    for k in range(12):
        tips = TIPS - (0, 0, 0.0005 * k)
        is_lost = 4 <= k < 8
        if is_lost:
            tips[0] = lost
        found = tracker.tick(tips, k * MS, k * MS)
        other = alone.tick(tips[1:], k * MS, k * MS)
        for name in found.dtype.names[1:]:
            assert np.array_equal(found[name][1], other[name][0], equal_nan=name not in ("flags",)), name
        if is_lost:
            first = found[0]
            assert flags_of(found) & ~ContactFlag.JUMPED == 0
            assert (first["lower"], first["upper"], first["part"]) == (-np.inf, np.inf, -1)
            assert (first["predicted_lower"], first["predicted_upper"]) == (-np.inf, np.inf)
            assert first["time_to_contact_lower"] == 0.0
            for name in ("signed_distance", "time_to_contact", "velocity", "normal", "predicted_distance"):
                assert np.isnan(first[name]).all()
        else:
            assert flags_of(found) & ContactFlag.EXACT
            assert found["signed_distance"][0] == pytest.approx(tips[0, 2] - RADIUS)
    assert found["velocity"][0] == pytest.approx([0, 0, -0.5], abs=1e-6)


def test_position_far_away_but_finite_is_answered():
    tracker = Tracker(Scene([plate()]), fingers=1)
    for k, far in enumerate((1e6, 1e12, 1e90)):
        found = tracker.tick([(0, 0, far)], k * MS, k * MS)[0]
        assert found["signed_distance"] == pytest.approx(far, rel=1e-6)
        assert found["lower"] <= far - RADIUS * 0.99 and found["upper"] >= (far - RADIUS) * (1 - 1e-15)
    assert tracker.tick([(0, 0, 0.05)], 9 * MS, 9 * MS)["signed_distance"][0] == pytest.approx(0.043)


@pytest.mark.parametrize("speed", [1e6, 1e300])
def test_velocity_beyond_reason_is_answered(speed):
    found = Tracker(Scene([plate()]), fingers=1).tick([(0, 0, 0.05)], 0, 0, velocities=[(0, 0, -speed)])[0]

    assert found["signed_distance"] == pytest.approx(0.043)
    assert 0.0 <= found["time_to_contact_lower"] <= 0.043 / speed
    assert found["predicted_lower"] <= found["predicted_distance"] <= found["predicted_upper"]
    assert not np.isnan(found["time_to_contact"])


def test_path_beyond_reason_is_answered():
    for far in (1e10, 1e100, 1e160):
        tracker = Tracker(Scene([plate()]), fingers=1)
        found = tracker.tick([(0, 0, 0.05)], 0, 0, paths=[[(0, 0, 0.05), (far, 0, 0.05)]])[0]
        assert found["signed_distance"] == pytest.approx(0.043)
        assert not found["contact_bend_error"] < np.inf


def test_time_that_goes_back_starts_the_velocity_anew(tracker):
    for ns in (10 * MS, 11 * MS, 12 * MS):
        assert tracker.tick(TIPS, ns, ns)["flags"][0] & ContactFlag.TRACKED
    found = tracker.tick(TIPS + 0.001, 5 * MS, 5 * MS)

    assert not flags_of(found) & ContactFlag.PREDICTED
    assert flags_of(found) & ContactFlag.EXACT
    assert found["pose_ns"][0] == 5 * MS


def test_pose_that_is_told_again_keeps_its_velocity(tracker):
    for k in range(3):
        tracker.tick(TIPS - (0, 0, 0.001 * k), k * MS, k * MS)
    found = tracker.tick(TIPS - (0, 0, 0.002), 2 * MS, 3 * MS)

    assert found["velocity"][:, 2] == pytest.approx([-1.0, -1.0])
    assert found["age_ns"].tolist() == [MS, MS]


def test_pose_of_the_future_is_predicted_for_itself(tracker):
    found = tracker.tick(TIPS, 9 * MS, 0, velocities=-TIPS)

    assert found["age_ns"].tolist() == [-9 * MS] * 2
    assert np.array_equal(found["predicted_distance"], found["signed_distance"])


def test_clock_may_start_anywhere(tracker):
    expected = [tracker.tick(TIPS * (1 - 0.01 * k), k * MS, (k + 1) * MS).copy() for k in range(4)]
    for start in (10**18, -(10**18), 2**62 - 9 * MS):
        other = Tracker(tracker.scene, fingers=2)
        for k in range(4):
            found = other.tick(TIPS * (1 - 0.01 * k), start + k * MS, start + (k + 1) * MS)
            for name in ("velocity", "age_ns", "predicted_lower", "time_to_contact_lower", "flags"):
                assert np.array_equal(found[name], expected[k][name])
            assert found["predicted_ns"][0] == start + (k + 2) * MS


def test_part_whose_pose_is_not_rigid_is_refused_and_ticks_go_on():
    scene = Scene([block("block", (0, 0, 0))])
    tracker = Tracker(scene, fingers=1)
    with pytest.raises(PoseError, match="part 'block'"):
        scene.move("block", np.diag([2.0, 1, 1, 1]))

    assert tracker.tick([(0, 0, 0.1)], 0, 0)["signed_distance"][0] == pytest.approx(0.05 - RADIUS)


@pytest.mark.parametrize("given", [{"bends": [0.5]}, {"path_bends": [0.0, 1.0]}])
def test_bends_without_paths_are_refused(given):
    tracker = Tracker(Scene([plate()]), fingers=1)

    with pytest.raises(ArgumentError, match="path_bends are given without paths"):
        tracker.tick([[0.0, 0.0, 0.05]], 0, 0, **given)


@pytest.mark.parametrize("latency", [0.0, 1.0])
def test_instants_as_far_apart_as_can_be_are_not_taken_for_near_ones(latency):
    tracker = Tracker(Scene([plate()]), fingers=1, latency=latency)
    tracker.tick([(0.0, 0.0, 0.06)], -(2**62), -(2**62))
    found = tracker.tick([(0.0, 0.0, 0.05)], -(2**62), 2**62)[0]

    assert (found["pose_ns"], found["age_ns"]) == (-(2**62), 2**63 - 1)
    assert found["predicted_ns"] == 2**62 + round(1e9 * latency)
    assert found["predicted_lower"] < -1e9 < 1e9 < found["predicted_upper"]
    found = tracker.tick([(0.0, 0.0, 0.05)], 2**62, 2**62)[0]
    assert found["age_ns"] == 0 and not found["flags"] & ContactFlag.PREDICTED  # the estimate restarts


def test_scene_of_a_tracker_stays_and_a_tracker_is_not_copied(tracker):
    with pytest.raises(AttributeError):
        tracker.scene = Scene([plate()])
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(
            ArgumentError, match="a tracker cannot be copied, because its state depends on its ticks"
        ):
            copied(tracker)
