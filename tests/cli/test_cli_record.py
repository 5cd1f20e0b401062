"""``proximity record``: the file has every received frame, for each end of the recording."""

import json
import os
import re
import signal
import threading
import time

import numpy as np
import pytest
import queued_transport
from sealed_frames import frame, sealed

from proximity.cli.service import record
from proximity.message import FRAME
from proximity.recording import FrameReader
from proximity.transport import open_outlet, open_publisher

COMMAND = ("record",)
ADDRESS = "queue:proximity"


@pytest.fixture(autouse=True)
def queued(monkeypatch):
    """Receive frames through a queue of this process."""
    queued_transport.register(monkeypatch)


def publish(count, fingers=5):
    with open_publisher(ADDRESS) as publisher:
        for _ in range(count):
            publisher.publish(frame(fingers, now_ns=time.monotonic_ns()))


def sequences(path):
    return np.concatenate([[], *(run["header"]["sequence"] for run in FrameReader(path))]).tolist()


def beside(function):
    """Run a function in a thread."""
    thread = threading.Thread(target=function)
    thread.start()
    return thread


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_every_frame_is_written_until_told_to_stop(run, tmp_path, number):
    path = tmp_path / "run.frames"
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]

    def service():
        publish(1000)
        ends = time.monotonic() + 60.0
        while path.stat().st_size < 1000 * FRAME.size(5) and time.monotonic() < ends:
            time.sleep(0.01)
        if signal.getsignal(number) not in before:  # otherwise the recording has failed and ended
            os.kill(os.getpid(), number)

    path.touch()
    thread = beside(service)
    result = run(ADDRESS, "--out", path)
    thread.join()

    assert result.code == 0
    assert result.err == ""
    assert re.fullmatch(re.escape(str(path)) + r": 1000 frames in \d+\.\d s, 0 lost, 0 refused\n", result.out)
    assert sequences(path) == list(range(1000))
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before


def test_what_is_lost_and_refused_is_told(run, tmp_path):
    outlet = open_outlet("queue:proximity")
    numbers = [0, 1, 4, 4, 3]
    for number in numbers:
        outlet.send(np.frombuffer(sealed([number]), np.uint8))
    damaged = np.array(np.frombuffer(sealed([5]), np.uint8))
    damaged[200] ^= 1
    outlet.send(damaged)
    outlet.send(np.frombuffer(sealed([0], session=2 * 10**18), np.uint8))

    result = run(ADDRESS, "--out", tmp_path / "run.frames", "--limit", 0.05)

    assert result.code == 0
    assert (
        result.out.split(" s, ")[1]
        == "2 lost, 3 refused (2 overtaken or repeated, 1 damaged in transit), 2 sessions\n"
    )
    assert result.out.split(": ")[1].startswith("4 frames in 0.")
    assert sequences(tmp_path / "run.frames") == [0, 1, 4, 0]


def test_json_is_the_summary_as_a_document(run, tmp_path):
    outlet, path = open_outlet(ADDRESS), tmp_path / "run.frames"
    for number in (0, 3, 3):
        outlet.send(np.frombuffer(sealed([number]), np.uint8))

    result = run(ADDRESS, "--out", path, "--limit", 0.05, "--json")

    told = json.loads(result.out)
    assert (result.code, result.err) == (0, "")
    assert 0.0 < told.pop("seconds") < 60.0
    assert told == {
        "file": str(path), "frames": 2, "lost": 2, "refused": 1, "sessions": 1,
        "reasons": {"overtaken or repeated": 1},
    }  # fmt: skip


def test_log_is_continued_and_what_was_torn_is_told(run, tmp_path):
    path = tmp_path / "run.frames"
    path.write_bytes(sealed([0, 1])[:-7])
    publish(2, fingers=1)

    result = run(ADDRESS, "--out", path, "--limit", 0.05)

    torn = FRAME.size(1) - 7
    assert result.err == f"proximity: {path}: {torn} bytes of a torn frame at its end were cut off\n"
    assert sequences(path) == [0, 0, 1]


def test_no_frame_is_exit_code_1(run, tmp_path, monkeypatch):
    monkeypatch.setattr(record, "ANNOUNCE_AFTER_S", 0.02)

    result = run(ADDRESS, "--out", tmp_path / "run.frames", "--limit", 0.2)

    assert result.code == 1
    assert result.err == f"proximity: no frame from {ADDRESS} yet\n"
    assert ": 0 frames in 0.2 s, 0 lost, 0 refused\n" in result.out


def test_full_disk_ends_the_recording_with_a_sentence(run, tmp_path):
    resource = pytest.importorskip("resource")
    path = tmp_path / "run.frames"
    publish(20, fingers=1)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    resource.setrlimit(resource.RLIMIT_FSIZE, (3 * FRAME.size(1) + 9, hard))
    try:
        result = run(ADDRESS, "--out", path, "--limit", 30)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    assert result.code == 2
    assert re.fullmatch(
        rf"proximity: {re.escape(str(path))}: cannot be written after 3 frames; .* \(File too large\)\n",
        result.err,
    )
    assert ": 3 frames in " in result.out
    assert path.read_bytes() == path.read_bytes()[: 3 * FRAME.size(1)]
    assert sequences(path) == [0, 1, 2]
