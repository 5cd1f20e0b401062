"""Measure all contenders in one run, and print the comparison: ``python bench/report.py``.

Answers are compared before timing. Rounds are interleaved; times a query or a call are medians over rounds,
and ratios medians over paired rounds. ``--json`` stores all results.
"""

import argparse
import sys
from pathlib import Path

from benchmarks.support import threads

THREADS = threads.limit_to_one_thread() if __name__ == "__main__" else threads.UNLIMITED

from benchmarks.queries import cases, sections
from benchmarks.queries.results import OURS, Row, judge
from benchmarks.rivals import registry, tinybvh
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import open_console, print_machine, print_verdicts, refuse_unknown, write_json

CASE_NAMES = [f"{mesh}/{pattern}" for mesh in cases.MESHES for pattern in cases.PATTERNS]
DEFAULT_MESHES = ("featuretype", "cycloidal", "plate", "globe")
DEFAULT_CASES = [f"{mesh}/{pattern}" for mesh in DEFAULT_MESHES for pattern in ("near", "rays")]
QUICK_ROUNDS, QUICK_QUERIES = 3, 2000


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; the exit code is 1 if a measured requirement is not met."""
    options = _parse(arguments)
    console = open_console()
    contenders, missing = registry.available(_chosen(options))
    machine = describe_machine(THREADS)
    print_machine(console, machine)
    for name, reason in missing.items():
        console.print(f"   without: {name} ({reason})", highlight=False, markup=False)

    rows: list[Row] = []
    for mesh_name in dict.fromkeys(name.partition("/")[0] for name in options.cases):
        names = [name for name in options.cases if name.partition("/")[0] == mesh_name]
        try:
            rows += sections.measure_mesh(console, mesh_name, names, contenders, options)
        except cases.MissingMeshError as reason:
            console.print(f"[yellow]{mesh_name} is left out: {reason}")
    if not options.without_us:
        rows += sections.measure_processes(console, min(options.rounds, sections.PROCESS_ROUNDS))

    verdicts = judge(rows)
    if verdicts:
        print_verdicts(console, verdicts)
    if options.json:
        write_json(
            options.json,
            machine,
            missing=missing,
            rounds=options.rounds,
            rows=rows,
            requirements=verdicts,
        )
    return 0 if all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", nargs="+", metavar="MESH/PATTERN", default=DEFAULT_CASES)
    files = "mesh files to measure with the cases, near and with rays"
    parser.add_argument("--files", nargs="+", type=Path, default=[], metavar="FILE", help=files)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--queries", type=int, default=cases.BATCH_COUNT, help="points or rays of a batch")
    quick = f"{QUICK_ROUNDS} rounds of {QUICK_QUERIES} queries"
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--without-us", action="store_true", help="the rivals among themselves")
    parser.add_argument("--rivals", nargs="+", metavar="NAME", help="only those whose names start so")
    parser.add_argument(
        "--tinybvh", type=Path, metavar="FOLDER", help="with TinyBVH, whose header is in FOLDER"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all results to FILE")
    options = parser.parse_args(arguments)
    refuse_unknown(parser, "case", options.cases, CASE_NAMES)
    added = [cases.add_file(path) for path in options.files]
    options.cases = [*options.cases, *(f"{name}/{pattern}" for name in added for pattern in ("near", "rays"))]
    if options.quick:
        options.rounds, options.queries = QUICK_ROUNDS, QUICK_QUERIES
    return options


def _chosen(options):
    """Return the kinds of contenders that take part."""
    kinds = registry.RIVALS if options.without_us else registry.CONTENDERS
    if options.tinybvh:
        tinybvh.TinyBvh.folder = options.tinybvh.resolve()
        kinds = (*kinds, tinybvh.TinyBvh, tinybvh.TinyBvhSingle)
    wanted = (OURS, *options.rivals) if options.rivals else ("",)
    return tuple(kind for kind in kinds if kind.name.startswith(wanted))


if __name__ == "__main__":
    sys.exit(main())
