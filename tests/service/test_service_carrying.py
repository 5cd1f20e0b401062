"""Parts that move between messages: extrapolated poses at each tick, and bounds that remain correct."""

import numpy as np
import pytest
import shapes
from fake_service import MS, SteppedLoop, hands_at

import oracle
from proximity.message import MOVES, ContactFlag, Message
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import MovesInput, TrackedContacts
from proximity.tracker.tracker import Tracker

NOW = 5_000_000_000  # ns
MESSAGE_NS = 16_666_667  # between messages of moves: 60 Hz
VERTICES, FACES = shapes.box((-0.03, -0.02, -0.01), (0.05, 0.02, 0.04))
VELOCITY, TURNING = np.array([0.1, -0.05, 0.2]), np.array([2.0, 1.0, -1.5])
"""m/s and rad/s, of the box."""
TIPS = np.array([[0.03, 0.01, 0.10], [-0.06, 0.0, 0.02], [0.0, 0.09, -0.02]])
RADIUS = 0.007
ROUNDING = 1e-9  # m


def scene():
    return Scene([Solid(VERTICES, FACES, name="box"), Solid(*shapes.cube(0.1, (1, 1, 1)), name="far")])


def rotation(angles):
    """Rotation matrix of a rotation vector: the exponential of its cross product, as a series."""
    x, y, z = angles
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn, term = np.eye(3), np.eye(3)
    for power in range(1, 30):
        term = term @ cross / power
        turn = turn + term
    return turn


def world_from_box(now_ns):
    """The true pose of the box."""
    seconds = 1e-9 * (now_ns - NOW)
    return rotation(TURNING * seconds), VELOCITY * seconds


def told(pose_ns, velocity=VELOCITY, turning=TURNING):
    """A message with the box's pose."""
    message = Message(MOVES, 1)
    message.records["name"], message.records["pose_ns"] = b"box", pose_ns
    message.records["rotation"], message.records["translation"] = world_from_box(pose_ns)
    message.records["velocity"], message.records["angular_velocity"] = velocity, turning
    return message


def distances(pose_ns):
    """True signed distances of the fingertips, each at the time of its pose."""
    true = []
    for tip, instant in zip(TIPS, pose_ns, strict=True):
        turn, shift = world_from_box(instant)
        true.append(oracle.closest(VERTICES @ turn.T + shift, FACES, tip).distance - RADIUS)
    return np.array(true)


class Served(SteppedLoop):
    """A loop with moving parts, stepped tick by tick."""

    def __init__(self, inlet):
        self.inlet, self.scene = inlet, scene()
        self.source = MovesInput("queue:", clock=lambda: NOW)
        tracker = Tracker(self.scene, fingers=len(TIPS), radius=RADIUS)
        super().__init__(TrackedContacts(tracker, self.source), NOW)

    def tick_at(self, now_ns, pose_ns):
        """Contacts of a tick with fingers at rest and the given pose times."""
        return self.tick(now_ns, hands_at(TIPS, pose_ns, np.zeros((len(TIPS), 3))))

    def assert_at(self, now_ns):
        """Check that the box is at its true pose."""
        turn, shift = world_from_box(now_ns)
        np.testing.assert_allclose(self.part("box")["rotation"].reshape(3, 3), turn, atol=1e-12)
        np.testing.assert_allclose(self.part("box")["translation"], shift, atol=1e-12)


def assert_holds(contacts, pose_ns):
    """Check the bounds of each finger at its pose time and at the predicted time."""
    true, then = distances(pose_ns), distances(contacts["predicted_ns"])
    assert (contacts["lower"] <= true + ROUNDING).all() and (true <= contacts["upper"] + ROUNDING).all()
    assert (contacts["predicted_lower"] <= then + ROUNDING).all()
    assert (then <= contacts["predicted_upper"] + ROUNDING).all()
    is_exact = (contacts["flags"] & ContactFlag.EXACT) != 0
    np.testing.assert_allclose(contacts["signed_distance"][is_exact], true[is_exact], atol=ROUNDING)


