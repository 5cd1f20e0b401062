"""Messages for the drum's controller, the inputs of a service, and the description of a service.

Messages are fixed NumPy structured types. Numbers are little-endian, every field is on a multiple of its
size, and sizes are multiples of eight. Lengths are in metres, times in int64 nanoseconds of one monotonic
clock. Tracker, transports and logs share this layout, byte for byte.
"""

from proximity.message.changes import (
    ADDITION,
    ADDITIONS,
    BLOCK_VERTICES,
    CHANGE,
    CHANGES,
    DEFORMATION,
    DEFORMATIONS,
    PartAction,
)
from proximity.message.contact import CONTACT, ContactFlag, Mode, Surface
from proximity.message.description import DESCRIPTION, DESCRIPTION_HEADER, LABEL
from proximity.message.envelope import MAX_RECORDS, PREFIX, VERSION, Defect, Kind, Message, parts_of, validate
from proximity.message.frame import FRAME, FRAME_HEADER, Source, State
from proximity.message.inputs import (
    GLOVE_POSE,
    GLOVE_POSES,
    INPUT_HEADER,
    MEASURED,
    MEASUREMENT,
    MOVE,
    MOVES,
    PATH_CORNERS,
    PATH_POSE,
    PATH_POSES,
    POSE,
    POSES,
)

__all__ = [
    "ADDITION",
    "ADDITIONS",
    "BLOCK_VERTICES",
    "CHANGE",
    "CHANGES",
    "CONTACT",
    "DEFORMATION",
    "DEFORMATIONS",
    "DESCRIPTION",
    "DESCRIPTION_HEADER",
    "FRAME",
    "FRAME_HEADER",
    "GLOVE_POSE",
    "GLOVE_POSES",
    "INPUT_HEADER",
    "LABEL",
    "MAX_RECORDS",
    "MEASURED",
    "MEASUREMENT",
    "MOVE",
    "MOVES",
    "PATH_CORNERS",
    "PATH_POSE",
    "PATH_POSES",
    "POSE",
    "POSES",
    "PREFIX",
    "VERSION",
    "ContactFlag",
    "Defect",
    "Kind",
    "Message",
    "Mode",
    "PartAction",
    "Source",
    "State",
    "Surface",
    "parts_of",
    "validate",
]
