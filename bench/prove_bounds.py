"""Hold the tracker to its promises, on all cores: ``python bench/prove_bounds.py --finger-ticks 1e7``.

Trials of `tests/bound_trials.py`, one after another number, until so many finger-ticks have been looked at.
Prints how often each promise was looked at and how near to broken it was: *worst* is what was exceeded, in
allowances for rounding (1 would be broken), *closest* what was left to the bound where that was more.
At the first violations all stops, with exit code 1 and what it takes to see them again: ``--trial N``.
"""

import argparse
import math
import multiprocessing
import os
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "tests"))
from bound_trials import run_trial
from trial_log import Tally

SIZES = (2000, 5000, 12_000, 40_000)
"""Finger-ticks of a trial, in turns: short ones meet more cells, long ones drift farther."""
LIGHT_SHARE = 3
"""Of so many trials one has only the cells that the tests have."""
MARGIN = 1.5
"""Finger-ticks planned for one wanted: lost fingers do not count."""
SHOWN = 5
SILENCE = 15.0  # s between two lines of progress


def main(arguments: list[str] | None = None) -> int:
    """Run trials; the exit code is 1 if a promise was broken."""
    options = _parse(arguments)
    if options.trial is not None:
        return _show_again(options.trial)
    total, trials, done, started = Tally(), 0, 0, time.perf_counter()
    said = started
    numbers = iter(range(options.seed, sys.maxsize))
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        for number, tally in pool.imap_unordered(_run, _paced(numbers, MARGIN * options.finger_ticks)):
            trials += 1
            total.add(tally)
            done = finger_ticks(total)
            now = time.perf_counter()
            if now - said > SILENCE:
                said = now
                print(f"{done:>12,} finger-ticks, {trials} trials, {now - started:.0f} s", flush=True)
            if total.broken:
                print(f"broken in trial {number}", flush=True)
            is_over = done >= options.finger_ticks or now - started > 60.0 * options.minutes
            if total.broken or is_over:
                pool.terminate()
                break
    _print_total(total, trials, time.perf_counter() - started)
    return 1 if total.broken else 0


def finger_ticks(tally: Tally) -> int:
    """Of how many finger-ticks the distance was held against the truth."""
    return tally.checks["the distance lies between its bounds"].count if tally.checks else 0


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--finger-ticks", type=float, default=1e7, help="how many to look at, about")
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop then, however many they are")
    parser.add_argument("--seed", type=int, default=0, help="number of the first trial")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--trial", type=int, help="only this one, and all that it breaks")
    return parser.parse_args(arguments)


def _size(number):
    return SIZES[number % len(SIZES)]


def _paced(numbers, wanted):
    """Numbers of trials that together have about so many finger-ticks."""
    planned = 0
    for number in numbers:
        if planned >= wanted:
            return
        planned += _size(number)
        yield number


def _run(number):
    _, tally = run_trial(number, _size(number), is_heavy=number % LIGHT_SHARE != 0)
    return number, tally


def _show_again(number):
    plan, tally = run_trial(number, _size(number), is_heavy=number % LIGHT_SHARE != 0)
    print(plan)
    for broken in tally.broken:
        print(broken)
    _print_total(tally, 1, 0.0)
    return 1 if tally.broken else 0


def _print_total(total, trials, seconds):
    print(f"\n{'promise':<56}{'looked at':>12}{'broken':>8}{'worst':>10}{'closest':>10}")
    for name, check in total.checks.items():
        closest = f"{check.closest:.2g}" if check.closest < math.inf and check.is_length else ""
        worst = f"{max(check.worst, 0.0) + 0.0:.2g}" if check.is_length else ""
        print(f"{name:<56}{check.count:>12,}{check.broken_count:>8,}{worst:>10}{closest:>10}")
    looks = sum(check.count for check in total.checks.values())
    print(f"\n{finger_ticks(total):,} finger-ticks in {trials} trials, {looks:,} looks, {seconds:.0f} s")
    for broken in total.broken[:SHOWN]:
        print(f"\n{broken}", file=sys.stderr)
    if total.broken:
        print("see it again: python bench/prove_bounds.py --trial N", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
