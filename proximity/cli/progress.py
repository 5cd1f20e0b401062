"""Show progress by a spinner or a bar on stderr, after a second, and only on a terminal."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Timer
from typing import Any, TypeVar

import proximity
from proximity.cli.output import report

ANNOUNCE_AFTER_S = 1.0  # shorter waits are not shown


T = TypeVar("T")


def is_terminal() -> bool:
    """Return whether Rich would draw on stderr. Rich is not imported for this."""
    return sys.stderr.isatty() or bool(os.environ.get("FORCE_COLOR"))


@contextmanager
def spinner(doing: str) -> Iterator[Callable[..., None]]:
    """Show *doing* and the elapsed time if the block takes long and stderr is a terminal.

    Yield a function that shows words, or a count and its total (None: unknown).
    """
    if not is_terminal():
        yield lambda done, total=None: None
        return
    from rich.markup import escape
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from proximity.cli.tables import Console

    columns = SpinnerColumn(), TextColumn("{task.description}"), TextColumn("{task.fields[count]}")
    status = Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True)
    task = status.add_task(escape(doing), count="", total=None)  # a file name may contain Rich's markup

    def show(done: int | str, total: int | None = None) -> None:
        status.update(task, count=escape(str(done)) if total is None else f"{done} of {total}")

    timer = Timer(ANNOUNCE_AFTER_S, status.start)
    timer.daemon = True
    timer.start()
    try:
        yield show
    finally:
        timer.cancel()
        timer.join()
        if status.live.is_started:
            status.stop()


def counted(
    chunks: Iterable[T],
    show: Callable[..., None],
    count_of: Callable[[Any], int] = len,
    total: int | None = None,
) -> Iterator[T]:
    """Yield *chunks*, and show the number of items in them until now."""
    done = 0
    for chunk in chunks:
        yield chunk
        done += count_of(chunk)
        show(done, total)


@contextmanager
def bar(doing: str) -> Iterator[Callable[[float, float | None, str], None]]:
    """Show a bar on stderr, if the block takes long and stderr is a terminal.

    Yield a function of the progress, the total (None: unknown) and words after the bar. Only calls of this
    function draw the bar, since a drawing thread would disturb measurements.
    """
    if not is_terminal():
        yield lambda done, total, words: None
        return
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn

    from proximity.cli.tables import Console

    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[words]}")
    status = Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False)
    task, started = status.add_task(escape(doing), total=None, words=""), time.monotonic()

    def show(done: float, total: float | None, words: str) -> None:
        status.update(task, completed=done, total=total, words=words)
        if time.monotonic() - started > ANNOUNCE_AFTER_S:
            status.start()
            status.refresh()

    try:
        yield show
    finally:
        status.stop()


def prepare_kernels() -> None:
    """Compile the kernels if they are not compiled on this machine yet. A note on stderr reports it."""
    if proximity.kernels_are_cached():
        return
    report("compiling the kernels for this processor; this happens once and takes a minute or two")
    with spinner("compiling"):
        proximity.warm_up()
