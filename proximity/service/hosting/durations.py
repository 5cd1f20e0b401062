"""Durations given by a caller, checked before anything starts."""

import threading
from typing import Any

from proximity.arrays import is_number
from proximity.errors import ServiceError


def checked_seconds(name: str, value: Any) -> float:
    """Return a span of time, s, that threads can wait for: inf is as long as they can, some centuries.

    Parameters
    ----------
    name : str
        Of the argument, for the message.
    value : float
        0 or more.

    Raises
    ------
    ServiceError
        If it is no such number.
    """
    if not is_number(value) or not float(value) >= 0.0:
        raise ServiceError(f"{name} is {value!r}, expected a number of seconds of 0 or more")
    return min(float(value), threading.TIMEOUT_MAX)
