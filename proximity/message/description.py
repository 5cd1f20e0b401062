"""Messages that describe a service by the names of its parts and fingers, and their assembly on arrival.

They are sent every tenth of a second (of more than 640 names every second), whenever the epoch changes, and
when a ``changes`` message requests them. A description of many names is several messages, which belong
together if the epoch is equal and the numbers of their first records continue.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.core.receiver_state import MAX_NAMES
from proximity.message.changes import NAME_BYTES
from proximity.message.envelope import PREFIX_FIELDS, Defect, Kind, parts_of
from proximity.message.fields import Field, dtype_of, reserved

MAX_LABELS = 64
"""Maximum number of names in one message. Its datagram has 5384 bytes at most."""
REFUSAL_BYTES = 192

DESCRIPTION_FIELDS = (
    *PREFIX_FIELDS,
    Field("send_ns", "<i8", "ns", "instant at which the message was sent"),
    Field("count", "<u4", "", "records that follow"),
    Field("first", "<u4", "", "number of the first record, parts and then fingers counted from 0"),
    Field(
        "part_count", "<u4", "", "of the scene: the number of records of parts, in the order of scene.parts"
    ),
    Field("finger_count", "<u4", "", "of a frame: the number of records of fingers, after those of parts"),
    Field("epoch", "<u8", "", "of the frames whose parts these are"),
    Field("refused", "<u8", "", "changes, additions, deformations and moves that the service has refused"),
    Field(
        "refusal",
        f"S{REFUSAL_BYTES}",
        "",
        "the last of them: its kind and the reason, UTF-8, cut where longer",
    ),
)
DESCRIPTION_HEADER = dtype_of(DESCRIPTION_FIELDS)
"""The header of a description, 264 bytes."""

LABEL_FIELDS = (
    Field("name", f"S{NAME_BYTES}", "", "of the part or finger, UTF-8, cut where longer"),
    Field("radius", "<f8", "m", "of the fingertip sphere; nan: a part, or not known"),
    Field("is_hidden", "<u1", "", "1 where the part is hidden"),
    reserved(7),
)
LABEL = dtype_of(LABEL_FIELDS)
"""One part or finger of a description, 80 bytes."""

DESCRIPTION = Kind("description", 0x44434544, DESCRIPTION_HEADER, LABEL, sent="send_ns")  # "DECD"


def encoded_name(name: str, most: int = NAME_BYTES) -> bytes:
    """Return a text as UTF-8 of at most *most* bytes, cut between two characters if it is too long."""
    data = name.encode("utf-8", "replace")
    return data if len(data) <= most else data[:most].decode("utf-8", "ignore").encode()


@dataclass(frozen=True, slots=True)
class Description:
    """Names of a service's parts and fingers.

    The numbers of parts in frames of another ``session`` or ``epoch`` refer to other parts.
    """

    session: int
    epoch: int
    part_names: tuple[str, ...]  # in the order of scene.parts; cut to 64 bytes each
    hidden_parts: tuple[str, ...]  # names of the hidden parts
    finger_names: tuple[str, ...]
    finger_radii: tuple[float, ...]  # m; nan: not known
    refused: int  # number of refused changes, additions, deformations and moves
    refusal: str  # kind of the last refused one, and the reason


class DescriptionMessages:
    """Assembles descriptions from messages.

    `newest` is the newest complete description, or None before the first.
    """

    newest: Description | None

    def __init__(self) -> None:
        self.newest = None
        self._key: tuple[int, ...] = ()  # session, epoch, part count and finger count
        self._labels: dict[int, tuple[str, bool, float]] = {}

    def add(self, data: np.ndarray) -> Defect | None:
        """Add a message to the description. Return the defect of its content, or None.

        *data*: a complete, new message of kind `DESCRIPTION`.
        """
        header, records = parts_of(data, DESCRIPTION)
        of = tuple(int(header[name]) for name in ("session", "epoch", "part_count", "finger_count"))
        first, total = int(header["first"]), of[2] + of[3]
        if total > MAX_NAMES or first + len(records) > total:
            return Defect.CONTENT
        if of != self._key or first == 0:
            self._key, self._labels = of, {}
        self._labels.update(enumerate(map(_label, records.tolist()), first))
        if len(self._labels) == total:
            self._complete(int(header["refused"]), header["refusal"].item().decode("utf-8", "replace"))
        return None

    def _complete(self, refused: int, refusal: str) -> None:
        session, epoch, part_count, finger_count = self._key
        labels = [self._labels[number] for number in range(part_count + finger_count)]
        parts, fingers = labels[:part_count], labels[part_count:]
        self.newest = Description(
            session=session,
            epoch=epoch,
            part_names=tuple(name for name, _, _ in parts),
            hidden_parts=tuple(name for name, is_hidden, _ in parts if is_hidden),
            finger_names=tuple(name for name, _, _ in fingers),
            finger_radii=tuple(radius for _, _, radius in fingers),
            refused=refused,
            refusal=refusal,
        )


def _label(record: tuple[Any, ...]) -> tuple[str, bool, float]:
    name, radius, is_hidden, _ = record
    return name.decode("utf-8", "replace"), bool(is_hidden), radius
