"""The compiled loop: bitwise agreement with Python, timing, messages and scene changes."""

import itertools
import os
import signal
import sys
import threading
import time
from pathlib import Path
from queue import SimpleQueue

import numpy as np
import pytest
import shapes
from contacts_in_python import ContactsInPython
from fake_service import MS, ManualClock, hands_at
from far_end import PATIENCE, new_name, until
from ports import free_port
from project import MESHES
from publishing import publishing

import proximity
from proximity import MOVES, PATH_POSES, POSES, Message
from proximity.errors import ServiceError
from proximity.message import CHANGES, DEFORMATIONS, FRAME, MEASURED, PartAction, State, parts_of
from proximity.native.mode import IS_AHEAD
from proximity.pose import Pose
from proximity.recording import Recording
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import (
    ChangesInput,
    Describer,
    MessageInput,
    MovesInput,
    RecordingInput,
    SensedContacts,
    Service,
    TrackedContacts,
    loop,
)
from proximity.service.hosting import start_service
from proximity.tracker.tracker import Tracker
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING
from proximity.transport.message_key import write_key

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not IS_AHEAD, reason="it needs mailboxes of Linux and compiled kernels"
)
COUNT = 5
BEGIN_NS = 1000 * MS


@pytest.fixture(scope="module")
def scene():
    return proximity.load(MESHES / "bracket.stl")


@pytest.fixture(autouse=True)
def _nothing_is_left():
    """Remove mailboxes of killed writers, which would persist until the next writer."""
    yield
    for left in Path("/dev/shm").glob(f"proximity.test-{os.getpid()}-*"):
        left.unlink()


def names():
    return [f"shm://{new_name()}" for _ in range(4)]


def contacts_of(scene, count=COUNT):
    return TrackedContacts(Tracker(scene, fingers=count, radius=0.005))


