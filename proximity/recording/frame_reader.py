"""Reader of frame logs: whole frames, oldest first, as a stream; torn and damaged bytes are counted.

Nothing in a log is trusted before its checksum. Frames of several sessions and with different numbers of
fingers may stand in one log, and it may be longer than memory.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.frame_bytes import MAGIC, UNDECIDED, frame_at, frame_type, is_known
from proximity.system.regular_file import open_regular

READ_BYTES = 1 << 22  # bytes read at once


@dataclass(frozen=True, slots=True)
class Damage:
    """A place in a log where no frame could be read."""

    start: int  # byte of the file
    size: int  # bytes up to the next whole frame


class FrameReader:
    """The frames in a log, to be iterated over; each iteration reads the file anew.

    Iterating gives runs of frames of the same number of fingers, oldest first: read-only arrays (B,) with the
    fields ``header`` (FRAME_HEADER) and ``contacts``, (N,) CONTACT. They stay as they are for as long as they
    are held. The counts below are those of what was read so far.

    *path*: the log; one that is being written may be read.
    """

    path: str
    frame_count: int
    damage: list[Damage]  # in the middle: skipped up to the next whole frame
    torn_size: int  # bytes at the end that are no whole frame
    foreign_count: int  # whole frames of another version of the layout, left out

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._reset_counts()

    def __iter__(self) -> Iterator[np.ndarray]:
        self._reset_counts()
        try:
            with open_regular(self.path) as file:
                yield from self._runs(file)
        except OSError as failure:
            raise RecordingError(f"{self.path}: cannot be read ({failure.strerror or failure})") from failure
        if self.torn_size and not self.frame_count + self.foreign_count:
            raise RecordingError(f"{self.path}: no frame was found in its {self.torn_size} bytes")

    @property
    def notes(self) -> list[str]:
        """Sentences on the log's condition, for the user."""
        reported = []
        if self.damage:
            damaged = "1 place" if len(self.damage) == 1 else f"{len(self.damage)} places"
            size = sum(each.size for each in self.damage)
            reported.append(
                f"damaged in {damaged}, {size} bytes skipped, the first at byte {self.damage[0].start}"
            )
        if self.torn_size:
            reported.append(f"{self.torn_size} bytes of a torn frame at the end were skipped")
        if self.foreign_count:
            frames = "1 frame" if self.foreign_count == 1 else f"{self.foreign_count} frames"
            reported.append(f"{frames} of another version of the message were skipped")
        return reported

    def _reset_counts(self) -> None:
        self.frame_count = self.torn_size = self.foreign_count = 0
        self.damage = []

    def _runs(self, file: BinaryIO) -> Iterator[np.ndarray]:
        """Frames that follow each other without a gap and are of one size, as one array."""
        data, first, size, count = b"", 0, 0, 0
        for stretch, offset, frame_size in self._frames(file):
            if count and not (stretch is data and offset == first + count * size and frame_size == size):
                yield np.frombuffer(data, frame_type(size), count, first)
                count = 0
            if not count:
                data, first, size = stretch, offset, frame_size
            count += 1
            self.frame_count += 1
        if count:
            yield np.frombuffer(data, frame_type(size), count, first)

    def _frames(self, file: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
        """Every whole frame: the stretch of the file that it is in, where in it, and its size."""
        window = _Window(file)
        bad_from = -1
        while not window.is_over():
            size = window.frame_size()
            if not size:
                bad_from = window.offset if bad_from < 0 else bad_from
                window.skip()
                continue
            if bad_from >= 0:
                self.damage.append(Damage(bad_from, window.offset - bad_from))
                bad_from = -1
            if is_known(window.view, window.index, size):
                yield window.data, window.index, size
            else:
                self.foreign_count += 1
            window.index += size
        self.torn_size = window.offset - bad_from if bad_from >= 0 else 0


class _Window:
    """The stretch of a file that is in memory, and how far it was looked at."""

    def __init__(self, file: BinaryIO) -> None:
        self.data, self.view = b"", memoryview(b"")
        self.index = 0  # in data: all before it was looked at
        self._start = 0  # of data in the file
        self._file = file

    @property
    def offset(self) -> int:
        """Byte of the file at which we are."""
        return self._start + self.index

    def is_over(self) -> bool:
        """Whether all of the file was looked at."""
        return self.index == len(self.data) and not self._read()

    def frame_size(self) -> int:
        """Size of the whole frame that begins here; 0 if none does."""
        size = frame_at(self.view, self.index)
        while size == UNDECIDED and self._read():
            size = frame_at(self.view, self.index)
        return max(size, 0)

    def skip(self) -> None:
        """Go on to where the next frame may begin."""
        found = self.data.find(MAGIC, self.index + 1)
        if found < 0:  # the last bytes may be the first of a magic that goes on in the next stretch
            found = max(self.index + 1, len(self.data) - len(MAGIC) + 1)
        self.index = found

    def _read(self) -> bool:
        more = self._file.read(READ_BYTES)
        if more:
            self._start += self.index
            self.data = self.data[self.index :] + more
            self.view, self.index = memoryview(self.data), 0
        return bool(more)
