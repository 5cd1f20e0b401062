"""Locks that stay usable in a forked child process.

A child has one thread. A lock held by another thread would stay locked there forever, with its data
half-changed. So a fork first acquires all locks, waiting for the threads that hold them; the compiler's last,
since those threads may wait for it.
"""

import _thread
import os
import sys
import threading
import weakref
from operator import methodcaller
from typing import Any

LATER = 0.01
"""s until an interruption is raised again: one raised before the fork has ended would be lost."""

_locks: weakref.WeakSet[threading.RLock] = weakref.WeakSet()
_listing = threading.RLock()
_held_by_forks: list[list[Any]] = []  # by forks in progress: nested if a signal handler forks
_interruptions: list[BaseException] = []

_acquired, _released = methodcaller("acquire"), methodcaller("release")


def fork_safe_lock() -> threading.RLock:
    """Return a new lock; its holder may acquire it again, as a signal handler may."""
    lock = threading.RLock()
    with _listing:
        _locks.add(lock)
    return lock


def _compiler_locks() -> list[Any]:
    """Return numba's lock, if it compiles kernels in this process."""
    compiler = sys.modules.get("numba.core.compiler_lock")
    return [compiler.global_compiler_lock] if compiler else []


def _all_locks() -> list[Any]:
    while True:
        try:
            return [_listing, *_locks, *_compiler_locks()]
        except RuntimeError:  # a concurrent change by another thread or a signal handler
            continue


def _acquire_all() -> None:
    """Acquire all locks despite interruptions: an exception here would be lost, and the fork continue."""
    locks, results = _all_locks(), list[bool]()
    while len(results) < len(locks):
        try:
            # Within one call, so that a signal arrives during a wait, not between two.
            results.extend(map(_acquired, locks[len(results) :]))
        except BaseException as interruption:
            _interruptions.append(interruption)
    _held_by_forks.append(locks)


def _release_all() -> None:
    for lock in reversed(_held_by_forks.pop()):
        _released(lock)


def _resume_parent() -> None:
    """Release the locks in the process that forked, and deliver a delayed interruption."""
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
