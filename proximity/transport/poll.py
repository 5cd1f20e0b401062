"""Waiting by polling, for transports whose libraries cannot wait, or only at a high cost."""

import time
from collections.abc import Callable

SHORTEST_NAP = 50e-6
"""s: a frame is seen that late at least; the system adds as much again."""
LONGEST_NAP = 1e-3
"""s, when nothing has come for long."""
NAP_SHARE = 0.125
"""Of the time waited so far: who has waited long does not mind a little more, and leaves the core alone."""


def wait_until(is_there: Callable[[], bool], timeout: float) -> bool:
    """Look until something is there, or that many seconds; say whether it is.

    Looks once even where there is no time.
    """
    began = time.monotonic()
    while not is_there():
        waited = time.monotonic() - began
        if waited >= timeout:
            return False
        nap = min(max(NAP_SHARE * waited, SHORTEST_NAP), LONGEST_NAP)
        time.sleep(min(nap, timeout - waited))
    return True
