"""The clock of a publisher on another machine, guessed from when its messages arrive."""

NS_PER_DRIFT = 5000
"""ns in which two quartz clocks may drift apart by one: 200e-6, twice what their makers promise."""
TRANSIT_NS = 1_000_000
"""A message is thought to have travelled that long at least: what no receiver can measure alone."""
SETTLING_NS = 50_000_000
"""For so long a clock is watched before it is believed."""
PACE_NS = 25_000_000
"""By how much messages may meanwhile be faster or slower on their way than the first."""
JUMP_NS = 1_000_000_000
"""A message that is off by more is of another clock, as after a new start or sleep of its machine; or old."""


class ForeignClock:
    """How far a publisher's clock is from ours: the message that was fastest on its way tells it.

    A message that took longer than the fastest one is older by that; what all of them took is not seen,
    and `TRANSIT_NS` is allowed for it.

    When a message was sent that comes alone, nothing tells: it may be a copy of an old one. So the clock is
    *settled* only when it has been seen to run: another message came `SETTLING_NS` later, and had been sent
    as much later.
    """

    is_settled: bool
    """Whether `theirs` may be believed."""

    def __init__(self) -> None:
        self.is_settled = False
        self._offset_ns: int | None = None
        self._first_offset_ns = self._first_ns = self._seen_ns = 0

    def arrived(self, sent_ns: int, now_ns: int) -> None:
        """Learn that what was sent at *sent_ns*, their clock, arrived at *now_ns*, ours."""
        offset = now_ns - sent_ns
        if self._offset_ns is None or abs(offset - self._offset_ns) > JUMP_NS:
            self._offset_ns, self._seen_ns, self.is_settled = offset, now_ns, False
            self._first_offset_ns, self._first_ns = offset, now_ns
            return
        grown = self._offset_ns + max(now_ns - self._seen_ns, 0) // NS_PER_DRIFT
        self._offset_ns, self._seen_ns = min(offset, grown), now_ns
        if not self.is_settled:
            self._watch(offset, now_ns)

    def _watch(self, offset: int, now_ns: int) -> None:
        """Whether the clock has been seen to run, by now."""
        if offset < self._first_offset_ns - PACE_NS:
            # What came before was held up, or is a row of old messages that came at once.
            self._first_offset_ns, self._first_ns = offset, now_ns
        elif offset <= self._first_offset_ns + PACE_NS:
            self.is_settled = now_ns - self._first_ns >= SETTLING_NS

    def theirs(self, now_ns: int) -> int:
        """Say what their clock shows at *now_ns*, ours; rather late than early."""
        if self._offset_ns is None:
            return now_ns
        return now_ns - self._offset_ns + TRANSIT_NS
