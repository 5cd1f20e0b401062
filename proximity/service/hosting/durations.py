"""Durations given by a caller, checked before anything starts."""

import threading
from typing import Any

from proximity.checks import not_negative
from proximity.errors import ServiceError


def checked_seconds(name: str, value: Any) -> float:
    """Return a span of time, s, that threads can wait for: inf is as long as they can, some centuries."""
    seconds = not_negative(name, value, "seconds", may_be_infinite=True, error=ServiceError)
    return min(seconds, threading.TIMEOUT_MAX)
