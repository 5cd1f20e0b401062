"""A scene file served in a thread of the test."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from proximity.service import Report
from proximity.service.hosting import serve

PATIENCE = 60.0  # s


@contextlib.contextmanager
def served_scene(path: Path, **options: Any) -> Iterator[SimpleNamespace]:
    """Serve until the block ends; ``beginnings`` lists the start reports, ``finish`` returns the report."""
    stop, begun, beginnings, reports = threading.Event(), threading.Event(), [], []

    def begin(beginning: Any) -> None:
        beginnings.append(beginning)
        begun.set()

    def run() -> None:
        try:
            reports.append(serve(path, stop=stop, begun=begin, **options))
        finally:
            begun.set()

    def finish() -> Report:
        stop.set()
        thread.join(PATIENCE)
        return reports[0]

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert begun.wait(PATIENCE) and beginnings
        yield SimpleNamespace(beginnings=beginnings, finish=finish)
    finally:
        stop.set()
        thread.join(PATIENCE)
    assert not thread.is_alive()
