"""Parts that move between their messages: where they are at a tick, and bounds that hold for that."""

import numpy as np
import pytest
import shapes
from fake_service import MS, filled, hands_at

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
        self.answers = TrackedContacts(tracker, self.source)

    def tick(self, now_ns, pose_ns):
        poses = hands_at(TIPS, pose_ns, np.zeros((len(TIPS), 3)))
        return filled(self.answers, poses, now_ns)


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


def test_fingers_that_are_not_there_say_nothing_of_when(inlet):
    served = Served(inlet)
    inlet.put(told(NOW))
    poses = hands_at(np.full((3, 3), np.nan), [NOW - 90 * MS, 0, -(2**62)])

    contacts = filled(served.answers, poses, NOW + 20 * MS)

    assert (contacts["lower"] == -np.inf).all() and (contacts["upper"] == np.inf).all()
    np.testing.assert_allclose(served.scene.part("box").pose.translation, 0.02 * VELOCITY, atol=1e-15)


def test_part_that_is_taken_out_while_it_moves_is_counted_once_and_the_others_go_on(inlet):
    served = Served(inlet)
    message = Message(MOVES, 2)
    message.records["translation"] = 0.0
    message.records["name"], message.records["pose_ns"] = [b"box", b"far"], NOW
    message.records["rotation"], message.records["velocity"] = np.eye(3), (0.1, 0, 0)
    inlet.put(message)
    served.tick(NOW, NOW)
    served.scene.remove("box")

    for ms in (10, 20):
        served.tick(NOW + ms * MS, NOW + ms * MS)

    np.testing.assert_allclose(served.scene.part("far").pose.translation, (0.002, 0, 0), atol=1e-15)
    assert served.source.notes == ["queue:: 1 moves of parts that are invalid"]


