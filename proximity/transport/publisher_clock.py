"""Estimate the clock of a publisher on another machine from the arrival of its messages."""

from proximity.core.receiver_state import (
    BACK_NS,
    JUMP_NS,
    NS_PER_DRIFT,
    PACE_NS,
    SETTLING_NS,
    TRANSIT_NS,
)


class ForeignClock:
    """Estimates the offset of a publisher's clock from this machine's clock.

    The fastest message gives the offset, and later the possible drift of the clocks is added. The minimum
    transit time cannot be observed; `TRANSIT_NS` is assumed. A longer transit cannot be distinguished from a
    clock that was set back, and it would be dangerous to adapt the offset to it. So the offset is kept for
    messages of any delay, and delayed ones count as old. The estimate restarts, and is unreliable until the
    clock was seen to advance for `SETTLING_NS`, if

    - a message comes impossibly early: the publisher's clock was set forward, or this machine was suspended;
    - an instant is before one of an earlier message of its kind. Transit cannot cause that, since messages of
      one kind arrive in order: the publisher's clock was set back, or an instant was wrong. The clock
      trusted before a message came too early is then the one to settle, if the message is at most `JUMP_NS`
      late by it;
    - a new run, which `Publisher` begins after a suspension of its machine, is more than `JUMP_NS` late.
    """

    is_certain: bool
    """True if `theirs` is reliable."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Discard the estimate, because the clock is another one."""
        self.is_certain = False
        self._first_ns = self._seen_ns = self._offset_ns = self._first_offset_ns = 0
        self._sent_ns: dict[int, int] = {}  # latest instant of each kind since the reset
        self._former: tuple[int, int] | None = None  # the estimate before a message came too early

    def arrived(self, sent_ns: int, now_ns: int, *, is_new_run: bool = False, kind: int = 0) -> None:
        """Update the estimate with a message that was sent at *sent_ns* and arrived at *now_ns*.

        *sent_ns* is on the publisher's clock and *now_ns* on this one. *is_new_run*: whether the publisher's
        session differs from that of the previous message of its kind. *kind*: kind of the message. Messages
        of one kind arrive in the order of their numbers; those of several kinds need not.
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
        """Return a lower estimate of the publisher's clock when this clock shows *now_ns*."""
        return now_ns - self._offset_ns + TRANSIT_NS if self._sent_ns else now_ns


def _grown(offset_ns: int, seen_ns: int, now_ns: int) -> int:
    """Return an offset increased by the possible drift of the clocks since *seen_ns*."""
    return offset_ns + max(now_ns - seen_ns, 0) // NS_PER_DRIFT
