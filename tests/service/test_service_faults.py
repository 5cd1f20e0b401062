"""System faults: a service in a separate process with shared memory, observed by readers.

Each test kills, starves, edits or sends invalid data to a service run by `start_service`. The components have
their own tests; these cover only effects of their combination.
"""

import os
import shutil
import signal
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from far_end import FarEnd, until
from project import MESHES

import proximity
from proximity.errors import ServiceError
from proximity.message import POSES, ContactFlag, Message, Mode, State
from proximity.recording import FrameReader
from proximity.service.hosting import start_service
from proximity.transport import open_publisher, open_subscriber

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="shared memory is for Linux")

SECOND = 1_000_000_000  # ns
VALID_NS = 20_000_000
PATIENCE = 60.0
RADIUS = 0.007
RECOVERS_WITHIN_NS = 2 * SECOND
"""The requirement is 100 ms; the test machine may be loaded."""
SCENE = """\
[service]
rate_hz = 1000
publish = "{name}"
real_time = false
[fingers]
count = 3
"""
PART = """\
[[parts]]
file = "bracket.stl"
"""
TRACKED = int(ContactFlag.TRACKED)
ABOVE = np.array([[0.05, 0.03, 0.15], [0.06, 0.03, 0.15], [0.07, 0.03, 0.15]])


def name_of(what):
    """A unique address in shared memory."""
    return f"shm://faults-{os.getpid()}-{time.time_ns()}/{what}"


def kept(reading):
    """Copy a reading, so that later ones do not overwrite it."""
    return replace(reading, header=reading.header.copy(), contacts=reading.contacts.copy())


def seen(subscriber, is_so, check=lambda reading: None):
    """Return the first new reading that meets the condition, checking each earlier one."""

    def look():
        reading = subscriber.wait(0.1)
        check(reading)
        return kept(reading) if reading.is_new and is_so(reading) else None

    return until(look, PATIENCE)


def is_ok(reading):
    return reading.state is State.OK


class Watching:
    """Read in a thread like a controller; record readings that are valid but should not be."""

    def __init__(self, subscriber):
        self.subscriber = subscriber
        self.states = []  # changes of (state, session)
        self.first = {}  # by session: time of the first valid reading
        self.wrongly_valid = self.used = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._over.is_set():
            self._note(self.subscriber.wait(0.001))

    def _note(self, reading):
        session = 0 if reading.header is None else int(reading.header["session"])
        if self.states[-1:] != [(reading.state, session)]:
            self.states.append((reading.state, session))
        if not reading.is_valid:
            return
        self.used += 1
        self.first.setdefault(session, reading.now_ns)
        oldest_ns = reading.contacts["pose_ns"][(reading.contacts["flags"] & TRACKED) != 0].min()
        until_ns = min(int(reading.header["valid_until_ns"]), int(oldest_ns) + VALID_NS)
        self.wrongly_valid += reading.now_ns > until_ns

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join(PATIENCE)


