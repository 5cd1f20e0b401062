"""Frame logs: frames are read back; damage by crashes and full or failing disks is found and reported."""

import errno
import os
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest
from sealed_frames import SESSION, frame, sealed

from proximity.errors import RecordingError
from proximity.message import FRAME, Message, validate
from proximity.recording import Damage, FrameLog, FrameReader, frame_bytes, frame_log, frame_reader

SIZE = FRAME.size(1)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.frames"


def append(path, data, size=SIZE):
    """Write frames of one size through a log; return the closed log."""
    with FrameLog(path) as log:
        for start in range(0, len(data), size):
            log.append(np.frombuffer(data[start : start + size], np.uint8))
    return log


def read(path):
    """Return an exhausted reader, and (session, sequence, number of fingers) of each frame."""
    reader, found = FrameReader(path), []
    for frames in reader:
        contacts = frames["contacts"]
        assert contacts.tobytes() == frame(contacts.shape[1]).records.tobytes() * len(frames)
        rows = zip(frames["header"]["session"].tolist(), frames["header"]["sequence"].tolist(), strict=True)
        found += [(session - SESSION, sequence, contacts.shape[1]) for session, sequence in rows]
    assert reader.frame_count == len(found)
    return reader, found


def sequences(path):
    return [sequence for _, sequence, _ in read(path)[1]]


@pytest.mark.parametrize("chunk", [1, 700, 1 << 22])
def test_sessions_and_finger_counts_may_follow_each_other(path, monkeypatch, chunk):
    monkeypatch.setattr(frame_reader, "READ_BYTES", chunk)
    path.write_bytes(
        sealed(range(3))
        + sealed([3, 4], count=5)
        + sealed([5], count=0)
        + sealed([0, 2], session=SESSION + 9)
    )

    reader, found = read(path)

    assert found == [(0, 0, 1), (0, 1, 1), (0, 2, 1), (0, 3, 5), (0, 4, 5), (0, 5, 0), (9, 0, 1), (9, 2, 1)]
    assert reader.notes == []
    assert read(path)[1] == found


def test_file_is_the_frames_byte_for_byte(path):
    log = append(path, sealed(range(7)))
    assert path.read_bytes() == sealed(range(7))
    assert (log.frame_count, log.lost_count, log.cut_size) == (7, 0, 0)


def test_memory_does_not_grow_with_the_log(path, monkeypatch):
    monkeypatch.setattr(frame_reader, "READ_BYTES", 1 << 16)
    path.write_bytes(sealed(range(100)) * 50)

    tracemalloc.start()
    try:
        count = sum(len(run) for run in FrameReader(path))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert count == 5000
    assert peak < path.stat().st_size / 4


@pytest.mark.parametrize("chunk", [SIZE - 1, 1 << 22])
def test_torn_tail_is_left_out_wherever_it_was_torn(path, monkeypatch, chunk):
    monkeypatch.setattr(frame_reader, "READ_BYTES", chunk)
    whole = sealed(range(3))
    for torn in range(1, SIZE):
        path.write_bytes(whole[: 2 * SIZE + torn])
        reader, found = read(path)
        assert [sequence for _, sequence, _ in found] == [0, 1]
        assert (reader.torn_size, reader.damage) == (torn, [])
    assert reader.notes == [f"{SIZE - 1} bytes of a torn frame at the end were skipped"]


def test_flipped_bit_costs_its_frame_only(path):
    whole = sealed(range(4))
    for place in range(SIZE, 2 * SIZE):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        path.write_bytes(damaged)
        reader, found = read(path)
        assert [sequence for _, sequence, _ in found] == [0, 2, 3]
        assert reader.damage == [Damage(SIZE, SIZE)]
        assert reader.torn_size == 0
    assert reader.notes == [f"damaged in 1 place, {SIZE} bytes skipped, the first at byte {SIZE}"]


@pytest.mark.parametrize("chunk", [5, 1000, 1 << 22])
def test_every_damaged_place_is_counted(path, monkeypatch, chunk):
    monkeypatch.setattr(frame_reader, "READ_BYTES", chunk)
    # a torn frame that claims the next ones, a lone magic, noise, zeros as after a power failure
    first, second = sealed([5], count=3)[:100], b"DEC" + b"DECF" * 3 + bytes(50) + b"DE"
    path.write_bytes(sealed([0]) + first + sealed([1, 2]) + second + sealed([3]) + bytes(600))

    reader, found = read(path)

    assert [sequence for _, sequence, _ in found] == [0, 1, 2, 3]
    assert reader.damage == [Damage(SIZE, 100), Damage(3 * SIZE + 100, len(second))]
    assert reader.torn_size == 600
    assert (
        reader.notes[0] == f"damaged in 2 places, {100 + len(second)} bytes skipped, the first at byte {SIZE}"
    )


