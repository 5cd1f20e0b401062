"""Recordings and callables as inputs of poses."""

import numpy as np
import pytest
import shapes
from fake_service import MS, FakeAnswers, SteppedLoop, hands_at

from proximity.errors import ServiceError
from proximity.kernels.contact_record import PREDICTED, TRACKED
from proximity.recording import Recording
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import FingerPoses, RecordingInput, Service, TrackedContacts
from proximity.service.samples import NewestSamples
from proximity.tracker.tracker import Tracker

NOW = 5000 * MS


def recording(times_ms, *, first=100.0):
    """One finger whose x is the time in s."""
    times = np.asarray(times_ms, np.float64)
    positions = np.zeros((len(times), 1, 3))
    positions[:, 0, 0] = times / 1000
    return Recording(np.int64((times + first) * MS), positions, ((0, 1),))


class Played(SteppedLoop):
    """A loop that plays a recording of one finger."""

    def __init__(self, recording, **options):
        tracker = Tracker(Scene([Solid(*shapes.cube(1.0), name="cube")]), fingers=1)
        super().__init__(TrackedContacts(tracker), NOW, RecordingInput(recording, **options))

    def at(self, instants_ms):
        """New pose of each tick: (x in ms, pose time in ms), or None."""
        memory, given = self.service._memory, []
        for instant in instants_ms:
            row, start_ns = self.row
            self.tick(NOW + int(instant * MS))
            x, pose_ns = memory._arrays["given"][0, 0], memory._arrays["given_ns"].item(0)
            given.append(None if self.row == (row, start_ns) else (1000 * x, (pose_ns - NOW) / MS))
        return given

    @property
    def row(self):
        """The last row played, and the time of the first; None before."""
        playing = self.service._loop.recording
        return (int(playing["row"]), int(playing["start_ns"])) if playing["has_begun"] else (None, None)

    @property
    def is_over(self):
        return bool(self.service._loop.recording["is_over"])


def near(pairs):
    return [None if pair is None else pytest.approx(pair, abs=1e-9) for pair in pairs]


def test_recording_gives_the_newest_pose_that_is_past_with_its_own_instant():
    loop = Played(recording([0, 8, 16, 30]))

    told = loop.at([0, 1, 7, 8, 9, 20, 21])

    assert told == near([(0, 0), None, None, (8, 8), None, (16, 16), None])
    assert not loop.is_over
    assert loop.at([30.5]) == near([(30, 30)])
    assert loop.is_over


def test_poses_are_as_old_as_the_latency_when_they_come():
    loop = Played(recording([0, 10, 20]), latency=0.004)
    assert loop.at([0, 9, 10, 20]) == near([(0, -4), None, (10, 6), (20, 16)])


AWAY = (pytest.approx(np.nan, nan_ok=True), 41)
"""After the recordings below: the hand is removed at 41 ms and returns 100 ms later."""


def test_recording_that_is_repeated_lets_the_hand_go_away_and_begins_anew():
    loop = Played(recording([0, 10, 20, 31]), repeat=True)

    told = loop.at([0, 20, 31, 40, 41, 140, 141, 151])

    assert told == [*near([(0, 0), (20, 20), (31, 31), None]), AWAY, *near([None, (0, 141), (10, 151)])]
    assert not loop.is_over


def test_recording_that_is_repeated_keeps_its_beat_through_rounds_slept_through():
    loop = Played(recording([0, 10, 20, 31]), repeat=True)
    assert loop.at([0, 141 * 7 + 12, 141 * 8]) == near([(0, 0), (10, 141 * 7 + 10), (0, 141 * 8)])


def started(count, origin="input"):
    """Initial samples of *count* fingers, stale after 100 ms."""
    newest = NewestSamples(FingerPoses(count), 100 * MS, origin)
    newest.start(NOW)
    return newest


