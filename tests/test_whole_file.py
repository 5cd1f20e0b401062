"""Files written wholly or not at all, in place of others."""

import os
import stat

import pytest

from proximity import RecordingError, SceneError
from proximity.whole_file import whole_file


def test_two_who_write_one_file_at_once_each_write_a_whole_one(tmp_path):
    """As threads do, or containers that share a folder: their processes may have one number."""
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
@pytest.mark.parametrize("mode", [0o600, 0o664, 0o440])
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


def test_error_is_the_one_asked_for_and_says_the_place(tmp_path):
    path = tmp_path / "nowhere" / "log.csv"

    for error in (RecordingError, SceneError):
        with (
            pytest.raises(error, match=r"nowhere/log\.csv: cannot be written \(No such file or directory\)$"),
            whole_file(path, error),
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
    with pytest.raises(RecordingError, match=message), whole_file(path):
        pytest.fail("there is no such path")


def test_device_is_written_to_as_it_is_or_refused():
    with whole_file("/dev/null") as stream:
        stream.write(b"contacts")
    refused = pytest.raises(SceneError, match=r"^/dev/null: cannot be written \(it is no regular file\)$")
    with refused, whole_file("/dev/null", SceneError, takes_devices=False):
        pytest.fail("it was opened")
