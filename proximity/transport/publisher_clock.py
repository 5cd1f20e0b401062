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
"""Where a new run of the publisher begins with a message that is later by more, its clock is another one."""
BACK_NS = 5_000_000
"""By how much threads that send side by side may be out of order; instants that go back by more are wrong."""
UNCERTAIN_NS = 1_000_000_000
"""After so long the former clock is asked again, where the instant that a clock began with was wrong."""


class ForeignClock:
    """How far a publisher's clock is from ours: the message that was fastest on its way tells it.

    A message that took longer than the fastest one is older by that; what all of them took is not seen,
    and `TRANSIT_NS` is allowed for it.

    However late messages come, the clock is thought to go on as it did. That their way has become longer,
    that their clock was put back and that their machine slept look the same, and only in the first case is it
    dangerous to be wrong. So what comes is old, until

    - a message is as fast again as they were; or
    - the publisher begins a new run, as `Publisher` does after its machine slept, or the reader starts anew.
      Of a run that begins more than `JUMP_NS` late the clock is thought to be another one. Less may be the
      way, so a run that is less late has another clock only where it was sent before what was sent last,
      as no run that follows another on one machine is: its clock was behind by more than the pause; or
    - clocks may have drifted apart so far, in `NS_PER_DRIFT` times as long: 83 minutes for each second.

    A message that is earlier than can be begins it anew at any time, as when their clock was put forward or
    our machine slept: nothing seems younger by that. If it was a mistake, the ones that follow undo it, but
    for two cases that cannot be distinguished from a way that was short once: none that follows tells an
    earlier instant, as where the next comes only after the mistake has passed; or another one that was as
    wrong came `SETTLING_NS` later. A longer way never makes instants go back, since a publisher's messages of
    one kind come in order or not at all; a mistake does. Then the former clock is begun again: at once where
    messages are more than `JUMP_NS` later than the mistake, otherwise after `UNCERTAIN_NS` in which none came
    that was as early, by one that fits the former clock. Where there was none, any begins it as if it were
    the first.

    When a message was sent that comes alone, nothing tells: it may be a copy of an old one. So the clock is
    *settled* only when it has been seen to run: another message came `SETTLING_NS` later, and had been sent
    as much later.
    """

    is_certain: bool
    """Whether `theirs` may be believed."""

    def __init__(self) -> None:
        self._first_offset_ns = self._first_ns = self._seen_ns = 0
        self._sent_ns: dict[int, int] = {}  # latest instant since the clock began, by kind
        self.reset()

    def reset(self) -> None:
        """Forget: the clock is another one."""
        self.is_certain = False
        self._offset_ns: int | None = None
        self._former: tuple[int, int] | None = None  # what was believed until a message came too early
        self._uncertain_since_ns: int | None = (
            None  # since when the instant it began with is known to be wrong
        )

    def arrived(self, sent_ns: int, now_ns: int, *, is_new_run: bool = False, kind: int = 0) -> None:
        """Learn that what was sent at *sent_ns*, their clock, arrived at *now_ns*, ours.

        Parameters
        ----------
        sent_ns, now_ns : int, ns
            As above.
        is_new_run : bool
            Whether the publisher's session is another one than that of the message before, of its kind.
        kind : int
            Messages of one kind come in the order of their numbers; of several, the order tells nothing.
        """
        offset = now_ns - sent_ns
        fastest = self._offset_ns
        if fastest is None:
            self._begin(offset, now_ns, {kind: sent_ns}, None)
            return
        pace = PACE_NS + max(now_ns - self._first_ns, 0) // NS_PER_DRIFT
        latest = self._sent_ns.get(kind, sent_ns)
        goes_back = sent_ns < latest - BACK_NS
        self._sent_ns[kind] = max(latest, sent_ns)
        if offset <= self._first_offset_ns + pace:
            self._uncertain_since_ns = None
        elif goes_back and not self.is_certain and self._uncertain_since_ns is None:
            self._uncertain_since_ns = now_ns
        if self._uncertain_since_ns is not None:
            before = offset if self._former is None else _grown(*self._former, now_ns)
            if offset > fastest + JUMP_NS:
                is_undone = offset <= before + JUMP_NS
            else:
                is_undone = (
                    abs(offset - before) <= PACE_NS and now_ns - self._uncertain_since_ns >= UNCERTAIN_NS
                )
            if is_undone:
                self._begin(min(offset, before), now_ns, {kind: sent_ns}, None)
                return
        is_other = goes_back and self._former is None and offset > fastest + PACE_NS
        if is_new_run and (is_other or offset > fastest + JUMP_NS):
            self._begin(offset, now_ns, {kind: sent_ns}, None)
            return
        if offset < self._first_offset_ns - pace:
            # Another clock; or what came before was held up; or these are old messages that come at once.
            former = (fastest, self._seen_ns) if self.is_certain else self._former
            self._begin(offset, now_ns, {kind: sent_ns}, former)
            return
        self._offset_ns, self._seen_ns = min(offset, _grown(fastest, self._seen_ns, now_ns)), now_ns
        if offset <= self._first_offset_ns + pace and now_ns - self._first_ns >= SETTLING_NS:
            self.is_certain, self._former = True, None

    def _begin(
        self, offset_ns: int, now_ns: int, sent_ns: dict[int, int], former: tuple[int, int] | None
    ) -> None:
        self.is_certain, self._former, self._uncertain_since_ns = False, former, None
        self._offset_ns = self._first_offset_ns = offset_ns
        self._seen_ns = self._first_ns = now_ns
        self._sent_ns = sent_ns

    def theirs(self, now_ns: int) -> int:
        """Say what their clock shows at *now_ns*, ours; rather late than early."""
        if self._offset_ns is None:
            return now_ns
        return now_ns - self._offset_ns + TRANSIT_NS


def _grown(offset_ns: int, seen_ns: int, now_ns: int) -> int:
    """What an offset may have become as the clocks drifted apart."""
    return offset_ns + max(now_ns - seen_ns, 0) // NS_PER_DRIFT
