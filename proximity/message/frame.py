"""A frame: what the drum's controller gets each tick, a header and a contact for each finger (PAPER 8)."""

from enum import IntEnum

import numpy as np

from proximity.message.contact import CONTACT
from proximity.message.envelope import PREFIX, Kind


class State(IntEnum):
    """How far a frame can be trusted; the subscriber makes it worse, never better."""

    STARTING = 0
    """The service is up and has no poses yet."""
    OK = 1
    """Every finger is tracked, and the frame was in time."""
    DEGRADED = 2
    """In time, but with less than was asked for: a finger is not tracked, or is near with bounds only."""
    LATE = 3
    """Ticks were missed, or the poses are older than the frame may be used: what holds are its bounds."""
    STALE = 4
    """Too old, or nothing came: nothing is known."""
    STOPPING = 5
    """The last frame of a service that was told to stop."""


class Source(IntEnum):
    """Where a distance comes from."""

    GEOMETRY = 0
    """From the scene."""
    TELEOPERATION = 1
    """Measured by a sensor; there is no geometry."""


FRAME_HEADER = np.dtype(
    [
        *((name, PREFIX.fields[name][0].str) for name in PREFIX.names),  # type: ignore[index, union-attr]
        ("pose_ns", "<i8"),  # instant of the oldest pose of a tracked finger; of start_ns where there is none
        ("start_ns", "<i8"),  # instant at which the tick began
        ("publish_ns", "<i8"),  # instant at which the frame was handed to the transport
        ("valid_until_ns", "<i8"),  # from then on only the bounds may be used, and they widen
        ("period_ns", "<i8"),  # between ticks
        ("epoch", "<u8"),  # counts the scene's changes: parts added, removed, deformed
        ("missed", "<u8"),  # ticks of this session that were left out because others took too long
        ("count", "<u4"),  # of fingers: records that follow
        ("state", "<u1"),  # State
        ("source", "<u1"),  # Source
        ("reserved", "<u1", (2,)),
    ]
)
"""The header of a frame, 96 bytes."""

FRAME = Kind("frame", 0x46434544, FRAME_HEADER, CONTACT)  # "DECF"
