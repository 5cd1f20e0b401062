"""Measure all contenders in one run, and print how they compare: ``python bench/report.py``.

Answers are compared before anything is timed. Rounds are interleaved; times a query or a call are medians
over rounds, and ratios medians over paired rounds. ``--json`` keeps everything, ``--markdown`` prints a
table for the README.
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import one_thread

HOW_THREADS = one_thread.hold_to_one_thread() if __name__ == "__main__" else "as the process has them"

import measure  # noqa: E402
from results import OURS, Row, describe_machine, judge  # noqa: E402
from rich.console import Console  # noqa: E402
from tables import markdown, print_verdicts  # noqa: E402

import cases  # noqa: E402 - NumPy counts its threads on import
import rivals  # noqa: E402

CASE_NAMES = [f"{mesh}/{pattern}" for mesh in cases.MESHES for pattern in cases.PATTERNS]
DEFAULT_MESHES = ("featuretype", "cycloidal", "plate")
DEFAULT_CASES = [f"{mesh}/{pattern}" for mesh in DEFAULT_MESHES for pattern in ("near", "rays")]
QUICK_ROUNDS, QUICK_QUERIES = 3, 2000


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; the exit code is 1 if a requirement that was measured is not met."""
    options = _parse(arguments)
    console = Console(stderr=options.markdown, width=None if sys.stdout.isatty() else 150)
    contenders, missing = rivals.available(_chosen(options))
    machine = describe_machine(HOW_THREADS)
    _print_head(console, machine, missing)

    rows: list[Row] = []
    for mesh_name in dict.fromkeys(name.partition("/")[0] for name in options.cases):
        names = [name for name in options.cases if name.partition("/")[0] == mesh_name]
        try:
            rows += measure.measure_mesh(console, mesh_name, names, contenders, options)
        except cases.MissingMeshError as reason:
            console.print(f"[yellow]{mesh_name} is left out: {reason}")
    if not options.without_us:
        rows += measure.measure_processes(console, min(options.rounds, measure.PROCESS_ROUNDS))

    verdicts = judge(rows)
    if verdicts:
        print_verdicts(console, verdicts)
    if options.json:
        _write_json(
            options.json,
            machine=machine,
            missing=missing,
            rounds=options.rounds,
            rows=rows,
            requirements=verdicts,
        )
    if options.markdown:
        print(markdown(machine, rows))
    return 0 if all(verdict.is_met for verdict in verdicts) else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", nargs="+", metavar="MESH/PATTERN", default=DEFAULT_CASES)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--queries", type=int, default=cases.BATCH_COUNT, help="points or rays of a batch")
    quick = f"{QUICK_ROUNDS} rounds of {QUICK_QUERIES} queries"
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--without-us", action="store_true", help="the rivals among themselves")
    parser.add_argument("--rivals", nargs="+", metavar="NAME", help="only those whose names start so")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything to FILE")
    parser.add_argument("--markdown", action="store_true", help="print a Markdown table, the rest to stderr")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.cases) - set(CASE_NAMES))
    if unknown:
        parser.error(f"no such case: {', '.join(unknown)}; there are {', '.join(CASE_NAMES)}")
    if options.quick:
        options.rounds, options.queries = QUICK_ROUNDS, QUICK_QUERIES
    return options


def _chosen(options):
    """The kinds of contenders that take part."""
    kinds = rivals.RIVALS if options.without_us else rivals.CONTENDERS
    wanted = (OURS, *options.rivals) if options.rivals else ("",)
    return tuple(kind for kind in kinds if kind.name.startswith(wanted))


def _print_head(console, machine, missing):
    for key, value in machine.items():
        console.print(f"{key:>10}: {value}", highlight=False)
    for name, reason in missing.items():
        console.print(f"   without: {name} ({reason})", highlight=False, markup=False)


def _write_json(path, *, rows, requirements, **rest):
    records = {"rows": rows, "requirements": requirements}
    document = rest | {key: [dataclasses.asdict(each) for each in found] for key, found in records.items()}
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
