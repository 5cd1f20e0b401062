"""Frame, the message to the drum's controller at each tick (see messages.md).

It has a header and a contact for each finger.
"""

from enum import IntEnum

from proximity.message.contact import CONTACT
from proximity.message.envelope import PREFIX_FIELDS, Kind
from proximity.message.fields import Field, dtype_of, reserved


class State(IntEnum):
    """Trust in a frame. The subscriber may lower the state, never raise it."""

    STARTING = 0
    """The service is running and has no poses yet."""
    OK = 1
    """Every finger is tracked, and the frame was in time."""
    DEGRADED = 2
    """In time, but a finger is not tracked, or is near a part with only bounds known."""
    LATE = 3
    """Ticks were missed, or the pose of a finger or of a moving part is too old: only the bounds hold."""
    STALE = 4
    """The newest frame is too old, or none came: the state is unknown."""
    STOPPING = 5
    """The last frame of a stopping service."""


class Source(IntEnum):
    """Source of a distance."""

    GEOMETRY = 0
    """From the scene."""
    TELEOPERATION = 1
    """Measured by a sensor, without geometry."""
    HELD = 2
    """From the scene, for a tracked part: a record is a connection of it to another part."""


FRAME_FIELDS = (
    *PREFIX_FIELDS,
    Field(
        "pose_ns", "<i8", "ns", "instant of the oldest pose of a tracked finger; start_ns where there is none"
    ),
    Field("start_ns", "<i8", "ns", "instant at which the tick began"),
    Field("publish_ns", "<i8", "ns", "instant at which the frame was handed to the transport"),
    Field(
        "valid_until_ns",
        "<i8",
        "ns",
        "from then on, and a second after pose_ns in any case, only the bounds may be used, and they widen",
    ),
    Field("period_ns", "<i8", "ns", "between ticks"),
    Field("epoch", "<u8", "", "counts the scene's changes: parts added, removed, deformed, hidden, shown"),
    Field("missed", "<u8", "", "ticks of this session that were skipped because earlier ones took too long"),
    Field("count", "<u4", "", "of fingers: records that follow"),
    Field("state", "<u1", "", "a State"),
    Field("source", "<u1", "", "a Source"),
    reserved(2),
)
FRAME_HEADER = dtype_of(FRAME_FIELDS)
"""The header of a frame, 96 bytes."""

FRAME = Kind(
    "frame", 0x46434544, FRAME_HEADER, CONTACT, sent="publish_ns", zeros=CONTACT.names or ()
)  # "DECF"
