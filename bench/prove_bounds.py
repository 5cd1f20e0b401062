"""Check the tracker's guarantees on all cores: ``python bench/prove_bounds.py --finger-ticks 1e7``.

Runs numbered trials of `tests/trials/bound_trials.py` until the given number of finger-ticks was checked.
Prints the number of checks of each guarantee and its margin: *worst* is the largest excess, in tolerances for
rounding (1 would be broken), *closest* the smallest distance to the bound without an excess. At the first
violation it stops, with exit code 1 and the option that repeats the trial: ``--trial N``. With ``--program``
a program with the engine for browsers ticks:
``"node --experimental-wasm-relaxed-simd tests/support/clients/module_server.mjs FOLDER plain"``.

With ``--parts --ticks 1e6`` the trials are those of `tests/trials/part_trials.py`: a part that moves among
others, with bounds, flags and certified times compared with `Scene.clearance` at one tick in ten; and every
second one is of `tests/trials/flush_trials.py`: solids of cubes that slide along each other, with shared
volume, distance and way out counted from the cubes.

With ``--recording HAND.csv --part FILE`` a recorded hand, placed so that it touches the part, is ticked at 1
kHz, and a sample of its bounds, predictions and certified times is checked instead.
"""

import argparse
import math
import multiprocessing
import os
import shlex
import sys
import time
from functools import partial

import numpy as np

import proximity
from benchmarks.digest.module_tracker import ForwardedScene, ModuleTracker
from benchmarks.replay.bounds_check import judge_bounds, judge_certified_times, judge_predictions
from benchmarks.replay.replay_loop import replay
from benchmarks.support.project import project_module
from proximity.recording import read_recording
from proximity.tracker.placement import fitted_pose

run_trial = project_module("tests/trials", "bound_trials").run_trial
run_part_trial = project_module("tests/trials", "part_trials").run_trial
run_flush_trial = project_module("tests/trials", "flush_trials").run_flush_trial
Tally = project_module("tests/trials", "trial_log").Tally

SIZES = (2000, 5000, 12_000, 40_000)
"""Finger-ticks of a trial, in turn: short ones meet more scenes, long ones drift farther."""
LIGHT_SHARE = 3
"""One trial in this number has only the scenes of the tests."""
MARGIN = 1.5
"""Planned finger-ticks for each wanted one: lost fingers do not count."""
SHOWN = 5
RADIUS = 0.007  # m, of recorded fingertips
SILENCE = 15.0  # s between two lines of progress


def main(arguments: list[str] | None = None) -> int:
    """Run trials; the exit code is 1 if a guarantee was broken."""
    options = _parse(arguments)
    if options.recording is not None:
        return _check_recording(options)
    if options.trial is not None:
        return _show_again(options)
    unit = "ticks" if options.parts else "finger-ticks"
    total, trials, done, started = Tally(), 0, 0, time.perf_counter()
    printed = started
    numbers = iter(range(options.seed, sys.maxsize))
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        run = partial(_run, options=options)
        wanted = options.finger_ticks * (1.0 if options.parts else MARGIN)
        for number, tally in pool.imap_unordered(run, _paced(numbers, wanted)):
            trials += 1
            total.add(tally)
            done = done + _size(number) if options.parts else finger_ticks(total)
            now = time.perf_counter()
            if now - printed > SILENCE:
                printed = now
                print(f"{done:>12,} {unit}, {trials} trials, {now - started:.0f} s", flush=True)
            if total.broken:
                print(f"broken in trial {number}", flush=True)
            is_over = done >= options.finger_ticks or now - started > 60.0 * options.minutes
            if total.broken or is_over:
                pool.terminate()
                break
    _print_total(total, f"{done:,} {unit}", trials, time.perf_counter() - started)
    return 1 if total.broken else 0


