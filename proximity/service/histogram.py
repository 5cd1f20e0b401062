"""Histogram of durations, of fixed size: each bin is as wide as 1/32 of its values."""

from collections.abc import Iterable, Iterator

SHARE_BITS = 5  # of a value that decide its bin
LARGEST_BITS = 42  # 2**42 ns are 73 minutes; what takes longer is in the last bin
BIN_COUNT = (LARGEST_BITS - SHARE_BITS + 1) << SHARE_BITS
LARGEST_NS = (1 << LARGEST_BITS) - 1


class Histogram:
    """Counts durations; takes a third of a microsecond each, and the same room however many.

    Up to 63 ns every nanosecond has its bin; beyond, bins double in width where durations double.
    """

    count: int
    max_ns: int  # the longest, exactly

    def __init__(self) -> None:
        self.count = 0
        self.max_ns = 0
        self._counts = [0] * BIN_COUNT

    def record(self, duration_ns: int) -> None:
        """Count a duration; one below zero counts as zero."""
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns
        self.count += 1
        shift = duration_ns.bit_length() - SHARE_BITS - 1
        if shift <= 0 or duration_ns < 0:
            self._counts[max(duration_ns, 0)] += 1
        elif duration_ns <= LARGEST_NS:
            self._counts[(shift << SHARE_BITS) + (duration_ns >> shift)] += 1
        else:
            self._counts[-1] += 1

    def percentile(self, share: float) -> int:
        """Return what that share of the durations do not exceed, ns: the upper end of a bin; 0 of none."""
        wanted = share / 100.0 * self.count
        seen = 0
        for _, upper_ns, count in self.rows():
            seen += count
            # The last bin has no upper end of its own.
            if seen >= wanted and upper_ns < LARGEST_NS:
                return min(upper_ns, self.max_ns)
        return self.max_ns

    def rows(self) -> Iterator[tuple[int, int, int]]:
        """Give each bin that is not empty: its shortest and longest duration, ns, and how many it holds."""
        for row, count in enumerate(self._counts):
            if count:
                yield *_ends(row), count

    def __str__(self) -> str:
        return ", ".join(
            f"{name} {_shown(value)}"
            for name, value in zip(("p50", "p99", "max"), self._figures(), strict=True)
        )

    def _figures(self) -> Iterable[int]:
        return self.percentile(50.0), self.percentile(99.0), self.max_ns


def _ends(row: int) -> tuple[int, int]:
    """Shortest and longest duration of a bin."""
    shift = max((row >> SHARE_BITS) - 1, 0)
    lower = (row - (shift << SHARE_BITS)) << shift
    return lower, lower + (1 << shift) - 1


def _shown(duration_ns: int) -> str:
    return f"{duration_ns / 1e3:.3g} µs" if duration_ns < 1_000_000 else f"{duration_ns / 1e6:.3g} ms"
