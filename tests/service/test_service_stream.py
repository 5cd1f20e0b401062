"""Poses from messages: over a real mailbox, and with every kind of error over a queue."""

import numpy as np
import pytest
from fake_service import MS, Newest, QueueInlet

from proximity.core.receiver_state import MAX_FLAWED
from proximity.errors import PublishError
from proximity.message import MEASURED, PATH_CORNERS, PATH_POSES, POSES, Message
from proximity.service import FingerPoses, Measurements, MessageInput
from proximity.service.inputs import inbox
from proximity.transport import open_publisher

NOW = 7000 * MS


def poses(positions, pose_ns=NOW, *, fingers=None, kind=POSES):
    """A message with these poses, by default of the first fingers."""
    message = Message(kind, len(positions))
    records = message.records
    records["finger"] = np.arange(len(positions)) if fingers is None else fingers
    records["pose_ns"], records["position"] = pose_ns, positions
    records["velocity"] = records["bend"] = np.nan
    return message


def stream(count=2):
    return Newest(MessageInput("queue:", count, clock=lambda: NOW), FingerPoses(count), NOW)


def measured(distances, measured_ns=NOW, *, fingers=None):
    """A message with these distances, by default of the first fingers."""
    message = Message(MEASURED, len(distances))
    message.records["finger"] = np.arange(len(distances)) if fingers is None else fingers
    message.records["measured_ns"], message.records["signed_distance"] = measured_ns, distances
    return message


def posed(heights, pose_ns=NOW, *, fingers=None):
    return poses([[height, 2.0, 3.0] for height in heights], pose_ns, fingers=fingers)


INPUTS = {"poses": (posed, FingerPoses, False), "measurements": (measured, Measurements, True)}
EACH_INPUT = pytest.mark.parametrize("what", INPUTS)


def received(what, count, address="queue:", clock=lambda: NOW):
    """An input of that kind, and a function that makes its messages."""
    make, samples, is_measured = INPUTS[what]
    source = MessageInput(address, count, clock=clock, is_measured=is_measured)
    return Newest(source, samples(count), NOW), make


@EACH_INPUT
def test_samples_cross_a_mailbox(what):
    source, make = received(what, 2, f"mailbox:{what}")
    with open_publisher(f"mailbox:{what}") as sender:
        assert source.poll(NOW) is None
        sender.publish(make([0.25, 0.5], [NOW, NOW - MS]))

        polled = source.poll(NOW)
        assert polled.values[:, 0].tolist() == [0.25, 0.5]
        assert polled.pose_ns.tolist() == [NOW, NOW - MS]
        if what == "poses":
            assert polled.velocities is None and polled.paths is None and polled.bends is None
        assert source.poll(NOW) is None
    source.source.close()
    assert source.notes == []


@EACH_INPUT
def test_message_need_not_have_all_fingers(inlet, what):
    source, make = received(what, 3)
    inlet.put(make([1.0, 1.5, 1.0]))
    inlet.put(make([2.0], NOW + 5, fingers=[1]))

    polled = source.poll(NOW)

    assert polled.values[:, 0].tolist() == [1.0, 2.0, 1.0]
    assert polled.pose_ns.tolist() == [NOW, NOW + 5, NOW]


@EACH_INPUT
def test_fingers_that_are_not_served_are_counted_and_the_others_taken(inlet, caplog, what):
    source, make = received(what, 2)
    for _ in range(2):
        inlet.put(make([3.0, 4.0, 5.0], fingers=[7, 1, 2**32 - 1]))

    polled = source.poll(NOW)

    assert np.isnan(polled.values[0, 0]) and polled.values[1, 0] == 4.0
    assert source.notes == [f"queue:: 4 {what} of fingers that are not served"]
    assert [record.message for record in caplog.records] == [
        f"queue:: {what} of fingers that are not served are not used"
    ]


