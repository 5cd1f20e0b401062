"""Tables and a live display on a terminal, drawn by Rich."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import rich.console
from rich.cells import cell_len
from rich.console import ConsoleDimensions, ConsoleOptions, RenderableType
from rich.live import Live
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from proximity.cli.output import report

UNBOUNDED = 10_000  # columns: wider than any table
DRAWN_EVERY_S = 0.05
LINE_EVERY_S = 1.0
FIRST_AFTER_S = 0.1  # time within which the first frame of a running service arrives


class Console(rich.console.Console):
    """Rich's console, which raises BrokenPipeError on a closed pipe as other files do."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError, while Rich would exit with code 1."""
        raise BrokenPipeError


def results_console() -> Console:
    """Return the console for stdout. It folds lines only on a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=UNBOUNDED)


def table(left: Iterable[str], right: Iterable[str] = (), rows: Iterable[Iterable[str]] = ()) -> Table:
    """Return a table without lines between its cells.

    Text in square brackets is not markup. *left*: titles of the columns of words. *right*: titles of the
    columns of numbers after them.
    """
    return table_of([(title, False) for title in left] + [(title, True) for title in right], rows)


def table_of(columns: Iterable[tuple[str, bool]], rows: Iterable[Iterable[str]] = ()) -> Table:
    """Return a table like `table`.

    *columns*: title of each column, and whether it is aligned to the right.
    """
    made = Table(box=None, pad_edge=False, header_style="bold")
    for title, is_right in columns:
        Column("", title, is_right).add_to(made)
    for row in rows:
        made.add_row(*map(Text, row))
    return made


class Drawn:
    """A cell or a line that is drawn as wide as its column.

    It has at least *least* and at most *most* cells.
    """

    def __init__(self, draw: Callable[[int], str | Text], least: int = 1, most: int = UNBOUNDED) -> None:
        self._draw, self.least, self.most = draw, least, most

    def __rich_measure__(self, console: rich.console.Console, options: ConsoleOptions) -> Measurement:
        return Measurement(self.least, self.most)

    def __rich_console__(
        self, console: rich.console.Console, options: ConsoleOptions
    ) -> Iterator[str | Text]:
        yield self._draw(options.max_width)


class Column(NamedTuple):
    """Column of a table that may be too wide for a terminal."""

    name: str
    title: str | Drawn
    is_right: bool
    cells: Sequence[str | Text | Drawn] = ()
    width: int | None = None  # width in a table that is drawn repeatedly; None: that of the widest cell
    legend: str = ""  # meaning of the letters and signs in the cells

    @property
    def space(self) -> int:
        """Width that the column needs."""
        each = [self.title, *self.cells]
        return self.width or max(cell.least if isinstance(cell, Drawn) else _width(cell) for cell in each)

    def add_to(self, table: Table) -> None:
        """Add the column to a table without its cells.

        A number is never broken across lines, since half of it would look complete.
        """
        title = Text(self.title) if isinstance(self.title, str) else self.title
        is_whole = self.is_right or self.width is not None
        table.add_column(
            title,
            justify="right" if self.is_right else "left",
            no_wrap=is_whole,
            overflow="ellipsis" if is_whole else "fold",
            width=self.width,
        )


def _width(cell: str | Text) -> int:
    return max(map(cell_len, str(cell).split("\n")))


class FittingTable(NamedTuple):
    """Table that Rich draws without the columns that do not fit the terminal."""

    columns: Sequence[Column]
    dispensable: Sequence[str]  # names of columns that may be omitted, in this order
    styles: Sequence[str] = ()  # styles of the last rows
    gap: int = 2  # cells between columns
    below: Sequence[Text] = ()  # lines between the table and the legends

    def kept(self, width: int) -> list[Column]:
        """Return the columns that fit into the width."""
        for count in range(len(self.dispensable) + 1):
            kept = [column for column in self.columns if column.name not in self.dispensable[:count]]
            if sum(column.space + self.gap for column in kept) - self.gap <= width:
                break
        return kept

    def __rich_console__(
        self, console: rich.console.Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        drawn = Table(box=None, pad_edge=False, padding=(0, 1, 0, self.gap - 1), header_style="bold")
        kept = self.kept(options.max_width)
        for column in kept:
            column.add_to(drawn)
        for cells in zip(*(column.cells for column in kept), strict=True):
            drawn.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in cells))
        for row, style in zip(reversed(drawn.rows), reversed(self.styles), strict=False):
            row.style = style
        yield drawn
        yield from self.below
        if legends := [column.legend for column in kept if column.legend]:
            yield Text(f"{'. '.join(legends)}.", "dim")


def print_fitting(
    console: rich.console.Console,
    columns: Sequence[Column],
    dispensable: Sequence[str],
    elsewhere: str,
    *,
    styles: Sequence[str] = (),
) -> None:
    """Print a table of columns. On a narrow console some are omitted, and a note reports it.

    *elsewhere*: name of an output that shows all columns. *styles*: styles of the last rows.
    """
    table = FittingTable(columns, dispensable, styles)
    console.print(table)
    kept = table.kept(console.width)
    if missing := ", ".join(str(column.title) for column in columns if column not in kept):
        report(f"note: the terminal is narrow: columns are left out ({missing}); {elsewhere} shows all")


class Screen:
    """Live display on a terminal. Otherwise it writes lines of text."""

    def __init__(self, console: rich.console.Console, *, is_silent: bool = False) -> None:
        self._console, self._is_silent = console, is_silent
        is_drawn = console.is_terminal and not is_silent
        self._live = Live(console=console, auto_refresh=False) if is_drawn else None
        self._due = time.monotonic() + FIRST_AFTER_S

    def show(self, words: Callable[[], str], picture: Callable[[ConsoleDimensions], RenderableType]) -> None:
        """Show a picture or words if the display is due for an update."""
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
