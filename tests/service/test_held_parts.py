"""A tracked part in a service: its connections are published in separate frames with correct bounds."""

import time

import numpy as np
import pytest
import shapes
from fake_service import KeepingOutlet, ManualClock
from project import MESHES
from served_scene import served_scene

from proximity import PartTracker, Pose
from proximity.errors import ServiceError
from proximity.message import (
    CHANGES,
    CONTACT,
    FRAME,
    MOVES,
    ContactFlag,
    Message,
    Mode,
    PartAction,
    Source,
    State,
    parts_of,
)
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import HeldContacts, MovesInput, NoPoses, Service
from proximity.service.config import check_held, read_scene_file
from proximity.transport import Publisher, open_publisher, open_subscriber
from proximity.transport.received_frame import ReceivedFrame

NOW = 5_000_000_000  # ns
MS = 1_000_000
PATIENCE_S = 60.0


def table():
    """A tracked ring with a lid on it, and three other parts."""
    scene = Scene(
        [
            Solid(*shapes.torus(0.03, 0.012, 40, 20), name="ring"),
            Solid(*shapes.sphere(0.02, 2), name="ball"),
            Solid(*shapes.box((-0.2, -0.2, -0.08), (0.2, 0.2, -0.07)), name="plate"),
            Solid(*shapes.box((-0.01, -0.01, 0.02), (0.01, 0.01, 0.03)), name="lid"),
            Solid(*shapes.sphere(0.01, 2), name="bead"),
        ]
    )
    scene.move("ball", Pose(None, [0.09, 0.0, 0.0]))
    scene.move("bead", Pose(None, [-0.1, 0.02, 0.0]))
    return scene


def move(poses, instant_ns, velocity=np.nan, turning=np.nan):
    """A message that moves parts."""
    message = Message(MOVES, len(poses))
    message.header["send_ns"] = message.records["pose_ns"] = instant_ns
    message.records["name"] = [name.encode() for name in poses]
    message.records["rotation"] = [pose.rotation for pose in poses.values()]
    message.records["translation"] = [pose.translation for pose in poses.values()]
    message.records["velocity"], message.records["angular_velocity"] = velocity, turning
    return message


class Held:
    """A tracked part next to the fingers' scene, stepped tick by tick."""

    def __init__(self, inlet, scene, *parts, **options):
        self.scene, self.inlet = scene, inlet
        self.moves = MovesInput("queue:", clock=lambda: self.now)
        self.now = NOW
        self.held = HeldContacts(lambda: self.scene, self.moves.reported, parts, **options)
        self.moves.follow(scene, parts, lambda: None)
        self.contacts = np.zeros(self.held.count, CONTACT)

    def tick(self, message=None, after_ns=MS):
        self.now += after_ns
        if message is not None:
            self.inlet.put(message)
        self.moves.take(self.scene, self.now)
        self.held.fill(self.contacts, None, self.now)
        return self.contacts


def wander(seed, count):
    """Random poses of a moving and rotating part."""
    rng = np.random.default_rng(seed)
    place, turn = np.array([0.0, 0.0, 0.02]), np.eye(3)
    for _ in range(count):
        place = np.clip(place + rng.normal(size=3) * rng.choice([1e-5, 1e-3]), -0.06, 0.06)
        turn = shapes.rotation(int(rng.integers(2**31))) if rng.random() < 0.01 else turn
        yield Pose(turn, place)


def connections_of(contacts):
    return contacts[contacts["part"] >= 0]