@EACH_INPUT
def test_sample_that_was_refused_is_not_given_again_with_those_of_other_fingers(inlet, what):
    """A refused future sample was once published half a second later, when its time came."""
    source, make = received(what, 2)
    inlet.put(make([9.0], NOW + 500 * MS, fingers=[0]))
    for ms in range(700):
        inlet.put(make([float(ms)], NOW + ms * MS, fingers=[1]))
        polled = source.poll(NOW + ms * MS)
        assert np.isnan(polled.values[0, 0])

    assert source.newest.future == 1 and polled.values[1, 0] == 699.0


def test_velocities_are_there_from_the_first_that_is_known_on(inlet):
    source = stream(2)
    inlet.put(poses(np.zeros((2, 3))))
    assert source.poll(NOW).velocities is None
    known = poses(np.zeros((2, 3)))
    known.records["velocity"][1] = (1, 2, 3)
    inlet.put(known)

    velocities = source.poll(NOW).velocities
    assert np.isnan(velocities[0]).all() and velocities[1].tolist() == [1, 2, 3]

    inlet.put(poses(np.zeros((2, 3))))
    assert np.isnan(source.poll(NOW).velocities).all()


def test_paths_come_with_their_poses_and_go_with_a_pose_without(inlet):
    source = stream(2)
    message = poses(np.zeros((2, 3)), kind=PATH_POSES)
    message.records["corners"] = np.arange(2 * PATH_CORNERS * 3).reshape(2, PATH_CORNERS, 3)
    message.records["bend"] = [0.25, np.nan]
    inlet.put(message)

    polled = source.poll(NOW)
    np.testing.assert_array_equal(polled.paths, message.records["corners"])
    np.testing.assert_array_equal(polled.bends, [0.25, np.nan])

    inlet.put(poses(np.zeros((1, 3)), fingers=[0]))
    polled = source.poll(NOW)
    assert np.isnan(polled.paths[0]).all() and np.isfinite(polled.paths[1]).all()


def test_bends_come_with_poses_that_have_no_path(inlet):
    source = stream(2)
    message = poses(np.zeros((2, 3)))
    message.records["bend"] = [0.25, np.nan]
    inlet.put(message)

    polled = source.poll(NOW)
    np.testing.assert_array_equal(polled.bends, [0.25, np.nan])
    assert polled.paths is None

    inlet.put(poses(np.zeros((1, 3)), fingers=[0]))
    assert np.isnan(source.poll(NOW).bends).all()


def test_both_kinds_are_numbered_apart(inlet):
    source = stream(1)
    inlet.put(poses(np.zeros((1, 3))), sequence=5)
    inlet.put(poses(np.ones((1, 3)), kind=PATH_POSES), sequence=0)

    assert (source.poll(NOW).positions == 1).all()


def test_damage_repetition_and_loss_are_counted_and_the_rest_taken(inlet):
    source = stream(1)
    inlet.put(poses(np.zeros((1, 3))), sequence=0)
    inlet.put(poses(np.ones((1, 3))), sequence=4)
    inlet.queue.append(inlet.queue[0].copy())  # again
    damaged = poses(np.full((1, 3), 2.0)).seal(1, 5).copy()
    damaged[60] ^= 1
    inlet.queue += [damaged, np.zeros(7, np.uint8), damaged[:-8]]

    assert (source.poll(NOW).positions == 1).all()
    assert source.notes == [
        "queue:: 2 received, 3 lost, 1 shorter than a header, 1 not as long as it declares, "
        "1 damaged in transit, 1 overtaken or repeated"
    ]


