"""The clock of a publisher on another machine, guessed from when its messages arrive."""

NS_PER_DRIFT = 5000
"""ns in which two quartz clocks may drift apart by one: 200e-6, twice what their makers promise."""
TRANSIT_NS = 1_000_000
"""A message is thought to have travelled that long at least: what no receiver can measure alone."""
SETTLING_NS = 50_000_000
"""For so long a clock is watched before it is believed."""
PACE_NS = 25_000_000
"""By how much messages may be faster on their way than the first, and one that settles slower."""
JUMP_NS = 1_000_000_000
"""A message that is later by more is of another clock, as after a new start of its machine; or it is old."""


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
        self._first_offset_ns = self._first_ns = self._seen_ns = 0
        self.reset()

    def reset(self) -> None:
        """Forget: the clock is another one."""
        self.is_settled = False
        self._offset_ns: int | None = None

    def arrived(self, sent_ns: int, now_ns: int) -> None:
        """Learn that what was sent at *sent_ns*, their clock, arrived at *now_ns*, ours."""
        offset = now_ns - sent_ns
        fastest = self._offset_ns
        pace = PACE_NS + max(now_ns - self._first_ns, 0) // NS_PER_DRIFT
        if fastest is None or offset > fastest + JUMP_NS or offset < self._first_offset_ns - pace:
            # Another clock; or what came before was held up; or these are old messages that come at once.
            self.is_settled = False
            self._offset_ns = self._first_offset_ns = offset
            self._seen_ns = self._first_ns = now_ns
            return
        grown = fastest + max(now_ns - self._seen_ns, 0) // NS_PER_DRIFT
        self._offset_ns, self._seen_ns = min(offset, grown), now_ns
        if offset <= self._first_offset_ns + pace:
            self.is_settled |= now_ns - self._first_ns >= SETTLING_NS

    def theirs(self, now_ns: int) -> int:
        """Say what their clock shows at *now_ns*, ours; rather late than early."""
        if self._offset_ns is None:
            return now_ns
        return now_ns - self._offset_ns + TRANSIT_NS
