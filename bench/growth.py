"""Measure how cost grows, with faces, parts, points and distance: ``python bench/growth.py``.

Times are thread times, each call's shortest of three; work is nodes and leaves visited and the same on every
machine. Slopes are fitted to the upper two decades of the medians, in logarithms of both. ``--out`` gets a
JSON, and a CSV, a PNG and an SVG for each axis.
"""

import argparse
import csv
import dataclasses
import json
import sys
import time
from pathlib import Path

import one_thread

HOW_THREADS = one_thread.hold_to_one_thread() if __name__ == "__main__" else "as the process has them"

import growth_plots  # noqa: E402 - NumPy counts its threads on import
from growth_axes import FULL, MEASURES, QUICK, SMALL  # noqa: E402
from growth_fit import Fit, fit_rows  # noqa: E402
from growth_timing import GrowthRow  # noqa: E402
from results import describe_machine  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

import proximity  # noqa: E402

HEADINGS = ("of what", "quantity", "unit", "first", "last", "median there", "p99", "slope")


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write; the exit code is 0."""
    options = _parse(arguments)
    console = Console(width=None if sys.stdout.isatty() else 160)
    machine = describe_machine(HOW_THREADS)
    for key, value in machine.items():
        console.print(f"{key:>10}: {value}", highlight=False)
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
        _write_json(options.json, machine, rows, fits, left_out)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        for path in write_pictures(options.out, machine, rows, fits):
            console.print(f"wrote {path}", highlight=False)
    return 0


def write_pictures(folder: Path, machine: dict, rows: list[GrowthRow], fits: list[Fit]) -> list[Path]:
    """Write growth_AXIS.csv, .png and .svg for each axis; their names."""
    caption = f"{machine['processor'].partition(' (')[0]}, {machine['date'][:10]}; line: fit, faint: p99"
    written = []
    for axis in dict.fromkeys(row.axis for row in rows):
        own = [row for row in rows if row.axis == axis]
        path = folder / f"growth_{axis}"
        with path.with_suffix(".csv").open("w", encoding="utf-8", newline="") as stream:
            table = csv.DictWriter(stream, [field.name for field in dataclasses.fields(GrowthRow)])
            table.writeheader()
            table.writerows(dataclasses.asdict(row) for row in own)
        figure = growth_plots.draw(axis, own, [fit for fit in fits if fit.axis == axis], caption)
        written += [path.with_suffix(".csv"), *growth_plots.save(figure, path)]
    return written


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="AXIS", default=list(MEASURES), help=", ".join(MEASURES))
    parser.add_argument("--quick", action="store_true", help="shorter, in less than a minute")
    parser.add_argument("--small", action="store_true", help="a look whether all runs: no figure means much")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything to FILE")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write plots and CSV to FOLDER")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.only) - set(MEASURES))
    if unknown:
        parser.error(f"no such axis: {', '.join(unknown)}; there are {', '.join(MEASURES)}")
    options.sizes = SMALL if options.small else QUICK if options.quick else FULL
    return options


def _table(axis, rows, seconds):
    """A line for each curve: where it ends, and how steeply."""
    table = Table(title=f"{axis}  [{seconds:.0f} s]", title_justify="left", header_style="bold")
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading in HEADINGS[:3] else "right")
    slopes = {(fit.series, fit.quantity): fit.words for fit in fit_rows(rows)}
    for curve in dict.fromkeys((row.series, row.quantity, row.unit) for row in rows):
        own = [row for row in rows if (row.series, row.quantity, row.unit) == curve]
        last = own[-1]
        tail = "" if last.p99 is None else f"{last.p99:.4g}"
        ends = (f"{own[0].x:.3g}", f"{last.x:.3g}", f"{last.median:.4g}")
        table.add_row(*curve, *ends, tail, slopes.get(curve[:2], ""))
    return table


def _write_json(path, machine, rows, fits, left_out):
    records = {"rows": rows, "fits": fits}
    document = {"machine": machine, "left_out": left_out}
    document |= {key: [dataclasses.asdict(each) for each in found] for key, found in records.items()}
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
