"""Poses of another clock or unit: each is flagged."""

import numpy as np
import pytest
from ticking import MS, contact, flags_of, plate

from proximity.errors import UnitsWarning
from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

BOOT, EPOCH = 3_000_000 * MS, 1_795_000_000_000 * MS
"""Instants of a monotonic clock and of the calendar."""


def approach(pose_ns, now_ns, count=40, **settings):
    """Move a finger to a plate at 0.3 m/s, a tick each ms; return the flags of each tick and the tracker."""
    tracker = Tracker(Scene([plate()]), fingers=1, **settings)
    flags = []
    for k in range(count):
        found = tracker.tick([(0.0, 0.0, 0.06 - 0.0003 * k)], pose_ns(k), now_ns(k))
        flags.append(flags_of(found))
    return flags, tracker


def test_hand_on_one_clock_is_exact_and_nothing_is_noted(caplog):
    flags, tracker = approach(lambda k: BOOT + k * MS, lambda k: BOOT + k * MS + MS // 2)

    assert all(flag & ContactFlag.EXACT and not flag & ContactFlag.JUMPED for flag in flags)
    assert tracker.notes == [] and not caplog.messages


@pytest.mark.parametrize(
    ("pose_base", "now_base", "sentence"),
    [
        (EPOCH, BOOT,
         "poses from the future are not used (by 1794997000 s; t_pose_ns and now_ns may be of two"),
        (BOOT, EPOCH,
         "poses older than 1 s are not used (1794997000 s old; t_pose_ns and now_ns may be of two"),
        (BOOT // 1000, BOOT, "poses older than 1 s are not used (2997 s old"),
    ],
)  # fmt: skip
def test_distance_is_never_exact_with_an_age_of_57_years(pose_base, now_base, sentence, caplog):
    flags, tracker = approach(lambda k: pose_base + k * MS, lambda k: now_base + k * MS)

    assert set(flags) == {ContactFlag(0)}
    assert tracker.contacts["upper"][0] == np.inf
    (note,) = tracker.notes
    assert note.startswith(sentence) and caplog.messages == [note]


@pytest.mark.parametrize("tick_ns", [1000, 10_000])  # 1 ms in µs, and in .NET's 100 ns
def test_hand_with_instants_of_another_unit_jumps_while_it_moves(tick_ns):
    """Regression: it counted as at rest, without a contact, until it was in the wall."""
    flags, _ = approach(lambda k: BOOT + k * tick_ns, lambda k: BOOT + k * tick_ns + tick_ns // 2)

    assert all(flag & ContactFlag.JUMPED for flag in flags[-10:])
    assert not any(flag & ContactFlag.PREDICTED for flag in flags[-10:])


def test_jumps_of_one_pose_in_a_fast_stream_are_one_jump():
    """Poses 0.1 ms apart: when the hand rests again, its slack is restored."""
    tracker = Tracker(Scene([plate()]), fingers=1)
    places = [0.06] * 20 + [0.09] * 20
    found = [
        flags_of(tracker.tick([(0.0, 0.0, z)], BOOT + k * MS // 10, BOOT + k * MS // 10))
        for k, z in enumerate(places)
    ]

    assert [k for k, flag in enumerate(found) if flag & ContactFlag.JUMPED] == [20]


def test_time_that_runs_backwards_jumps_at_every_tick():
    flags, _ = approach(lambda k: BOOT - k * MS, lambda k: BOOT - k * MS)

    assert not flags[0] & ContactFlag.JUMPED
    assert all(flag & ContactFlag.JUMPED and not flag & ContactFlag.PREDICTED for flag in flags[1:])


def test_pose_that_is_a_little_ahead_is_answered_for_its_own_instant_and_noted_once(caplog):
    flags, tracker = approach(lambda k: BOOT + (k + 20) * MS, lambda k: BOOT + k * MS)

    assert flags[-1] & ContactFlag.PREDICTED
    (note,) = tracker.notes
    assert note.startswith("poses from the future are predicted for their own instant (by 20.0 ms; send the")
    assert caplog.messages == [note]


def test_finger_of_another_clock_is_lost_and_the_other_goes_on():
    tracker = Tracker(Scene([plate()]), fingers=2)
    found = tracker.tick([(0, 0, 0.05), (0.02, 0, 0.05)], [BOOT, EPOCH], BOOT)

    assert flags_of(found, 0) & ContactFlag.EXACT and not flags_of(found, 1)
    assert len(tracker.notes) == 1
    tracker.tick([(0, 0, 0.05), (np.nan,) * 3], [BOOT + MS, EPOCH], BOOT + MS)
    assert len(tracker.notes) == 1


def test_fingers_in_millimetres_are_noted_once(caplog):
    tracker = Tracker(Scene([plate()]), fingers=2)
    for k in range(5):
        tracker.tick([(40.0, 0, 50.0), (0, 0, 68.0 - k)], BOOT + k * MS, BOOT + k * MS)

    (note,) = tracker.notes
    assert (
        note
        == "finger 0 is 64 m from the nearest part, 226 times the size of the scene: positions are metres"
    )
    assert caplog.messages == [note]


@pytest.mark.parametrize("far", [20.0, 5000.0])  # 70 and 18 000 times the size of the plate
def test_finger_at_a_distance_that_no_unit_explains_is_not_noted(far):
    tracker = Tracker(Scene([plate()]), fingers=1)
    tracker.tick([(0, 0, far)], BOOT, BOOT)

    assert tracker.notes == []


@pytest.mark.parametrize("ask", ["closest", "signed_distance", "distance"])
@pytest.mark.parametrize(
    "points", [[0.0, 0.0, 68.0], np.array([[0.0, 0, 68], [1, 2, 70]]), np.full((900, 3), 60.0)]
)
def test_points_in_millimetres_warn_at_the_line_of_the_caller(ask, points):
    scene = Scene([plate()])
    with pytest.warns(
        UnitsWarning, match=r"from the nearest part, \d+ times the size of the scene"
    ) as caught:
        getattr(scene, ask)(points)

    assert caught[0].filename == __file__


def test_points_of_which_one_is_near_do_not_warn():
    points = np.array([[0.0, 0.0, 0.05], [0.0, 0.0, 68.0]])

    assert Scene([plate()]).signed_distance(points) == pytest.approx([0.05, 68.0])


def test_solid_alone_and_moved_parts_know_their_size_too():
    scene = Scene([plate(), plate("other")])
    matrix = np.eye(4)
    matrix[:3, 3] = (0, 0, 3.0)
    scene.move("other", matrix)

    assert scene.signed_distance([0, 0, 68.0]) == pytest.approx(65.0)  # 22 sizes of the present scene
    with pytest.warns(UnitsWarning):
        plate().signed_distance([0, 0, 68.0])


def test_contact_at_arms_length_is_not_noted():
    assert contact([plate()], (0, 0, 0.5))["signed_distance"] == pytest.approx(0.493)
