"""Read the whole frames of a frame log as a stream, oldest first. Torn and damaged bytes are counted.

Data are used only after their checksum is verified. A log may contain frames of several sessions and with
different numbers of fingers, and may be larger than memory.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.frame_bytes import MAGIC, UNDECIDED, frame_at, frame_type, is_known
from proximity.system.regular_file import open_regular

READ_BYTES = 1 << 22  # bytes per read


@dataclass(frozen=True, slots=True)
class Damage:
    """A range of bytes in a log that contains no valid frame."""

    start: int  # offset in the file
    size: int  # number of bytes up to the next whole frame


class FrameReader:
    """Iterable over the frames in a log. Each iteration reads the file again.

    Iterating yields runs of frames with equal numbers of fingers, oldest first. A run is a read-only array
    (B,) with the fields ``header`` (FRAME_HEADER) and ``contacts``, (N,) CONTACT, which is never overwritten.
    The counts below include only frames that were already read.

    *path*: the log, which may still be written to.
    """

    path: str
    frame_count: int
    damage: list[Damage]  # ranges before a later whole frame, which were skipped
    torn_size: int  # number of bytes at the end that are not a whole frame
    foreign_count: int  # number of skipped frames with another version of the layout

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
        """Sentences for the user on damage in the log."""
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
        """Yield arrays of consecutive frames that have the same size."""
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
        """Yield the location of every whole frame.

        A location is the stretch of the file that is in memory, the offset in it, and the size of the frame.
        """
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
    """The stretch of the file that is in memory, and the current position in it."""

    def __init__(self, file: BinaryIO) -> None:
        self.data, self.view = b"", memoryview(b"")
        self.index = 0  # position in `data`; the bytes before it were scanned
        self._start = 0  # offset of `data` in the file
        self._file = file

    @property
    def offset(self) -> int:
        """Current position in the file, bytes."""
        return self._start + self.index

    def is_over(self) -> bool:
        """Return whether the whole file was scanned."""
        return self.index == len(self.data) and not self._read()

    def frame_size(self) -> int:
        """Return the size of the whole frame at the current position, or 0 if there is none."""
        size = frame_at(self.view, self.index)
        while size == UNDECIDED and self._read():
            size = frame_at(self.view, self.index)
        return max(size, 0)

    def skip(self) -> None:
        """Advance to the next position at which a frame may start."""
        found = self.data.find(MAGIC, self.index + 1)
        if found < 0:  # the last bytes may be the start of a magic
            found = max(self.index + 1, len(self.data) - len(MAGIC) + 1)
        self.index = found

    def _read(self) -> bool:
        more = self._file.read(READ_BYTES)
        if more:
            self._start += self.index
            self.data = self.data[self.index :] + more
            self.view, self.index = memoryview(self.data), 0
        return bool(more)
