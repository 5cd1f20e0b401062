"""Concurrent readers of an object that another thread changes."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def seen_while(change: Callable[[], None], ask: Callable[[], Any], count: int = 2) -> list[list[Any]]:
    """Return the values each of *count* threads read until *change* ended, and one read after it."""
    is_done = threading.Event()

    def changed() -> None:
        try:
            change()
        finally:
            is_done.set()

    def asked(_: int) -> list[Any]:
        seen = []
        while True:
            is_last = is_done.is_set()
            seen.append(ask())
            if is_last:
                return seen

    with ThreadPoolExecutor(count + 1) as pool:
        changer = pool.submit(changed)
        seen = list(pool.map(asked, range(count)))
        changer.result()
    return seen