def test_frames_have_the_answers_of_a_part_tracker(inlet):
    held = Held(inlet, table(), "ring", connections=3, latency=0.002)
    tracker = PartTracker(table(), "ring", connections=3, latency=0.002)
    for pose in wander(3, 50):
        contacts = held.tick(move({"ring": pose}, held.now))
        expected = tracker.tick(pose, held.now - MS, held.now)
        for name, own in (("signed_distance", "distance"), ("point_on_finger", "point_on_own")):
            np.testing.assert_array_equal(contacts[name], expected[own])
        for name in ("lower", "upper", "point_on_part", "part", "face", "pose_ns", "age_ns", "predicted_ns"):
            np.testing.assert_array_equal(contacts[name], expected[name])
        for name in ("approach_speed", "predicted_lower", "predicted_upper", "time_to_contact_lower"):
            np.testing.assert_array_equal(contacts[name], expected[name])
        assert contacts["finger"].tolist() == [0, 1, 2]
        assert (contacts["source"] == Source.HELD).all()
        assert (contacts["flags"] & ContactFlag.TRACKED).all()


@pytest.mark.parametrize("options", [{}, {"tolerance": 0.1}, {"budget": 30}, {"working_range": 0.03}])
def test_bounds_hold_over_a_random_motion(inlet, options):
    held, still = Held(inlet, table(), "ring", connections=4, **options), table()
    for pose in wander(5, 150):
        contacts = held.tick(move({"ring": pose}, held.now))
        still.move("ring", pose)
        exact = {
            row: still.clearance("ring", part.name).distance
            for row, part in enumerate(still.parts)
            if part.name != "ring"
        }
        assert contacts["lower"][0] <= min(exact.values()) + 1e-15
        for contact in connections_of(contacts):
            true = exact[int(contact["part"])]
            assert contact["lower"] <= true + 1e-15 and true <= contact["upper"] + 1e-15
            if "tolerance" in options:
                assert not contact["flags"] & ContactFlag.BOUNDED


def test_all_parts_are_where_they_were_at_the_instant_of_the_pose(inlet):
    held, still = Held(inlet, table(), "ring"), table()
    ball = Pose(None, [0.09, 0.0, 0.0])
    held.tick(move({"ball": ball}, held.now, velocity=(-0.2, 0.0, 0.0), turning=(0.0, 0.0, 3.0)))
    started = held.now - MS
    contacts = held.tick(move({"ring": Pose(None, [0.02, 0.0, 0.0])}, held.now + 5 * MS), 7 * MS)
    gone = 1e-9 * (contacts["pose_ns"][0] - started)
    still.move("ring", Pose(None, [0.02, 0.0, 0.0]))
    turn = [[np.cos(3 * gone), -np.sin(3 * gone), 0], [np.sin(3 * gone), np.cos(3 * gone), 0], [0, 0, 1]]
    still.move("ball", Pose(turn, [0.09 - 0.2 * gone, 0.0, 0.0]))
    assert contacts["signed_distance"][0] == pytest.approx(
        still.clearance("ring", "ball").distance, abs=1e-14
    )
    assert held.scene.part("ball").pose.translation[0] == 0.09  # the scene has the reported pose


def test_velocities_that_are_not_given_are_estimated(inlet):
    held = Held(inlet, table(), "ring")
    first = held.tick(move({"ring": Pose(None, [0.0, 0.0, 0.01])}, held.now)).copy()
    assert not first["flags"][0] & ContactFlag.PREDICTED
    assert first["time_to_contact_lower"][0] == 0.0 and first["predicted_upper"][0] == np.inf
    held.tick(move({"ring": Pose(None, [0.0, 0.0, 0.0095])}, held.now))  # 0.5 m/s down
    contact = held.contacts[0]
    assert contact["flags"] & ContactFlag.PREDICTED
    np.testing.assert_allclose(contact["velocity"], [0.0, 0.0, -0.5], atol=1e-9)
    given = held.tick(move({"ring": Pose(None, [0.0, 0.0, 0.0095])}, held.now, (0, 0, 0), (0, 0, 0)))
    assert given["velocity"][0].tolist() == [0, 0, 0] and given["mode"][0] == Mode.RETRACT


