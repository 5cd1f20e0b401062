"""What Python keeps of work that is done again and again."""

import gc
import tracemalloc
from collections.abc import Callable


def traced_growth(work: Callable[[], object], rounds: int = 3) -> int:
    """Bytes that `work` leaves behind: the least of several rounds, as threads of the run keep some too."""
    grown = []
    tracemalloc.start()
    try:
        for _ in range(rounds):
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            work()
            if gc.isenabled():  # where it is off, cycles stay and count
                gc.collect()
            grown.append(tracemalloc.get_traced_memory()[0] - before)
    finally:
        tracemalloc.stop()
    return min(grown)
