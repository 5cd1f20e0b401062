"""Atomic files: written under another name, then renamed.

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
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

_UNFINISHED = re.compile(r"\.[0-9a-f]{16}\.unfinished")


@contextmanager
def whole_file(
    path: str | bytes | os.PathLike[str],
    *,
    takes_devices: bool = True,
) -> Iterator[BinaryIO]:
    """Yield a stream to write a file with; the file is replaced when the block ends without an error.

    The target of a link is replaced, not the link; its permissions stay. Of concurrent writers the last to
    end wins. After the block the file survives a loss of power. *takes_devices*: write directly to an
    existing path that is not a regular file, such as ``/dev/null``; else raise.
    """
    try:
        shown = os.fsdecode(path)
        target = Path(os.path.realpath(shown))
    except TypeError:
        raise FileError(f"the path is {path!r}, expected text or a path") from None
    except ValueError as reason:  # a null byte
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
        with contextlib.suppress(OSError):  # not every system supports that for a folder
            _put_on_disk(target.parent)
    except FileError:
        raise
    except OSError as reason:
        raise FileError(f"{shown}: cannot be written ({reason.strerror or reason})") from reason


@contextmanager
def _unfinished_beside(target: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Yield a new, locked file in *target*'s folder and a stream; removed if the block fails."""
    while True:
        # Short for any name of the file, and unique: threads share a process id.
        unfinished = target.with_name(f".{secrets.token_hex(8)}.unfinished")
        stream = unfinished.open("xb")
        lock = os.dup(stream.fileno())  # held until the file has its name, when the stream is closed
        try:
            if not _lock(lock, waits=True) or unfinished.exists():
                yield unfinished, stream
                return
            stream.close()  # another process took it for abandoned before it was locked
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
    with contextlib.suppress(OSError):  # it may be finished by now, or another user's
        number = os.open(path, os.O_RDONLY)
        try:
            if _lock(number, waits=False):
                os.unlink(path)
        finally:
            os.close(number)


def _lock(number: int, *, waits: bool) -> bool:
    """Lock an open file, until all its descriptors are closed; return whether it succeeded."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # locked by another process, or a disk without locks
        return False
    return True


def _allow_as(old: Path, new: Path) -> None:
    """Copy the permissions of one file to another."""
    with contextlib.suppress(OSError):  # no old file, or a disk without permissions
        new.chmod(stat.S_IMODE(old.stat().st_mode))


def _put_on_disk(path: Path) -> None:
    """Wait until a file's content, or a folder's names, survive a loss of power."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def write_files(
    contents: Mapping[str, str | bytes], folder: str | os.PathLike[str], kept: Collection[str] = ()
) -> dict[str, bool]:
    """Write files into a folder, which is made where it is not there.

    *kept*: files that are left alone where they are there already. A package of Python is no such folder:
    they would be imported with it.
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
