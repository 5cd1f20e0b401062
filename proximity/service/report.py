"""Report of a service: ticks, lateness, computing times, and everything that was not as it should be."""

from dataclasses import dataclass, field
from typing import Any

from proximity.message import State
from proximity.service.histogram import Histogram


@dataclass(slots=True, eq=False)
class Report:
    """Figures of one run; while it goes on, those so far."""

    period_ns: int
    ticks: int = 0  # frames made, those at the end left out
    missed: int = 0  # ticks left out because others took too long
    compute: Histogram = field(default_factory=Histogram)  # from the begin of a tick until its frame is out
    lateness: Histogram = field(default_factory=Histogram)  # from when a tick was due until it began
    states: dict[State, int] = field(default_factory=lambda: dict.fromkeys(State, 0))  # frames of each
    future: int = 0  # poses, of fingers and of parts, left out because they are from the future
    backwards: int = 0  # … because they are older than the one before
    too_old: int = 0  # … because they are worth nothing when they come
    publish_failures: dict[str, int] = field(default_factory=dict)  # by address
    log_written: int = 0
    log_lost: int = 0
    notes: list[str] = field(default_factory=list)  # sentences: failures, what the system granted or refused

    def as_dict(self) -> dict[str, Any]:
        """Return it as numbers, texts and lists, for JSON."""
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
