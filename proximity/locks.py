"""Locks that a fork finds open: nobody is at work then, and the child finds nothing half done.

A child has one thread. A lock that another thread held would stay held there for ever, over what that thread
had begun. So whoever forks takes all locks first, which waits for those at work.
"""

import os
import threading
import weakref

_locks: weakref.WeakSet[threading.RLock] = weakref.WeakSet()
_listing = threading.Lock()
_held: list[threading.RLock] = []


def fork_safe_lock() -> threading.RLock:
    """Return a lock of its own; the thread that holds it may take it again, as a signal handler may."""
    lock = threading.RLock()
    with _listing:
        _locks.add(lock)
    return lock


def _take_all() -> None:
    _listing.acquire()
    for lock in list(_locks):
        lock.acquire()
        _held.append(lock)


def _give_back_all() -> None:
    while _held:
        _held.pop().release()
    _listing.release()


if hasattr(os, "register_at_fork"):  # where there are forks
    os.register_at_fork(before=_take_all, after_in_parent=_give_back_all, after_in_child=_give_back_all)
