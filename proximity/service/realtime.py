"""Real-time settings of the loop's thread: sharp timers, priority, locked memory, a core of its own.

Each is tried; what the system does not permit is reported in a sentence, and nothing fails because of it.
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
"""s after which a thread that computes in Python lets another have its turn. Python's own 5 ms are five ticks
of a loop that shares its process with whoever loads an edited scene."""
PRIORITY = 80
"""Of SCHED_FIFO: above what serves interrupts (50), below what keeps the system alive (99)."""

# Of Linux: <sys/prctl.h>, <sys/mman.h>
PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 29, 30
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


@contextmanager
def undisturbed() -> Iterator[None]:
    """Do what needs no permission, for the thread that enters: timers and Python itself keep out of its way.

    No collector of cycles, short turns of other threads, and on Linux timers without their 50 µs of slack.
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
        if interval != SWITCH_INTERVAL:  # of several threads, the first one within restores it
            sys.setswitchinterval(interval)
        if was_enabled:
            gc.enable()
        gc.unfreeze()


@contextmanager
def sharp_timers() -> Iterator[None]:
    """Have the thread that enters woken when it is due, on Linux: without 50 µs of slack."""
    slack_ns = _set_timer_slack(1)
    try:
        yield
    finally:
        _set_timer_slack(slack_ns)


class RealTime:
    """Ask for what needs a permission, for the thread that enters the ``with`` block; undone at its end.

    *core*: core to run on; None: the last one that the process may use, where there are several. *is_pinned*:
    whether it stays on a core at all.
    """

    notes: list[str]  # what was granted or refused, a sentence each
    refused: list[str]  # those of what was refused

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
        # Memory first: it takes a while, in which nothing else should have to wait.
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
        """Give a thread that receives or sends for the loop the priority below, where that is allowed."""
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
        """Get real-time priority: before all that is not real-time."""
        before, settings = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
        self._undo.callback(os.sched_setscheduler, 0, before, settings)
        return f"real-time (SCHED_FIFO {self._priority})"

    def _stay_on_core(self) -> str:
        """Stay on one core: caches stay warm."""
        usable = os.sched_getaffinity(0)
        if self._core is None and len(usable) == 1:
            return "the process may use one core only"
        core = max(usable) if self._core is None else self._core
        os.sched_setaffinity(0, {core})
        self._undo.callback(os.sched_setaffinity, 0, usable)
        return f"{core}, and no other"

    def _lock_all_memory(self) -> str:
        """Lock what is touched already, and what will be."""
        libc = _libc()
        flags = MCL_CURRENT | MCL_ONFAULT
        is_unlimited = _may_lock_all()
        # Under a limit, memory that is asked for later would not be given at all.
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
    """The C library; a TypeError on Windows."""
    return ctypes.CDLL(None, use_errno=True)


def _set_timer_slack(slack_ns: int) -> int:
    """Have this thread woken no later than that after it is due; what it was before, -1 where unknown."""
    if slack_ns < 0 or not sys.platform.startswith("linux"):
        return -1
    prctl = _libc().prctl
    before = int(prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0))
    prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0)
    return before
