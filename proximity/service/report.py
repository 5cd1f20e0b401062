"""Report of a service, with its ticks, lateness, computing times and irregularities."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from proximity.message import State

SHARE_BITS = 5  # leading bits of a value that decide its bin
MAX_BITS = 42  # 2**42 ns are 73 minutes; longer durations are in the last bin
BIN_COUNT = (MAX_BITS - SHARE_BITS + 1) << SHARE_BITS
MAX_NS = (1 << MAX_BITS) - 1


class Histogram:
    """Histogram of durations in constant memory.

    Each nanosecond up to 63 ns has a separate bin. Beyond, the width of the bins doubles whenever the
    duration doubles.
    """

    count: int
    max_ns: int  # exact maximum

    def __init__(self) -> None:
        self.count = 0
        self.max_ns = 0
        self._counts = [0] * BIN_COUNT

    @classmethod
    def of(cls, count: int, max_ns: int, counts: list[int]) -> "Histogram":
        """Return a histogram with the given counts of its bins."""
        made = cls()
        made.count, made.max_ns, made._counts = count, max_ns, counts
        return made

    def record(self, duration_ns: int) -> None:
        """Count a duration. A negative duration counts as zero."""
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns
        self.count += 1
        shift = duration_ns.bit_length() - SHARE_BITS - 1
        if shift <= 0 or duration_ns < 0:
            self._counts[max(duration_ns, 0)] += 1
        elif duration_ns <= MAX_NS:
            self._counts[(shift << SHARE_BITS) + (duration_ns >> shift)] += 1
        else:
            self._counts[-1] += 1

    def percentile(self, share: float) -> int:
        """Return a percentile of the durations, ns.

        It is the upper end of a bin, and 0 for an empty histogram. *share*: per cent.
        """
        wanted = share / 100.0 * self.count
        seen = 0
        for _, upper_ns, count in self.rows():
            seen += count
            # The last bin has no upper end.
            if seen >= wanted and upper_ns < MAX_NS:
                return min(upper_ns, self.max_ns)
        return self.max_ns

    def rows(self) -> Iterator[tuple[int, int, int]]:
        """Yield the shortest duration, the longest duration and the count of each non-empty bin, ns."""
        for row, count in enumerate(self._counts):
            if count:
                yield *_ends(row), count

    def __str__(self) -> str:
        p50, p99 = self.percentile(50.0), self.percentile(99.0)
        return f"p50 {_shown(p50)}, p99 {_shown(p99)}, max {_shown(self.max_ns)}"


def _ends(row: int) -> tuple[int, int]:
    """Return the shortest and the longest duration of a bin, ns."""
    shift = max((row >> SHARE_BITS) - 1, 0)
    lower = (row - (shift << SHARE_BITS)) << shift
    return lower, lower + (1 << shift) - 1


def _shown(duration_ns: int) -> str:
    return f"{duration_ns / 1e3:.3g} µs" if duration_ns < 1_000_000 else f"{duration_ns / 1e6:.3g} ms"


@dataclass(slots=True, eq=False)
class Report:
    """Counts and times of one run of a service. While it runs, they are those until now."""

    period_ns: int
    ticks: int = 0  # number of frames, except those at the end
    missed: int = 0  # number of ticks skipped because others took too long
    compute: Histogram = field(default_factory=Histogram)  # start of a tick until its frame is sent
    lateness: Histogram = field(default_factory=Histogram)  # time from a tick's due time until its start
    states: dict[State, int] = field(default_factory=lambda: dict.fromkeys(State, 0))  # frames by state
    future: int = 0  # number of unused poses of fingers and parts from the future
    backwards: int = 0  # … older than the previous one
    too_old: int = 0  # … too old on arrival
    publish_failures: dict[str, int] = field(default_factory=dict)  # failures by address
    log_written: int = 0
    log_lost: int = 0
    notes: list[str] = field(default_factory=list)  # sentences: failures, settings granted or refused

    def as_dict(self) -> dict[str, Any]:
        """Return the report as numbers, texts and lists, for JSON."""
        return {
            "period_ns": self.period_ns,
            "ticks": self.ticks,
            "missed": self.missed,
            "compute": _figures(self.compute),
            "lateness": _figures(self.lateness),
            "states": {state.name.lower(): count for state, count in self.states.items()},
            "future": self.future,
            "backwards": self.backwards,
            "too_old": self.too_old,
            "publish_failures": dict(self.publish_failures),
            "log_written": self.log_written,
            "log_lost": self.log_lost,
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        reported = ", ".join(f"{count} {state.name.lower()}" for state, count in self.states.items() if count)
        lines = [
            f"{self.ticks} ticks ({reported or 'none'}), {self.missed} missed",
            f"computing: {self.compute}",
            f"woken late: {self.lateness}",
        ]
        if self.future or self.backwards or self.too_old:
            lines.append(
                f"left out: {self.future} poses from the future, {self.backwards} older than the one before, "
                f"{self.too_old} too old"
            )
        lines += self.notes
        return "\n".join(lines)


def _figures(histogram: Histogram) -> dict[str, Any]:
    return {
        "count": histogram.count,
        "p50_ns": histogram.percentile(50.0),
        "p99_ns": histogram.percentile(99.0),
        "p999_ns": histogram.percentile(99.9),
        "max_ns": histogram.max_ns,
        "rows": [list(row) for row in histogram.rows()],
    }
