"""The description of a service: names of parts and fingers, published beside frames.

It is sent every second, whenever the epoch changes, and when a ``changes`` message asks for it. A description
of many names is several messages, which the epoch and the numbers of their first records hold together.
"""

from proximity.message.changes import NAME_BYTES
from proximity.message.envelope import PREFIX_FIELDS, Kind
from proximity.message.fields import Field, dtype_of, reserved

MOST_LABELS = 64
"""Names in one message: a datagram of 5184 bytes at most."""

DESCRIPTION_FIELDS = (
    *PREFIX_FIELDS,
    Field("send_ns", "<i8", "ns", "instant at which the message was sent"),
    Field("count", "<u4", "", "records that follow"),
    Field("first", "<u4", "", "number of the first record, parts and then fingers counted from 0"),
    Field(
        "part_count", "<u4", "", "of the scene: that many records are of parts, in the order of scene.parts"
    ),
    Field("finger_count", "<u4", "", "of a frame: that many records, behind those of parts, are of fingers"),
    Field("epoch", "<u8", "", "of the frames whose parts these are"),
)
DESCRIPTION_HEADER = dtype_of(DESCRIPTION_FIELDS)
"""The header of a description, 64 bytes."""

LABEL_FIELDS = (
    Field("name", f"S{NAME_BYTES}", "", "of the part or finger, UTF-8, cut where longer"),
    Field("radius", "<f8", "m", "of the fingertip sphere; nan: a part, or not known"),
    Field("is_hidden", "<u1", "", "1 where the part is hidden"),
    reserved(7),
)
LABEL = dtype_of(LABEL_FIELDS)
"""One part or finger of a description, 80 bytes."""

DESCRIPTION = Kind("description", 0x44434544, DESCRIPTION_HEADER, LABEL, sent="send_ns")  # "DECD"


def encoded_name(name: str) -> bytes:
    """Return a name as messages hold it: cut between two characters where it is too long."""
    data = name.encode("utf-8", "replace")
    return data if len(data) <= NAME_BYTES else data[:NAME_BYTES].decode("utf-8", "ignore").encode()
