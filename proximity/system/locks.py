"""Locks that stay usable in a forked child process.

A child has one thread. A lock that another thread held would stay held there for ever, over what that thread
had begun. So whoever forks takes all locks first, which waits for those at work; the compiler's last, which
they may be waiting for.
"""

import _thread
import os
import sys
import threading
import weakref
from operator import methodcaller
from typing import Any

LATER = 0.01
"""s until an interruption comes again: what is raised before the fork has ended would be lost once more."""

_locks: weakref.WeakSet[threading.RLock] = weakref.WeakSet()
_listing = threading.RLock()
_held_by_forks: list[list[Any]] = []  # by forks under way: one within another where a signal handler forks
_interruptions: list[BaseException] = []

_acquired, _released = methodcaller("acquire"), methodcaller("release")


def fork_safe_lock() -> threading.RLock:
    """Return a lock of its own; the thread that holds it may take it again, as a signal handler may."""
    lock = threading.RLock()
    with _listing:
        _locks.add(lock)
    return lock


def _compiler_locks() -> list[Any]:
    """numba's lock, where it compiles kernels in this process."""
    compiler = sys.modules.get("numba.core.compiler_lock")
    return [compiler.global_compiler_lock] if compiler else []


def _all_locks() -> list[Any]:
    while True:
        try:
            return [_listing, *_locks, *_compiler_locks()]
        except RuntimeError:  # a scene was made meanwhile, by another thread or by a signal handler
            continue


def _acquire_all() -> None:
    """Acquire all locks, whoever interrupts: nobody hears of what is raised here, and the fork goes on."""
    locks, results = _all_locks(), list[bool]()
    while len(results) < len(locks):
        try:
            # Within one call, so that a signal comes while one is waited for, and not between two.
            results.extend(map(_acquired, locks[len(results) :]))
        except BaseException as interruption:
            _interruptions.append(interruption)
    _held_by_forks.append(locks)


def _release_all() -> None:
    for lock in reversed(_held_by_forks.pop()):
        _released(lock)


def _resume_parent() -> None:
    """Release the locks in the process that forked, and deliver an interruption that came meanwhile."""
    _release_all()
    if _interruptions:
        _interruptions.clear()
        later = threading.Timer(LATER, _thread.interrupt_main)
        later.daemon = True
        later.start()


def _resume_child() -> None:
    _interruptions.clear()
    _release_all()


if hasattr(os, "register_at_fork"):  # where there are forks
    os.register_at_fork(before=_acquire_all, after_in_parent=_resume_parent, after_in_child=_resume_child)