@pytest.mark.parametrize("jump", [0.002, 0.1])
def test_way_from_the_end_of_a_recording_to_its_beginning_is_no_velocity(jump):
    """The tracker restarts instead of using that displacement, and predicted speeds stay within limits."""
    rows = 30
    positions = np.zeros((rows, 1, 3))
    positions[:, 0, 2] = np.linspace(1.0, 1.0 + jump, rows)
    hand = Recording(np.arange(rows) * np.int64(MS), positions, ((0, 1),))
    loop, fastest = Played(hand, latency=0.0, repeat=True), abs(jump) / (rows - 1) / 1e-3 + 1e-6

    seen = 0
    for tick in range(3 * (rows + 100)):
        (contact,) = loop.tick(NOW + tick * MS)
        seen += bool(contact["flags"] & TRACKED)
        assert not contact["flags"] & PREDICTED or np.abs(contact["velocity"]).max() <= fastest
    assert seen == 3 * rows


def test_recording_of_one_instant_is_over_at_once_or_comes_again_and_again():
    once, again = Played(recording([0])), Played(recording([0]), repeat=True)

    assert once.at([0]) == near([(0, 0)]) and once.is_over
    assert again.at([0, 999, 1000])[:2] == near([(0, 0), None])
    assert again.at([1100]) == near([(0, 1100)])


def test_recording_is_refused_where_the_loop_cannot_play_it():
    with pytest.raises(ServiceError, match="recorded poses are for contacts that the loop makes"):
        Service(FakeAnswers(1), RecordingInput(recording([0])), [], period=0.001)


@pytest.mark.parametrize("latency", [-0.001, float("nan")])
def test_latency_of_a_recording_that_cannot_be_is_refused(latency):
    with pytest.raises(ServiceError, match=r"^a recording with a latency of .* s, expected 0 to 1 s$"):
        RecordingInput(recording([0]), latency=latency)


AHEAD = (
    "shm://poses: poses from the future are not used (by 25.0 ms; send the instant at which hand or part "
    "was there, not the predicted display time)"
)
OTHER_CLOCK = (
    "shm://poses: poses {} (by {} s; they are of another clock: on the service's machine send "
    "time.monotonic_ns(), CLOCK_MONOTONIC)"
)


@pytest.mark.parametrize(
    ("ahead_ms", "sentence"),
    [
        (25, AHEAD),
        (3_600_000, OTHER_CLOCK.format("from the future are not used", 3600)),
        (-500, "shm://poses: poses older than 100 ms are not used (500.0 ms old; send them as soon as they"),
        (-3_600_000, "shm://poses: poses older than 100 ms are not used (3600 s old; they are of another"),
        (-50, "shm://poses: poses older than the one before are not used (by 50.0 ms; they are of two"),
    ],
)
def test_first_pose_that_cannot_be_used_is_told_with_its_address_and_a_remedy(ahead_ms, sentence, caplog):
    """The service once reported them only at its end, and never reported that they were too old."""
    newest = started(1, "shm://poses")
    newest.update(hands_at([[0, 0, 0]], NOW), NOW)
    for tick in range(3):
        newest.update(hands_at([[1, 1, 1]], NOW + ahead_ms * MS + tick), NOW + tick)

    assert len(caplog.messages) == 1 and caplog.messages[0].startswith(sentence)
    assert newest.samples.positions.tolist() == [[0, 0, 0]]
    counts = newest.future, newest.backwards, newest.too_old
    assert sum(counts) == 3 and counts.index(3) == (0 if ahead_ms > 0 else 1 if ahead_ms == -50 else 2)


def test_pose_that_grew_old_here_is_not_counted_as_too_old():
    newest = started(2)
    for ms in range(300):
        newest.update(hands_at(np.zeros((2, 3)), [NOW, NOW + ms * MS]), NOW + ms * MS)
    assert newest.too_old == 0


def test_what_was_told_once_and_is_not_any_more_becomes_unknown():
    newest = started(2)
    first = hands_at(np.zeros((2, 3)), NOW, velocities=np.ones((2, 3)))
    first.paths, first.bends = np.ones((2, 4, 3)), np.ones(2)

    newest.update(first, NOW)
    assert (
        (newest.samples.velocities == 1).all()
        and (newest.samples.paths == 1).all()
        and (newest.samples.bends == 1).all()
    )
    assert newest.samples.velocities is not first.velocities  # a copy: the input reuses its arrays

    newest.update(hands_at(np.zeros((2, 3)), NOW + 1), NOW + 1)
    assert np.isnan(newest.samples.velocities).all()
    assert np.isnan(newest.samples.paths).all() and np.isnan(newest.samples.bends).all()


