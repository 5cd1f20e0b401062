"""Recordings through a tracker: one tick per instant, and detection of broken bounds."""

import make
import numpy as np
import pytest
from fake_tracker import FakeTracker

from benchmarks.replay import bounds_check, replay_loop
from benchmarks.replay.replay_loop import replay
from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.recording import Recording
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

RADIUS = 0.005
FINGERS = ((0, 1), (0, 2))


@pytest.fixture(scope="module")
def scene():
    """The box [0, 40] x [0, 30] x [0, 20] mm."""
    return Scene([Solid(*make.box(), name="box")])


def recording_above_the_box(heights, *, step_ns=1_000_000):
    """Return a recording: index finger at *heights* (m) above the box, middle finger at 100 mm."""
    positions = np.full((len(heights), 2, 3), [0.020, 0.015, 0.120])
    positions[:, 0, 2] = 0.020 + np.array(heights)
    positions[:, 0][np.isnan(heights)] = np.nan
    return Recording(np.arange(len(heights)) * step_ns, positions, FINGERS, "hand.csv")


def run_over(scene, recording, *, working_range=0.050, spoil=None, **options):
    """Replay a recording; return the result and the trackers."""
    made = []

    def make_tracker():
        made.append(FakeTracker(scene, fingers=2, radius=RADIUS, working_range=working_range, spoil=spoil))
        return made[-1]

    return replay(make_tracker, recording, **options), made


DOWN_AND_UP = np.concatenate([np.linspace(0.020, 0.004, 17), np.linspace(0.005, 0.030, 26)])


def test_every_instant_is_one_tick_of_a_fresh_tracker(scene):
    recording = recording_above_the_box(DOWN_AND_UP)

    run, (rehearsed, tracker) = run_over(scene, recording, latency=0.002)

    assert len(rehearsed.ticks) == replay_loop.REHEARSAL
    assert tracker.ticks == [(at, at + 2_000_000) for at in recording.times_ns.tolist()]
    np.testing.assert_array_equal(run.contacts["position"], recording.positions)
    np.testing.assert_allclose(run.contacts["signed_distance"][:, 0], DOWN_AND_UP - RADIUS, atol=1e-15)
    assert (run.wall_ns > 0).all()
    assert (run.compute_ns >= 0).all()


def test_bounds_that_hold_are_found_to_hold(scene):
    run, _ = run_over(scene, recording_above_the_box(DOWN_AND_UP))

    assert bounds_check.judge_bounds(scene, run, RADIUS) == bounds_check.BoundsKept(86, 0, 0.0, "")


@pytest.mark.parametrize(("name", "off"), [("lower", 1e-6), ("upper", -1e-6), ("upper", np.nan)])
def test_one_broken_bound_is_noticed(scene, name, off):
    def spoil(contacts, tick):
        if tick == 11:
            contacts[name][0] += off

    run, _ = run_over(scene, recording_above_the_box(DOWN_AND_UP), spoil=spoil)
    kept = bounds_check.judge_bounds(scene, run, RADIUS)

    assert (kept.checked_count, kept.broken_count) == (86, 1)
    assert kept.worst == pytest.approx(0.0 if np.isnan(off) else 1e-6, abs=1e-12)
    assert kept.first_broken.startswith("index at 0.010000 s: ")


def test_finger_that_was_not_there_but_is_said_to_be_tracked_breaks_its_bounds(scene):
    def spoil(contacts, tick):
        if tick == 2:
            contacts["flags"][0] |= int(ContactFlag.TRACKED)

    run, _ = run_over(scene, recording_above_the_box([0.01, np.nan, 0.01]), spoil=spoil)

    assert bounds_check.judge_bounds(scene, run, RADIUS).broken_count == 1