class Poses:
    """Messages of a hand that moves about the bracket, including errors of sensors and senders."""

    def __init__(self, scene, seed):
        self.rng = np.random.default_rng(seed)
        lower, upper = scene.bounds
        self.begin = self.rng.uniform(lower, upper, (COUNT, 3))
        self.goal = self.rng.uniform(lower - 0.01, upper + 0.01, (COUNT, 3))
        self.with_paths = seed % 3 == 2
        self.with_velocities = seed % 3 >= 1

    def messages(self, tick, now_ns):
        """Messages before a tick: mostly one; or none, two, part of a hand, or invalid data."""
        chance = self.rng.random()
        for k in range(0 if chance < 0.1 else 2 if chance < 0.2 else 1):
            yield self.message(tick, now_ns - (2 - k) * MS // 4)

    def message(self, tick, pose_ns):
        kind = PATH_POSES if self.with_paths and self.rng.random() < 0.9 else POSES
        rows = np.sort(self.rng.permutation(COUNT + 1)[: self.rng.integers(1, COUNT + 2)])
        if self.rng.random() < 0.7:
            rows = np.arange(COUNT)
        message = Message(kind, len(rows))
        records, share = message.records, 0.5 - 0.5 * np.cos(tick / 60)
        places = np.vstack([self.begin + share * (self.goal - self.begin), [[0.1, 0.1, 0.1]]])
        records["finger"], records["pose_ns"], message.header["send_ns"] = rows, pose_ns, pose_ns
        records["position"] = places[rows] + self.rng.normal(0.0, 2e-5, (len(rows), 3))
        if self.with_velocities and self.rng.random() < 0.9:
            records["velocity"] = self.rng.normal(0.0, 0.1, (len(rows), 3))
            records["bend"] = self.rng.uniform(0.0, 1.0, len(rows))
        if kind is PATH_POSES:
            along = np.linspace(-0.03, 0.03, proximity.message.PATH_CORNERS)
            records["corners"] = records["position"][:, None] + along[:, None] * self.rng.normal(size=3)
        odd = self.rng.random(len(rows))
        records["position"][odd < 0.03] = np.nan
        records["pose_ns"][(odd > 0.03) & (odd < 0.05)] += 50 * MS
        records["pose_ns"][(odd > 0.05) & (odd < 0.07)] -= 500 * MS
        records["pose_ns"][(odd > 0.07) & (odd < 0.09)] -= 3 * MS
        if odd[0] > 0.98:
            records["position"] = 0.01
        return message


class Parts:
    """Messages of parts that move, rotate, rest, fall silent, and are hidden, shown and deformed."""

    def __init__(self, scene, seed):
        self.rng = np.random.default_rng(100 + seed)
        self.names = [part.name for part in scene.parts]
        self.vertices = scene.parts[-1].solid.mesh.vertices
        self.turns = seed % 2 == 1
        self.silent_until = 0

    def messages(self, tick, now_ns):
        """Kinds and messages before a tick."""
        if self.rng.random() < 0.02:
            self.silent_until = tick + int(self.rng.integers(80, 160))
        if tick >= self.silent_until and self.rng.random() < 0.4:
            yield "moves", self.moves(tick, now_ns)
        if self.rng.random() < 0.03:
            message = Message(CHANGES, 1)
            message.records["name"] = self.rng.choice(self.names[1:]).encode()
            message.records["action"] = self.rng.choice([PartAction.HIDE, PartAction.SHOW])
            yield "changes", message
        if self.rng.random() < 0.01:
            message = Message(DEFORMATIONS, 1)
            message.records["name"], message.records["vertex_count"] = self.names[-1].encode(), 8
            message.records["vertices"][0, :8] = self.vertices * self.rng.uniform(0.9, 1.1)
            yield "changes", message

    def moves(self, tick, now_ns):
        rows = np.sort(self.rng.permutation(len(self.names))[: self.rng.integers(1, len(self.names) + 1)])
        message = Message(MOVES, len(rows))
        records = message.records
        records["name"] = [self.names[row].encode() for row in rows]
        records["pose_ns"] = now_ns - self.rng.integers(0, 3 * MS, len(rows))
        message.header["send_ns"] = now_ns
        angle = 0.3 * np.sin(0.01 * tick) if self.turns else 0.0
        records["rotation"] = Pose.from_quaternion([0, 0, np.sin(angle), np.cos(angle)]).rotation
        records["translation"] = 0.02 * np.sin(0.02 * tick + rows)[:, None] * [1.0, 0.5, -0.3]
        moving = self.rng.random(len(rows)) < 0.7
        records["velocity"] = moving[:, None] * self.rng.normal(0.0, 0.1, 3)
        records["angular_velocity"] = (moving & self.turns)[:, None] * self.rng.normal(0.0, 1.0, 3)
        return message


class Measured:
    """Messages of a distance sensor, including its errors."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(200 + seed)
        self.distances, self.speeds = self.rng.uniform(-0.01, 0.1, COUNT), self.rng.normal(0.0, 0.1, COUNT)

    def messages(self, tick, now_ns):
        """Messages before a tick: mostly one, of some of the fingers."""
        self.speeds += self.rng.normal(0.0, 0.01, COUNT)
        self.distances += 0.001 * self.speeds
        if self.rng.random() < 0.1:
            return
        rows = np.sort(self.rng.permutation(COUNT)[: self.rng.integers(1, COUNT + 1)])
        message, rng, count = Message(MEASURED, len(rows)), self.rng, len(rows)
        records = message.records
        records["finger"], records["signed_distance"] = rows, self.distances[rows]
        records["measured_ns"] = now_ns - rng.integers(0, 3 * MS, count)
        message.header["send_ns"] = now_ns
        for name in ("position", "velocity"):
            records[name] = rng.normal(size=(count, 3))
        records["normal"] = [0.0, 0.0, 1.0]
        records["approach_speed"] = np.where(rng.random(count) < 0.5, np.nan, -self.speeds[rows])
        records["error"] = rng.choice([0.0, 1e-4, np.nan, np.inf, -1.0], count)
        for name in ("bend", "bend_rate"):
            records[name] = rng.choice([np.nan, 0.1, 0.9], count)
        for name in ("force", "stiffness", "damping"):
            records[name] = rng.choice([np.nan, 1.5, 200.0], count)
        records["surface"], records["force_is_valid"] = rng.integers(0, 4, count), rng.integers(0, 2, count)
        odd = rng.random(count)
        records["signed_distance"][odd < 0.05] = np.nan
        records["measured_ns"][(odd > 0.05) & (odd < 0.07)] += 50 * MS
        records["measured_ns"][(odd > 0.07) & (odd < 0.09)] -= 500 * MS
        yield message


def frames_of(scene, seed, *, in_python, ticks=300, parts=None):
    """Frames and report of a service on a manual clock, with the same messages in every run."""
    poses, frames, *of_parts = names()
    is_measured = scene is None
    feed, clock, taken = Measured(seed) if is_measured else Poses(scene, seed), ManualClock(BEGIN_NS), []
    sender, reader, due = open_publisher(poses), open_inlet(frames), itertools.count()
    room = np.zeros(4096, np.uint8)

    def take():
        while (size := reader.receive(room)) != NOTHING:
            data = room[:size].copy()
            data[4:8] = data[16:24] = 0  # checksum and session
            taken.append(data)

    def sleep_until(due_ns):
        take()
        clock.now = max(clock.now, due_ns)
        tick = next(due)
        for message in feed.messages(tick, due_ns):
            sender.publish(message)
        for end, message in () if parts is None else parts.messages(tick, due_ns):
            ends[end].publish(message)

    clock.sleep_until = sleep_until
    source, inputs, ends = SensedContacts(COUNT) if is_measured else contacts_of(scene), (None, None), {}
    if parts is not None:
        inputs = MovesInput(of_parts[0], clock=clock.now_ns), ChangesInput(of_parts[1], SimpleQueue())
        ends = {name: open_publisher(end) for name, end in zip(("moves", "changes"), of_parts, strict=True)}
    if not is_measured:
        source = (ContactsInPython if in_python else TrackedContacts)(source.tracker, *inputs)
    source.is_ticked_by_loop = not in_python
    pose_input = MessageInput(poses, COUNT, clock=clock.now_ns, is_measured=is_measured)
    service = Service(
        source, pose_input, [open_publisher(frames)], period=0.001, valid_for=0.005, clock=clock
    )
    report = service.run(tick_count=ticks)
    take()
    for end in (sender, reader, *ends.values()):
        end.close()
    return taken, report


def assert_same(ones, others):
    assert len(ones) == len(others) == 303
    for tick, (one, other) in enumerate(zip(ones, others, strict=True)):
        assert one.tobytes() == other.tobytes(), (tick, *(parts_of(each, FRAME) for each in (one, other)))


@pytest.mark.parametrize("seed", range(6))
def test_frames_beside_parts_that_move_and_change_are_those_that_python_makes_to_the_bit(seed):
    frames = []
    for in_python in (True, False):
        boxes = [shapes.box((0.02 * k, 0, 0), (0.02 * k + 0.01, 0.02, 0.03)) for k in range(2 + seed)]
        scene = Scene([Solid(*box, name=f"box {k}") for k, box in enumerate(boxes)])
        taken, report = frames_of(scene, seed, in_python=in_python, parts=Parts(scene, seed))
        frames.append(taken)
        assert report.states[State.LATE] or report.states[State.DEGRADED]
    assert_same(*frames)


@pytest.mark.parametrize("seed", range(3))
def test_frames_of_a_sensor_are_those_that_python_makes_to_the_bit(seed):
    (ones, _), (others, report) = (frames_of(None, seed, in_python=way) for way in (True, False))
    assert_same(ones, others)
    assert report.states[State.DEGRADED] + report.states[State.OK] > 100 and report.too_old and report.future


@pytest.mark.parametrize("seed", range(6))
def test_frames_are_those_that_python_makes_to_the_bit(scene, seed):
    """The compiled loop gives the same frames as NumPy and the tracker."""
    (ones, theirs), (others, ours) = (frames_of(scene, seed, in_python=way) for way in (True, False))

    assert_same(ones, others)
    reports = [
        {**each.as_dict(), "compute": 0, "lateness": 0, "publish_failures": 0} for each in (theirs, ours)
    ]
    reports = [{**each, "notes": [note.partition(": ")[2] for note in each["notes"]]} for each in reports]
    assert reports[0] == reports[1]
    assert theirs.states[State.OK] + theirs.states[State.DEGRADED] > 100 and theirs.future and theirs.too_old


class Served:
    """A service in this process, with a publisher and a subscriber."""

    def __init__(self, scene, poses, frames, **settings):
        self.over, self.poses, self.frames = threading.Event(), poses, frames
        source, self.report = contacts_of(scene), None
        describer = Describer([f"finger {k}" for k in range(COUNT)], [0.005] * COUNT)
        settings = {"period": 0.001, "describer": describer, **settings}
        self.service = Service(source, MessageInput(poses, COUNT), [open_publisher(frames)], **settings)
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        self.report = self.service.run(stop=self.over)

    def __enter__(self):
        self.publisher, self.subscriber = open_publisher(self.poses), open_subscriber(self.frames)
        self._thread.start()
        until(lambda: self.subscriber.wait(0.1).is_new)
        return self

    def __exit__(self, *_):
        self.over.set()
        self._thread.join(PATIENCE)
        self.publisher.close()
        self.subscriber.close()

    def pose(self, positions):
        """Publish a current pose; return its time."""
        message, now_ns = Message(POSES, COUNT), time.monotonic_ns()
        message.records["finger"], message.records["position"] = np.arange(COUNT), positions
        message.header["send_ns"] = message.records["pose_ns"] = now_ns
        self.publisher.publish(message)
        return now_ns

    def answer(self, positions):
        """Publish a pose until a valid reading is based on it; return that reading."""

        def look():
            pose_ns = self.pose(positions)
            ends = time.monotonic() + 1.0
            while time.monotonic() < ends:
                reading = self.subscriber.wait(0.1)
                if reading.is_valid and reading.contacts["pose_ns"][0] == pose_ns:
                    return reading
            return None

        return until(look)


ABOVE = np.linspace([0.05, 0.03, 0.15], [0.07, 0.03, 0.15], COUNT)


def by_shared_memory():
    return names()[:2]


def by_threads():
    return [f"mailbox:{new_name()}" for _ in range(2)]


def by_ipv6():
    return [f"udp://[::1]:{free_port()}" for _ in range(2)]


def by_udp(key=""):
    return [f"udp://127.0.0.1:{free_port()}{key}" for _ in range(2)]


def holds(scene, reading):
    """Test whether the bounds of all tracked fingers hold."""
    contacts = reading.contacts[(reading.contacts["flags"] & 1) != 0]
    true = scene.signed_distance(contacts["position"]) - 0.005
    return (contacts["lower"] <= true + 1e-12).all() and (true <= contacts["upper"] + 1e-12).all()


@pytest.mark.parametrize("ends", [by_shared_memory, by_udp, by_threads, by_ipv6])
def test_pose_that_comes_wakes_it(scene, ends):
    """A frame follows the pose, well before the next tick of a period of seconds."""
    with Served(scene, *ends(), period=2.0, valid_for=8.0, stale_after=10.0) as served:
        for lift in (0.0, 0.01, 0.02):
            before_ns = int(served.subscriber.read().header["publish_ns"])
            reading = served.answer(ABOVE + np.array([0.0, 0.0, lift]))
            assert int(reading.header["start_ns"]) - before_ns < 2 * 10**9
            assert holds(scene, reading) and reading.state is State.OK
    assert served.report.ticks >= 4


@pytest.mark.parametrize("ends", [by_shared_memory, by_udp])
def test_threads_send_and_receive_where_the_loop_does_not_know_the_system(scene, ends, monkeypatch):
    monkeypatch.setattr(loop, "OPENS_ENDS", False)
    with Served(scene, *ends()) as served:
        assert holds(scene, served.answer(ABOVE))
    assert not served.report.publish_failures[served.frames]


def test_frames_come_every_period_without_poses(scene):
    with Served(scene, *by_shared_memory(), period=0.0001) as served:
        until(lambda: served.service.report.ticks > 300)
    report = served.report
    assert report.states[State.STARTING] == report.ticks == report.lateness.count == report.compute.count


def test_names_are_described_and_a_scene_is_exchanged_between_two_frames(scene):
    with Served(scene, *by_shared_memory()) as served:
        until(lambda: served.subscriber.wait(0.1) and served.subscriber.part_names)
        first = served.answer(ABOVE)
        distance, epoch = first.contacts["signed_distance"].copy(), int(first.header["epoch"])
        lifted = proximity.load(MESHES / "bracket.stl")
        lifted.hide(lifted.parts[0].name)
        lifted.show(lifted.parts[0].name)
        assert lifted.epoch > 0
        lifted.move(lifted.parts[0].name, proximity.Pose(translation=[0.0, 0.0, 0.05]))
        served.service.replace(contacts_of(lifted))
        second = served.answer(ABOVE)
        assert second.header["epoch"] == epoch + 1
        assert (np.abs(second.contacts["signed_distance"] - distance) > 0.01).all() and holds(lifted, second)
        until(lambda: served.subscriber.wait(0.1) and served.subscriber.part_names)


def test_flood_of_garbage_and_forged_poses_makes_no_wrong_frame(scene, tmp_path):
    """With a key, forged messages are counted; every valid frame has true poses and correct bounds."""
    key = tmp_path / "poses.key"
    write_key(str(key))
    poses, frames = by_udp(f"?key={key}")
    forger, over, true = open_outlet(poses.partition("?")[0]), threading.Event(), set()

    def flood():
        message, rng = Message(POSES, COUNT), np.random.default_rng(0)
        message.records["finger"], message.records["position"] = np.arange(COUNT), [0.0, 0.0, 1.0]
        while not over.wait(0.0002):
            message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
            forger.send(message.seal(time.time_ns(), 1))
            forger.send(rng.integers(0, 256, 500, np.uint8))

    flooder = threading.Thread(target=flood)
    with Served(scene, poses, frames) as served:
        flooder.start()
        for lift in np.linspace(0.0, 0.05, 100):
            true.add(served.pose(ABOVE + np.array([0.0, 0.0, lift])))
            reading = served.subscriber.wait(0.1)
            if reading.is_valid:
                assert set(reading.contacts["pose_ns"].tolist()) <= true and holds(scene, reading)
        over.set()
        flooder.join()
        served.answer(ABOVE)
    assert any("not verified by the key" in note for note in served.report.notes)
    forger.close()


def test_count_of_lost_messages_does_not_overflow(scene):
    """A run may begin with any number; its use as a count of lost messages once overflowed."""
    poses, frames = by_shared_memory()
    with Served(scene, poses, frames) as served:
        served.publisher.close()
        sender, message = open_outlet(poses), Message(POSES, COUNT)
        message.records["finger"], message.records["position"] = np.arange(COUNT), ABOVE
        for session, number in enumerate([2**64 - 2, 2**63, 4, 2**64 - 1]):
            message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
            sender.send(message.seal(time.time_ns() + session, number).copy())
        taken = served.service._loop.input["receiver"]
        until(lambda: int(taken["received"]) == 4)
        assert int(taken["lost"]) == 4 and int(taken["sessions"]) == 4
        sender.close()


def test_sender_that_ends_leaves_frames_late_then_stale_and_the_next_is_taken(scene):
    with Served(scene, *by_shared_memory(), valid_for=0.02) as served:
        for _ in range(3):
            assert holds(scene, served.answer(ABOVE))
            until(lambda: served.subscriber.wait(0.01).state is State.STALE)
            served.publisher.close()
            served.publisher = open_publisher(served.poses)


class FullDisk:
    """A log that accepts ten frames."""

    def __init__(self):
        self.taken = 0

    def append(self, data):
        self.taken += 1
        if self.taken > 10:
            raise OSError("no space left on device")

    def close(self):
        pass


def test_full_disk_is_told_and_stops_nothing(scene):
    with Served(scene, *by_shared_memory(), log=FullDisk()) as served:
        until(lambda: served.service.report.ticks > 50)
        assert holds(scene, served.answer(ABOVE))
    report = served.report
    assert (report.log_written, report.log_lost) == (10, report.ticks + 3 - 10)
    assert any(
        note.endswith("frames were not logged, first: no space left on device") for note in report.notes
    )


SCENE = """\
[service]
publish = ["{frames}"]
[[parts]]
file = "{part}"
[fingers]
count = 5
radius = 0.005
[input]
poses = "{poses}"
"""


def test_service_that_is_held_and_killed_says_nothing_wrong(scene, tmp_path):
    """Across three cycles of SIGSTOP and kill, valid readings are in time, and their bounds hold."""
    (poses, frames), path = by_shared_memory(), tmp_path / "cell.toml"
    path.write_text(SCENE.format(frames=frames, poses=poses, part=MESHES / "bracket.stl"))

    def pose():
        message, now_ns = Message(POSES, COUNT), time.monotonic_ns()
        message.records["finger"] = np.arange(COUNT)
        message.header["send_ns"] = message.records["pose_ns"] = now_ns
        message.records["position"] = ABOVE + 0.03 * np.sin(6e-9 * now_ns)
        return message

    used, sessions = 0, set()
    with publishing(poses, pose, 0.003), open_subscriber(frames) as subscriber:

        def look():
            nonlocal used
            reading = subscriber.wait(0.02)
            if reading.is_valid:
                used += 1
                sessions.add(int(reading.header["session"]))
                header = reading.header
                assert reading.now_ns <= min(header["valid_until_ns"], header["pose_ns"] + 20 * MS)
                assert not reading.is_new or holds(scene, reading)
            return reading

        for _ in range(3):
            with pytest.raises(ServiceError, match="exit code -9"), start_service(path) as service:
                until(lambda: look().is_valid)
                os.kill(service.beginning["pid"], signal.SIGSTOP)
                until(lambda: look().state is State.STALE)
                os.kill(service.beginning["pid"], signal.SIGCONT)
                until(lambda: look().is_valid)
                os.kill(service.beginning["pid"], signal.SIGKILL)
                until(lambda: look().state is State.STALE)
                service.stop()
        assert used >= 6 and len(sessions) == 3 and not subscriber.counts.flawed


class Polled:
    """Python version of playback: yields the last past pose of a recording, if new."""

    address, notes, is_over = "hand", (), False

    def __init__(self, recording):
        end = recording.loop_recording()
        self._recording, self._latency_ns, self._round_ns = recording, end["latency_ns"], end["round_ns"]
        self._times_ns, self._positions, self._row = recording._times_ns, recording._positions, -1
        self._start_ns = None

    def poll(self, now_ns):
        then_ns = now_ns - self._latency_ns
        self._start_ns = then_ns if self._start_ns is None else self._start_ns
        if self._round_ns and then_ns - self._start_ns >= self._round_ns:
            self._start_ns += (then_ns - self._start_ns) // self._round_ns * self._round_ns
            self._row = -1
        row = int(np.searchsorted(self._times_ns, then_ns - self._start_ns, "right")) - 1
        if row > self._row:
            self._row, self.is_over = row, not self._round_ns and row == len(self._times_ns) - 1
            yield hands_at(self._positions[row], self._start_ns + self._times_ns.item(row))

    def close(self):
        pass


@pytest.mark.parametrize(
    ("repeat", "latency", "ticks"), [(False, 0.002, None), (True, 0.0, 700), (True, 0.03, 900)]
)
def test_recording_that_the_loop_plays_is_what_python_polls(scene, repeat, latency, ticks):
    """Playback is bitwise equal, with repeats, a lost finger and pauses of the machine."""
    rng = np.random.default_rng(int(1e3 * latency))
    times_ns = np.cumsum(rng.integers(1, 9, 60)) * MS
    lower, upper = scene.bounds
    positions = np.linspace(lower - 0.01, upper, 60)[:, None] + rng.normal(0.0, 0.002, (60, COUNT, 3))
    positions[20:30, 1] = np.nan
    hand = Recording(times_ns, positions, tuple((0, k) for k in range(COUNT)), "hand")
    taken = []
    for kind in (lambda each: each, Polled):
        frames, oversleeps = (
            names()[0],
            np.random.default_rng(1).choice([0, 0, 0, 0, 400 * MS], 1000, p=[0.3, 0.3, 0.2, 0.19, 0.01]),
        )
        reader, room, found = open_inlet(frames), np.zeros(4096, np.uint8), []
        clock = ManualClock(BEGIN_NS, oversleeps.tolist())
        sleep = clock.sleep_until

        def sleep_until(due_ns, sleep=sleep, reader=reader, room=room, found=found):
            while (size := reader.receive(room)) != NOTHING:
                found.append(room[24:size].tobytes())
            sleep(due_ns)

        clock.sleep_until = sleep_until
        pose_input = kind(RecordingInput(hand, latency=latency, repeat=repeat))
        service = Service(contacts_of(scene), pose_input, [open_publisher(frames)], period=0.001, clock=clock)
        report = service.run(tick_count=ticks)
        sleep_until(0)
        taken.append((found, {**report.as_dict(), "compute": 0, "lateness": 0, "publish_failures": 0}))
        reader.close()

    assert len(taken[0][0]) > 100 and taken[0] == taken[1]
