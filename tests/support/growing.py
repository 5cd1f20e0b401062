"""Memory growth of repeated work in Python."""

import gc
import tracemalloc
from collections.abc import Callable


def traced_growth(work: Callable[[], object], rounds: int = 3) -> int:
    """Bytes that `work` leaves allocated: the minimum of several rounds, as other threads allocate too."""
    grown = []
    tracemalloc.start()
    try:
        for _ in range(rounds):
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            work()
            if gc.isenabled():  # with collection off, cycles count as growth
                gc.collect()
            grown.append(tracemalloc.get_traced_memory()[0] - before)
    finally:
        tracemalloc.stop()
    return min(grown)