@pytest.mark.parametrize("age_ns", [0, 30 * MS, 80 * MS])
def test_bounds_hold_at_every_tick_between_messages_however_old_they_are(inlet, age_ns):
    served, next_ns = Served(inlet), NOW
    for ms in range(120):
        now_ns = NOW + ms * MS
        if now_ns >= next_ns:
            inlet.put(told(now_ns - age_ns))
            next_ns += MESSAGE_NS
        pose_ns = np.full(len(TIPS), now_ns - 700_000)
        contacts = served.tick_at(now_ns, pose_ns)

        assert_holds(contacts, pose_ns)
        assert (contacts["flags"] & ContactFlag.EXACT).all() and not served.is_late

    served.assert_at(now_ns - 700_000)


def test_bounds_of_fingers_of_other_instants_are_wider_and_hold(inlet):
    """Parts are placed at the newest pose time; bounds of fingers with older poses are wider."""
    served = Served(inlet)
    inlet.put(told(NOW - 20 * MS))
    pose_ns = np.array([NOW - 15 * MS, NOW - MS, NOW - 40 * MS])

    contacts = served.tick_at(NOW, pose_ns)

    assert_holds(contacts, pose_ns)
    flags = contacts["flags"]
    assert ((flags & ContactFlag.EXACT) != 0).tolist() == [False, True, False]
    assert ((flags & ContactFlag.BOUNDED) != 0).tolist() == [True, False, True]
    free = contacts["time_to_contact_lower"]
    for row, tip_free in enumerate(free):
        for instant in pose_ns[row] + np.linspace(0, 1e9 * tip_free, 20).astype(np.int64):
            assert distances(np.full(len(TIPS), instant))[row] >= -ROUNDING


def test_part_that_nothing_more_is_told_of_makes_frames_late_and_bounds_wider(inlet):
    """After the sender dies, the part may continue at its last speed at most."""
    served = Served(inlet)
    for ms in range(0, 400, 10):
        now_ns = NOW + ms * MS
        if ms <= 50:
            inlet.put(told(now_ns))
        pose_ns = np.full(len(TIPS), now_ns - MS)
        contacts = served.tick_at(now_ns, pose_ns)

        assert_holds(contacts, pose_ns)
        assert served.is_late == (ms >= 150)
    assert not (contacts["flags"] & ContactFlag.EXACT).any() and not contacts["part_velocity"].any()

    inlet.put(told(now_ns))
    contacts = served.tick_at(now_ns, pose_ns)
    assert_holds(contacts, pose_ns)
    assert (contacts["flags"] & ContactFlag.EXACT).all() and not served.is_late


def test_fingers_that_are_not_there_say_nothing_of_when(inlet):
    served = Served(inlet)
    inlet.put(told(NOW))
    poses = hands_at(np.full((3, 3), np.nan), [NOW - 90 * MS, 0, -(2**62)])

    contacts = served.tick(NOW + 20 * MS, poses)

    assert (contacts["lower"] == -np.inf).all() and (contacts["upper"] == np.inf).all()
    np.testing.assert_allclose(served.part("box")["translation"], 0.02 * VELOCITY, atol=1e-15)


def test_part_that_is_taken_out_while_it_moves_leaves_the_others_to_go_on(inlet):
    served = Served(inlet)
    message = Message(MOVES, 2)
    message.records["translation"] = 0.0
    message.records["name"], message.records["pose_ns"] = [b"box", b"far"], NOW
    message.records["rotation"], message.records["velocity"] = np.eye(3), (0.1, 0, 0)
    inlet.put(message)
    served.tick_at(NOW, NOW)
    served.scene.remove("box")

    for ms in (10, 20):
        served.tick_at(NOW + ms * MS, NOW + ms * MS)

    np.testing.assert_allclose(served.part("far")["translation"], (0.002, 0, 0), atol=1e-15)
    assert served.source.notes == []


def test_part_is_carried_no_longer_than_it_is_believed_whatever_a_finger_says_of_its_instant(inlet):
    """Poses may be some milliseconds ahead of the tick, before the part stops."""
    served = Served(inlet)
    inlet.put(told(NOW))
    served.tick_at(NOW + 99 * MS, NOW + 103 * MS)

    assert not served.is_late
    served.assert_at(NOW + 100 * MS)


