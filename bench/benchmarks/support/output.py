"""Shared parts of the commands: the console, the machine's lines, verdicts, JSON, unknown names."""

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.support.verdicts import Verdict

WIDTH = 160  # columns if the output is not a terminal


def open_console() -> Console:
    """Return the console to print to, wide for output to a file."""
    return Console(width=None if sys.stdout.isatty() else WIDTH)


def print_machine(console: Console, machine: dict[str, str]) -> None:
    """Print a line for each known property of the machine."""
    for key, value in machine.items():
        console.print(f"{key:>10}: {value}", highlight=False)


def table_of(title: str, headings: Iterable[str], left: int = 1) -> Table:
    """Return an empty table; the first *left* columns are words, the others figures."""
    table = Table(title=title, title_justify="left", header_style="bold")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number < left else "right")
    return table


def print_verdicts(console: Console, verdicts: list[Verdict]) -> None:
    """Print each requirement with its measurement."""
    table = table_of("Requirements", ("requirement", "measured", "met"), left=3)
    for verdict in verdicts:
        table.add_row(verdict.requirement, verdict.measured, "[green]yes" if verdict.is_met else "[red]no")
    console.print(table)


def write_json(path: Path, machine: dict[str, str], **records: Any) -> None:
    """Write a document: the machine, and *records*, with dataclasses in lists converted to objects."""
    document = {"machine": machine, **{key: _plain(value) for key, value in records.items()}}
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _plain(value):
    if isinstance(value, list):
        return [dataclasses.asdict(each) if dataclasses.is_dataclass(each) else each for each in value]
    return value


def refuse_unknown(
    parser: argparse.ArgumentParser, kind: str, given: Iterable[str], known: Iterable[str]
) -> None:
    """End the program with exit code 2 if a *given* name is not a *known* one; *kind*: "case", "axis"."""
    unknown = sorted(set(given) - set(known))
    if unknown:
        parser.error(f"no such {kind}: {', '.join(unknown)}; there are {', '.join(known)}")
