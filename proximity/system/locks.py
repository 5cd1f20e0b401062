"""Locks that stay usable in a forked child process.

A forked child has only one thread. A lock that another thread held would stay locked in the child forever,
with its data half-changed. So a fork first waits for all locks and acquires them. The compiler's lock is the
last, since threads that hold other locks may wait for it.
"""

import _thread
import os
import sys
import threading
import weakref
from operator import methodcaller
from typing import Any

LATER = 0.01
"""Time until an interruption is raised again, s. One raised before the fork has ended would be lost."""

_locks: weakref.WeakSet[threading.RLock] = weakref.WeakSet()
_listing = threading.RLock()
_held_by_forks: list[list[Any]] = []  # locks of nested forks in progress
_interruptions: list[BaseException] = []

_acquired, _released = methodcaller("acquire"), methodcaller("release")


def fork_safe_lock() -> threading.RLock:
    """Return a new reentrant lock, which a signal handler of its holder may acquire again."""
    lock = threading.RLock()
    with _listing:
        _locks.add(lock)
    return lock


def _compiler_locks() -> list[Any]:
    """Return the lock of numba's compiler if it is loaded in this process."""
    compiler = sys.modules.get("numba.core.compiler_lock")
    return [compiler.global_compiler_lock] if compiler else []


def _all_locks() -> list[Any]:
    while True:
        try:
            return [_listing, *_locks, *_compiler_locks()]
        except RuntimeError:  # a concurrent change by another thread or a signal handler
            continue


def _acquire_all() -> None:
    """Acquire all locks, even if interrupted.

    An exception here would be lost, and the fork would continue. So it is delivered later.
    """
    locks, results = _all_locks(), list[bool]()
    while len(results) < len(locks):
        try:
            # In one call, so that a signal can only arrive during a wait, not between two.
            results.extend(map(_acquired, locks[len(results) :]))
        except BaseException as interruption:
            _interruptions.append(interruption)
    _held_by_forks.append(locks)


def _release_all() -> None:
    for lock in reversed(_held_by_forks.pop()):
        _released(lock)


def _resume_parent() -> None:
    """Release the locks in the parent process and deliver a delayed interruption."""
    _release_all()
    if _interruptions:
        _interruptions.clear()
        later = threading.Timer(LATER, _thread.interrupt_main)
        later.daemon = True
        later.start()


def _resume_child() -> None:
    _interruptions.clear()
    _release_all()


if hasattr(os, "register_at_fork"):  # systems that fork
    os.register_at_fork(before=_acquire_all, after_in_parent=_resume_parent, after_in_child=_resume_child)
