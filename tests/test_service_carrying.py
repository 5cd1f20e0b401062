"""Parts that move between their messages: where they are at a tick, and bounds that hold for that."""

import numpy as np
import pytest
import shapes
from fake_service import MS, QueueInlet, hands_at

import oracle
from proximity.message import MOVES, ContactFlag, Message
from proximity.scene import Scene
from proximity.service import MovesInput, TrackerAnswers, reception
from proximity.solid import Solid
from proximity.tracker import Tracker

NOW = 5_000_000_000  # ns
MESSAGE_NS = 16_666_667  # between messages of moves: 60 Hz
VERTICES, FACES = shapes.box((-0.03, -0.02, -0.01), (0.05, 0.02, 0.04))
VELOCITY, TURNING = np.array([0.1, -0.05, 0.2]), np.array([2.0, 1.0, -1.5])
"""m/s and rad/s, of the box."""
TIPS = np.array([[0.03, 0.01, 0.10], [-0.06, 0.0, 0.02], [0.0, 0.09, -0.02]])
RADIUS = 0.007
ROUNDING = 1e-9  # m


@pytest.fixture
def inlet(monkeypatch):
    queue = QueueInlet()
    monkeypatch.setattr(reception, "open_inlet", lambda address: queue)
    return queue


def scene():
    return Scene([Solid(VERTICES, FACES, name="box"), Solid(*shapes.cube(0.1, (1, 1, 1)), name="far")])


def rotation(angles):
    """Turned about a vector by its length: the exponential of its cross product, as a series."""
    x, y, z = angles
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn, term = np.eye(3), np.eye(3)
    for power in range(1, 30):
        term = term @ cross / power
        turn = turn + term
    return turn


def world_from_box(now_ns):
    """Where the box truly is."""
    seconds = 1e-9 * (now_ns - NOW)
    return rotation(TURNING * seconds), VELOCITY * seconds


def told(pose_ns, velocity=VELOCITY, turning=TURNING):
    """A message of where the box is."""
    message = Message(MOVES, 1)
    message.records["name"], message.records["pose_ns"] = b"box", pose_ns
    message.records["rotation"], message.records["translation"] = world_from_box(pose_ns)
    message.records["velocity"], message.records["angular_velocity"] = velocity, turning
    return message


def distances(pose_ns):
    """True signed distances of the fingertips, each at the instant of its pose."""
    true = []
    for tip, instant in zip(TIPS, pose_ns, strict=True):
        turn, shift = world_from_box(instant)
        true.append(oracle.closest(VERTICES @ turn.T + shift, FACES, tip).distance - RADIUS)
    return np.array(true)


class Served:
    """A tracker that is fed with moves, tick by tick."""

    def __init__(self, inlet):
        self.inlet, self.scene = inlet, scene()
        self.source = MovesInput("queue:", clock=lambda: NOW)
        tracker = Tracker(self.scene, fingers=len(TIPS), radius=RADIUS)
        self.answers = TrackerAnswers(tracker, self.source)

    def tick(self, now_ns, pose_ns):
        hands = hands_at(TIPS, pose_ns, np.zeros((len(TIPS), 3)))
        return self.answers.answer(hands, now_ns)


def assert_holds(contacts, pose_ns):
    """What is said of each finger is so, at its pose and when the controller acts."""
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
        contacts = served.tick(now_ns, pose_ns)

        assert_holds(contacts, pose_ns)
        assert (contacts["flags"] & ContactFlag.EXACT).all() and not served.answers.is_late

    matrix = served.scene.part("box").pose.matrix
    turn, shift = world_from_box(now_ns - 700_000)
    np.testing.assert_allclose(matrix[:3, :3], turn, atol=1e-12)
    np.testing.assert_allclose(matrix[:3, 3], shift, atol=1e-12)


def test_bounds_of_fingers_of_other_instants_are_wider_and_hold(inlet):
    """Parts are where they are at the newest pose; of a finger that was seen before, less is known."""
    served = Served(inlet)
    inlet.put(told(NOW - 20 * MS))
    pose_ns = np.array([NOW - 15 * MS, NOW - MS, NOW - 40 * MS])

    contacts = served.tick(NOW, pose_ns)

    assert_holds(contacts, pose_ns)
    flags = contacts["flags"]
    assert ((flags & ContactFlag.EXACT) != 0).tolist() == [False, True, False]
    assert ((flags & ContactFlag.BOUNDED) != 0).tolist() == [True, False, True]
    free = contacts["time_to_contact_lower"]
    for row, tip_free in enumerate(free):
        for instant in pose_ns[row] + np.linspace(0, 1e9 * tip_free, 20).astype(np.int64):
            assert distances(np.full(len(TIPS), instant))[row] >= -ROUNDING


def test_part_that_nothing_more_is_told_of_makes_frames_late_and_bounds_wider(inlet):
    """The one who tells dies; the part goes on, no faster than was told."""
    served = Served(inlet)
    for ms in range(0, 400, 10):
        now_ns = NOW + ms * MS
        if ms <= 50:
            inlet.put(told(now_ns))
        pose_ns = np.full(len(TIPS), now_ns - MS)
        contacts = served.tick(now_ns, pose_ns)

        assert_holds(contacts, pose_ns)
        assert served.answers.is_late == (ms >= 150)
    assert not (contacts["flags"] & ContactFlag.EXACT).any() and not contacts["part_velocity"].any()

    inlet.put(told(now_ns))
    contacts = served.tick(now_ns, pose_ns)
    assert_holds(contacts, pose_ns)
    assert (contacts["flags"] & ContactFlag.EXACT).all() and not served.answers.is_late


def test_nothing_is_moved_in_a_tick_where_nothing_moves(inlet, monkeypatch):
    served, calls = Served(inlet), []
    move_many = served.scene.move_many
    monkeypatch.setattr(
        served.scene, "move_many", lambda names, *rest: calls.append(names) or move_many(names, *rest)
    )
    inlet.put(told(NOW, velocity=np.nan, turning=0.0))
    for ms in range(5):
        served.tick(NOW + ms * MS, NOW + ms * MS)
    assert calls == [["box"]]  # as the message came

    inlet.put(told(NOW))
    for ms in range(300):
        served.tick(NOW + ms * MS, NOW + ms * MS)
    assert len(calls) == 1 + 1 + 101  # the message, 100 ticks until it is silent, and where it stands then


def test_fingers_that_are_not_there_say_nothing_of_when(inlet):
    served = Served(inlet)
    inlet.put(told(NOW))
    hands = hands_at(np.full((3, 3), np.nan), [NOW - 90 * MS, 0, -(2**62)])

    contacts = served.answers.answer(hands, NOW + 20 * MS)

    assert (contacts["lower"] == -np.inf).all() and (contacts["upper"] == np.inf).all()
    np.testing.assert_allclose(served.scene.part("box").pose.translation, 0.02 * VELOCITY, atol=1e-15)


def test_part_that_is_taken_out_while_it_moves_is_counted_once_and_the_others_go_on(inlet):
    served = Served(inlet)
    message = Message(MOVES, 2)
    message.records["name"], message.records["pose_ns"] = [b"box", b"far"], NOW
    message.records["rotation"], message.records["velocity"] = np.eye(3), (0.1, 0, 0)
    inlet.put(message)
    served.tick(NOW, NOW)
    served.scene.remove("box")

    for ms in (10, 20):
        served.tick(NOW + ms * MS, NOW + ms * MS)

    np.testing.assert_allclose(served.scene.part("far").pose.translation, (0.002, 0, 0), atol=1e-15)
    assert served.source.notes == ["queue:: 1 moves of parts that cannot be"]