def test_service_killed_and_started_anew_is_read_again_and_every_frame_is_accounted_for(tmp_path):
    """After a kill and restart, readers go from OK to LATE, STALE and back to OK without intervention.

    Every frame published by the second run is in the log, and was received or counted as lost.
    """
    for name in ("bracket.stl", "hand.csv"):
        shutil.copy(MESHES / name, tmp_path)
    path, address, log = tmp_path / "cell.toml", name_of("frames"), tmp_path / "run.frames"
    path.write_text(
        SCENE.format(name=address).replace("count = 3\n", "")
        + f'{PART}[input]\nrecording = "hand.csv"\nrepeat = true\n'
    )

    with open_subscriber(address) as mine, Watching(mine) as watching:
        with pytest.raises(ServiceError, match="exit code -9"), start_service(path, log=log) as first:
            until(lambda: watching.first, PATIENCE)
            until(lambda: log.exists() and any(len(run["header"]) for run in FrameReader(log)), PATIENCE)
            os.kill(first.beginning["pid"], signal.SIGKILL)
            until(lambda: watching.states[-1][0] is State.STALE, PATIENCE)
        killed = watching.states[-1][1]
        told = [state for state, _ in watching.states]
        assert told[-2:] == [State.LATE, State.STALE]

        with open_subscriber(address) as other, start_service(path, log=log) as second:
            ends = time.monotonic() + 2.0
            until(lambda: killed not in (watching.states[-1][1], 0), PATIENCE)
            while time.monotonic() < ends:
                other.wait(0.1)
            report = second.stop()
            reading = other.read()
        until(lambda: watching.states[-1][0] is State.STOPPING, PATIENCE)

    published, session = report["ticks"] + 3, int(reading.header["session"])
    headers = np.concatenate([run["header"] for run in FrameReader(log)])
    assert list(dict.fromkeys(headers["session"].tolist())) == [killed, session]
    headers = headers[headers["session"] == session]
    np.testing.assert_array_equal(headers["sequence"], np.arange(published))
    assert report["log_written"] == published and report["log_lost"] == 0
    assert reading.header["sequence"] == published - 1
    # The mailbox of the killed service still had its newest frame.
    assert (other.counts.received + other.counts.lost, other.counts.flawed.total()) == (published + 1, 0)
    assert report["publish_failures"] == {address: 0}

    assert watching.used > 0 and watching.wrongly_valid == 0
    assert (mine.counts.sessions, mine.counts.flawed.total()) == (2, 0)
    usable_ns = headers["publish_ns"][np.isin(headers["state"], [State.OK, State.DEGRADED])][0]
    took_ns = watching.first[session] - int(usable_ns)
    print(f"read {1e-6 * took_ns:.2f} ms after the first frame that can be used was published")
    assert took_ns < RECOVERS_WITHIN_NS


