"""Cache of file contents in the user's cache folder.

Damaged files, and folders that another user may write to, are not read. If their total size exceeds a limit,
the least recently used files are removed.
"""

import hashlib
import os
from contextlib import suppress
from pathlib import Path

from proximity.errors import FileError
from proximity.system.whole_file import whole_file

FOLDER_VARIABLE = "PROXIMITY_CACHE_DIR"
_SUFFIX, _DIGEST_BYTES = ".kept", 32


class FileCache:
    """Cache of contents by key, with at most *limit* bytes in total. Processes may share the folder."""

    def __init__(self, name: str, limit: int) -> None:
        self._name, self.limit, self.kept_count = name, limit, 0

    def read(self, key: str) -> bytes | None:
        """Return a content and mark it as used now. Return None if it is missing or damaged."""
        path = self._folder() / (key + _SUFFIX)
        try:
            if not _is_ours(path.parent):
                return None
            stored = path.read_bytes()
            if _digest(stored[_DIGEST_BYTES:]) != stored[:_DIGEST_BYTES]:
                path.unlink()
                return None
            os.utime(path)
        except OSError:
            return None
        return stored[_DIGEST_BYTES:]

    def write(self, key: str, content: bytes) -> None:
        """Store a content if possible. If the limit is exceeded, remove the least recently used contents."""
        folder = self._folder()
        with suppress(OSError, FileError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_ours(folder) and len(content) < self.limit:
                with whole_file(folder / (key + _SUFFIX)) as stream:
                    stream.write(_digest(content) + content)
                self.kept_count += 1
                self._evict(folder)

    def _folder(self) -> Path:
        import platformdirs  # imported with the first STEP file only

        chosen = os.environ.get(FOLDER_VARIABLE)
        return Path(chosen or platformdirs.user_cache_path("proximity", False), self._name)

    def _evict(self, folder: Path) -> None:
        files = [(path.stat(), path) for path in folder.glob("*" + _SUFFIX)]
        total = 0
        for status, path in sorted(files, key=lambda file: file[0].st_mtime_ns, reverse=True):
            total += status.st_size
            if total > self.limit:
                with suppress(OSError):  # another process has removed the file, or is reading it
                    path.unlink()


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()


def _is_ours(folder: Path) -> bool:
    """Return whether only this user can write to a folder."""
    status = folder.stat()
    return os.name == "nt" or (status.st_uid == os.geteuid() and not status.st_mode & 0o022)
