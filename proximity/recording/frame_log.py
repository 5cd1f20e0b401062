"""Frame logs, to which the published frames of a service are appended.

The file has no header or trailer, so that it is complete after each frame. A frame is one write to the
operating system: if the process is killed, at most the last one is torn. A power failure loses the data not
yet on the disk, usually those of some seconds; `FrameLog.close` waits for the disk.
"""

import contextlib
import errno
import os
import stat
from types import TracebackType

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.frame_bytes import MAGIC, MAX_FRAME, last_end

try:
    import fcntl
except ModuleNotFoundError:  # Windows: two writers are not prevented
    fcntl = None  # type: ignore[assignment]

RETRY_AFTER = 1000
"""Number of frames skipped after a failed write. On a full disk each attempt may cost milliseconds."""
_NO_LOCKS_HERE = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)  # on network drives and special files
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)


class FrameLog:
    """Appends frames to a new or existing file.

    A torn frame at the end of an existing file, left by a crash, is removed first; its size is `cut_size`. A
    longer remainder is kept, and readers skip it.
    """

    path: str
    frame_count: int  # number of frames written by this writer
    lost_count: int  # number of frames that were not written
    cut_size: int  # size of the torn frame that was removed

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.frame_count = self.lost_count = 0
        self._pause, self._refusal = 0, ""  # number of frames still to refuse, and the reason
        try:
            self._file = os.open(self.path, _FLAGS, 0o666)
        except OSError as failure:
            raise self._error("cannot be opened", failure) from failure
        try:
            self._lock()
            mode = os.fstat(self._file).st_mode
            self._is_regular = stat.S_ISREG(mode)
            if stat.S_ISFIFO(mode):  # a full pipe would block until it is read
                raise OSError(errno.EINVAL, "is not a regular file")
            self.cut_size = self._cut_torn() if self._is_regular else 0
        except OSError as failure:
            self._release()
            raise self._error("cannot be continued", failure) from failure
        except RecordingError:
            self._release()
            raise

    def append(self, data: np.ndarray) -> None:
        """Append a frame to the file.

        After a failure, the file is truncated to its last whole frame. The next `RETRY_AFTER` frames are
        refused with the same error; then writing is tried again. Frames that were not written are counted in
        `lost_count`.
        """
        if self._pause:
            self._pause -= 1
            self.lost_count += 1
            raise RecordingError(self._refusal)
        written, whole = 0, data.data
        try:
            while written < len(whole):
                step = os.write(self._file, whole[written:])
                if step == 0:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                written += step
        except OSError as failure:
            self._cut_back(written)
            self.lost_count += 1
            self._pause = RETRY_AFTER
            what = f"cannot be written after {self.frame_count} frames; it ends with the last whole one"
            error = self._error(what, failure)
            self._refusal = str(error)
            raise error from failure
        self.frame_count += 1

    def close(self) -> None:
        """Wait until all frames are on the disk, and close the file. Closing again has no effect."""
        if self._file < 0:
            return
        try:
            if self._is_regular:
                os.fsync(self._file)
        except OSError as failure:
            raise self._error("may be incomplete on the disk", failure) from failure
        finally:
            self._release()

    def __enter__(self) -> "FrameLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _release(self) -> None:
        os.close(self._file)
        self._file = -1

    def _lock(self) -> None:
        """Raise an error if another process writes to the file.

        Frames of two services in one log would look like one sequence.
        """
        if fcntl is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as held:
            raise RecordingError(f"{self.path}: another recorder is writing to it") from held
        except OSError as failure:
            if failure.errno not in _NO_LOCKS_HERE:
                raise

    def _cut_torn(self) -> int:
        """Remove the bytes after the last whole frame if they are fewer than a frame. Return their number."""
        size = os.fstat(self._file).st_size
        beginning = self._bytes_at(0, len(MAGIC))
        if not MAGIC.startswith(beginning):
            raise RecordingError(f"{self.path}: not a frame log, expected a file that begins with a frame")
        first = max(0, size - 2 * MAX_FRAME)  # enough for a torn frame and the previous one
        end = first + last_end(memoryview(self._bytes_at(first, size - first)))
        torn = size - end
        if not 0 < torn <= MAX_FRAME:
            return 0
        os.ftruncate(self._file, end)
        return torn

    def _bytes_at(self, offset: int, size: int) -> bytes:
        os.lseek(self._file, offset, os.SEEK_SET)
        pieces = []
        while size > 0 and (piece := os.read(self._file, size)):
            pieces.append(piece)
            size -= len(piece)
        return b"".join(pieces)

    def _cut_back(self, written: int) -> None:
        """Remove the written part of a frame. If that fails, too, readers skip it."""
        if written and self._is_regular:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, os.fstat(self._file).st_size - written)

    def _error(self, what: str, failure: OSError) -> RecordingError:
        return RecordingError(f"{self.path}: {what} ({failure.strerror or failure})")
