"""Messages with which other programs hide, show, remove, add or deform parts of a served scene.

They use the same transports as other inputs. They refer to parts by name, since numbers change with the
epoch. A message takes effect completely or, if part of it is invalid, not at all.
"""

from enum import IntEnum

from proximity.message.envelope import Kind
from proximity.message.fields import VECTOR, Field, dtype_of, reserved
from proximity.message.inputs import INPUT_HEADER

NAME_BYTES = 64
"""Maximum size of a part's or finger's name in UTF-8. Messages cannot change a part with a longer name."""
BLOCK_VERTICES = 64
"""Vertices in a record of a ``deformations`` message. Over UDP a message has 40 records at most, which are
2560 vertices; elsewhere 4096, which are 262 144."""


class PartAction(IntEnum):
    """Action on a part."""

    HIDE = 0
    """No query finds the part until it is shown."""
    SHOW = 1
    """Queries find the part again."""
    REMOVE = 2
    """The part is removed from the scene."""
    DESCRIBE = 3
    """No change, and no part is named: the service publishes its description now."""


CHANGE_FIELDS = (
    Field("name", f"S{NAME_BYTES}", "", "of the part, UTF-8, ended by a zero where shorter"),
    Field("action", "<u4", "", "a PartAction"),
    reserved(4),
)
CHANGE = dtype_of(CHANGE_FIELDS)
"""One part of a ``changes`` message, 72 bytes."""

ADDITION_FIELDS = (
    Field(
        "name", f"S{NAME_BYTES}", "", "of the new part, UTF-8; before each name where the file has several"
    ),
    Field("file", "S192", "", "in a folder of input.parts_from, UTF-8, such as lid.stl or inner/lid.stl"),
    Field("units", "S8", "", "of a file that declares none, such as m; empty: mm"),
    Field("rotation", "<f8", "", "world_from_file, row by row", (3, 3)),
    Field("translation", "<f8", "m", "of the file's origin", VECTOR),
)
ADDITION = dtype_of(ADDITION_FIELDS)
"""One file of an ``additions`` message, 360 bytes."""

DEFORMATION_FIELDS = (
    Field("name", f"S{NAME_BYTES}", "", "of the part, UTF-8; the same in all records of a message"),
    Field("first", "<u4", "", "row of the first vertex of this record: 0, 64, 128, …"),
    Field("vertex_count", "<u4", "", "of the whole part; further rows of the last record are ignored"),
    Field("vertices", "<f8", "m", "from now on, in the part's frame", (BLOCK_VERTICES, 3)),
)
DEFORMATION = dtype_of(DEFORMATION_FIELDS)
"""Up to 64 vertices of the one part of a ``deformations`` message, 1608 bytes."""

CHANGES = Kind("changes", 0x43434544, INPUT_HEADER, CHANGE, sent="send_ns")  # "DECC"
ADDITIONS = Kind(
    "additions", 0x41434544, INPUT_HEADER, ADDITION, sent="send_ns", zeros=("translation",)
)  # "DECA"; the default pose is the identity
DEFORMATIONS = Kind("deformations", 0x56434544, INPUT_HEADER, DEFORMATION, sent="send_ns")  # "DECV"
