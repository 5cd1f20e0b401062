"""Distrust of what arrives: only whole, new messages of an expected kind go on; the others are counted."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from proximity.message import MAX_RECORDS, PREFIX, Flaw, Kind, flaw_of
from proximity.transport.links import NOTHING, Inlet

MOST_AT_ONCE = 256
"""Messages looked at in one go: a flood must not keep a reader from its work."""
RESTART_SILENCE_NS = 50_000_000
"""A publisher silent for longer may have been started anew with a clock that was put back."""


@dataclass(slots=True)
class Counts:
    """What a receiver has seen since it was opened."""

    received: int = 0  # messages that were used
    lost: int = 0  # numbers that were left out within a session
    sessions: int = 0  # runs of the publisher
    refused: int = 0  # from somebody else than the address names
    flawed: Counter[Flaw] = field(default_factory=Counter)  # not used, by reason

    def __str__(self) -> str:
        parts = [f"{self.received} received", f"{self.lost} lost"]
        parts += [f"{count} {flaw.value}" for flaw, count in self.flawed.items()]
        if self.refused:
            parts.append(f"{self.refused} from a stranger")
        return ", ".join(parts)


class Examiner:
    """Takes messages from an inlet and lets through those that can be used.

    Parameters
    ----------
    inlet : Inlet
        Where they come from.
    kinds : sequence of Kind
        Which are expected; each kind has sessions and numbers of its own.
    clock : callable
        Gives now, ns, monotonic.
    most_at_once : int
        Messages looked at in one go.
    """

    def __init__(
        self,
        inlet: Inlet,
        kinds: Sequence[Kind],
        clock: Callable[[], int] = time.monotonic_ns,
        most_at_once: int = MOST_AT_ONCE,
    ) -> None:
        self.counts = Counts()
        self._inlet = inlet
        self._kinds = {kind.magic: kind for kind in kinds}
        self._default = kinds[0]
        self._room = np.empty(max(kind.size(MAX_RECORDS) for kind in kinds) + 8, np.uint8)
        self._clock = clock
        self._most_at_once = most_at_once
        self._last: dict[str, tuple[int, int, int]] = {}  # session, sequence, when; by kind

    def messages(
        self, content_flaw: Callable[[Kind, np.ndarray, int], Flaw | None] | None = None
    ) -> Iterator[tuple[Kind, np.ndarray, int]]:
        """Give what has arrived and can be used, oldest first: kind, bytes, instant of arrival, ns.

        The bytes, (size,) uint8, are overwritten by the next message.

        Parameters
        ----------
        content_flaw : callable
            Says what is wrong inside of a message that is whole and new; None: nothing.
        """
        for _ in range(self._most_at_once):
            size = self._inlet.receive(self._room)
            self.counts.refused = self._inlet.refused
            if size == NOTHING:
                return
            now = self._clock()
            if size > len(self._room):
                self.counts.flawed[Flaw.SIZE] += 1
                continue
            data = self._room[:size]
            kind = self._kind_of(data)
            flaw = flaw_of(data, kind) or self._age_flaw(kind, data, now)
            if flaw is None and content_flaw is not None:
                flaw = content_flaw(kind, data, now)
            if flaw is not None:
                self.counts.flawed[flaw] += 1
                continue
            self._accept(kind, data, now)
            yield kind, data, now

    def _kind_of(self, data: np.ndarray) -> Kind:
        if len(data) < PREFIX.itemsize:
            return self._default
        return self._kinds.get(int(data[:4].view("<u4")[0]), self._default)

    def _age_flaw(self, kind: Kind, data: np.ndarray, now: int) -> Flaw | None:
        """Whether the message was overtaken or is repeated."""
        last = self._last.get(kind.name)
        if last is None:
            return None
        session, sequence = _numbers(data)
        if session == last[0]:
            return Flaw.OLD if sequence <= last[1] else None
        is_silent = now - last[2] > RESTART_SILENCE_NS
        return None if session > last[0] or is_silent else Flaw.OLD

    def _accept(self, kind: Kind, data: np.ndarray, now: int) -> None:
        session, sequence = _numbers(data)
        last = self._last.get(kind.name)
        if last is not None and last[0] == session:
            self.counts.lost += sequence - last[1] - 1
        else:
            self.counts.sessions += 1
        self.counts.received += 1
        self._last[kind.name] = session, sequence, now


def _numbers(data: np.ndarray) -> tuple[int, int]:
    session, sequence = data[16:32].view("<u8").tolist()
    return session, sequence