def test_a_group_moves_as_one(inlet):
    held, still = Held(inlet, table(), "ring", "lid", connections=3), table()
    turn = shapes.rotation(4)
    for step in range(20):
        pose = Pose(turn, [0.0, 0.0, 0.03 + 1e-3 * step])
        contacts = held.tick(move({"ring": pose}, held.now))
    still.move_many(["ring", "lid"], [pose, pose])  # both were at the origin
    np.testing.assert_allclose(held.scene.part("lid").pose.matrix, pose.matrix, atol=1e-12)
    assert len(connections_of(contacts)) == 3
    for contact in connections_of(contacts):
        name = still.parts[contact["part"]].name
        exact = min(still.clearance(own, name).distance for own in ("ring", "lid"))
        assert contact["signed_distance"] == pytest.approx(exact, abs=1e-12) and name not in ("ring", "lid")


def test_a_part_of_which_no_pose_comes_is_not_tracked(inlet):
    held = Held(inlet, table(), "ring", connections=2)
    assert not held.tick()["flags"].any()
    assert held.tick(move({"ring": Pose(None, [0.0, 0.0, 0.01])}, held.now))["flags"].all()
    assert held.tick(after_ns=98 * MS)["flags"].all()
    lost = held.tick(after_ns=2 * MS)
    assert not lost["flags"].any() and (lost["lower"] == -np.inf).all() and (lost["upper"] == np.inf).all()
    assert lost["source"].tolist() == [Source.HELD] * 2 and lost["finger"].tolist() == [0, 1]
    assert held.tick(move({"ring": Pose(None, [0.0, 0.0, 0.01])}, held.now))["flags"].all()


def test_another_part_that_is_not_reported_any_more_makes_bounds_wider(inlet):
    held = Held(inlet, table(), "ring")
    held.tick(move({"ball": Pose(None, [0.09, 0.0, 0.0])}, held.now, (-0.1, 0.0, 0.0), (0, 0, 0)))
    ring = Pose(None, [0.02, 0.0, 0.0])
    sure = held.tick(move({"ring": ring}, held.now), 50 * MS)[0].copy()
    assert not held.held.is_late and sure["flags"] & ContactFlag.EXACT
    contact = held.tick(move({"ring": ring}, held.now + 150 * MS), 151 * MS)[0]
    assert held.held.is_late and not contact["flags"] & ContactFlag.EXACT
    assert contact["upper"] - contact["lower"] >= 2 * 0.1 * 0.1 and contact["time_to_contact_lower"] == 0.0


def test_parts_that_cross_are_inside_each_other(inlet):
    held = Held(inlet, table(), "ring")
    contact = held.tick(move({"ring": Pose(None, [0.07, 0.0, 0.0])}, held.now))[0]
    assert contact["flags"] & ContactFlag.INSIDE and contact["signed_distance"] == 0.0
    assert contact["mode"] == Mode.POSITION and np.linalg.norm(contact["normal"]) == pytest.approx(1.0)


def test_another_scene_and_a_removed_part_are_noticed(inlet):
    held = Held(inlet, table(), "ring", connections=4)
    pose = Pose(None, [0.0, 0.0, 0.01])
    assert len(connections_of(held.tick(move({"ring": pose}, held.now)))) == 4
    epoch = held.held.epoch
    held.scene.hide("ball")
    assert len(connections_of(held.tick(move({"ring": pose}, held.now)))) == 3 and held.held.epoch > epoch
    epoch, held.scene = held.held.epoch, table()
    assert len(connections_of(held.tick(move({"ring": pose}, held.now)))) == 4 and held.held.epoch > epoch
    held.scene = table()
    held.scene.remove("ring")
    assert not held.tick(move({"ring": pose}, held.now))["flags"].any()
    held.tick()
    assert held.held.notes == ["the held part 'ring' was removed: its contacts are now unknown"]
    held.scene = table()
    assert held.tick(move({"ring": pose}, held.now))["flags"].all()


