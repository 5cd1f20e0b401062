"""The clock of a publisher on another machine, guessed from when its messages arrive."""

from proximity.core.receiver_state import (
    BACK_NS,
    JUMP_NS,
    NS_PER_DRIFT,
    PACE_NS,
    SETTLING_NS,
    TRANSIT_NS,
)


class ForeignClock:
    """How far a publisher's clock is from ours: by the message that was fastest on its way, as clocks drift.

    What all messages took is not seen, and `TRANSIT_NS` is allowed for it. A longer way and a clock that was
    put back look the same, and to mistake the first for the second is dangerous: so however late messages
    come, the clock is thought to go on as it did, and they are old. It begins anew, and is not certain until
    it has been seen to run for `SETTLING_NS`, where

    - a message comes earlier than can be: their clock was put forward, or ours slept;
    - an instant is before one of a message of its kind that came earlier. No way makes that, since messages
      of one kind come in order: their clock was put back, or an instant was wrong. The clock that was
      believed before a message came too early is then the one to settle, if what comes is at most `JUMP_NS`
      late by it;
    - a new run, as `Publisher` begins after its machine slept, is more than `JUMP_NS` late.
    """

    is_certain: bool
    """Whether `theirs` may be believed."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget: the clock is another one."""
        self.is_certain = False
        self._first_ns = self._seen_ns = self._offset_ns = self._first_offset_ns = 0
        self._sent_ns: dict[int, int] = {}  # latest of each kind since it began; empty: none yet
        self._former: tuple[int, int] | None = None  # believed before a message came too early

    def arrived(self, sent_ns: int, now_ns: int, *, is_new_run: bool = False, kind: int = 0) -> None:
        """Learn that what was sent at *sent_ns*, their clock, arrived at *now_ns*, ours.

        *is_new_run*: whether the publisher's session is another one than that of the message before, of its
        kind. *kind*: messages of one kind come in the order of their numbers; of several, the order tells
        nothing.
        """
        offset, fastest = now_ns - sent_ns, _grown(self._offset_ns, self._seen_ns, now_ns)
        pace = PACE_NS + max(now_ns - self._first_ns, 0) // NS_PER_DRIFT
        latest = self._sent_ns.get(kind, sent_ns)
        if not self._sent_ns or sent_ns < latest - BACK_NS or (is_new_run and offset > fastest + JUMP_NS):
            before = offset if self._former is None else _grown(*self._former, now_ns)
            self._former = None
            self._begin(min(offset, before) if offset <= before + JUMP_NS else offset, now_ns)
        elif offset < self._first_offset_ns - pace:
            if self.is_certain:
                self._former = self._offset_ns, self._seen_ns
            self._begin(offset, now_ns)
        else:
            self._offset_ns, self._seen_ns = min(offset, fastest), now_ns
            if offset <= self._first_offset_ns + pace and now_ns - self._first_ns >= SETTLING_NS:
                self.is_certain, self._former = True, None
            sent_ns = max(latest, sent_ns)
        self._sent_ns[kind] = sent_ns

    def _begin(self, offset_ns: int, now_ns: int) -> None:
        self.is_certain, self._sent_ns = False, {}
        self._offset_ns = self._first_offset_ns = offset_ns
        self._seen_ns = self._first_ns = now_ns

    def theirs(self, now_ns: int) -> int:
        """Say what their clock shows at *now_ns*, ours; rather late than early."""
        return now_ns - self._offset_ns + TRANSIT_NS if self._sent_ns else now_ns


def _grown(offset_ns: int, seen_ns: int, now_ns: int) -> int:
    """What an offset may have become as the clocks drifted apart."""
    return offset_ns + max(now_ns - seen_ns, 0) // NS_PER_DRIFT