def test_finger_whose_sample_is_left_out_keeps_all_of_the_one_before():
    newest = started(2)
    newest.update(hands_at(np.zeros((2, 3)), NOW, velocities=np.zeros((2, 3))), NOW)
    newest.update(hands_at(np.ones((2, 3)), [NOW - 1, NOW + 1], velocities=np.ones((2, 3))), NOW + 1)
    assert newest.samples.positions.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert newest.samples.velocities.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert newest.samples.pose_ns.tolist() == [NOW, NOW + 1]
    assert (newest.future, newest.backwards) == (0, 1)


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("pose_ns", [0, NOW + 1])
def test_finger_that_is_lost_is_lost_at_once_whatever_its_instant(unknown, axis, pose_ns):
    newest = started(1)
    newest.update(hands_at([[1, 1, 1]], NOW), NOW)
    lost = hands_at([[1, 1, 1]], pose_ns)
    lost.positions[0, axis] = unknown

    newest.update(lost, NOW + 1)
    assert not np.isfinite(newest.samples.positions).all()
    assert newest.samples.pose_ns.tolist() == [NOW]  # of the last known pose
    assert (newest.future, newest.backwards) == (0, 0)

    newest.update(hands_at([[2, 2, 2]], NOW - 1), NOW + 2)
    assert not np.isfinite(newest.samples.positions).all() and newest.backwards == 1
    newest.update(hands_at([[2, 2, 2]], NOW + 2), NOW + 2)
    assert newest.samples.positions.tolist() == [[2, 2, 2]]


@pytest.mark.parametrize(("future_ns", "is_taken"), [(5 * MS, True), (5 * MS + 1, False)])
def test_poses_may_be_five_milliseconds_ahead(future_ns, is_taken):
    newest = started(1)
    newest.update(hands_at([[1, 1, 1]], NOW + future_ns), NOW)
    assert np.isfinite(newest.samples.positions).all() == is_taken
    assert newest.future == (not is_taken)


@pytest.mark.parametrize("pose_ns", [NOW + 500 * MS, NOW - 1])
def test_sample_that_was_left_out_is_not_given_again(pose_ns):
    """A source that updates one finger at a time passes all fingers each time."""
    newest, given = started(2), hands_at(np.zeros((2, 3)), NOW, velocities=np.zeros((2, 3)))
    given.bends = np.zeros(2)
    newest.update(given, NOW)
    given.positions[0], given.pose_ns[0], given.velocities[0], given.bends[0] = 1, pose_ns, 1, 1

    for ms in range(600):
        given.positions[1], given.pose_ns[1] = ms, NOW + ms * MS
        newest.update(given, NOW + ms * MS)
        newest.drop_stale(NOW + ms * MS)

    assert newest.future + newest.backwards == 1
    assert np.isnan(newest.samples.positions[0, 0]) and newest.samples.positions[1].tolist() == [599] * 3
    assert newest.samples.velocities.tolist() == [[0, 0, 0]] * 2 and newest.samples.bends.tolist() == [0, 0]


def test_hand_whose_fingers_are_all_at_one_place_is_lost_and_counted(caplog):
    """The left hand is reported as (0, 0, 0) while lost; the right one is unaffected."""
    newest = started(10, "shm://poses")
    tips = np.arange(30.0).reshape(10, 3)
    lost = tips.copy()
    lost[:5] = 0.0
    for ms, positions in enumerate((tips, lost, lost, tips)):
        newest.update(hands_at(positions, NOW + ms * MS), NOW + ms * MS)
        is_there = np.isfinite(newest.samples.positions).all(axis=1)
        assert is_there.tolist() == [positions is tips] * 5 + [True] * 5

    assert newest.notes == ["shm://poses: 10 poses of hands whose fingers are all at one place are not used"]
    (said,) = caplog.messages
    assert said.endswith("are all at one place are not used (the hand is lost there: send nan)")


def test_two_fingers_of_one_hand_may_be_at_one_place():
    newest = started(2)
    newest.update(hands_at(np.zeros((2, 3)), NOW), NOW)
    assert np.isfinite(newest.samples.positions).all() and newest.lost == 0
