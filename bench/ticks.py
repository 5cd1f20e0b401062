"""Measure ticks, case by case, against their requirements: ``python bench/ticks.py``.

Every tick is timed separately: thread time (of the processor) and wall time, from call to answer, in Python,
without subtractions. "Best of 3" is the shortest thread time of each tick in three equal runs: its tail is
due to the work. "A bare loop" only counts, for the time of the median tick: its tail is due to the
machine. The exit code is 1 if a measured requirement is not met.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.support import threads

THREADS = threads.limit_to_one_thread() if __name__ == "__main__" else threads.UNLIMITED

from rich.console import Console

import proximity
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import (
    open_console,
    print_machine,
    print_verdicts,
    refuse_unknown,
    table_of,
    write_json,
)
from benchmarks.ticks import scenes
from benchmarks.ticks.crowds import measure_cavity, measure_moving, measure_skin
from benchmarks.ticks.hands import measure_fingers, measure_warm
from benchmarks.ticks.prediction import measure_prediction
from benchmarks.ticks.scene_changes import measure_deform, measure_open
from benchmarks.ticks.timing import Figures, TickRow, clock_cost

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
    """Run the cases; the exit code is 1 if a measured requirement is not met."""
    options = _parse(arguments)
    console = open_console()
    machine = describe_machine(THREADS)
    proximity.warm_up()
    clocks = clock_cost()
    machine["clocks"] = (
        f"an empty call takes {clocks[0].p50:.2f} µs of thread time (p99.9 {clocks[0].p999:.2f}) "
        f"and {clocks[1].p50:.2f} µs (p99.9 {clocks[1].p999:.2f}) of wall time; not subtracted"
    )
    print_machine(console, machine)
    rows: list[TickRow] = []
    for name in options.cases:
        start = time.perf_counter()
        found = CASES[name](options)
        rows += found
        print_rows(console, name, found, time.perf_counter() - start)
    verdicts = [verdict for row in rows for verdict in row.verdicts]
    print_verdicts(console, verdicts)
    if options.json:
        write_json(options.json, machine, rows=rows)
    if options.small:
        console.print("Small scenes: requirements are not checked.")
        return 0
    return 0 if all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--ticks", type=int, default=TICKS, help="of each case, at least one")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_TICKS} ticks of each case")
    parser.add_argument("--small", action="store_true", help="smoke test: small scenes, few ticks")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all results to OUT")
    options = parser.parse_args(arguments)
    refuse_unknown(parser, "case", options.cases, CASES)
    if options.ticks < 1:
        parser.error(f"{options.ticks} ticks cannot be measured, expected at least one")
    options.cases = list(dict.fromkeys(options.cases)) or list(CASES)
    options.ticks = SMALL_TICKS if options.small else QUICK_TICKS if options.quick else options.ticks
    options.sizes = scenes.SMALL if options.small else scenes.FULL
    return options


def print_rows(console: Console, title: str, rows: list[TickRow], seconds: float) -> None:
    """Print a case: thread and wall time of each row, whether requirements are met, and remarks."""
    table = table_of(f"{title}  [{seconds:.0f} s]", (*HEADINGS, *PERCENTILES, "met"))
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