def test_readers_take_every_frame(inlet):
    """Cover near, far and crossing parts, with and without velocities, and beyond the working range."""
    scene, outlet = table(), KeepingOutlet()
    clock = ManualClock(NOW)
    moves = MovesInput("queue:", clock=clock.now_ns)
    source = HeldContacts(lambda: scene, moves.reported, ["ring"], connections=4, working_range=0.05)
    service = Service(source, NoPoses(moves.address), [Publisher(outlet, "")], period=1e-3, clock=clock)
    frame, states = ReceivedFrame(4), set()
    for tick, pose in enumerate(wander(8, 60)):
        clock.now += MS
        velocity = (0.1, 0.0, 0.3) if tick % 3 else np.nan
        inlet.put(move({"ring": pose}, clock.now, velocity, velocity))
        moves.take(scene, clock.now)
        service.step(clock.now)
        assert frame.decode(outlet.sent[-1], clock.now) is None
        header, records = parts_of(outlet.sent[-1], FRAME)
        assert header["source"] == Source.HELD and (records["source"] == Source.HELD).all()
        states.add(State(int(header["state"])))
    assert states == {State.OK}
    clock.now += 150 * MS
    service.step(clock.now)
    assert parts_of(outlet.sent[-1], FRAME)[0]["state"] == State.STALE


SCENE = """\
[service]
rate_hz = 200
publish = "mailbox:{name}"
[fingers]
count = 1
[[parts]]
file = "{file}"
[input]
poses = "mailbox:{name}/poses"
moves = "mailbox:{name}/moves"
changes = "mailbox:{name}/changes"
[[held]]
part = "pin"
publish = "mailbox:{name}/held"
connections = 2
working_range = 0.5
"""


@pytest.fixture
def served(tmp_path):
    """Serve a scene file with a tracked part in a thread; yield subscriber, publishers and stop function."""
    path, name = tmp_path / "cell.toml", tmp_path.name
    path.write_text(SCENE.format(name=name, file=MESHES / "assembly.step"))
    with (
        open_subscriber(f"mailbox:{name}/held") as frames,
        open_publisher(f"mailbox:{name}/moves") as moves,
        open_publisher(f"mailbox:{name}/changes") as changes,
        served_scene(path) as scene,
    ):
        yield frames, moves, changes, scene.finish


def reading_of(frames, is_it, again=lambda: None):
    """Return the first reading that meets the condition; *again* is called before each read."""
    ends = time.monotonic() + PATIENCE_S
    while True:
        again()
        reading = frames.wait(0.05)
        if is_it(reading):
            return reading
        assert time.monotonic() < ends


def test_a_served_part_is_followed_hidden_parts_left_out_and_its_end_is_said(served):
    frames, moves, changes, finish = served
    pose = Pose(None, [0.0, 0.0, 0.05])

    def report():
        moves.publish(move({"pin": pose}, time.monotonic_ns()))

    reading = reading_of(frames, lambda reading: reading.state is State.OK and frames.part_names, report)
    assert reading.header["source"] == Source.HELD and frames.finger_names == ("pin 1", "pin 2")
    assert frames.part_name(reading.contacts[0]) == "lid"
    message = Message(CHANGES, 1)
    message.records["name"], message.records["action"] = b"lid", PartAction.HIDE
    changes.publish(message)
    reading_of(frames, lambda _: frames.part_name(frames.read().contacts[0]) == "base", report)
    message.records["name"], message.records["action"] = b"pin", PartAction.REMOVE
    changes.publish(message)
    reading = reading_of(
        frames, lambda reading: reading.is_new and reading.header["state"] == State.STALE, report
    )
    assert not reading.contacts["flags"].any()
    report = finish()
    assert any("held part pin:" in note for note in report.notes)
    assert any("'pin' was removed" in note for note in report.notes)
    assert reading_of(frames, lambda reading: reading.state is State.STOPPING)


def test_a_part_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(SCENE.format(name="x", file="assembly.step").replace('"pin"', '["ring", "bolt"]'))
    (tmp_path / "assembly.step").write_bytes((MESHES / "assembly.step").read_bytes())
    with pytest.raises(
        ServiceError, match=r"cell.toml:13: held\[0\]\.part is 'bolt', expected one of ring, ball"
    ):
        check_held(read_scene_file(path), table())
