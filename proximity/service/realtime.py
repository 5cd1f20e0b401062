"""Real-time settings of the loop's thread, which are precise timers, priority, locked memory and a core.

Each setting is attempted. If the system refuses one, a sentence reports it, and no error is raised.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import Any

SWITCH_INTERVAL = 1e-4
"""Time after which a computing Python thread yields to another, s. Python's default of 5 ms is five ticks of
a loop in a process that also loads an edited scene."""
PRIORITY = 80
"""Priority in SCHED_FIFO. It is above interrupt threads (50) and below critical threads of the system
(99)."""

# Of Linux: <sys/prctl.h>, <sys/mman.h>
PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 29, 30
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


@contextmanager
def undisturbed() -> Iterator[None]:
    """Apply the settings that need no permission to the calling thread during the block.

    The garbage collector is off, other Python threads have shorter time slices, and timers on Linux have no
    slack of 50 µs.
    """
    interval, was_enabled = sys.getswitchinterval(), gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        with sharp_timers():
            yield
    finally:
        if interval != SWITCH_INTERVAL:  # of several threads in such blocks, the first one restores it
            sys.setswitchinterval(interval)
        if was_enabled:
            gc.enable()
        gc.unfreeze()


@contextmanager
def sharp_timers() -> Iterator[None]:
    """Set the timer slack of the calling thread to the minimum during the block.

    The default of Linux is 50 µs; other systems have no such setting.
    """
    slack_ns = _set_timer_slack(1)
    try:
        yield
    finally:
        _set_timer_slack(slack_ns)


class RealTime:
    """Settings that need a permission, for the thread that enters the ``with`` block.

    They are undone at the end of the block. *core*: core to run on; None: the last one that the process may
    use, if there are several. *is_pinned*: whether the thread stays on one core.
    """

    notes: list[str]  # a sentence for each setting, granted or refused
    refused: list[str]  # the sentences for refused settings

    def __init__(
        self,
        *,
        priority: int = PRIORITY,
        core: int | None = None,
        lock_memory: bool = True,
        is_pinned: bool = True,
    ) -> None:
        self.notes, self.refused = [], []
        self._priority, self._core, self._lock_memory = priority, core, lock_memory
        self._is_pinned = is_pinned
        self._undo = ExitStack()

    def __enter__(self) -> "RealTime":
        # Memory first, because locking it is slow.
        if self._lock_memory:
            self._try("memory", self._lock_all_memory)
        if self._is_pinned:
            self._try("core", self._stay_on_core)
        self._try("priority", self._raise_priority)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()

    @contextmanager
    def beside(self) -> Iterator[None]:
        """Set the next lower priority for a thread that receives or sends for the loop, if permitted."""
        with ExitStack() as undo:
            with suppress(AttributeError, OSError, ValueError):
                before, settings = os.sched_getscheduler(0), os.sched_getparam(0)
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority - 1))
                undo.callback(os.sched_setscheduler, 0, before, settings)
            yield

    def _try(self, what: str, attempt: Callable[[], str]) -> None:
        try:
            self.notes.append(f"{what}: {attempt()}")
            return
        except (AttributeError, TypeError):
            reason = "this system cannot be asked for it"
        except (OSError, ValueError, OverflowError) as refusal:
            reason = f"not permitted ({getattr(refusal, 'strerror', None) or refusal})"
        self.refused.append(f"{what}: {reason}")
        self.notes.append(self.refused[-1])

    def _raise_priority(self) -> str:
        """Set a real-time priority, which is above that of all normal threads."""
        before, settings = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
        self._undo.callback(os.sched_setscheduler, 0, before, settings)
        return f"real-time (SCHED_FIFO {self._priority})"

    def _stay_on_core(self) -> str:
        """Pin the thread to one core, so that its caches stay warm."""
        usable = os.sched_getaffinity(0)
        if self._core is None and len(usable) == 1:
            return "the process may use one core only"
        core = max(usable) if self._core is None else self._core
        os.sched_setaffinity(0, {core})
        self._undo.callback(os.sched_setaffinity, 0, usable)
        return f"{core}, and no other"

    def _lock_all_memory(self) -> str:
        """Lock present and, if the limits permit, future memory."""
        libc = _libc()
        flags = MCL_CURRENT | MCL_ONFAULT
        is_unlimited = _may_lock_all()
        # Under a limit, later allocations would fail.
        if is_unlimited:
            flags |= MCL_FUTURE
        if libc.mlockall(flags):
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))
        self._undo.callback(libc.munlockall)
        return "locked" if is_unlimited else "locked as far as it is in use now"


def _may_lock_all() -> bool:
    import resource  # not on Windows

    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY


def _libc() -> Any:
    """Return the C library. On Windows this raises TypeError."""
    return ctypes.CDLL(None, use_errno=True)


def _set_timer_slack(slack_ns: int) -> int:
    """Set the timer slack of the thread. Return the previous value, or -1 if there is none."""
    if slack_ns < 0 or not sys.platform.startswith("linux"):
        return -1
    prctl = _libc().prctl
    before = int(prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0))
    prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0)
    return before
