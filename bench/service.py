"""Measure the service, from publishing to a minute of it: ``python bench/service.py``.

Publishing is timed call by call, with a subscriber in another process that reads every frame. What that
process sees is timed from ``publish_ns``, taken just before a frame is sealed, to the return of the read. A
minute is served in a process of its own, from a recorded hand, with its log, and every frame is accounted
for here. Beside both stands what this machine and iceoryx2 take by themselves. The exit code is 1 if
something that was measured is not met.
"""

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

from results import Verdict, describe_machine
from rich.console import Console
from rich.table import Table
from service_control import bare_iceoryx, bare_loop
from service_minutes import measure_memory, measure_minute
from service_publishing import PublishRow, measure_publishing
from tables import print_verdicts

CASES = ("publish", "minute", "memory")
HEADINGS = ("address", "what, µs", "count")
PERCENTILES = ("p50", "p90", "p99", "p99.9", "max")


def main(arguments: list[str] | None = None) -> int:
    """Run the cases; the exit code is 1 if a requirement that was measured is not met."""
    options = _parse(arguments)
    console = Console(width=None if sys.stdout.isatty() else 140)
    machine = describe_machine("as the process has them")
    for key, value in machine.items():
        console.print(f"{key:>10}: {value}", highlight=False)
    measure: dict[str, Callable[[argparse.Namespace], tuple[list[PublishRow], list[Verdict]]]] = {
        "publish": measure_publishing,
        "minute": measure_minute,
        "memory": measure_memory,
    }
    control: dict[str, Callable[[], list[PublishRow]]] = {
        "publish": lambda: bare_iceoryx(200 if options.small else 10_000),
        "minute": lambda: bare_loop(0.2 if options.small else 10.0),
        "memory": list,
    }
    rows: list[PublishRow] = []
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
        document = {
            "machine": machine,
            "rows": [_document(row) for row in rows],
            "verdicts": [dataclasses.asdict(verdict) for verdict in verdicts],
        }
        options.json.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0 if options.small or all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all but memory by default"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of the minute")
    parser.add_argument("--minutes", type=float, default=10.0, help="over which the memory is watched")
    parser.add_argument("--small", action="store_true", help="a look whether all runs: nothing is judged")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write everything to OUT")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.cases if name not in CASES]
    if unknown:
        parser.error(f"no case is called {unknown[0]} (expected {', '.join(CASES)})")
    options.cases = options.cases or [name for name in CASES if name != "memory"]
    return options


def _document(row):
    """A row as JSON has it: what is not known is null."""
    document = dataclasses.asdict(row)
    document["figures"] = {
        name: None if math.isnan(value) else value for name, value in document["figures"].items()
    }
    return document


def _table(name, rows):
    table = Table(title=name, title_justify="left", header_style="bold")
    for heading in (*HEADINGS, *PERCENTILES):
        table.add_column(heading, justify="left" if heading in HEADINGS[:2] else "right")
    for row in rows:
        figures = dataclasses.astuple(row.figures)
        table.add_row(row.address, row.what, f"{row.count:,}", *(f"{value:,.1f}" for value in figures))
    return table


if __name__ == "__main__":
    sys.exit(main())