def finger_ticks(tally: Tally) -> int:
    """Return the number of finger-ticks whose distance was compared with the true one."""
    return tally.checks["the distance lies between its bounds"].count if tally.checks else 0


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--finger-ticks", "--ticks", type=float, default=1e7, help="about how many to check")
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop then, however many they are")
    parser.add_argument("--seed", type=int, default=0, help="number of the first trial")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--parts", action="store_true", help="ticks of trackers of parts")
    parser.add_argument("--program", help="command of a program that ticks, see above")
    parser.add_argument("--trial", type=int, help="only this one, and all that it breaks")
    parser.add_argument("--recording", help="hand to tick (CSV), instead of trials")
    parser.add_argument("--part", help="part that it touches; with --recording")
    options = parser.parse_args(arguments)
    if (options.recording is None) != (options.part is None):
        parser.error("--recording and --part belong together, expected both or neither")
    return options


def _check_recording(options):
    scene, recorded = proximity.load(options.part), read_recording(options.recording)
    placed = recorded.placed(fitted_pose(scene, recorded, RADIUS)).resampled(1e-3)
    run = replay(lambda: proximity.Tracker(scene, fingers=len(placed.fingers), radius=RADIUS), placed)
    bounds, predictions, times = (
        judge(scene, run, RADIUS) for judge in (judge_bounds, judge_predictions, judge_certified_times)
    )
    p50, p99 = np.percentile(1e-3 * run.compute_ns, [50, 99])
    print(f"{len(run.compute_ns)} ticks of {len(placed.fingers)} fingers, p50 {p50:.1f}, p99 {p99:.1f} µs")
    print(f"bounds: {bounds.broken_count} of {bounds.checked_count} broken {bounds.first_broken}")
    print(f"predictions: {predictions.kept_count} of {predictions.checked_count} within their bounds")
    print(f"certified times: {times.broken_count} of {times.checked_count} broken {times.first_broken}")
    return 1 if bounds.broken_count or times.broken_count else 0


def _size(number):
    return SIZES[number % len(SIZES)]


def _paced(numbers, wanted):
    """Yield numbers of trials with about *wanted* finger-ticks in total."""
    planned = 0
    for number in numbers:
        if planned >= wanted:
            return
        planned += _size(number)
        yield number


def _run(number, options):
    return number, _trial(number, options)[1]


def _trial(number, options):
    if options.parts:
        run = run_flush_trial if number % 2 else run_part_trial
        return run(number // 2, _size(number))
    program, given = options.program, {"is_heavy": number % LIGHT_SHARE != 0}
    if program is None:
        return run_trial(number, _size(number), **given)
    scenes = []

    def make_tracker(cell, **settings):
        cell.scene = ForwardedScene(cell.scene, shlex.split(program))
        scenes.append(cell.scene)
        return ModuleTracker(cell.scene, **settings)

    try:
        return run_trial(number, _size(number), **given, make_tracker=make_tracker)
    finally:
        for scene in scenes:
            scene.close()


def _show_again(options):
    plan, tally = _trial(options.trial, options)
    print(plan)
    for broken in tally.broken:
        print(broken)
    _print_total(tally, f"about {_size(options.trial):,} ticks", 1, 0.0)
    return 1 if tally.broken else 0


def _print_total(total, done, trials, seconds):
    print(f"\n{'guarantee':<56}{'checked':>12}{'broken':>8}{'worst':>10}{'closest':>10}")
    for name, check in total.checks.items():
        closest = f"{check.closest:.2g}" if check.closest < math.inf and check.is_length else ""
        worst = f"{max(check.worst, 0.0) + 0.0:.2g}" if check.is_length else ""
        print(f"{name:<56}{check.count:>12,}{check.broken_count:>8,}{worst:>10}{closest:>10}")
    checks = sum(check.count for check in total.checks.values())
    print(f"\n{done} in {trials} trials, {checks:,} checks, {seconds:.0f} s")
    for broken in total.broken[:SHOWN]:
        print(f"\n{broken}", file=sys.stderr)
    if total.broken:
        print("see it again: python bench/prove_bounds.py --trial N", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
