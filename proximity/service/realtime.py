"""Real-time settings of the loop's thread: precise timers, priority, locked memory, a core.

Each is tried; a refusal by the system is reported in a sentence, and never raises.
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
"""s after which a computing Python thread yields to another. Python's default, 5 ms, is five ticks of a loop
in a process that also loads an edited scene."""
PRIORITY = 80
"""Priority in SCHED_FIFO: above interrupt threads (50), below the system's critical threads (99)."""

# Of Linux: <sys/prctl.h>, <sys/mman.h>
PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 29, 30
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


@contextmanager
def undisturbed() -> Iterator[None]:
    """Apply the settings that need no permission to the entering thread.

    The garbage collector is off, other Python threads have short turns, and on Linux timers have no slack of
    50 µs.
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
    """Set the timer slack of the entering thread to the minimum on Linux, instead of 50 µs."""
    slack_ns = _set_timer_slack(1)
    try:
        yield
    finally:
        _set_timer_slack(slack_ns)


class RealTime:
    """Settings that need a permission, for the thread that enters the ``with`` block; undone at its end.

    *core*: core to run on; None: the last one that the process may use, if there are several. *is_pinned*:
    whether it stays on a core at all.
    """

    notes: list[str]  # settings granted or refused, a sentence each
    refused: list[str]  # the refused ones

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
        # Memory first: it is slow, and other settings should not wait.
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
        """Set real-time priority, above all normal threads."""
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
        """Lock present and future memory."""
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
    """Return the C library; raise TypeError on Windows."""
    return ctypes.CDLL(None, use_errno=True)


def _set_timer_slack(slack_ns: int) -> int:
    """Set the thread's timer slack; return the previous value, or -1."""
    if slack_ns < 0 or not sys.platform.startswith("linux"):
        return -1
    prctl = _libc().prctl
    before = int(prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0))
    prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0)
    return before
