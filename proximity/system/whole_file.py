"""Write files atomically, under a temporary name that is then replaced by the final one.

The writer holds a lock on the temporary file, which distinguishes files of killed processes from files in
progress: the former are removed when the next file is written in their folder.
"""

import contextlib
import os
import re
import secrets
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from proximity.errors import FileError, ProximityError

try:
    import fcntl
except ImportError:  # the system is not POSIX
    fcntl = None  # type: ignore[assignment]

_UNFINISHED = re.compile(r"\.[0-9a-f]{16}\.unfinished")


@contextmanager
def whole_file(
    path: str | bytes | os.PathLike[str],
    *,
    takes_devices: bool = True,
) -> Iterator[BinaryIO]:
    """Yield a stream to a temporary file that replaces *path* when the block ends without an error.

    If *path* is a link, its target is replaced. The permissions of the replaced file are kept. Of concurrent
    writers the last to end wins. After the block the file survives a power failure. *takes_devices*: whether
    an existing path that is not a regular file, such as ``/dev/null``, is written to directly; otherwise it
    raises an error.
    """
    try:
        shown = os.fsdecode(path)
        target = Path(os.path.realpath(shown))
    except TypeError:
        raise FileError(f"the path is {path!r}, expected text or a path") from None
    except ValueError as reason:  # the path contains a null byte
        raise FileError(f"{shown}: cannot be written ({reason})") from reason
    if not shown:
        raise FileError("the path is empty, expected the name of a file")
    try:
        if target.exists() and not target.is_file():
            if not takes_devices:
                raise FileError(f"{shown}: cannot be written (it is not a regular file)")
            with target.open("wb") as stream:
                yield stream
            return
        _remove_abandoned(target.parent)
        with _unfinished_beside(target) as (unfinished, stream):
            with stream:
                _allow_as(target, unfinished)
                yield stream
            _put_on_disk(unfinished)
            os.replace(unfinished, target)
        with contextlib.suppress(OSError):  # not every system can do this for a folder
            _put_on_disk(target.parent)
    except FileError:
        raise
    except OSError as reason:
        raise FileError(f"{shown}: cannot be written ({reason.strerror or reason})") from reason


@contextmanager
def _unfinished_beside(target: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Create a locked file next to *target* and yield its path and stream.

    The file is removed if the block fails.
    """
    while True:
        # Short whatever the name of the file, and unique: threads share a process id.
        unfinished = target.with_name(f".{secrets.token_hex(8)}.unfinished")
        stream = unfinished.open("xb")
        lock = os.dup(stream.fileno())  # held until the file has its name, when the stream is closed
        try:
            if not _lock(lock, waits=True) or unfinished.exists():
                yield unfinished, stream
                return
            stream.close()  # another process removed it as abandoned before it was locked
        except BaseException:
            stream.close()
            with contextlib.suppress(OSError):
                unfinished.unlink()
            raise
        finally:
            os.close(lock)


def _remove_abandoned(folder: Path) -> None:
    """Remove the temporary files of killed processes in a folder."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _UNFINISHED.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                _remove_if_abandoned(entry.path)


def _remove_if_abandoned(path: str) -> None:
    with contextlib.suppress(OSError):  # the file may be finished by now, or belong to another user
        number = os.open(path, os.O_RDONLY)
        try:
            if _lock(number, waits=False):
                os.unlink(path)
        finally:
            os.close(number)


def _lock(number: int, *, waits: bool) -> bool:
    """Lock an open file until all its descriptors are closed. Return whether it succeeded."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another process holds the lock, or the disk has no locks
        return False
    return True


def _allow_as(old: Path, new: Path) -> None:
    """Copy the permissions of one file to another."""
    with contextlib.suppress(OSError):  # the old file is missing, or the disk has no permissions
        new.chmod(stat.S_IMODE(old.stat().st_mode))


def _put_on_disk(path: Path) -> None:
    """Wait until the content of a file or the names in a folder are on the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def write_files(
    contents: Mapping[str, str | bytes], folder: str | os.PathLike[str], kept: Collection[str] = ()
) -> dict[str, bool]:
    """Write files into a folder, which is created if it does not exist.

    Return the paths of the files and whether each was written. *kept*: names of files that are not
    overwritten if they exist. A folder that is a Python package is refused, because the files would be
    imported with it.
    """
    if Path(folder, "__init__.py").is_file():
        raise ProximityError(f"{folder}: is a package of Python, expected another folder, such as engine")
    written = {}
    for name, content in contents.items():
        path = Path(folder) / name
        is_kept = name in kept and path.exists()
        written[str(path)] = not is_kept
        if not is_kept:
            _make_folder(path.parent)
            with whole_file(path, takes_devices=False) as stream:
                stream.write(content.encode() if isinstance(content, str) else content)
    return written


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise ProximityError(f"{folder}: is not a folder and cannot be created ({reason})") from failure
