"""Frames logged by another thread: all of them, in order, or counted as lost."""

import threading

import numpy as np
from far_end import until

from proximity.errors import RecordingError
from proximity.message import FRAME, MAX_RECORDS
from proximity.service import frame_log
from proximity.service.frame_log import FrameLogThread
from proximity.transport import shared_memory

PATIENCE = 20.0  # s


class KeepingLog:
    """Keep appended frames; *gate* blocks appends, *failing* are the numbers of appends that fail."""

    def __init__(self, failing=(), gate=None, failing_close=False):
        self.frames, self.count, self.failing, self.gate = [], 0, failing, gate
        self.is_closed, self.failing_close = False, failing_close

    def append(self, data):
        if self.gate is not None:
            assert self.gate.wait(PATIENCE)
        self.count += 1
        if self.count - 1 in self.failing:
            raise RecordingError("run.frames: cannot be written (No space left on device)")
        self.frames.append(data.copy())

    def close(self):
        self.is_closed = True
        if self.failing_close:
            raise OSError("cannot be closed")


class LogWriter(FrameLogThread):
    """The log's thread, with a writer to its mailbox in place of a loop."""

    count = 0

    def put(self, data):
        self._mailbox.send(data)
        self.count += 1

    def finish(self):
        self.close(self.count)


def frame(number):
    return np.full(16, number % 251, np.uint8)


def test_all_frames_are_appended_in_order():
    log = KeepingLog()
    writer = LogWriter(log, 16, depth=2000)

    for number in range(2000):
        writer.put(frame(number))
    writer.finish()

    assert log.is_closed and writer.written == 2000 and writer.notes == []
    np.testing.assert_array_equal(np.array(log.frames), np.array([frame(k) for k in range(2000)]))


def test_frame_is_appended_without_waiting_for_the_next():
    """A crash loses at most the frame being written."""
    log = KeepingLog()
    writer = LogWriter(log, 16)
    for number in range(50):
        writer.put(frame(number))
        until(lambda expected=number + 1: len(log.frames) == expected)
    writer.finish()


def test_disk_that_stands_still_delays_nobody_and_what_finds_no_room_is_counted():
    """The newest frames are kept in order, as is the one being written."""
    gate = threading.Event()
    log = KeepingLog(gate=gate)
    writer = LogWriter(log, 16, depth=4)

    for number in range(100):
        writer.put(frame(number))
    gate.set()
    writer.finish()

    kept = [int(data[0]) for data in log.frames]
    assert kept == sorted(kept) and kept[-1] == 99 and len(kept) == writer.written < 100
    lost = 100 - writer.written
    assert writer.notes == [f"{lost} frames were not logged: the log was slower than the service"]


def test_frames_go_round_the_ring_unharmed():
    log = KeepingLog()
    writer = LogWriter(log, 16, depth=3)

    for number in range(100):
        writer.put(frame(number))
        until(lambda expected=number + 1: len(log.frames) >= expected - 2)
    writer.finish()

    np.testing.assert_array_equal(np.array(log.frames), np.array([frame(k) for k in range(100)]))


def test_frames_of_a_skin_wait_within_some_megabytes():
    """A ring of 4096 frames of 4096 fingers would take 5.5 GB."""
    size, gate = FRAME.size(MAX_RECORDS), threading.Event()
    log = KeepingLog(gate=gate)
    writer = LogWriter(log, size)
    data = np.full(size, 7, np.uint8)

    for _ in range(100):
        writer.put(data)
    gate.set()
    writer.finish()

    room = shared_memory.MAX_RING_BYTES / size
    assert shared_memory.MIN_SLOT_COUNT < writer.written <= room + 1 and writer.lost == 100 - writer.written


def test_disk_that_is_full_is_said_once_and_what_follows_is_still_tried(caplog):
    log = KeepingLog(failing={1, 2, 3})
    writer = LogWriter(log, 16)

    for number in range(6):
        writer.put(frame(number))
    writer.finish()

    np.testing.assert_array_equal(np.array(log.frames), np.array([frame(k) for k in (0, 4, 5)]))
    assert (writer.written, writer.failed, writer.lost) == (3, 3, 0)
    reason = "run.frames: cannot be written (No space left on device)"
    assert writer.notes == [f"3 frames were not logged, first: {reason}"]
    assert [record.message for record in caplog.records] == [f"frames cannot be logged: {reason}"]


def test_log_that_cannot_be_closed_harms_nobody(caplog):
    log = KeepingLog(failing_close=True)
    writer = LogWriter(log, 16)

    writer.finish()

    assert log.is_closed
    assert [record.message for record in caplog.records] == ["frames cannot be logged: cannot be closed"]


def test_log_that_never_answers_is_left(monkeypatch, caplog):
    monkeypatch.setattr(frame_log, "CLOSE_TIMEOUT", 0.05)
    gate = threading.Event()
    log = KeepingLog(gate=gate)
    writer = LogWriter(log, 16)
    writer.put(frame(0))
    writer.put(frame(1))

    writer.finish()

    assert writer.lost == 2
    assert [record.message for record in caplog.records] == ["the log does not respond: it is abandoned"]
    gate.set()
    writer._thread.join(PATIENCE)
