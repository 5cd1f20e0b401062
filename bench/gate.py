"""Fail if a call became slower, by ratios to a yardstick in the same run: ``python bench/gate.py``.

Calls of the package and of the yardstick take turns of a few milliseconds, in thread time; a case's ratio is
the median over the turns. So a busy machine, or one half as fast, gives the same ratios. A case above its
limit (``gate.toml``) is measured again, over more turns, before the gate fails. ``--twice CASE`` makes our
call twice, to see that the gate fails then.
"""

import argparse
import gc
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.support import threads

if __name__ == "__main__":
    threads.limit_to_one_thread()

from rich.table import Table

import proximity
from benchmarks.gate import limits
from benchmarks.gate.cases import AnswerError, GateCase, make_cases
from benchmarks.support.output import open_console, table_of
from proximity.system.memory import collector_paused

ROUNDS, MORE_ROUNDS, TURN_NS = 60, 200, 4_000_000
MAX_SECONDS = 3.0  # of a case; one with long calls has fewer rounds, at least a third
HEADINGS = ("case", "ours / yardstick", "measured", "limit", "verdict")


def main(arguments: list[str] | None = None) -> int:
    """Measure and judge; the exit code is 1 if a case is slower than its limit, 2 if that is unknown."""
    options = _parse(arguments)
    console = open_console()
    try:
        proximity.warm_up()
        found = _chosen(make_cases(), options)
        ratios = {case.name: measure(case, options.rounds) for case in found}
        if options.update is not None:
            return _update(console, ratios, options.reason)
        allowed = limits.allowed_here(limits.read_limits())
        verdicts = limits.judge(ratios, allowed)
        again = {each.case for each in verdicts if not each.is_met}
        if again:
            console.print(f"Again, over {options.more_rounds} rounds: {', '.join(sorted(again))}")
            slow = [case for case in found if case.name in again]
            ratios |= {case.name: measure(case, options.more_rounds) for case in slow}
            verdicts = limits.judge(ratios, allowed)
    except (AnswerError, limits.LimitError) as reason:
        console.print(f"[red]gate: {reason}", highlight=False, soft_wrap=True)
        return 2
    console.print(verdict_table(verdicts))
    failed = [each for each in verdicts if not each.is_met]
    for each in failed:
        console.print(f"gate: {each.sentence}", highlight=False, soft_wrap=True, markup=False)
    return 1 if failed else 0


def measure(case: GateCase, round_count: int) -> float:
    """Return the case's time divided by the yardstick's: the median over paired turns."""
    ours, theirs = _turn(case.ours), _turn(case.theirs)
    with collector_paused():
        started, ratios = time.perf_counter(), []
        while len(ratios) < round_count:
            ratios.append(ours() / theirs())
            is_late = time.perf_counter() - started > MAX_SECONDS
            if is_late and 3 * len(ratios) >= round_count:
                break
        gc.collect()
    return statistics.median(ratios)


def verdict_table(verdicts: list[limits.GateVerdict]) -> Table:
    """Return the table of the verdicts."""
    table = table_of("Regression gate", HEADINGS)
    for each in verdicts:
        figures = (f"{value:.3g}" for value in (each.ratio, each.limit.measured, each.limit.limit))
        table.add_row(each.case, *figures, "[green]ok" if each.is_met else "[red]slower")
    return table


def _turn(run: Callable[[], Any]) -> Callable[[], float]:
    """Return a call that repeats *run* for about `TURN_NS`, and returns the thread time of one run, ns."""
    run()
    first_ns = min(_timed(run, 1) for _ in range(3))
    count = max(1, round(TURN_NS / max(1.0, first_ns)))
    return lambda: _timed(run, count)


def _timed(run, count):
    start = time.thread_time_ns()
    for _ in range(count):
        run()
    return (time.thread_time_ns() - start) / count


def _update(console, ratios, reason):
    known = limits.read_limits() if limits.FILE.is_file() else {}
    known |= {name: limits.new_limit(ratio, reason) for name, ratio in ratios.items()}
    limits.write_limits(known)
    console.print(verdict_table(limits.judge(ratios, known)))
    return 0


def _chosen(found, options):
    names = {case.name for case in found}
    asked = set(options.cases) | set(options.update or ()) | set(options.twice)
    unknown = sorted(asked - names)
    if unknown:
        raise limits.LimitError(f"no case is called {unknown[0]} (expected {', '.join(sorted(names))})")
    wanted = set(options.cases) | set(options.update or ()) or names
    found = [case for case in found if case.name in wanted]
    return [_asked_twice(case) if case.name in options.twice else case for case in found]


def _asked_twice(case):
    return GateCase(case.name, lambda: (case.ours(), case.ours()), case.theirs)


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help="all by default")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--more-rounds", type=int, default=MORE_ROUNDS, help="of the second try")
    parser.add_argument(
        "--update", nargs="*", metavar="CASE", help="write new limits; all cases if none named"
    )
    parser.add_argument("--reason", help="why the new limits are right")
    parser.add_argument(
        "--twice", nargs="+", default=[], metavar="CASE", help="ask ours twice: the gate must fail"
    )
    options = parser.parse_args(arguments)
    if options.update is not None and not options.reason:
        parser.error('limits are not written without a reason, expected --reason "why"')
    return options


if __name__ == "__main__":
    sys.exit(main())
