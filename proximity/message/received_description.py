"""A received description: names of parts and fingers, complete when all its messages have come."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.message.description import DESCRIPTION
from proximity.message.envelope import Flaw, parts_of

MOST_NAMES = 1 << 20
"""Of parts and fingers: a publisher that claims more is not believed."""


@dataclass(frozen=True, slots=True)
class Description:
    """Names of what a service publishes frames of.

    Frames of another ``session`` or ``epoch`` number other parts.
    """

    session: int
    epoch: int
    part_names: tuple[str, ...]  # in the order of scene.parts; cut to 64 bytes each
    hidden_parts: tuple[str, ...]  # of these, those that no question finds
    finger_names: tuple[str, ...]
    finger_radii: tuple[float, ...]  # m; nan: not known


class DescriptionMessages:
    """Collects the messages of a description.

    `newest` is the newest one that is complete, None before the first.
    """

    newest: Description | None

    def __init__(self) -> None:
        self.newest = None
        self._of: tuple[int, ...] = ()  # session, epoch, numbers of parts and fingers of the one collected
        self._labels: dict[int, tuple[str, bool, float]] = {}

    def take(self, data: np.ndarray) -> Flaw | None:
        """Take one message in, and say what is wrong inside of it; None: nothing.

        *data*: a message of kind `DESCRIPTION` that is whole and new.
        """
        header, records = parts_of(data, DESCRIPTION)
        of = tuple(int(header[name]) for name in ("session", "epoch", "part_count", "finger_count"))
        first, total = int(header["first"]), of[2] + of[3]
        if total > MOST_NAMES or first + len(records) > total:
            return Flaw.CONTENT
        if of != self._of or first == 0:
            self._of, self._labels = of, {}
        self._labels.update(enumerate(map(_label, records.tolist()), first))
        if len(self._labels) == total:
            self._complete()
        return None

    def _complete(self) -> None:
        session, epoch, part_count, finger_count = self._of
        labels = [self._labels[number] for number in range(part_count + finger_count)]
        parts, fingers = labels[:part_count], labels[part_count:]
        self.newest = Description(
            session=session,
            epoch=epoch,
            part_names=tuple(name for name, _, _ in parts),
            hidden_parts=tuple(name for name, is_hidden, _ in parts if is_hidden),
            finger_names=tuple(name for name, _, _ in fingers),
            finger_radii=tuple(radius for _, _, radius in fingers),
        )


def _label(record: tuple[Any, ...]) -> tuple[str, bool, float]:
    name, radius, is_hidden, _ = record
    return name.decode("utf-8", "replace"), bool(is_hidden), radius
