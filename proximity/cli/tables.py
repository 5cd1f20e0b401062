"""Tables on a terminal, and a live display, by Rich."""

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import rich.console
from rich.console import ConsoleDimensions, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from proximity.cli.output import report

UNBOUNDED = 10_000  # columns: wider than any table
DRAWN_EVERY_S = 0.05
LINE_EVERY_S = 1.0
FIRST_AFTER_S = 0.1  # within which the first frame of a running service arrives


class Console(rich.console.Console):
    """Rich's console; on a closed pipe it raises BrokenPipeError, as other files do."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError; Rich would exit with 1."""
        raise BrokenPipeError


def results_console() -> Console:
    """Return the console of stdout; lines are folded on a terminal only."""
    console = Console()
    return console if console.is_terminal else Console(width=UNBOUNDED)


def table(left: Iterable[str], right: Iterable[str] = (), rows: Iterable[Iterable[str]] = ()) -> Table:
    """Return a table without lines between its cells; text in square brackets is not markup.

    *left*, *right*: titles of the columns of words, and of the following columns of numbers.
    """
    return table_of([(title, False) for title in left] + [(title, True) for title in right], rows)


def table_of(columns: Iterable[tuple[str, bool]], rows: Iterable[Iterable[str]] = ()) -> Table:
    """Return a table as `table`; *columns*: titles, and whether they are aligned to the right."""
    made = Table(box=None, pad_edge=False, header_style="bold")
    for title, is_right in columns:
        if is_right:  # a number is never broken: half of it would look complete
            made.add_column(Text(title), justify="right", no_wrap=True, overflow="ellipsis")
        else:
            made.add_column(Text(title), overflow="fold")
    for row in rows:
        made.add_row(*map(Text, row))
    return made


class Column(NamedTuple):
    """Column of a table that may be too wide for a terminal."""

    name: str
    title: str
    is_right: bool
    cells: list[str]


def print_fitting(
    console: rich.console.Console,
    columns: Sequence[Column],
    dispensable: Sequence[str],
    elsewhere: str,
    *,
    styles: Sequence[str] = (),
) -> None:
    """Print columns; omit some on a narrow console, with a note.

    *elsewhere*: an output with all columns. *styles*: of the last rows.
    """
    unbounded = console.options.update(width=UNBOUNDED)
    for count in range(len(dispensable) + 1):
        kept = [column for column in columns if column.name not in dispensable[:count]]
        titles = [(column.title, column.is_right) for column in kept]
        drawn = table_of(titles, zip(*(column.cells for column in kept), strict=True))
        if console.measure(drawn, options=unbounded).maximum <= console.width:
            break
    for row, style in zip(reversed(drawn.rows), reversed(styles), strict=False):
        row.style = style
    console.print(drawn)
    if missing := ", ".join(column.title for column in columns if column not in kept):
        report(f"note: the terminal is narrow: columns are left out ({missing}); {elsewhere} shows all")


class Screen:
    """Live display on a terminal, or lines of text without one."""

    def __init__(self, console: rich.console.Console, *, is_silent: bool = False) -> None:
        self._console, self._is_silent = console, is_silent
        is_drawn = console.is_terminal and not is_silent
        self._live = Live(console=console, auto_refresh=False) if is_drawn else None
        self._due = time.monotonic() + FIRST_AFTER_S

    def show(self, words: Callable[[], str], picture: Callable[[ConsoleDimensions], RenderableType]) -> None:
        """Show a picture or words, if the display is due."""
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

    def __exit__(self, *unused: object) -> None:
        if self._live is not None:
            self._live.stop()
