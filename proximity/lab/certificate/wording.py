"""Numbers of a certificate as text, with no more digits than the number of ticks supports."""

import math
from typing import Any

UNKNOWN = "–"
WORDS = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}


def microseconds(nanoseconds: float | None) -> str:
    """Return a time in µs, three digits; a dash where it is not known."""
    return UNKNOWN if nanoseconds is None else three(nanoseconds / 1e3)


def percent(share: float | None) -> str:
    """Return a share in percent, two digits; a dash where it is not known."""
    if share is None:
        return UNKNOWN
    value = 100.0 * share
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.1g}"


def millimetres(metres: float) -> str:
    """Return a coordinate in mm, to a hundredth; zero has no sign."""
    return f"{round(1e3 * metres, 2) + 0.0:.2f}"


def three(value: float) -> str:
    """Return a number with three digits and without an exponent."""
    size = abs(value)
    return f"{value:.0f}" if size >= 100.0 else f"{value:.1f}" if size >= 10.0 else f"{value:.2f}"


def two(value: float) -> str:
    """Return a number with two digits and without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def missed(reported: dict[str, Any], unit: str = " a million") -> str:
    """Return how many deadlines were missed, per million, and what that many ticks leave open.

    *reported*: with ``missed`` and what goes with it, see `document`.
    """
    if reported["missed_per_million"] == 1e6:
        return "all"
    upper = _two(_raised(reported["missed_per_million_upper_95"]))
    return f"{_two(reported['missed_per_million'])}{unit} (95 % bound: {upper})"


def goal(reported: dict[str, Any]) -> str:
    """Return what a search was for."""
    return f"{reported['manner']}, {'within the budget' if reported['within_budget'] else 'exact'}"


def fed(settings: dict[str, Any]) -> str:
    """Return what fingers were timed with besides their poses, behind a semicolon; nothing where that is
    all.
    """
    corners, additions = settings["path_corners"], []
    if corners is not None:
        additions.append(f"on paths of {corners} corners")
    if settings["parts_move"]:
        additions.append("with all parts moving")
    return f"; passing also {', and '.join(additions)}" if additions else ""


def counted(count: int, what: str) -> str:
    """Return a number with what it counts."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _raised(value: float) -> float:
    """The next number above that has two digits: a bound must not be rounded down."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return step * math.ceil(value / step * (1.0 - 1e-12))


def _two(value: float) -> str:
    """Two digits: more would be no knowledge."""
    if value == 0.0:
        return "0"
    return f"{float(f'{value:.2g}'):,.0f}".replace(",", " ") if value >= 1.0 else f"{value:.1g}"