def test_flood_takes_a_few_messages_of_a_tick_and_no_more(inlet):
    source = stream(1)
    inlet.queue = [np.zeros(200, np.uint8)] * 1000
    inlet.put(poses(np.ones((1, 3))))

    assert source.poll(NOW) is None
    assert len(inlet.queue) == 1001 - MAX_FLAWED
    for _ in range(1000 // MAX_FLAWED):
        polled = source.poll(NOW)
    assert (polled.positions == 1).all()


def test_newest_pose_counts_however_many_came_since_the_tick_before(inlet):
    """At 1000 messages per second and 20 ticks, the oldest queued ones were once served, all late."""
    source = stream(1)
    for tick in range(5):
        for number in range(50):
            inlet.put(poses([[tick, number, 0.0]], NOW + number))

        assert source.poll(NOW).positions.tolist() == [[tick, 49, 0]]


def test_address_that_fails_is_counted_and_said_once(inlet, caplog):
    source = stream(1)
    inlet.queue = [PublishError("queue: broken"), PublishError("queue: broken again")]

    assert source.poll(NOW) is None and source.poll(NOW) is None
    inlet.put(poses(np.ones((1, 3))))
    assert (source.poll(NOW).positions == 1).all()
    assert source.notes == ["receiving failed 2 times, first: queue: broken"]
    assert [record.message for record in caplog.records] == ["receiving failed: queue: broken"]


class ForeignSender:
    """A sender on another machine, whose clock is ahead, with 10 ms between messages."""

    def __init__(self, monkeypatch):
        self.queue, self.now, self.session = QueueInlet(shares_clock=False), NOW, 1
        self.ahead = 5 * 3600 * 1000 * MS
        monkeypatch.setattr(inbox, "open_inlet", lambda address: self.queue)
        self.source = Newest(MessageInput("queue:", 1, clock=lambda: self.now), FingerPoses(1), NOW)

    def send(self, transit=MS):
        """Reported age, ms, of a pose that was 2 ms old when sent; None if rejected."""
        self.now += 10 * MS
        sent = self.now + self.ahead - transit
        message = poses(np.zeros((1, 3)), sent - 2 * MS)
        message.header["send_ns"] = sent
        self.queue.put(message, session=self.session)
        polled = self.source.poll(self.now)
        return None if polled is None else (self.now - polled.pose_ns[0]) / MS


def test_instants_of_another_machine_are_told_on_our_clock(monkeypatch):
    sender = ForeignSender(monkeypatch)

    ages = [sender.send(transit) for transit in (3 * MS, MS, 4 * MS, MS, MS, MS, 4 * MS, MS)]

    # Poses are accepted once the other clock has been observed for 50 ms. The transit time in excess of the
    # fastest is measured, and 1 ms is added for the fastest.
    assert ages[:5] == [None] * 5
    assert ages[5:] == pytest.approx([2 + 1, 2 + 3 + 1, 2 + 1], abs=0.05)


def test_sender_on_another_machine_that_starts_anew_has_another_clock(monkeypatch):
    sender = ForeignSender(monkeypatch)
    assert sender.send() is None
    while (age := sender.send()) is None:
        pass
    assert age == pytest.approx(3, abs=0.05)

    sender.session, sender.ahead = 2, -sender.now
    assert sender.send() is None
    while (age := sender.send()) is None:
        pass
    assert age == pytest.approx(3, abs=0.05)


def test_poses_that_become_late_for_good_are_not_taken_for_new_ones_of_another_clock(monkeypatch):
    sender = ForeignSender(monkeypatch)
    while sender.send() is None:
        pass
    sender.now += 1300 * MS
    ages = [sender.send(transit=1301 * MS) for _ in range(200)]

    assert min(age for age in ages if age is not None) >= 1300


@pytest.mark.parametrize("ahead", [-(2**63) - NOW + 1, 2**63 - NOW - 1000 * MS])
def test_sender_whose_clock_is_beyond_all_measure_is_left_out(monkeypatch, ahead):
    """Its times and their offset from the local clock do not fit into 64 bits."""
    sender = ForeignSender(monkeypatch)
    sender.ahead = ahead
    told = [sender.send(transit=0) for _ in range(20)]

    assert told == [None] * 20
    (note,) = sender.source.notes
    assert note.endswith(" messages with an impossible time")


def test_address_that_cannot_be_opened_is_refused_at_once():
    with pytest.raises(PublishError, match="no transport is called 'pigeon'"):
        MessageInput("pigeon://loft", 1)
