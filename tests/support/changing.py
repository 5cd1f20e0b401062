"""Threads that ask while another changes what they ask."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def seen_while(change: Callable[[], None], ask: Callable[[], Any], count: int = 2) -> list[list[Any]]:
    """Return what each of *count* threads was answered until *change* had ended, and once afterwards."""
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
