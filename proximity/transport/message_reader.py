"""Checks of received messages: only whole, new messages of an expected kind pass; the others are counted."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from struct import Struct

import numpy as np

from proximity.message import MAX_RECORDS, PREFIX, Defect, Kind, validate
from proximity.message.envelope import unpack_prefix
from proximity.transport.link import NOTHING, Inlet

MOST_AT_ONCE = 1024
"""Messages taken in one go: more than a transport keeps for a reader."""
MOST_FLAWED = 256
"""Of these, such that cannot be used: a flood must not keep a reader from its work."""
RESTART_SILENCE_NS = 50_000_000
"""A publisher elsewhere that is silent for longer may have been started anew with its calendar put back; one
that came before it and is there again is believed."""
MOST_RUNS = 64
"""Runs of the publisher that are remembered: what came of them does not come again."""
MOST_SKIPPED = 100_000_000
"""Numbers that may be missing between two messages of a run: one that is farther on is none of it."""

_Seen = tuple[int, int, int, int]
"""A message: session, sequence, when it was sent on the publisher's clock and taken on ours, ns."""
_NUMBERS_AT = PREFIX.fields["session"][1]  # type: ignore[index]
_unpack_numbers = Struct("<QQ").unpack_from  # session and sequence
_unpack_instant = Struct("<q").unpack_from


@dataclass(slots=True)
class Counts:
    """Numbers of messages that a receiver has seen since it was opened."""

    received: int = 0  # messages that were used
    lost: int = 0  # numbers that were left out since the first message
    sessions: int = 0  # runs of the publisher
    refused: int = 0  # from somebody else than the address names
    unverified: int = 0  # not verified by the address's key
    flawed: Counter[Defect] = field(default_factory=Counter)  # not used, by reason

    @property
    def unused(self) -> int:
        """Messages that came and were not used, for whatever reason."""
        return self.refused + self.unverified + self.flawed.total()

    def __str__(self) -> str:
        parts = [f"{self.received} received", f"{self.lost} lost"]
        parts += [f"{count} {defect.value}" for defect, count in self.flawed.items()]
        if self.refused:
            parts.append(f"{self.refused} from another sender")
        if self.unverified:
            parts.append(f"{self.unverified} not verified by the key")
        return ", ".join(parts)


