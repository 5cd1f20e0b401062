"""Description of a service: names of parts and fingers, published as messages next to the frames."""

from collections.abc import Callable, Sequence

import numpy as np

from proximity.message import DESCRIPTION, Message
from proximity.message.description import MAX_LABELS, REFUSAL_BYTES, encoded_name
from proximity.system.time_units import NS_PER_S

APART_NS = NS_PER_S // 10
"""Time between two descriptions, times the messages of one; a second at most."""
PartLabels = tuple[Sequence[str], np.ndarray]
"""Names of parts, and whether each is hidden, (P,) bool."""


class Describer:
    """Makes the messages of a description: repeatedly, at each change of the epoch, and on request.

    At most one a tick: a tick encodes at most `MAX_LABELS` names.
    """

    def __init__(self, finger_names: Sequence[str], radii: Sequence[float]) -> None:
        self._fingers = [encoded_name(name) for name in finger_names]
        self._radii = list(radii)
        self._messages: dict[int, Message] = {}  # by number of records
        self._epoch = -1
        self._next: int | None = None  # number of the next record; None: complete
        self._due_ns = -(2**63)
        self._is_asked = False
        self._refused, self._refusal = 0, b""

    def refuse(self, kind: str, reason: str, count: int = 1) -> None:
        """Record, for the next description, that messages of a kind, or moves, were refused, and why."""
        self._refused += count
        self._refusal = encoded_name(f"{kind}: {reason}", REFUSAL_BYTES)

    def ask(self) -> None:
        """Request a description from the next tick on."""
        self._is_asked = True

    def message(self, epoch: int, now_ns: int, labels: Callable[[], PartLabels]) -> Message | None:
        """Return the message to publish now, or None.

        *labels*: returns the parts of that epoch; called only if a message is published.
        """
        if epoch != self._epoch or self._is_asked or (self._next is None and now_ns >= self._due_ns):
            self._epoch, self._next, self._is_asked = epoch, 0, False
        if self._next is None:
            return None
        names, is_hidden = labels()
        total = len(names) + len(self._fingers)
        if self._next == 0:
            self._due_ns = now_ns + min(-(-total // MAX_LABELS) * APART_NS, NS_PER_S)
        first, end = self._next, min(self._next + MAX_LABELS, total)
        self._next = None if end == total else end
        message = self._message_for(end - first)
        header, records = message.header, message.records
        header["send_ns"], header["epoch"], header["first"] = now_ns, epoch, first
        header["part_count"], header["finger_count"] = len(names), len(self._fingers)
        header["refused"], header["refusal"] = self._refused, self._refusal
        named = names[first:end]
        count, finger = len(named), max(first - len(names), 0)
        fingers = slice(finger, finger + len(records) - count)
        records["name"][:count] = [encoded_name(name) for name in named]
        records["name"][count:] = self._fingers[fingers]
        records["radius"][:count], records["radius"][count:] = np.nan, self._radii[fingers]
        records["is_hidden"][:count], records["is_hidden"][count:] = is_hidden[first:end], 0
        return message

    def _message_for(self, count: int) -> Message:
        if count not in self._messages:
            self._messages[count] = Message(DESCRIPTION, count)
        return self._messages[count]
