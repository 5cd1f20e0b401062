"""Durations given by a caller, checked before anything starts."""

import threading
from typing import Any

from proximity.checks import not_negative


def checked_seconds(name: str, value: Any) -> float:
    """Return a span of time, s, that threads can wait for: inf is as long as they can, some centuries."""
    seconds = not_negative(name, value, "seconds", may_be_infinite=True)
    return min(seconds, threading.TIMEOUT_MAX)
