"""Open files named by a user without blocking, and only if they are regular files.

Opening a named pipe would wait for a writer, and a device may never end.
"""

import errno
import os
import stat
from typing import BinaryIO

_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)


class NotRegularFileError(OSError):
    """Raised for a pipe, socket or device where a file is expected."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(errno.EINVAL, "is not a regular file", path)


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading bytes. Links are followed."""
    return open(path, "rb", opener=_open_descriptor)


def _open_descriptor(path: str, flags: int) -> int:
    try:
        descriptor = os.open(path, flags | _WITHOUT_WAITING)
    except OSError as failure:
        if failure.errno == errno.ENXIO:  # the path is a socket or a missing device
            raise NotRegularFileError(path) from failure
        raise
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    raise NotRegularFileError(path)
