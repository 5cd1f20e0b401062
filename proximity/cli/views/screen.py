"""Display of a process that runs for a while: redrawn on a terminal, otherwise a line of text at times."""

import sys
import time
from collections.abc import Callable
from types import TracebackType

from rich.console import Console, ConsoleDimensions, RenderableType
from rich.live import Live

DRAWN_EVERY_S = 0.05
LINE_EVERY_S = 1.0
FIRST_AFTER_S = 0.1  # a first frame comes within that, where there is a service


class Screen:
    """A position on a terminal that is drawn anew, or lines of text where there is none."""

    def __init__(self, console: Console, *, is_silent: bool = False) -> None:
        self._console, self._is_silent = console, is_silent
        is_drawn = console.is_terminal and not is_silent
        self._live = Live(console=console, auto_refresh=False) if is_drawn else None
        self._due = time.monotonic() + FIRST_AFTER_S

    def show(self, words: Callable[[], str], picture: Callable[[ConsoleDimensions], RenderableType]) -> None:
        """Show something if it is time for it."""
        now = time.monotonic()
        if self._is_silent or now < self._due:
            return
        self._due = now + (LINE_EVERY_S if self._live is None else DRAWN_EVERY_S)
        if self._live is None:
            sys.stdout.write(words() + "\n")
            sys.stdout.flush()
        else:
            self._live.update(picture(self._console.size), refresh=True)

    def __enter__(self) -> "Screen":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()