def test_part_is_carried_no_longer_than_it_is_believed_whatever_a_finger_says_of_its_instant(inlet):
    """Poses may be some milliseconds ahead of the tick, when the part does not stand still yet."""
    served = Served(inlet)
    inlet.put(told(NOW))
    served.tick(NOW + 99 * MS, NOW + 103 * MS)

    assert not served.answers.is_late
    turn, shift = world_from_box(NOW + 100 * MS)
    np.testing.assert_allclose(served.scene.part("box").pose.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(served.scene.part("box").pose.translation, shift, atol=1e-12)


def test_finger_that_is_not_predicted_is_free_for_no_time_beside_a_part_of_another_instant(inlet):
    served = Served(inlet)
    inlet.put(told(NOW - 20 * MS))
    poses = hands_at(TIPS, [NOW - 15 * MS, NOW - MS, NOW - 40 * MS])  # the first: no velocity is known

    contacts = filled(served.answers, poses, NOW)

    assert not (contacts["flags"] & ContactFlag.PREDICTED).any() and (contacts["lower"] > 0.0).all()
    assert (contacts["time_to_contact_lower"] > 0.0).tolist() == [False, True, False]


def silent(inlet):
    """Served parts: nothing more is told of the box, which turned."""
    served = Served(inlet)
    inlet.put(told(NOW))
    for ms in (0, 150, 300):
        contacts = served.tick(NOW + ms * MS, NOW + ms * MS)
    assert served.answers.is_late and (contacts["lower"] < contacts["signed_distance"]).all()
    return served


class Watched:
    """By how much `MovesInput.widen` made upper bounds wider at the last tick, m, (N,)."""

    def __init__(self, served, monkeypatch):
        widen = served.source.widen

        def watched(contacts):
            before = contacts["upper"].copy()
            widen(contacts)
            self.wider = contacts["upper"] - before

        self.served = served
        monkeypatch.setattr(served.source, "widen", watched)

    def tick(self, ms):
        """Of fingers of the same instant, and two of earlier ones."""
        return self.served.tick(NOW + ms * MS, NOW + ms * MS - np.arange(len(TIPS)) * MS)

    def is_sure(self, ms):
        """Whether a frame is in time, and its bounds are the tracker's."""
        self.tick(ms)
        return not self.wider.any() and not self.served.answers.is_late


def test_silent_part_that_is_taken_out_makes_nothing_late_and_no_bound_wider(inlet, monkeypatch):
    served = silent(inlet)
    watched = Watched(served, monkeypatch)
    box = served.scene.part("box")
    served.scene.remove("box")
    assert watched.is_sure(310) and watched.is_sure(3000)
    assert served.source.notes == [
        "queue:: 1 parts stood still: no move for 100 ms"
    ]  # nobody wanted to move it any more

    served.scene.add(box)
    assert not watched.is_sure(3010) and served.answers.is_late
    turn, shift = world_from_box(NOW + 100 * MS)
    np.testing.assert_allclose(served.scene.part("box").pose.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(served.scene.part("box").pose.translation, shift, atol=1e-12)


def test_hidden_part_is_carried_on_and_others_go_on_to_widen_bounds(inlet, monkeypatch):
    served = Served(inlet)
    watched = Watched(served, monkeypatch)
    message = Message(MOVES, 2)
    message.records["translation"] = 0.0
    message.records["name"], message.records["pose_ns"] = [b"box", b"far"], NOW
    message.records["rotation"], message.records["velocity"] = np.eye(3), [(9.0, 0, 0), (0.1, 0, 0)]
    inlet.put(message)
    served.scene.hide("box")
    watched.tick(10)

    np.testing.assert_allclose(watched.wider, (0.0, 0.0001, 0.0002), atol=1e-9)  # by the speed of the other
    np.testing.assert_allclose(served.scene.part("box").pose.translation, (0.09, 0, 0), atol=1e-12)


def test_part_that_is_shown_while_a_tick_asks_widens_its_bounds(inlet, monkeypatch):
    served = silent(inlet)
    watched = Watched(served, monkeypatch)
    served.scene.hide("box")
    assert watched.is_sure(310)
    tracker = served.answers.tracker
    advance = tracker.advance
    monkeypatch.setattr(
        tracker, "advance", lambda *given, **named: served.scene.show("box") or advance(*given, **named)
    )
    contacts = served.tick(NOW + 320 * MS, NOW + 320 * MS)
    assert_holds(contacts, np.full(len(TIPS), NOW + 320 * MS))
    assert not (contacts["flags"] & ContactFlag.EXACT).any()


@pytest.mark.parametrize("edit", [Scene.remove, Scene.hide])
def test_turning_part_that_goes_while_a_tick_asks_does_not_end_the_service(inlet, monkeypatch, edit):
    """Another thread takes it out between the moves and the bounds."""
    served = Served(inlet)
    watched = Watched(served, monkeypatch)
    inlet.put(told(NOW))
    tracker = served.answers.tracker
    advance = tracker.advance
    with monkeypatch.context() as patch:
        patch.setattr(
            tracker, "advance", lambda *rest, **more: edit(served.scene, "box") or advance(*rest, **more)
        )
        served.tick(NOW, NOW - np.arange(len(TIPS)) * MS)
    assert watched.is_sure(10)


@pytest.mark.parametrize("again", [False, True])
def test_part_that_goes_just_before_it_is_moved_is_no_unfit_move(inlet, monkeypatch, again):
    """Between a tick's look at the scene and its moves; and whoever took it out may put it back."""
    served = Served(inlet)
    watched = Watched(served, monkeypatch)
    inlet.put(told(NOW))
    served.tick(NOW, NOW)
    box, move_many = served.scene.part("box"), served.scene.move_many

    def too_late(names, *rest):
        served.scene.remove("box")
        try:
            move_many(names, *rest)
        finally:
            if again:
                served.scene.add(box)

    with monkeypatch.context() as patch:
        patch.setattr(served.scene, "move_many", too_late)
        served.tick(NOW + 10 * MS, NOW + 10 * MS)
    assert served.source.notes == []

    pose_ns = NOW + 20 * MS - np.arange(len(TIPS)) * MS
    contacts = served.tick(NOW + 20 * MS, pose_ns)
    if again:
        assert_holds(contacts, pose_ns)
        np.testing.assert_allclose(served.scene.part("box").pose.translation, 0.02 * VELOCITY, atol=1e-15)
    else:
        assert served.source.notes == ["queue:: 1 moves of parts that are invalid"]
        assert watched.is_sure(30)


def test_bounds_hold_of_a_turning_part_that_is_made_larger(inlet):
    """It turns about its origin: what is farther from there goes faster."""
    served = Served(inlet)
    inlet.put(told(NOW, velocity=0.0))
    pose_ns = NOW + np.array([10, 0, 10]) * MS
    before = np.ptp([served.tick(NOW + 10 * MS, pose_ns)[bound][1] for bound in ("lower", "upper")])
    served.scene.deform("box", 2.0 * VERTICES)

    after = np.ptp([served.tick(NOW + 10 * MS, pose_ns)[bound][1] for bound in ("lower", "upper")])

    corner = np.linalg.norm(np.abs(VERTICES).max(axis=0))
    assert before == pytest.approx(2 * 0.01 * np.linalg.norm(TURNING) * corner, rel=1e-9)
    assert after == pytest.approx(2 * before, rel=1e-9)
