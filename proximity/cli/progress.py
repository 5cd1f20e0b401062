"""Progress for a person who waits: a spinner or a bar on stderr, after a second, and only on a terminal."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from threading import Timer
from types import TracebackType
from typing import TypeVar

import proximity
from proximity.cli.output import report

ANNOUNCE_AFTER_S = 1.0  # a wait shorter than this shows nothing
STATUS_EVERY_S = 0.5


T = TypeVar("T")
C = TypeVar("C", bound=Sized)


def _is_terminal() -> bool:
    """Whether Rich would draw on stderr; what asks does not import Rich where nobody sees it."""
    return sys.stderr.isatty() or bool(os.environ.get("FORCE_COLOR"))


@contextmanager
def spinner(doing: str) -> Iterator[Callable[[int, int | None], None]]:
    """Show *doing* and the seconds that have passed, if the block runs long and stderr is a terminal.

    Gives a function that shows a count: how many are done, and of how many (None: not known).
    """
    if not _is_terminal():
        yield lambda done, total: None
        return
    from rich.markup import escape
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from proximity.cli.tables import Console

    columns = SpinnerColumn(), TextColumn("{task.description}"), TextColumn("{task.fields[count]}")
    status = Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True)
    task = status.add_task(escape(doing), count="", total=None)  # a file may be named like Rich's marks

    def show(done: int, total: int | None) -> None:
        status.update(task, count=f"{done}" if total is None else f"{done} of {total}")

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


def counted(chunks: Iterable[C], show: Callable[[int, int | None], None]) -> Iterator[C]:
    """Pass *chunks* on, and show how many items they held so far."""
    done = 0
    for chunk in chunks:
        yield chunk
        done += len(chunk)
        show(done, None)


def with_bar(
    chunks: Iterable[T], count_of: Callable[[T], int], total: int | None, *, is_shown: bool
) -> Iterator[T]:
    """Pass *chunks* on, and show how many of all queries are answered.

    *total*: how many there are; None where that is not known. *is_shown*: false where a bar would run into
    the output.
    """
    if not (is_shown and _is_terminal()):
        yield from chunks
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from proximity.cli.tables import Console

    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    task = bar.add_task("answered", total=total)
    started = time.monotonic()
    try:
        for chunk in chunks:
            yield chunk
            bar.advance(task, count_of(chunk))
            if time.monotonic() - started > ANNOUNCE_AFTER_S:
                bar.start()
    finally:
        bar.stop()


class Status:
    """A line on stderr that tells how something goes on, where that is a terminal; and a word, once."""

    def __init__(self) -> None:
        self._spinner = None
        if _is_terminal():
            from proximity.cli.tables import Console

            self._spinner = Console(stderr=True).status("")
        self._has_reported = False
        self._due = 0.0

    def show(self, text: str) -> None:
        """Show *text* in place of what was shown, twice a second at most."""
        if self._spinner is None or time.monotonic() < self._due:
            return
        self._due = time.monotonic() + STATUS_EVERY_S
        from rich.markup import escape

        self._spinner.update(escape(text))
        self._spinner.start()

    def report_once(self, text: str) -> None:
        """Say *text*, the first time only, to a terminal or not."""
        if not self._has_reported:
            report(text)
        self._has_reported = True

    def __enter__(self) -> "Status":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._spinner is not None:
            self._spinner.stop()


def prepare_kernels() -> None:
    """Compile the kernels, with a word on stderr, where they have not been compiled on this machine yet."""
    if proximity.kernels_are_cached():
        return
    report("compiling the kernels for this processor; this happens once and takes a minute or two")
    with spinner("compiling"):
        proximity.warm_up()