def test_finger_that_is_not_predicted_is_free_for_no_time_beside_a_part_of_another_instant(inlet):
    served = Served(inlet)
    inlet.put(told(NOW - 20 * MS))
    poses = hands_at(TIPS, [NOW - 15 * MS, NOW - MS, NOW - 40 * MS])  # the first: unknown velocity

    contacts = served.tick(NOW, poses)

    assert not (contacts["flags"] & ContactFlag.PREDICTED).any() and (contacts["lower"] > 0.0).all()
    assert (contacts["time_to_contact_lower"] > 0.0).tolist() == [False, True, False]


def silent(inlet):
    """A loop with a rotating box that received no further messages."""
    served = Served(inlet)
    inlet.put(told(NOW))
    for ms in (0, 150, 300):
        contacts = served.tick_at(NOW + ms * MS, NOW + ms * MS)
    assert served.is_late and (contacts["lower"] < contacts["signed_distance"]).all()
    return served


class Watched:
    """Widening of the upper bounds in the last tick, relative to the tracker's exact ones."""

    def __init__(self, served):
        self.served = served

    def tick(self, ms):
        """Run a tick with one current pose and two older ones."""
        contacts = self.served.tick_at(NOW + ms * MS, NOW + ms * MS - np.arange(len(TIPS)) * MS)
        self.wider = contacts["upper"] - contacts["signed_distance"]

    def is_sure(self, ms):
        """Test whether a tick is in time with the tracker's own bounds."""
        self.tick(ms)
        return not self.wider.any() and not self.served.is_late


def test_silent_part_that_is_taken_out_makes_nothing_late_and_no_bound_wider(inlet):
    served = silent(inlet)
    watched = Watched(served)
    box = served.scene.part("box")
    served.scene.remove("box")
    assert watched.is_sure(310) and watched.is_sure(3000)
    assert served.source.notes == [
        "queue:: 1 parts stood still: no move for 100 ms"
    ]  # no message has moved it since

    served.scene.add(box)
    assert not watched.is_sure(3010) and served.is_late
    served.assert_at(NOW + 100 * MS)


def test_hidden_part_is_carried_on_and_others_go_on_to_widen_bounds(inlet):
    served = Served(inlet)
    watched = Watched(served)
    message = Message(MOVES, 2)
    message.records["translation"] = 0.0
    message.records["name"], message.records["pose_ns"] = [b"box", b"far"], NOW
    message.records["rotation"], message.records["velocity"] = np.eye(3), [(9.0, 0, 0), (0.1, 0, 0)]
    inlet.put(message)
    served.scene.hide("box")
    watched.tick(10)

    np.testing.assert_allclose(watched.wider, (0.0, 0.0001, 0.0002), atol=1e-9)  # at the other's speed
    np.testing.assert_allclose(served.part("box")["translation"], (0.09, 0, 0), atol=1e-12)


def test_silent_part_that_is_hidden_and_shown_widens_bounds_only_where_it_is_shown(inlet):
    served = silent(inlet)
    watched = Watched(served)
    served.scene.hide("box")
    assert watched.is_sure(310)
    served.scene.show("box")
    contacts = served.tick_at(NOW + 320 * MS, NOW + 320 * MS)
    assert_holds(contacts, np.full(len(TIPS), NOW + 320 * MS))
    assert not (contacts["flags"] & ContactFlag.EXACT).any()


def test_bounds_hold_of_a_turning_part_that_is_made_larger(inlet):
    """The speed grows with the distance from the origin, the centre of rotation."""
    served = Served(inlet)
    inlet.put(told(NOW, velocity=0.0))
    pose_ns = NOW + np.array([10, 0, 10]) * MS
    before = np.ptp([served.tick_at(NOW + 10 * MS, pose_ns)[bound][1] for bound in ("lower", "upper")])
    served.scene.deform("box", 2.0 * VERTICES)

    after = np.ptp([served.tick_at(NOW + 10 * MS, pose_ns)[bound][1] for bound in ("lower", "upper")])

    corner = np.linalg.norm(np.abs(VERTICES).max(axis=0))
    assert before == pytest.approx(2 * 0.01 * np.linalg.norm(TURNING) * corner, rel=1e-9)
    assert after == pytest.approx(2 * before, rel=1e-9)
