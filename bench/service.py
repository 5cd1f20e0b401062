"""Measure the service, from one publish to a minute of serving: ``python bench/service.py``.

Publishing is timed call by call, with a subscriber in another process that reads every frame; there, the time
from ``publish_ns``, taken just before a frame is sealed, to the return of the read is measured. A separate
process serves a minute from a recorded hand, with its log, and every frame is counted here. Both are compared
with the times of this machine alone. The exit code is 1 if a measured requirement is not met.
"""

import argparse
import dataclasses
import math
import sys
from collections.abc import Callable
from pathlib import Path

from rich.table import Table

from benchmarks.service.baseline import bare_loop
from benchmarks.service.minutes import measure_memory, measure_minute
from benchmarks.service.publishing import ServiceRow, measure_publishing
from benchmarks.support import threads
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import (
    open_console,
    print_machine,
    print_verdicts,
    refuse_unknown,
    table_of,
    write_json,
)
from benchmarks.support.verdicts import Verdict

CASES = ("publish", "minute", "memory")
HEADINGS = ("address", "what, µs", "count")
PERCENTILES = ("p50", "p90", "p99", "p99.9", "max")


def main(arguments: list[str] | None = None) -> int:
    """Run the cases; the exit code is 1 if a measured requirement is not met."""
    options = _parse(arguments)
    console = open_console()
    machine = describe_machine(threads.UNLIMITED)
    print_machine(console, machine)
    measure: dict[str, Callable[[argparse.Namespace], tuple[list[ServiceRow], list[Verdict]]]] = {
        "publish": measure_publishing,
        "minute": measure_minute,
        "memory": measure_memory,
    }
    control: dict[str, Callable[[], list[ServiceRow]]] = {
        "publish": list,
        "minute": lambda: bare_loop(0.2 if options.small else 10.0),
        "memory": list,
    }
    rows: list[ServiceRow] = []
    verdicts: list[Verdict] = []
    for name in options.cases:
        found, judged = measure[name](options)
        found += control[name]()
        rows += found
        verdicts += judged
        if found:
            console.print(_table(name, found))
    print_verdicts(console, verdicts)
    if options.json:
        write_json(options.json, machine, rows=[_document(row) for row in rows], verdicts=verdicts)
    return 0 if options.small or all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all but memory by default"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of the minute")
    parser.add_argument("--minutes", type=float, default=10.0, help="over which the memory is watched")
    parser.add_argument("--small", action="store_true", help="smoke test: requirements are not checked")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all results to OUT")
    options = parser.parse_args(arguments)
    refuse_unknown(parser, "case", options.cases, CASES)
    options.cases = options.cases or [name for name in CASES if name != "memory"]
    return options


def _document(row):
    """A row for JSON: unknown figures are null."""
    document = dataclasses.asdict(row)
    document["figures"] = {
        name: None if math.isnan(value) else value for name, value in document["figures"].items()
    }
    return document


def _table(name: str, rows: list[ServiceRow]) -> Table:
    table = table_of(name, (*HEADINGS, *PERCENTILES), left=2)
    for row in rows:
        figures = dataclasses.astuple(row.figures)
        table.add_row(row.address, row.what, f"{row.count:,}", *(f"{value:,.1f}" for value in figures))
    return table


if __name__ == "__main__":
    sys.exit(main())
