"""Output for people: Rich's console, blocks of labelled lines, and tables."""

from collections.abc import Iterable, Sequence

import rich.console
from rich.table import Table
from rich.text import Text

from proximity.cli.wording import printable

UNBOUNDED = 10_000  # columns: wider than any table

Lines = list[tuple[str, str]]


class Console(rich.console.Console):
    """Rich's console; where nobody reads any more it raises BrokenPipeError, as any other file does."""

    def on_broken_pipe(self) -> None:
        """Say that the reader has gone. Rich itself would end the program, with 1."""
        raise BrokenPipeError


def results_console() -> Console:
    """Return the console of stdout; where that is no terminal, lines are not folded to a width."""
    console = Console()
    return console if console.is_terminal else Console(width=UNBOUNDED)


def print_block(console: rich.console.Console, lines: Iterable[tuple[str, str]]) -> None:
    """Print labels and values, one pair a line."""
    for label, value in lines:
        console.print(Text.assemble((f"{label:<15} ", "bold"), printable(value)), soft_wrap=True)


def table(left: Iterable[str], right: Iterable[str] = ()) -> Table:
    """Return an empty table without lines between its cells; text in square brackets is no mark.

    *left*, *right*: titles of the columns of words, and of those of numbers behind them.
    """
    return table_of([(title, False) for title in left] + [(title, True) for title in right])


def table_of(columns: Iterable[tuple[str, bool]]) -> Table:
    """Return an empty table as `table`, of titles with whether the column is aligned to the right."""
    made = Table(box=None, pad_edge=False, header_style="bold")
    for title, is_right in columns:
        if is_right:  # a number is never broken: half of one looks complete
            made.add_column(Text(title), justify="right", no_wrap=True, overflow="ellipsis")
        else:
            made.add_column(Text(title), overflow="fold")
    return made


def print_fitting(console: rich.console.Console, tables: Sequence[Table]) -> int:
    """Print the first table that is no wider than the console, or else the last; return which it was."""
    unbounded = console.options.update(width=UNBOUNDED)
    widths = [console.measure(each, options=unbounded).maximum for each in tables]
    fitting = [number for number, width in enumerate(widths) if width <= console.width]
    chosen = fitting[0] if fitting else len(tables) - 1
    console.print(tables[chosen])
    return chosen
