"""Files written completely or not at all, replacing others."""

import os
import signal
import stat
import subprocess
import sys
import threading

import pytest

from proximity.errors import FileError
from proximity.system.whole_file import whole_file


def test_two_who_write_one_file_at_once_each_write_a_whole_one(tmp_path):
    """As by threads, or by containers with a shared folder, whose processes may have the same id."""
    path = tmp_path / "log.npy"

    with whole_file(path) as first:
        first.write(b"one")
        with whole_file(path) as second:
            second.write(b"another")
        assert path.read_bytes() == b"another"
        first.write(b" and its end")

    assert path.read_bytes() == b"one and its end"
    assert list(tmp_path.iterdir()) == [path]


def test_link_to_a_file_stays_one(tmp_path):
    path, link = tmp_path / "log.npy", tmp_path / "latest.npy"
    link.symlink_to(path)

    with whole_file(link) as stream:
        stream.write(b"contacts")

    assert link.is_symlink()
    assert path.read_bytes() == b"contacts"


def test_file_is_written_under_the_longest_name_there_is(tmp_path):
    path = tmp_path / ("n" * 251 + ".npy")

    with whole_file(path) as stream:
        stream.write(b"contacts")

    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="permissions are told otherwise there")
@pytest.mark.parametrize("mode", [0o600, 0o440])
def test_who_may_read_a_file_stays_as_it_was_when_it_is_replaced(tmp_path, mode):
    path = tmp_path / "secret.csv"
    path.write_bytes(b"old")
    path.chmod(mode)

    with whole_file(path) as stream:
        unfinished = next(file for file in tmp_path.iterdir() if file != path)
        assert stat.S_IMODE(unfinished.stat().st_mode) == mode  # from the first byte on
        stream.write(b"new")

    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_what_goes_wrong_in_the_block_leaves_what_was_there(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"old")

    with pytest.raises(ZeroDivisionError), whole_file(path) as stream:
        stream.write(b"half")
        stream.write(bytes([1 // 0]))

    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_error_says_the_place(tmp_path):
    path = tmp_path / "nowhere" / "log.csv"

    with (
        pytest.raises(FileError, match=r"nowhere/log\.csv: cannot be written \(No such file or directory\)$"),
        whole_file(path),
    ):
        pytest.fail("there is no folder")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (None, "^the path is None, expected text or a path$"),
        ("", r"^the path is empty, expected the name of a file$"),
        ("log\0.csv", r"cannot be written \(embedded null byte\)$"),
    ],
)
def test_path_that_is_none_is_refused(path, message):
    with pytest.raises(FileError, match=message), whole_file(path):
        pytest.fail("there is no such path")


def test_device_is_written_to_as_it_is_or_refused():
    with whole_file("/dev/null") as stream:
        stream.write(b"contacts")
    refused = pytest.raises(FileError, match=r"^/dev/null: cannot be written \(it is not a regular file\)$")
    with refused, whole_file("/dev/null", takes_devices=False):
        pytest.fail("it was opened")


needs_locks = pytest.mark.skipif(os.name == "nt", reason="there are no such locks there")


def written(path, data=b"new"):
    with whole_file(path) as stream:
        stream.write(data)


@pytest.fixture
def writer(tmp_path):
    """Start a process that writes a file without finishing."""
    code = (
        "import sys, time; from proximity.system.whole_file import whole_file\n"
        "with whole_file(sys.argv[1]) as stream:\n"
        "    stream.write(b'half'); stream.flush(); print('writing', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, tmp_path / "log.npy"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "writing\n"
        yield process
        process.kill()


@pytest.mark.processes
@needs_locks
@pytest.mark.parametrize("number", ["SIGTERM", "SIGKILL"])
def test_what_a_killed_writer_left_goes_with_the_next_file(number, writer, tmp_path):
    writer.send_signal(getattr(signal, number))
    writer.wait(timeout=30)
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(".unfinished")

    written(tmp_path / "other.csv")

    assert list(tmp_path.iterdir()) == [tmp_path / "other.csv"]


@pytest.mark.processes
@needs_locks
def test_what_a_living_writer_has_begun_stays(writer, tmp_path):
    (unfinished,) = tmp_path.iterdir()

    written(tmp_path / "log.npy")

    assert unfinished.read_bytes() == b"half"


@needs_locks
def test_threads_that_write_side_by_side_leave_each_other_alone(tmp_path):
    wrong = []

    def write(name):
        try:
            for step in range(40):
                written(tmp_path / name, bytes([step]) * 1000)
        except Exception as error:  # an exception in a thread would not fail the test
            wrong.append(error)

    threads = [threading.Thread(target=write, args=(f"{k % 3}.npy",)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert wrong == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.npy", "1.npy", "2.npy"]


def test_files_of_others_that_look_alike_stay(tmp_path):
    names = [".unfinished", "notes.unfinished", ".0123456789abcdef.unfinished.txt", ".0123.unfinished"]
    for name in names:
        (tmp_path / name).write_bytes(b"precious")
    (tmp_path / ".0123456789abcdef.unfinished").mkdir()
    (tmp_path / ".fedcba9876543210.unfinished").symlink_to(tmp_path / ".unfinished")

    written(tmp_path / "log.npy")

    assert len(list(tmp_path.iterdir())) == len(names) + 3
