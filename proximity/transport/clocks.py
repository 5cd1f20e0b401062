"""The clock of a publisher on another machine, guessed from when its messages arrive."""

DRIFT = 200e-6
"""By which two quartz clocks may drift apart, each second a second: twice what their makers promise."""
TRANSIT_NS = 1_000_000
"""A message is thought to have travelled that long at least: what no receiver can measure alone."""


class ForeignClock:
    """How far a publisher's clock is from ours: the message that was fastest on its way tells it.

    A message that took longer than the fastest one is older by that; what all of them took is not seen,
    and `TRANSIT_NS` is allowed for it.
    """

    def __init__(self) -> None:
        self._offset_ns: float | None = None
        self._seen_ns = 0

    def arrived(self, sent_ns: int, now_ns: int) -> None:
        """Learn that what was sent at *sent_ns*, their clock, arrived at *now_ns*, ours."""
        offset: float = now_ns - sent_ns
        if self._offset_ns is not None:
            grown = self._offset_ns + DRIFT * max(now_ns - self._seen_ns, 0)
            offset = min(offset, grown)
        self._offset_ns, self._seen_ns = offset, now_ns

    def theirs(self, now_ns: int) -> int:
        """Say what their clock shows at *now_ns*, ours; rather late than early."""
        if self._offset_ns is None:
            return now_ns
        return now_ns - round(self._offset_ns) + TRANSIT_NS

    def reset(self) -> None:
        """Forget: the publisher was started anew."""
        self._offset_ns = None