class Feeding:
    """Publish finger poses from a thread at 250 Hz; tests make them invalid."""

    def __init__(self, address):
        self.future_ns = 0
        self.positions = ABOVE.copy()
        self.good = set()  # times of true poses
        self._publisher = open_publisher(address)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        message = Message(POSES, len(ABOVE))
        message.records["finger"] = np.arange(len(ABOVE))
        message.records["velocity"] = message.records["bend"] = np.nan
        while not self._over.wait(0.004):
            now_ns, future_ns = time.monotonic_ns(), self.future_ns
            if not future_ns:
                self.good.add(now_ns)
            message.header["send_ns"] = now_ns
            message.records["pose_ns"] = now_ns + future_ns
            message.records["position"] = self.positions
            self._publisher.publish(message)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join(PATIENCE)
        self._publisher.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A service with live input, common to all tests that do not end it."""
    folder = tmp_path_factory.mktemp("served")
    shutil.copy(MESHES / "bracket.stl", folder)
    path, said = folder / "cell.toml", []
    address = name_of("frames")
    path.write_text(SCENE.format(name=address) + f'{PART}[input]\nposes = "{address}/poses"\n')
    with start_service(path, say=said.append) as service, Feeding(f"{address}/poses") as feeding:
        yield SimpleNamespace(service=service, address=address, path=path, said=said, feeding=feeding)
        report = service.stop(timeout=PATIENCE)
    assert report["publish_failures"] == {address: 0}


@pytest.fixture
def subscriber(served):
    """A reader that has received the hand."""
    with open_subscriber(served.address) as opened:
        seen(opened, is_ok)
        yield opened


def test_finger_that_is_no_number_is_not_tracked_and_the_others_go_on(served, subscriber):
    before = seen(subscriber, is_ok)
    served.feeding.positions[1, 2] = np.nan
    try:
        reading = seen(subscriber, lambda reading: reading.state is State.DEGRADED)
        later = seen(
            subscriber,
            lambda each: (
                each.state is State.DEGRADED and each.header["pose_ns"] > reading.header["pose_ns"] + VALID_NS
            ),
        )
    finally:
        served.feeding.positions[:] = ABOVE

    for each in (reading, later):
        assert each.is_valid
        assert ((each.contacts["flags"] & TRACKED) != 0).tolist() == [True, False, True]
        distances = each.contacts["signed_distance"]
        np.testing.assert_allclose(distances[[0, 2]], before.contacts["signed_distance"][[0, 2]], atol=1e-12)
        assert np.isnan(distances[1]) and each.contacts["lower"][1] == -np.inf
        assert each.contacts["mode"][1] == Mode.HOLD
    seen(subscriber, is_ok)


def test_poses_whose_clock_jumps_ahead_are_dropped_and_the_frame_goes_stale_rather_than_valid(
    served, subscriber
):
    def check(reading):
        if reading.is_valid:
            assert reading.now_ns <= reading.header["valid_until_ns"] <= max(served.feeding.good) + VALID_NS
            assert set(reading.contacts["pose_ns"].tolist()) <= served.feeding.good

    served.feeding.future_ns = SECOND
    try:
        late = seen(subscriber, lambda reading: reading.state is State.LATE, check)
        stale = seen(subscriber, lambda reading: reading.state is State.STALE, check)
    finally:
        served.feeding.future_ns = 0
    again = seen(subscriber, is_ok, check)

    assert late.header["sequence"] < stale.header["sequence"] < again.header["sequence"]
    assert (stale.contacts["flags"] & TRACKED == 0).all()
    assert np.isnan(stale.contacts["signed_distance"]).all()


def test_reader_that_sleeps_for_a_second_counts_what_it_has_lost(served, subscriber):
    with open_subscriber(served.address) as sleeper:
        seen(sleeper, lambda reading: True)
        before, received = int(sleeper.read().header["sequence"]), sleeper.counts.received

        def has_lost_some():
            time.sleep(1.0)
            reading = sleeper.read()
            return kept(reading) if sleeper.counts.lost else None

        last = until(has_lost_some, PATIENCE)
        counts = sleeper.counts

    assert counts.received - received + counts.lost == last.header["sequence"] - before
    assert counts.received > received and (counts.sessions, counts.flawed.total()) == (1, 0)
    assert last.is_new and last.age_ns < SECOND


def test_killed_readers_disturb_neither_the_service_nor_others(served, subscriber):
    before = seen(subscriber, is_ok).header
    for role in ("subscribe", "hold"):
        with FarEnd(role, served.address, 4) as reader:
            assert reader.said == "ready"
            seen(subscriber, is_ok)
            reader.kill()
    after = seen(subscriber, is_ok).header

    # The reader buffers 64 frames, all of which arrive if it is not kept from reading.
    assert after["session"] == before["session"] and after["sequence"] > before["sequence"]
    assert subscriber.counts.flawed.total() == 0 and served.service.is_running


def test_second_service_at_the_address_is_refused_and_the_first_goes_on(served, subscriber):
    with pytest.raises(ServiceError, match=rf"^{served.address}: is in use: .* publishes there$"):
        start_service(served.path)
    session = int(seen(subscriber, is_ok).header["session"])
    assert subscriber.counts.sessions == 1 and session == int(subscriber.read().header["session"])


def test_scene_file_that_is_replaced_is_taken_or_refused_between_two_frames(served, subscriber):
    before = seen(subscriber, is_ok)
    text, said, beside = served.path.read_text(), len(served.said), served.path.with_suffix(".new")

    bracket = proximity.load(MESHES / "bracket.stl")

    def distance_is_of_its_scene(reading):
        if reading.is_new and reading.is_valid:
            lifted = 0.05 * (reading.header["epoch"] > before.header["epoch"])
            expected = bracket.signed_distance(ABOVE - [0.0, 0.0, lifted]) - RADIUS
            np.testing.assert_allclose(reading.contacts["signed_distance"], expected, atol=1e-9)

    beside.write_text(text.replace("bracket.stl", "brocket.stl"))
    beside.replace(served.path)
    until(lambda: distance_is_of_its_scene(subscriber.wait(0.1)) or len(served.said) > said, PATIENCE)
    assert served.said[-1].startswith(
        f"the edit is refused, the previous scene stays in use: {served.path}:8: parts[0].file is "
        "'brocket.stl'"
    )
    still = seen(subscriber, is_ok, distance_is_of_its_scene)
    assert still.header["epoch"] == before.header["epoch"]

    beside.write_text(text.replace('stl"\n', 'stl"\nposition = [0, 0, 0.05]\n'))
    beside.replace(served.path)
    after = seen(
        subscriber,
        lambda reading: is_ok(reading) and reading.header["epoch"] > before.header["epoch"],
        distance_is_of_its_scene,
    )
    distance_is_of_its_scene(after)
    assert after.header["session"] == before.header["session"]
