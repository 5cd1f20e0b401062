"""From pose to frame, with pytest-benchmark: ``python -m pytest bench -k end_to_end``.

A service runs in a separate process. This process is glove and controller: it publishes five poses and reads
until it has the frame that answers them. The time includes the transport of the poses, the wait for the next
tick (half a period on average: poses are sent at any instant of it), the tick, and the transport of the frame
and its checks.
"""

import json
import time
from contextlib import contextmanager

import numpy as np
import pytest

import proximity
from benchmarks.service.addresses import new_addresses
from benchmarks.support import threads
from benchmarks.support.project import MESHES
from benchmarks.ticks import motions
from benchmarks.ticks.scenes import RADIUS, face_count
from proximity.errors import PublishError

PART = MESHES / "bracket.stl"
ANSWERED_WITHIN = 30.0  # s
SENT_AGAIN = 0.1  # s
ANSWERS = (proximity.State.OK, proximity.State.DEGRADED, proximity.State.LATE)
TICKS = 1000  # of the hand's motion, there and back
CASES = [("shm", 1000), ("shm", 5000), ("udp", 1000), ("zenoh", 1000)]
pytestmark = pytest.mark.benchmark(timer=time.perf_counter)
SCENE = """
[service]
rate_hz = {rate}
publish = [{frames}]
[fingers]
radius = {radius}
max_speed = 100.0
[[parts]]
file = {part}
[input]
poses = {poses}
"""


@pytest.mark.parametrize(("scheme", "rate"), CASES)
def test_pose_to_frame(timed, leave_out, is_small, tmp_path, scheme, rate):
    if is_small and (scheme, rate) != CASES[0]:
        pytest.skip("one service is enough for a look")
    scene = proximity.load(PART)
    positions = unbroken(motions.ticks_of(next(motions.hands()), scene))[:TICKS]
    faces = face_count(scene)
    try:
        with a_loop(tmp_path, scheme, rate) as loop:
            check_answers(loop, scene, [*positions[:: len(positions) // 5], positions[0]])
            rounds, rng = there_and_back(positions), np.random.default_rng(14)

            def arguments():
                time.sleep(rng.uniform(0.0, 1.0 / rate))
                return (next(rounds),), {}

            group = f"end to end, bracket/generated hand, {faces:,} faces, 5 fingers, {rate} Hz"
            timed(f"pose to frame, {scheme}", group, loop.ask, 1, arguments=arguments)
    except PublishError as reason:
        leave_out(scheme, reason)


class Loop:
    """Sends poses, and waits for the frame that answers them."""

    def __init__(self, poses, frames):
        self._poses, self._frames = poses, frames
        self._message = proximity.Message(proximity.POSES, 5)
        self._message.records["finger"] = range(5)
        self._message.records["velocity"] = self._message.records["bend"] = np.nan
        self._answered_ns = 0

    def ask(self, positions):
        """Publish five positions, and return the reading that answers them.

        Without an answer in time, as on a busy machine, they are sent again.
        """
        ends = time.monotonic() + ANSWERED_WITHIN
        while time.monotonic() < ends:
            self._send(positions)
            again = time.monotonic() + SENT_AGAIN
            while time.monotonic() < again:
                reading = self._frames.read()
                pose_ns = int(reading.header["pose_ns"])
                if pose_ns > self._answered_ns and reading.header["state"] in ANSWERS:
                    self._answered_ns = pose_ns
                    return reading
        raise TimeoutError(f"no frame answered a pose within {ANSWERED_WITHIN:g} s; {_words(reading)}")

    def _send(self, positions):
        message = self._message
        message.records["position"] = positions
        message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
        self._poses.publish(message)


def _words(reading):
    header, state = reading.header, proximity.State(int(reading.header["state"]))
    age = 1e-6 * (reading.now_ns - int(header["pose_ns"]))
    return f"the last is {state.name}, its poses are {age:.0f} ms old, {header['missed']} ticks were missed"


@contextmanager
def a_loop(folder, scheme, rate):
    """Yield a service that answers poses, with this process as its glove and its controller."""
    cores = threads.CORES
    read_at, frames_at = new_addresses(scheme)
    poses_at, send_at = new_addresses(scheme)
    path = folder / "scene.toml"
    texts = {"frames": frames_at, "part": str(PART), "poses": poses_at}
    quoted = {name: json.dumps(text) for name, text in texts.items()}
    path.write_text(SCENE.format(rate=rate, radius=RADIUS, **quoted), encoding="utf-8")
    with (
        threads.on_cores(cores),  # inherited by the service's process, which takes the last one
        proximity.open_subscriber(read_at) as frames,
        proximity.start_service(path),
        threads.on_cores(sorted(cores)[:-1] or cores),
        proximity.open_publisher(send_at) as poses,
    ):
        yield Loop(poses, frames)


def check_answers(loop, scene, positions):
    """Compare the bounds in frames with the scene's distances at the same positions."""
    for tips in positions:
        loop.ask(tips)
        time.sleep(0.05)  # distant parts may be a tick behind, with bounds only
        contacts = loop.ask(tips).contacts
        time.sleep(0.05)
        true = scene.signed_distance(tips) - RADIUS
        tolerance = 1e-9  # m
        assert (contacts["lower"] <= true + tolerance).all() and (true <= contacts["upper"] + tolerance).all()


def unbroken(positions):
    """Return the longest run of ticks in which all fingers are tracked: the service rejects jumps."""
    is_whole = ~np.isnan(positions).any(axis=(1, 2))
    runs = np.split(positions, np.flatnonzero(np.diff(is_whole)) + 1)
    return max((run for run in runs if not np.isnan(run).any()), key=len)


def there_and_back(positions):
    """Yield all positions forward and backward, without end."""
    while True:
        yield from positions
        yield from positions[::-1]