def test_bounds_hold_where_no_part_is_shown(scene):
    hidden = Scene([Part("box", scene.parts[0].solid, Pose(), np.arange(12), is_hidden=True)])
    recording = recording_above_the_box([0.02, 0.01, np.nan])

    run = replay(lambda: Tracker(hidden, fingers=2, radius=RADIUS), recording)

    assert np.isposinf(run.contacts["lower"][0]).all()
    assert bounds_check.judge_bounds(hidden, run, RADIUS) == bounds_check.BoundsKept(5, 0, 0.0, "")


def test_steady_motion_is_predicted_and_a_turn_is_not(scene):
    run, _ = run_over(scene, recording_above_the_box([0.040, 0.037, 0.034, 0.031, 0.028, 0.031, 0.034]))

    kept = bounds_check.judge_predictions(scene, run, RADIUS)

    # Ticks 1 to 4 predict two steps; in 3 and 4 the finger reverses. The other one is at rest.
    assert (kept.checked_count, kept.kept_count) == (8, 6)
    assert kept.error_p50 == pytest.approx(0.0, abs=1e-12)
    assert kept.error_p95 > 0.005


def test_prediction_for_an_instant_that_was_not_recorded_does_not_count(scene):
    run, _ = run_over(scene, recording_above_the_box([0.040, 0.037, 0.034, np.nan, np.nan]))

    kept = bounds_check.judge_predictions(scene, run, RADIUS)

    assert kept.checked_count == 2  # of the finger at rest
    run, _ = run_over(scene, recording_above_the_box([0.040]))
    assert bounds_check.judge_predictions(scene, run, RADIUS).checked_count == 0


STEADY = np.linspace(0.0202, 0.0047, 32)  # 0.5 m/s; touches at 31 ms


def certified_times(scene, heights, **options):
    run, _ = run_over(scene, recording_above_the_box(heights), **options)
    return bounds_check.judge_certified_times(scene, run, RADIUS)


def test_certified_times_of_a_steady_finger_hold(scene):
    """All but the first tick, which has no velocity, and the one of the contact."""
    assert certified_times(scene, STEADY) == bounds_check.CertifiedTimes(30, 0, "")


@pytest.mark.parametrize("factor", [1.2, 3.0])
def test_certified_time_that_is_too_long_is_noticed(scene, factor):
    def spoil(contacts, tick):
        if tick == 12:
            contacts["time_to_contact_lower"][0] *= factor

    judged = certified_times(scene, STEADY, spoil=spoil)

    assert (judged.checked_count, judged.broken_count) == (30, 1)
    certified = factor * (STEADY[11] - RADIUS) / 0.5
    assert judged.first_broken == (
        f"index at 0.011000 s: touched after 0.020000 s, certified {certified:.6f} s"
    )


@pytest.mark.parametrize(
    "heights",
    [
        [0.020, 0.0195, 0.0185, 0.0165, 0.0125, 0.0049],  # accelerating: touches before the certified time
        [0.020, 0.018, np.nan, np.nan, 0.004, 0.003],  # lost before the touch
        [0.020, 0.019],  # the recording ends first
    ],
)
def test_certified_time_is_not_checked_where_velocity_or_finger_was_lost(scene, heights):
    assert certified_times(scene, heights).checked_count == 0


def test_touch_that_a_small_change_of_velocity_led_to_breaks_nothing(scene):
    """A finger slides along the box towards a distant part, and sinks by 2 % of its displacement."""
    ticks = np.arange(60)
    recording = recording_above_the_box(0.0055 - 0.00002 * np.maximum(ticks - 30, 0))
    recording.positions.flags.writeable = True
    recording.positions[:, 0, 0] = 0.005 + 0.0005 * ticks

    def spoil(contacts, tick):
        if tick <= 30:  # not sinking yet
            contacts["time_to_contact_lower"][0] = 0.040

    run, _ = run_over(scene, recording, spoil=spoil)
    judged = bounds_check.judge_certified_times(scene, run, RADIUS)

    assert judged.broken_count == 0 and judged.checked_count > 0
