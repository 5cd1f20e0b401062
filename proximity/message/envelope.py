"""Envelope that all messages share, with their kind, size, sequence number and checksum.

A message is a header and then its records, without gaps; most kinds have one record for each finger. All
headers begin with the 32 bytes of `PREFIX`, so that a receiver can refuse other messages before reading
further. Sizes are multiples of eight; numbers are little-endian. The checksum is the CRC-32 of zlib, Ethernet
and PNG over all bytes after it: 8 to ``size``.
"""

import zlib
from dataclasses import dataclass, field
from enum import Enum
from struct import Struct

import numpy as np

from proximity.errors import ArgumentError
from proximity.message.fields import Field, blank_of, dtype_of, struct_of

VERSION = 2
"""Version of the layout of all messages. A receiver accepts only its own version. Version 1 had other
names."""
MAX_RECORDS = 4096
"""Maximum number of records of a message, which suffices for the skin of a hand."""

PREFIX_FIELDS = (
    Field("magic", "<u4", "", "which kind of message"),
    Field("checksum", "<u4", "", "CRC-32 of bytes 8 to size"),
    Field("version", "<u2", "", "of the layout"),
    Field("header_size", "<u2", "bytes", "of the header; the records follow"),
    Field("size", "<u4", "bytes", "of the whole message"),
    Field(
        "session",
        "<u8",
        "ns",
        "calendar time at which the publisher started: another value means another run",
    ),
    Field("sequence", "<u8", "", "0, 1, 2, … of this kind within a session; gaps are messages lost"),
)
PREFIX = dtype_of(PREFIX_FIELDS)
"""Common start of all headers, 32 bytes."""
unpack_prefix = struct_of(PREFIX_FIELDS).unpack_from
"""Unpacks all numbers of a `PREFIX`."""
CHECKED_FROM = 8
_COUNT = Struct("<I")


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A kind of message, with its magic number and its layout."""

    name: str
    magic: int
    header: np.dtype  # begins with the fields of `PREFIX` and has a field ``count``
    record: np.dtype
    sent: str  # field of the header with the instant of sending, ns
    zeros: tuple[str, ...] = ()  # real fields that are initially 0; others are initially nan
    header_size: int = field(init=False)  # bytes
    record_size: int = field(init=False)
    count_at: int = field(init=False)  # byte offset of ``count``
    sent_at: int = field(init=False)
    blank: np.ndarray = field(init=False)  # () structured, with unset fields

    def __post_init__(self) -> None:
        offsets = {name: self.header.fields[name][1] for name in self.header.names}  # type: ignore[index, union-attr]
        for name, value in (
            ("header_size", self.header.itemsize),
            ("record_size", self.record.itemsize),
            ("count_at", offsets["count"]),
            ("sent_at", offsets[self.sent]),
            ("blank", blank_of(self.record, self.zeros)),
        ):
            object.__setattr__(self, name, value)

    def size(self, count: int) -> int:
        """Return the size of a message with *count* records, bytes."""
        return self.header_size + count * self.record_size


class Defect(Enum):
    """Reason why bytes are not a usable message."""

    SHORT = "shorter than a header"
    MAGIC = "another kind of message, or none"
    VERSION = "another version of the layout"
    SIZE = "not as long as it declares"
    CHECKSUM = "damaged in transit"
    OLD = "overtaken or repeated"
    FUTURE = "from the future"
    CONTENT = "without sense"


class Message:
    """A message with a fixed number of records. Its header and records are arrays.

    Write ``header[field]`` and ``records[field]``, the fields of its kind; ``data`` has the bytes of both.
    Records of inputs are initially unset. Their real numbers are then nan, rotations are the identity, and
    other fields are zero. The publisher fills in session, sequence and checksum; the other fields of the
    prefix are already set.

    Parameters
    ----------
    kind : Kind
        Kind of the message, such as `POSES`.
    count : int
        Number of records, 0 to 4096.

    Raises
    ------
    ArgumentError
        If *count* is out of range.
    """

    kind: Kind
    data: np.ndarray  # uint8, the whole message
    header: np.ndarray  # () structured
    records: np.ndarray  # (count,) structured

    def __init__(self, kind: Kind, count: int) -> None:
        if not isinstance(count, (int, np.integer)) or not 0 <= count <= MAX_RECORDS:
            raise ArgumentError(f"{count!r} records, expected 0 to {MAX_RECORDS}")
        self.kind = kind
        self.data = np.zeros(kind.size(count), np.uint8)
        self.header, self.records = parts_of(self.data, kind)
        self.records[...] = kind.blank
        self.header["magic"] = kind.magic
        self.header["version"] = VERSION
        self.header["header_size"] = kind.header.itemsize
        self.header["size"] = len(self.data)
        self.header["count"] = count
        self._checksum = self.data[4:8].view("<u4")
        self._numbers = self.data[16:32].view("<u8")
        self._checked = self.data[CHECKED_FROM:]

    def seal(self, session: int, sequence: int) -> np.ndarray:
        """Write session, sequence number and checksum into the message, and return its bytes.

        The same array is returned each time.

        Parameters
        ----------
        session : int
            Session of the publisher.
        sequence : int
            Sequence number of the message in the session.

        Returns
        -------
        (size,) uint8
            The whole message.
        """
        self._numbers[0] = session
        self._numbers[1] = sequence
        self._checksum[0] = zlib.crc32(self._checked.data)
        return self.data


def parts_of(data: np.ndarray, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """Return the header, as an array of shape (), and the records of a message.

    Both are views of its bytes. *data*: a message without a defect, or memory for one.
    """
    size = kind.header.itemsize
    return data[:size].view(kind.header).reshape(()), data[size:].view(kind.record)


def validate(data: np.ndarray, kind: Kind) -> Defect | None:
    """Return the defect of bytes that should be a message of a kind, or None."""
    size = len(data)
    if size < kind.header_size:
        return Defect.SHORT
    magic, checksum, version, header_size, declared_size, _, _ = unpack_prefix(data.data)
    if magic != kind.magic:
        return Defect.MAGIC
    if version != VERSION:
        return Defect.VERSION
    count, rest = divmod(size - kind.header_size, kind.record_size)
    if declared_size != size or header_size != kind.header_size or rest or count > MAX_RECORDS:
        return Defect.SIZE
    if zlib.crc32(data[CHECKED_FROM:].data) != checksum:
        return Defect.CHECKSUM
    return None if _COUNT.unpack_from(data.data, kind.count_at)[0] == count else Defect.SIZE