def test_frames_of_another_version_are_left_out_and_counted(path):
    message = frame()
    message.header["version"] = 1
    path.write_bytes(sealed([0]) + message.seal(SESSION, 1).tobytes() + sealed([2]))

    reader, found = read(path)

    assert [sequence for _, sequence, _ in found] == [0, 2]
    assert (reader.foreign_count, reader.damage) == (1, [])
    assert reader.notes == ["1 frame of another version of the message were skipped"]


def test_frames_are_told_as_the_message_itself_tells_them():
    """The fast validation of a log agrees with `validate` for any change of bytes, resealed or not."""
    rng = np.random.default_rng(11)
    verdicts = set()
    for _ in range(2000):
        message = frame(int(rng.integers(0, 3)))
        if rng.random() < 0.7:
            name = rng.choice(["magic", "version", "header_size", "size", "count"])
            message.header[name] = message.header[name] + rng.integers(0, 2) * rng.choice([1, 328, 65000])
        data = message.seal(SESSION, 3)
        if rng.random() < 0.3:
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        size = frame_bytes.frame_at(memoryview(data), 0)
        is_frame = size == len(data) and frame_bytes.is_known(memoryview(data), 0, size)
        assert is_frame == (validate(data, FRAME) is None)
        verdicts.add(is_frame)
    assert verdicts == {True, False}


def test_log_of_nothing_has_no_frames(path):
    path.touch()
    assert read(path)[1] == []


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"time_s,hand,finger\n", r"run\.frames: no frame was found in its 19 bytes"),
        (sealed([0])[:-1], rf"run\.frames: no frame was found in its {SIZE - 1} bytes"),
        (None, r"run\.frames: cannot be read \(No such file or directory\)"),
    ],
)
def test_what_is_no_log_is_refused(path, content, message):
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        list(FrameReader(path))


def test_log_is_continued(path):
    append(path, sealed(range(3)))
    log = append(path, sealed(range(3, 5)))

    assert sequences(path) == [0, 1, 2, 3, 4]
    assert log.cut_size == 0


@pytest.mark.parametrize("torn", [1, 32, SIZE - 1])
@pytest.mark.parametrize("before", [0, 3])
def test_torn_frame_is_cut_before_the_log_is_continued(path, before, torn):
    path.write_bytes(sealed(range(before)) + sealed([77])[:torn])

    log = append(path, sealed([8]))

    assert log.cut_size == torn
    assert path.read_bytes() == sealed(range(before)) + sealed([8])


def test_frame_of_another_version_at_the_end_is_not_torn(path):
    message = frame()
    message.header["version"] = 1
    path.write_bytes(sealed([0]) + message.seal(SESSION, 1).tobytes())

    assert append(path, sealed([2])).cut_size == 0
    assert sequences(path) == [0, 2]


def test_more_damage_than_a_crash_leaves_is_not_cut(path, monkeypatch):
    monkeypatch.setattr(frame_log, "MAX_FRAME", 2 * SIZE)
    whole = sealed(range(2)) + bytes(2 * SIZE + 1)
    path.write_bytes(whole)

    log = append(path, sealed([2]))

    assert log.cut_size == 0
    assert path.read_bytes() == whole + sealed([2])
    assert sequences(path) == [0, 1, 2]


@pytest.mark.parametrize("content", [b"time_s,hand,finger\n", bytes(500)])
def test_another_file_is_neither_continued_nor_changed(path, content):
    path.write_bytes(content)
    with pytest.raises(
        RecordingError, match=r"run\.frames: not a frame log, expected a file that begins with"
    ):
        FrameLog(path)
    assert path.read_bytes() == content


def test_file_that_cannot_be_opened_is_told(tmp_path):
    with pytest.raises(
        RecordingError, match=r"none/run\.frames: cannot be opened \(No such file or directory"
    ):
        FrameLog(tmp_path / "none" / "run.frames")
    with pytest.raises(RecordingError, match=r"cannot be opened \(Is a directory\)"):
        FrameLog(tmp_path)


