"""Advice to senders of unusable instants, which states the error and what to send instead."""

from proximity.system.time_units import NS_PER_MS, NS_PER_S

OTHER_CLOCK_NS = 1_000_000_000
"""Difference beyond which instants are assumed to be of another clock, not due to prediction or transport."""

FROM_FUTURE, OUT_OF_ORDER = "poses from the future", "poses older than the one before"

OTHER_CLOCK = "they are of another clock: on the service's machine send time.monotonic_ns(), CLOCK_MONOTONIC"


def on_future(ahead_ns: int, other_clock: str = OTHER_CLOCK) -> str:
    """Return advice to a sender whose instant is *ahead_ns* in the future."""
    if ahead_ns >= OTHER_CLOCK_NS:
        return f"by {_shown(ahead_ns)}; {other_clock}"
    return (
        f"by {_shown(ahead_ns)}; send the instant at which hand or part was there, "
        "not the predicted display time"
    )


def on_too_old(age_ns: int, other_clock: str = OTHER_CLOCK) -> str:
    """Return advice to a sender whose instant is too old on arrival."""
    if age_ns >= OTHER_CLOCK_NS:
        return f"{_shown(age_ns)} old; {other_clock}"
    return f"{_shown(age_ns)} old; send them as soon as they are known"


def on_backwards(back_ns: int) -> str:
    """Return advice to a sender whose instant is *back_ns* before the previous one."""
    return (
        f"by {_shown(back_ns)}; they are of two clocks, such as those of two machines or of a browser, "
        "or out of order: send instants of one clock"
    )


def _shown(ns: int) -> str:
    return f"{ns / NS_PER_MS:.1f} ms" if ns < NS_PER_S else f"{ns / NS_PER_S:.0f} s"
