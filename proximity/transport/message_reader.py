"""Check received messages. Only whole, new messages of an expected kind are used; the others are counted."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from proximity.core.library_in_c import receiver_in_c
from proximity.core.receiver_state import MAX_AT_ONCE, MAX_FLAWED, RECEIVER
from proximity.message import MAX_RECORDS, PREFIX, Defect, Kind, validate
from proximity.message.envelope import unpack_prefix
from proximity.transport.link import NOTHING, Inlet

_NUMBERS = {defect: number for number, defect in enumerate(Defect, 1)}


@dataclass(slots=True)
class Counts:
    """Numbers of messages seen by a receiver since it was opened."""

    received: int = 0  # number of messages that were used
    lost: int = 0  # number of messages missing since the first one
    sessions: int = 0  # number of runs of the publisher
    refused: int = 0  # messages from another sender than the address permits
    unverified: int = 0  # messages that the key of the address does not verify
    flawed: Counter[Defect] = field(default_factory=Counter)  # unusable messages by reason

    @classmethod
    def of(cls, receiver: Any, refused: int, unverified: int) -> "Counts":
        """Return the counts of a receiver in C, a record of `RECEIVER`."""
        received, lost, sessions = (int(receiver[name]) for name in ("received", "lost", "sessions"))
        flawed = zip(Defect, receiver["flawed"][1:].tolist(), strict=True)
        counted = Counter({defect: count for defect, count in flawed if count})
        return cls(received, lost, sessions, refused, unverified, counted)

    @property
    def unused(self) -> int:
        """Number of messages that were received and not used, for any reason."""
        return self.refused + self.unverified + self.flawed.total()

    def __str__(self) -> str:
        parts = [f"{self.received} received", f"{self.lost} lost"]
        parts += [f"{count} {defect.value}" for defect, count in self.flawed.most_common()]
        if self.refused:
            parts.append(f"{self.refused} from another sender")
        if self.unverified:
            parts.append(f"{self.unverified} not verified by the key")
        return ", ".join(parts)


class MessageReader:
    """Reads messages from an inlet and yields the usable ones.

    *kinds*: expected kinds of messages, each with separate sessions and numbers. *max_flawed*: maximum number
    of unusable messages that one call reads. *uncounted*: the kind whose messages are counted neither as
    received nor as lost. The receiver in C decides which messages are usable, see ``proximity_message.h``.
    """

    def __init__(
        self,
        inlet: Inlet,
        kinds: Sequence[Kind],
        clock: Callable[[], int] = time.monotonic_ns,
        max_at_once: int = MAX_AT_ONCE,
        max_flawed: int = MAX_FLAWED,
        uncounted: Kind | None = None,
    ) -> None:
        self._inlet = inlet
        self._kinds = {kind.magic: kind for kind in kinds}
        self._rows = {kind.magic: row for row, kind in enumerate(kinds)}
        self._default = kinds[0]
        self._buffer = np.empty(max(kind.size(MAX_RECORDS) for kind in kinds) + 8, np.uint8)
        self._clock = clock
        self._max_at_once, self._max_flawed = max_at_once, max_flawed
        (self._state,) = state = np.zeros(1, RECEIVER)
        self._state["shares_clock"], self._state["is_keyed"] = inlet.shares_clock, inlet.is_keyed
        self._state["uncounted"] = 0 if uncounted is None else 1 + self._rows[uncounted.magic]
        self._bytes = state.view(np.uint8)
        self._is_old, self._accept = receiver_in_c("is_old"), receiver_in_c("accept")

    @property
    def counts(self) -> Counts:
        """Counts of messages until now."""
        return Counts.of(self._state, self._inlet.refused, self._inlet.unverified)

    @property
    def is_new_run(self) -> bool:
        """Whether the last message is from another run of the publisher than the previous one of its kind."""
        return bool(self._state["is_new_run"])

    def messages(
        self, content_defect: Callable[[Kind, np.ndarray, int], Defect | None] | None = None
    ) -> Iterator[tuple[Kind, np.ndarray, int]]:
        """Yield the kind, the bytes and the arrival time of each usable message, oldest first.

        The bytes, (size,) uint8, are overwritten by the next message. The time is in ns. *content_defect*:
        function that returns the defect of a complete, new message, or None.
        """
        inlet, buffer = self._inlet, self._buffer
        flawed_count = 0
        for _ in range(self._max_at_once):
            size = inlet.receive(buffer)
            if size == NOTHING:
                return
            now = self._clock()
            data = buffer[:size]
            kind = self._kind_of(data)
            defect = self._check(kind, data, now, content_defect) if size <= len(buffer) else Defect.SIZE
            if defect is None:
                yield kind, data, now
                continue
            self._state["flawed"][_NUMBERS[defect]] += 1
            flawed_count += 1
            if flawed_count == self._max_flawed:
                return

    def _check(
        self,
        kind: Kind,
        data: np.ndarray,
        now: int,
        content_defect: Callable[[Kind, np.ndarray, int], Defect | None] | None,
    ) -> Defect | None:
        """Return the defect of a message, or count it as received and return None."""
        defect = validate(data, kind)
        if defect is not None:
            return defect
        message = self._bytes, data, self._rows[kind.magic], kind.sent_at, now
        if self._is_old(*message):
            return Defect.OLD
        defect = None if content_defect is None else content_defect(kind, data, now)
        if defect is None:
            self._accept(*message)
        return defect

    def _kind_of(self, data: np.ndarray) -> Kind:
        if len(self._kinds) == 1 or len(data) < PREFIX.itemsize:
            return self._default
        return self._kinds.get(unpack_prefix(data.data)[0], self._default)
