"""Compiled code on disk: kept by processes side by side, and made anew where it is damaged.

numba keeps, for each function, a list of its versions and a file a version. Here each of these files has a
checksum in front, since a flipped bit in code is executed like any other. What cannot be read counts as not
there: it is removed with one sentence on stderr, and compiled again.
"""

import pickle
import shutil
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

COMPLETE = "complete-"
"""How the name of the file begins that says that all kernels are in a folder; see `warmup`."""
_CHECKSUM_BYTES = 4
_said: set[str] = set()  # once is enough


class SharedCache(FunctionCache):
    """numba's, for processes that compile side by side.

    To keep a version of a function numba reads the list of those that are kept, and then writes the list with
    one more and the code. Of two processes that did so at once, the list of one could lead to the code of the
    other, for arguments of other types.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        impl = self._impl
        self._cache_file = _SealedFile(
            cache_path=self._cache_path,
            filename_base=impl.filename_base,
            source_stamp=impl.locator.get_source_stamp(),
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        folder = Path(self.cache_path).parent
        try:
            with _alone(folder):
                super().save_overload(sig, data)
        except OSError as reason:
            _say(f"compiled kernels cannot be kept in {folder} ({reason.strerror or reason})")


class _SealedFile(IndexDataCacheFile):
    """The list of a function's versions and their code, each file behind a checksum."""

    def _load_index(self) -> dict[Any, Any]:
        try:
            version, stamp, overloads = _read(self._index_path)
        except OSError:
            return {}
        # Of another version, or of another source.
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, Any]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        return _read(self._data_path(name))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        data = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(zlib.crc32(data).to_bytes(_CHECKSUM_BYTES, "little") + data)


def _read(path: str) -> Any:
    """What a file holds; `OSError` where there is none, or was none that can be used."""
    try:
        data = Path(path).read_bytes()
        if zlib.crc32(data[_CHECKSUM_BYTES:]) != int.from_bytes(data[:_CHECKSUM_BYTES], "little"):
            raise ValueError("its checksum differs")
        return pickle.loads(memoryview(data)[_CHECKSUM_BYTES:])
    except FileNotFoundError:
        raise
    except Exception as reason:  # whatever pickle comes upon
        _throw_away(Path(path), reason)
        raise FileNotFoundError(path) from reason


def _throw_away(path: Path, reason: Exception) -> None:
    reported = (isinstance(reason, OSError) and reason.strerror) or reason
    folder = path.parent.parent
    _say(
        f"compiled kernels in {folder} are damaged ({path.name}: {reported}); they are made anew, which may "
        "take a minute or two"
    )
    for mark in folder.glob(COMPLETE + "*"):
        with suppress(OSError):
            mark.unlink()
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):  # of another user; it is reported when nothing can be kept
            path.unlink()


def _say(sentence: str) -> None:
    """Say a sentence on stderr, if none of its kind has been said."""
    kind = sentence.split("(", maxsplit=1)[0]
    if kind not in _said and sys.stderr is not None:
        print(f"proximity: {sentence}", file=sys.stderr)
    _said.add(kind)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process is in such a block for this folder, where the system can tell."""
    if fcntl is None:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("ab") as lock:
        with suppress(OSError):  # of a file system that knows no locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
