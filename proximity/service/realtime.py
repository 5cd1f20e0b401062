"""What keeps a loop from being disturbed: priority, memory that stays, a core of its own, no collector.

Each is tried; what the system does not permit is told in a sentence, and nothing fails because of it.
"""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

SWITCH_INTERVAL = 1e-4
"""s after which a thread that computes in Python lets another have its turn. Python's own 5 ms are five ticks
of a loop that shares its process with whoever loads an edited scene."""


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep Python itself out of a loop's way: no collector of cycles, and short turns of other threads."""
    interval, was_enabled = sys.getswitchinterval(), gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        if was_enabled:
            gc.enable()
        gc.unfreeze()


class RealTime:
    """Asks the system for what a loop on time needs, for the thread that enters it; undone when it leaves.

    Parameters
    ----------
    priority : int
        Of SCHED_FIFO, 1 to 99.
    core : int
        The one to stay on; None: the last one that the process may use, where there are several.
    lock_memory : bool
        Whether memory is kept from being swapped out.
    """

    def __init__(self, *, priority: int = 80, core: int | None = None, lock_memory: bool = True) -> None:
        self.notes: list[str] = []
        self._priority, self._core, self._lock_memory = priority, core, lock_memory

    def __enter__(self) -> "RealTime":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass
