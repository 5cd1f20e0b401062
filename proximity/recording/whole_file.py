"""Files that are either wholly there or not at all: written under another name and then renamed."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from proximity.errors import RecordingError


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Give a stream to write a file with; the file is replaced when the block ends without an error.

    What is there and no regular file, ``/dev/null`` for example, is written to as it is. Where a link leads
    to a file, it is that file which is replaced. Of several who write one file at once, the last to end wins.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    RecordingError
        If it cannot be written; what was there before is there still.
    """
    target = Path(path)
    try:
        if target.exists() and not target.is_file():
            with target.open("wb") as stream:
                yield stream
            return
        place = Path(os.path.realpath(target))
        # Short, whatever the file's own name is, and nobody else's: threads share a number of their process.
        unfinished = place.with_name(f".{secrets.token_hex(8)}.unfinished")
        try:
            with unfinished.open("xb") as stream:
                yield stream
            os.replace(unfinished, place)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as failure:
        raise RecordingError(f"{target}: cannot be written ({failure.strerror or failure})") from failure
