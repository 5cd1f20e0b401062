"""Measure the tick, case by case, and hold it against what was asked for: ``python bench/ticks.py``.

Every tick is timed on its own: thread time (the processor on this thread) and wall time, from call to
answer, in Python; nothing is subtracted. "Best of 3" is the thread time of each tick in the calmest of three
runs that are the same: what is left of its tail is the work's own. "A bare loop" only counts, for as long as
the middle tick takes: its tail is the machine's own. The exit code is 1 if something that was measured is not
met.
"""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import one_thread

HOW_THREADS = one_thread.hold_to_one_thread() if __name__ == "__main__" else "as the process has them"

import tick_cases as scenes  # noqa: E402 - NumPy counts its threads on import
from results import describe_machine  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402
from tables import print_verdicts  # noqa: E402
from tick_crowds import measure_cavity, measure_moving, measure_skin  # noqa: E402
from tick_files import measure_deform, measure_open  # noqa: E402
from tick_hands import measure_fingers, measure_prediction, measure_warm  # noqa: E402
from tick_timing import Figures, TickRow, clock_cost  # noqa: E402

import proximity  # noqa: E402

CASES: dict[str, Callable[[argparse.Namespace], list[TickRow]]] = {
    "fingers": measure_fingers,
    "moving": measure_moving,
    "skin": measure_skin,
    "cavity": measure_cavity,
    "warm": measure_warm,
    "prediction": measure_prediction,
    "open": measure_open,
    "deform": measure_deform,
}
TICKS, QUICK_TICKS, SMALL_TICKS = 20_000, 2_000, 40
HEADINGS = ("case", "parts", "faces", "fingers", "ticks", "time, µs")
PERCENTILES = ("p50", "p90", "p99", "p99.9", "max")


def main(arguments: list[str] | None = None) -> int:
    """Run the cases; the exit code is 1 if a requirement that was measured is not met."""
    options = _parse(arguments)
    console = Console(width=None if sys.stdout.isatty() else 160)
    machine = describe_machine(HOW_THREADS)
    proximity.warm_up()
    clocks = clock_cost()
    machine["clocks"] = (
        f"an empty call takes {clocks[0].p50:.2f} µs of thread time (p99.9 {clocks[0].p999:.2f}) "
        f"and {clocks[1].p50:.2f} µs (p99.9 {clocks[1].p999:.2f}) of wall time; not subtracted"
    )
    for key, value in machine.items():
        console.print(f"{key:>10}: {value}", highlight=False)
    rows: list[TickRow] = []
    for name in options.cases:
        start = time.perf_counter()
        found = CASES[name](options)
        rows += found
        print_rows(console, name, found, time.perf_counter() - start)
    verdicts = [verdict for row in rows for verdict in row.verdicts]
    print_verdicts(console, verdicts)
    if options.json:
        document = {"machine": machine, "rows": [dataclasses.asdict(row) for row in rows]}
        options.json.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if options.small:
        console.print("Small scenes: nothing is judged.")
        return 0
    return 0 if all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--ticks", type=int, default=TICKS, help="of each case, at least one")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_TICKS} ticks of each case")
    parser.add_argument(
        "--small", action="store_true", help="a look whether all runs: small scenes, few ticks"
    )
    parser.add_argument("--json", type=Path, metavar="OUT", help="write everything to OUT")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.cases) - set(CASES))
    if unknown:
        parser.error(f"no such case: {', '.join(unknown)}; there are {', '.join(CASES)}")
    if options.ticks < 1:
        parser.error(f"{options.ticks} ticks cannot be measured, expected at least one")
    options.cases = list(dict.fromkeys(options.cases)) or list(CASES)
    options.ticks = SMALL_TICKS if options.small else QUICK_TICKS if options.quick else options.ticks
    options.sizes = scenes.SMALL if options.small else scenes.FULL
    return options


def print_rows(console: Console, title: str, rows: list[TickRow], seconds: float) -> None:
    """Print a case: for each row thread and wall time, what was asked of it, and remarks below."""
    table = Table(title=f"{title}  [{seconds:.0f} s]", title_justify="left", header_style="bold")
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading in ("case", "time, µs") else "right")
    for heading in PERCENTILES:
        table.add_column(heading, justify="right")
    table.add_column("met")
    for row in rows:
        head = [
            row.case,
            *(f"{n:,}" for n in (row.part_count, row.face_count, row.finger_count, row.tick_count)),
        ]
        met = "" if not row.verdicts else "yes" if all(each.is_met for each in row.verdicts) else "no"
        for kind, figures in _kinds(row):
            table.add_row(*head, kind, *_cells(figures), met)
            head, met = [""] * len(head), ""
        if row.thread is None and row.wall is None:
            table.add_row(*head, *[""] * (len(PERCENTILES) + 1), met)
    console.print(table)
    for row in rows:
        for remark in row.remarks:
            console.print(f"  {row.case}: {remark}", highlight=False, markup=False)


def _kinds(row):
    named = ("thread", row.thread), ("wall", row.wall), ("best of 3", row.best), ("a bare loop", row.bare)
    return [(kind, figures) for kind, figures in named if figures is not None]


def _cells(figures: Figures) -> list[str]:
    return [f"{value:,.1f}" for value in dataclasses.astuple(figures)]


if __name__ == "__main__":
    sys.exit(main())
