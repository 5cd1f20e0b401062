"""Measure the growth of costs with faces, parts, points and distance: ``python bench/growth.py``.

Times are thread times, each call's shortest of three; work is nodes and leaves visited and the same on every
machine. Slopes are fitted to the upper two decades of the medians, in logarithms of both. ``--out`` gets a
CSV, a PNG and an SVG for each axis. numba compiles all kernels here, including the counting ones.
"""

import argparse
import os
import sys
import time
from pathlib import Path

from benchmarks.support import threads

if __name__ == "__main__":
    os.environ["PROXIMITY_ISA"] = "jit"  # rays are counted by a kernel of `benchmarks.growth.work`
THREADS = threads.limit_to_one_thread() if __name__ == "__main__" else threads.UNLIMITED

import proximity
from benchmarks.growth.axes import FULL, MEASURES, QUICK, SMALL
from benchmarks.growth.fit import fit_rows
from benchmarks.growth.plots import write_plots
from benchmarks.growth.samples import GrowthRow
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import open_console, print_machine, refuse_unknown, table_of, write_json

HEADINGS = ("series", "quantity", "unit", "first", "last", "median there", "p99", "slope")


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write; the exit code is 0."""
    options = _parse(arguments)
    console = open_console()
    machine = describe_machine(THREADS)
    print_machine(console, machine)
    proximity.warm_up()
    rows: list[GrowthRow] = []
    left_out: list[str] = []
    for axis in options.only:
        start = time.perf_counter()
        curve = MEASURES[axis](options.sizes)
        rows += curve.rows
        left_out += curve.left_out
        console.print(_table(axis, curve.rows, time.perf_counter() - start))
        for sentence in curve.left_out:
            console.print(f"[yellow]{sentence}", highlight=False)
    fits = fit_rows(rows)
    if options.json:
        write_json(options.json, machine, left_out=left_out, rows=rows, fits=fits)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        for path in write_plots(options.out, machine, rows, fits):
            console.print(f"wrote {path}", highlight=False)
    return 0


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="AXIS", default=list(MEASURES), help=", ".join(MEASURES))
    parser.add_argument("--quick", action="store_true", help="shorter, in less than a minute")
    parser.add_argument("--small", action="store_true", help="smoke test: figures are meaningless")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all results to FILE")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write plots and CSV to FOLDER")
    options = parser.parse_args(arguments)
    refuse_unknown(parser, "axis", options.only, MEASURES)
    options.sizes = SMALL if options.small else QUICK if options.quick else FULL
    return options


def _table(axis, rows, seconds):
    """Return a row for each curve: its ends, and its slope."""
    table = table_of(f"{axis}  [{seconds:.0f} s]", HEADINGS, left=3)
    slopes = {(fit.series, fit.quantity): fit.words for fit in fit_rows(rows)}
    for curve in dict.fromkeys((row.series, row.quantity, row.unit) for row in rows):
        own = [row for row in rows if (row.series, row.quantity, row.unit) == curve]
        last = own[-1]
        tail = "" if last.p99 is None else f"{last.p99:.4g}"
        ends = (f"{own[0].x:.3g}", f"{last.x:.3g}", f"{last.median:.4g}")
        table.add_row(*curve, *ends, tail, slopes.get(curve[:2], ""))
    return table


if __name__ == "__main__":
    sys.exit(main())
