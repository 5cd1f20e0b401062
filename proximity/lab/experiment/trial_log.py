"""Log of a session: a line a step, on the disk before the next step, and chained so that edits show.

Each line holds the hash of the line before it and its own. A line that a crash left unfinished is cut off
when the log is opened again: the step at hand is lost, nothing else.
"""

import hashlib
import json
import math
import os
from pathlib import Path
from typing import Any

from proximity.errors import RecordingError

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

Entry = dict[str, Any]
START = "0" * 64  # hash before the first line


class TrialLog:
    """The log of one participant, opened to go on; a new file where there is none."""

    entries: list[Entry]  # from the first
    head: str  # hash of the last

    def __init__(self, path: Path) -> None:
        try:
            self._stream = path.open("ab")
        except OSError as failed:
            raise RecordingError(f"{path}: cannot be written ({failed.strerror})") from failed
        try:
            if fcntl is not None:
                fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.entries, whole = _read(path)
            os.truncate(path, whole)
        except BaseException as failed:
            self._stream.close()
            if not isinstance(failed, OSError):
                raise
            is_taken = isinstance(failed, BlockingIOError)
            why = (
                "another program runs this participant" if is_taken else f"cannot be cut ({failed.strerror})"
            )
            raise RecordingError(f"{path}: {why}") from failed
        self.head = self.entries[-1]["sha256"] if self.entries else START

    def append(self, event: str, **content: Any) -> Entry:
        """Write an entry; when this returns it is on the disk."""
        entry: Entry = {"event": event} | {key: _plain(value) for key, value in content.items()}
        entry |= {"previous": self.head}
        self.head = entry["sha256"] = _hash(entry)
        self._stream.write(json.dumps(entry, allow_nan=False, ensure_ascii=False).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self.entries.append(entry)
        return entry

    def __enter__(self) -> "TrialLog":
        """Keep it open."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self._stream.close()


def read_log(path: Path) -> list[Entry]:
    """Return the entries of a log."""
    return _read(path)[0]


def _read(path: Path) -> tuple[list[Entry], int]:
    """Entries, and how many bytes they take: an unfinished last line is not among them."""
    try:
        content = path.read_bytes()
    except OSError as failed:
        raise RecordingError(f"{path}: cannot be read ({failed.strerror})") from failed
    whole = content.rfind(b"\n") + 1
    entries: list[Entry] = []
    head = START
    for number, line in enumerate(content[:whole].splitlines(), start=1):
        try:
            entry = json.loads(line)
            is_chained = entry["previous"] == head and entry["sha256"] == _hash(entry)
        except (ValueError, KeyError, TypeError):
            is_chained = False
        if not is_chained:
            raise RecordingError(
                f"{path}:{number}: this line, or one before it, was edited after it was written; expected "
                "the log as the experiment left it"
            )
        entries.append(entry)
        head = entry["sha256"]
    return entries, whole


def _hash(entry: Entry) -> str:
    content = {key: value for key, value in entry.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value