@pytest.mark.skipif(frame_log.fcntl is None, reason="nothing keeps two writers apart here")
def test_two_do_not_write_to_one_log(path):
    with (
        FrameLog(path),
        pytest.raises(RecordingError, match=r"run\.frames: another recorder is writing to it"),
    ):
        FrameLog(path)
    append(path, sealed([0]))
    assert sequences(path) == [0]


WRITER = """
import sys
import numpy as np
from proximity.message import FRAME, Message
from proximity.recording import FrameLog
log, message = FrameLog(sys.argv[1]), Message(FRAME, 5)
for sequence in range(10**9):
    log.append(message.seal(1, sequence))
"""


def test_killed_writer_loses_at_max_the_frame_being_written(path):
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)])
    try:
        ends = time.monotonic() + 60.0
        while not path.exists() or path.stat().st_size < 1_000_000:
            assert time.monotonic() < ends and writer.poll() is None
            time.sleep(0.001)
    finally:
        writer.kill()
        writer.wait()

    reader = FrameReader(path)
    written = np.concatenate([frames["header"]["sequence"] for frames in reader])

    assert written.tolist() == list(range(len(written)))
    assert reader.damage == []
    assert reader.torn_size < FRAME.size(5)
    assert len(written) * FRAME.size(5) + reader.torn_size == path.stat().st_size


@pytest.fixture
def limit_size():
    """Limit the size of files; None: the former limit."""
    resource = pytest.importorskip("resource")  # the interpreter ignores SIGXFSZ: a write fails instead
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size):
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))

    yield limit
    limit(None)


def test_full_disk_leaves_whole_frames_and_writing_goes_on_when_there_is_room(path, limit_size, monkeypatch):
    monkeypatch.setattr(frame_log, "RETRY_AFTER", 3)
    frames = [np.frombuffer(sealed([sequence]), np.uint8) for sequence in range(20)]
    with FrameLog(path) as log:
        log.append(frames[0])
        limit_size(2 * SIZE + 50)
        log.append(frames[1])
        with pytest.raises(
            RecordingError,
            match=r"run\.frames: cannot be written after 2 frames; it ends with the last whole one \(File",
        ):
            log.append(frames[2])
        limit_size(None)
        for sequence in range(3, 6):  # skipped without an attempt
            with pytest.raises(RecordingError, match="after 2 frames"):
                log.append(frames[sequence])
        assert (log.frame_count, log.lost_count) == (2, 4)
        assert path.read_bytes() == sealed([0, 1])

        for sequence in range(6, 9):
            log.append(frames[sequence])

    assert (log.frame_count, log.lost_count) == (5, 4)
    assert path.read_bytes() == sealed([0, 1, 6, 7, 8])


def test_frame_that_is_taken_in_pieces_is_whole(path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:100]))

    append(path, sealed(range(3)))

    assert path.read_bytes() == sealed(range(3))


def test_what_could_not_be_cut_back_is_skipped(path, monkeypatch):
    """A drive that writes half a frame, and then fails to truncate."""
    write, cut = os.write, os.ftruncate

    def half(file, data):
        if len(data) < SIZE:
            raise OSError(errno.EIO, "Input/output error")
        return write(file, data[: SIZE // 2])

    def fail(file, size):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(frame_log, "RETRY_AFTER", 0)
    with FrameLog(path) as log:
        log.append(np.frombuffer(sealed([0]), np.uint8))
        monkeypatch.setattr(os, "write", half)
        monkeypatch.setattr(os, "ftruncate", fail)
        with pytest.raises(RecordingError, match="Input/output error"):
            log.append(np.frombuffer(sealed([1]), np.uint8))
        monkeypatch.setattr(os, "write", write)
        monkeypatch.setattr(os, "ftruncate", cut)
        log.append(np.frombuffer(sealed([2]), np.uint8))

    reader, found = read(path)
    assert [sequence for _, sequence, _ in found] == [0, 2]
    assert reader.damage == [Damage(SIZE, SIZE // 2)]


def test_disk_that_fails_at_the_end_is_told(path, monkeypatch):
    def fail(file):
        raise OSError(errno.EIO, "Input/output error")

    log = FrameLog(path)
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(
        RecordingError, match=r"run\.frames: may be incomplete on the disk \(Input/output error"
    ):
        log.close()
    log.close()


def test_largest_frame_fits(path):
    message = Message(FRAME, 4096)
    data = message.seal(SESSION, 0).tobytes()
    path.write_bytes(data + data[:-1])

    log = append(path, sealed([1]))

    assert log.cut_size == len(data) - 1
    assert [run["contacts"].shape[1] for run in FrameReader(path)] == [4096, 1]
