"""Detect whole frames in bytes, for the reader and the writer of frame logs.

A frame is identified only by its magic, size and checksum, so that the next one after damage is found. The
check is equivalent to `validate` on one message, and eight times as fast; a test compares both.
"""

import struct
import zlib
from functools import cache

import numpy as np

from proximity.message import CONTACT, FRAME, FRAME_HEADER, MAX_RECORDS, PREFIX, VERSION

MAGIC = FRAME.magic.to_bytes(4, "little")
MAX_FRAME = FRAME.size(MAX_RECORDS)
"""Maximum size of a frame, bytes."""
UNDECIDED = -1
"""Result if more bytes are needed to decide."""

_BEGINNING = struct.Struct("<IIHHI")  # magic, checksum, version, header_size, size: as in `PREFIX`
_COUNT = struct.Struct("<I")
_COUNT_AT = FRAME_HEADER.fields["count"][1]  # type: ignore[index]
_CHECKED_FROM = 8


def frame_at(data: memoryview, offset: int) -> int:
    """Return the size of the whole frame at *offset*.

    Return 0 if there is none, and `UNDECIDED` if more bytes are needed. The frame may have another version of
    the layout: see `is_known`.
    """
    left = len(data) - offset
    if left < PREFIX.itemsize:
        return UNDECIDED if MAGIC.startswith(bytes(data[offset : offset + len(MAGIC)])) else 0
    magic, checksum, _, _, size = _BEGINNING.unpack_from(data, offset)
    if magic != FRAME.magic or not PREFIX.itemsize <= size <= MAX_FRAME:
        return 0
    if size > left:
        return UNDECIDED
    return size if zlib.crc32(data[offset + _CHECKED_FROM : offset + size]) == checksum else 0


def is_known(data: memoryview, offset: int, size: int) -> bool:
    """Return whether a whole frame has the present layout of `FRAME`."""
    _, _, version, header_size, _ = _BEGINNING.unpack_from(data, offset)
    if version != VERSION or header_size != FRAME_HEADER.itemsize or size < header_size:
        return False
    (count,) = _COUNT.unpack_from(data, offset + _COUNT_AT)
    return FRAME.size(count) == size


def last_end(data: memoryview) -> int:
    """Return the end of the last whole frame in a stretch of a log, or 0 if there is none.

    *data*: the stretch, which may begin in the middle of a frame.
    """
    found, offset = 0, 0
    text = bytes(data)
    while (offset := text.find(MAGIC, offset)) >= 0:
        size = frame_at(data, offset)
        if size > 0:
            found = offset = offset + size
        else:
            offset += 1
    return found


@cache
def frame_type(size: int) -> np.dtype:
    """Return the NumPy type of a frame of *size* bytes.

    Its fields are ``header`` and ``contacts``, (N,) CONTACT.
    """
    count = (size - FRAME_HEADER.itemsize) // CONTACT.itemsize
    return np.dtype([("header", FRAME_HEADER), ("contacts", CONTACT, (count,))])