class MessageReader:
    """Reads messages from an inlet and gives those that can be used.

    *kinds*: which are expected; each kind has sessions and numbers of its own. *most_flawed*: of these, such
    that cannot be used; then the others wait for the next go. *uncounted*: one of the kinds, whose messages
    are neither counted as received nor as lost.

    Notes
    -----
    Within a session numbers only rise. Another session is another run of the publisher. It counts if its
    number is higher: it began later, by the calendar. If the number is lower, either the calendar was put
    back or these are copies from an earlier run. On a shared clock the instant of sending tells which; a
    foreign clock tells nothing, and the present run must have been silent. So it must before a run comes back
    that another has followed: of two publishers that go on side by side one is believed, not each in turn.
    What has come once of any run does not come again.

    Where a key verifies messages, nobody else can begin a session, but recorded messages still verify: so a
    session that is lower than any that was used, of whatever kind, never counts. A publisher whose calendar
    was put back is then heard only by a receiver that is started anew.
    """

    is_new_run: bool  # the message that was given last is of another run than the one of its kind before it

    def __init__(
        self,
        inlet: Inlet,
        kinds: Sequence[Kind],
        clock: Callable[[], int] = time.monotonic_ns,
        most_at_once: int = MOST_AT_ONCE,
        most_flawed: int = MOST_FLAWED,
        uncounted: Kind | None = None,
    ) -> None:
        self.counts = Counts()
        self._uncounted = 0 if uncounted is None else uncounted.magic
        self.is_new_run = False
        self._inlet = inlet
        self._kinds = {kind.magic: kind for kind in kinds}
        self._default = kinds[0]
        self._buffer = np.empty(max(kind.size(MAX_RECORDS) for kind in kinds) + 8, np.uint8)
        self._clock = clock
        self._most_at_once, self._most_flawed = most_at_once, most_flawed
        self._newest_session = 0  # of all kinds
        self._last: dict[int, _Seen] = {}  # by the kind's magic
        self._ended: dict[tuple[int, int], int] = {}  # magic, session: the last number of a run before

    def messages(
        self, content_defect: Callable[[Kind, np.ndarray, int], Defect | None] | None = None
    ) -> Iterator[tuple[Kind, np.ndarray, int]]:
        """Give what has arrived and can be used, oldest first: kind, bytes, instant of arrival, ns.

        The bytes, (size,) uint8, are overwritten by the next message.

        *content_defect*: says what is wrong inside of a message that is whole and new; None: nothing.
        """
        inlet, buffer, counts = self._inlet, self._buffer, self.counts
        flawed_count = 0
        for _ in range(self._most_at_once):
            size = inlet.receive(buffer)
            counts.refused, counts.unverified = inlet.refused, inlet.unverified
            if size == NOTHING:
                return
            now = self._clock()
            data = buffer[:size]
            kind = self._kind_of(data)
            defect = self._check(kind, data, now, content_defect) if size <= len(buffer) else Defect.SIZE
            if defect is None:
                yield kind, data, now
                continue
            counts.flawed[defect] += 1
            flawed_count += 1
            if flawed_count == self._most_flawed:
                return

    def _check(
        self,
        kind: Kind,
        data: np.ndarray,
        now: int,
        content_defect: Callable[[Kind, np.ndarray, int], Defect | None] | None,
    ) -> Defect | None:
        """Count a message that can be used; of one that cannot, say why."""
        defect = validate(data, kind)
        if defect is not None:
            return defect
        session, sequence = _unpack_numbers(data.data, _NUMBERS_AT)
        message = session, sequence, _unpack_instant(data.data, kind.sent_at)[0], now
        defect = self._age_defect(kind, message)
        if defect is None and content_defect is not None:
            defect = content_defect(kind, data, now)
        if defect is None:
            self._accept(kind, message)
        return defect

    def _kind_of(self, data: np.ndarray) -> Kind:
        if len(self._kinds) == 1 or len(data) < PREFIX.itemsize:
            return self._default
        return self._kinds.get(unpack_prefix(data.data)[0], self._default)

    def _age_defect(self, kind: Kind, message: _Seen) -> Defect | None:
        """Whether the message was overtaken or is repeated."""
        session, sequence, sent_ns, now_ns = message
        if session < self._newest_session and self._inlet.is_keyed:
            return Defect.OLD
        last = self._last.get(kind.magic)
        if last is None:
            return None
        last_session, last_sequence, last_sent_ns, last_ns = last
        if session == last_session:
            return None if 0 < sequence - last_sequence <= MOST_SKIPPED else Defect.OLD
        was_followed = (kind.magic, session) in self._ended
        if session > last_session and not was_followed:
            return None
        is_silent = now_ns - last_ns > RESTART_SILENCE_NS
        if was_followed:
            is_alive = is_silent and sequence > self._ended[kind.magic, session]
        else:
            is_alive = sent_ns > last_sent_ns if self._inlet.shares_clock else is_silent
        return None if is_alive else Defect.OLD

    def _accept(self, kind: Kind, message: _Seen) -> None:
        """Count a message that is used, and those before it that are missing."""
        last, (session, sequence, *_) = self._last.get(kind.magic), message
        counts = self.counts if kind.magic != self._uncounted else Counts()
        before = sequence - 1  # of the very first none is missing
        self.is_new_run = last is not None and last[0] != session
        if last is None:
            counts.sessions += 1
        elif last[0] == session:
            before = last[1]
        else:
            counts.sessions += 1
            self._ended[kind.magic, last[0]] = last[1]
            before = self._ended.pop((kind.magic, session), -1)
            if len(self._ended) > MOST_RUNS:
                del self._ended[next(iter(self._ended))]
        missing = sequence - before - 1
        counts.lost += missing if missing <= MOST_SKIPPED else 0  # of a run that was joined late
        counts.received += 1
        self._last[kind.magic] = message
        self._newest_session = max(self._newest_session, session)
