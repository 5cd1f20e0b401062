"""Ticks of recorded hands: five fingers at one part, warm against cold, and how well fingers are foretold."""

import importlib
from collections.abc import Iterator

import numpy as np
import tick_cases as scenes
import tick_motions as motions
from results import Verdict
from tick_timing import (
    REPEATS,
    TickLog,
    TickRow,
    at_least,
    at_most,
    best_of,
    row_of,
    tick_all,
    time_calls,
    without_collector,
)

import rivals
from proximity import Solid, Tracker
from proximity.scene import Scene

BLOCK = 200  # ticks, then the others' turn
FARTHEST = 0.3  # m above its fitted place: a hand out of the working range
AHEAD_NS = 9_000_000
MOST_ERROR = 2.6e-3  # m
MOVING = 0.1  # m/s
LONGEST_STEP_NS = 30_000_000
WALL_DISTANCE = 1.0  # m


def blocks(
    scene: Scene, options, rise: float = 0.0, *, only_whole: bool = False
) -> Iterator[tuple[int, str, int, np.ndarray]]:
    """Round and round through all hands in blocks, until there are ticks enough.

    Gives the number of the hand, its name, the number of its first tick, and (T, 5, 3) positions; a hand that
    comes again goes on in time. Ticks count that have all their fingers; *only_whole*: no others are given.
    """
    found = [(hand.name, motions.ticks_of(hand, scene)) for hand in motions.hands()]
    left, turn = options.ticks, 0
    while left > 0:
        for number, (name, positions) in enumerate(found):
            for first in range(0, len(positions), BLOCK):
                block = positions[first : first + BLOCK] + np.array([0.0, 0.0, rise])
                whole = int((~np.isnan(block).any(axis=(1, 2))).sum())
                if only_whole and (whole < len(block) or whole < 2):
                    continue
                left -= whole
                yield number, name, turn * (len(positions) + 1000) + first, block
                if left <= 0:
                    return
        assert left < options.ticks, "no hand of the recordings is ever seen whole"
        turn += 1


def measure_fingers(options) -> list[TickRow]:
    """Five fingers of recorded hands at one part; Open3D's distances at the same places in between."""
    return [
        *_measure_fingers("fingers/plate", scenes.plate(options.sizes.plate), options),
        *_measure_fingers("fingers/freeform", scenes.freeform(options.sizes.freeform), options),
    ]


def _measure_fingers(case, mesh, options):
    scene = scenes.scene_of(mesh)
    found, missing = rivals.available((rivals.Open3D,))
    other = found[0] if found else None
    if other is not None:
        other.build(*mesh)
    runs = [_run_fingers(scene, options, other) for _ in range(REPEATS)]
    log, others, ratios = runs[0]
    is_whole = log.is_whole()
    thread_us = np.array(log.thread_ns)[is_whole] / 1e3
    p50, p999 = np.percentile(thread_us, (50.0, 99.9))
    verdicts = [
        at_most(f"{case}: p50 of thread time", 10.0, p50),
        at_most(f"{case}: p99.9 of thread time", 50.0, p999),
    ]
    remarks = [log.remark(), f"ticks whose five fingers were all seen; {len(log.wall_ns)} in all"]
    if motions.missing_hands():
        remarks.append(f"recordings that are not here: {', '.join(motions.missing_hands())}")
    rows = []
    if other is None:
        remarks.append(f"without Open3D ({missing['Open3D']})")
    else:
        low, middle, high = np.percentile(ratios, (10, 50, 90))
        verdicts.append(
            at_least(
                f"{case}: a tick against Open3D's 5 signed distances",
                1.0,
                middle,
                f" ({low:.2f} to {high:.2f})",
            )
        )
        rows.append(row_of(f"{case}: Open3D {other.version}, 5 signed distances", scene, 5, others))
    best = best_of([run[0] for run in runs])
    row = row_of(case, scene, 5, log, best=best, verdicts=verdicts, remarks=remarks, chosen=is_whole)
    return row, *rows


def _run_fingers(scene, options, other):
    """All blocks once: the ticks, the other's times at the same places, and the ratio of each block."""
    log, others, ratios, trackers = TickLog(), TickLog(), [], {}
    with without_collector():
        for number, _, first, positions in blocks(scene, options):
            if number not in trackers:
                trackers[number] = Tracker(scene, radius=scenes.RADIUS)
                tick_all(trackers[number], positions[:3], TickLog(), first=-3)
            begin, theirs = len(log.wall_ns), len(others.wall_ns)
            tick_all(trackers[number], positions, log, first=first)
            is_whole = ~np.isnan(positions).any(axis=(1, 2))
            if other is not None and is_whole.any():
                time_calls([other.signed_distance(points).run for points in positions[is_whole]], others)
                ours = np.array(log.wall_ns[begin:])[is_whole]
                ratios.append(np.median(others.wall_ns[theirs:]) / np.median(ours))
    return log, others, ratios


def measure_warm(options) -> list[TickRow]:
    """A tracker that remembers, one that is made to forget before each tick, and plain questions, in turn."""
    sizes, rows = options.sizes, []
    for name, mesh in (("plate", scenes.plate(sizes.plate)), ("freeform", scenes.freeform(sizes.freeform))):
        scene = scenes.scene_of(mesh)
        rows += _measure_warm(f"warm/{name}, outside", scene, options, rise=FARTHEST)
        rows += _measure_warm(f"warm/{name}, inside", scene, options)
    return rows


def _measure_warm(case, scene, options, rise=0.0):
    """Inside the working range velocities are given to both, so that both look ahead: a tracker that forgets
    has none. Outside nobody looks ahead."""
    names = ("warm", "cold", "closest")
    logs = {name: TickLog() for name in names}
    trackers = {name: {} for name in names[:2]}
    ratios = {name: [] for name in names[1:]}
    with without_collector():
        for number, _, first, positions in blocks(scene, options, rise, only_whole=True):
            velocities = None if rise else np.gradient(positions, 1.0 / motions.RATE, axis=0)
            begin = len(logs["warm"].wall_ns)
            for name, own in trackers.items():
                if number not in own:
                    own[number] = Tracker(scene, radius=scenes.RADIUS)
                    tick_all(own[number], positions[:3], TickLog(), first=-3, velocities=velocities)
                before = (lambda _, reset=own[number].reset: reset()) if name == "cold" else None
                tick_all(
                    own[number], positions, logs[name], first=first, velocities=velocities, before=before
                )
            time_calls([lambda points=points: scene.closest(points) for points in positions], logs["closest"])
            warm = np.median(logs["warm"].thread_ns[begin:])
            for name in ratios:
                ratios[name].append(np.median(logs[name].thread_ns[begin:]) / warm)
    rows = []
    for name in names:
        verdicts, remarks = [], [logs[name].remark()] if name != "closest" else []
        if name != "warm":
            low, middle, high = np.percentile(ratios[name], (10, 50, 90))
            spread = f" ({low:.2f} to {high:.2f})"
            if name == "cold":
                what = f"{case}: a track kept, against one that forgets, p50"
                verdicts.append(at_least(what, 2.0 if rise else 1.0, middle, spread))
            else:
                what = f"{case}: a tick of a track kept, against scene.closest, p50"
                verdicts.append(at_least(what, 2.0 if rise else 1.0, middle, spread))
            remarks.append(f"{middle:.2f}{spread} times as long as the tick of a track kept")
        rows.append(row_of(f"{case}: {name}", scene, 5, logs[name], verdicts=verdicts, remarks=remarks))
    return rows


def measure_prediction(options) -> list[TickRow]:
    """How far fingers are from where a tick foretells them 9 ms after their pose.

    Three walls far off, one across each axis: the distance foretold to each, less the one at present, is how
    far the finger is thought to go along that axis. So it is the tick's own answer that is judged. Poses come
    as the sensor gave them; as in the test of the kernels, a pose counts where the finger moves faster than
    0.1 m/s and no step of more than 30 ms follows.
    """
    held, error = [], []
    for hand in motions.hands():
        if hand.name == "generated" and not motions.missing_hands():
            continue  # its places are a formula's
        for held_by, missed_by in _errors_of(hand.recording):
            held.append(held_by)
            error.append(missed_by)
    held_p95, error_p95, p50 = (
        float(np.percentile(np.concatenate(values), share))
        for values, share in ((held, 95), (error, 95), (error, 50))
    )
    verdict = Verdict(
        f"prediction: p95 of the error 9 ms ahead at most {1e3 * MOST_ERROR:g} mm",
        f"{1e3 * error_p95:.2f} mm; holding the pose {1e3 * held_p95:.2f} mm",
        error_p95 <= MOST_ERROR,
    )
    count = sum(map(len, error))
    remark = f"{count} poses of fingers faster than {MOVING} m/s; half of the errors below {1e3 * p50:.2f} mm"
    return [TickRow("prediction", 1, 12, 5, count, verdicts=(verdict,), remarks=(remark,))]


def _errors_of(recording):
    """For each finger: how far the place 9 ms later is from the pose, and from where it was foretold."""
    box = importlib.import_module("shapes").box
    positions, times_ns = recording.positions, recording.times_ns
    lower = np.nanmin(positions, axis=(0, 1))
    trackers = []
    for axis in range(3):
        low, high = lower - 100.0, lower + 130.0  # the fingers are not opposite to its diagonals
        high[axis] = lower[axis] - WALL_DISTANCE
        scene = Scene([Solid(*box(low, high), name="wall")])
        trackers.append(
            Tracker(scene, fingers=positions.shape[1], latency=1e-9 * AHEAD_NS, working_range=10.0)
        )
    foretold = np.full_like(positions, np.nan)
    for k, now in enumerate(times_ns.tolist()):
        for axis, tracker in enumerate(trackers):
            contacts = tracker.tick(positions[k], now, now)
            foretold[k, :, axis] = (
                positions[k, :, axis] + contacts["predicted_distance"] - contacts["signed_distance"]
            )
            assert (contacts["predicted_ns"] == now + AHEAD_NS).all()
    for finger, seen in enumerate(recording.is_present.T):
        times, places = times_ns[seen], positions[seen, finger]
        if len(times) > 1:
            yield _compared(times, places, foretold[seen, finger])


def _compared(times, places, foretold):
    steps = np.diff(times)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / (1e-9 * steps)
    later = times + AHEAD_NS
    after = np.searchsorted(times, later)
    truth = np.stack([np.interp(later, times, places[:, axis]) for axis in range(3)], axis=1)
    chosen = [
        k
        for k in range(1, len(times))
        if speeds[k - 1] > MOVING and after[k] < len(times) and steps[k : after[k]].max() <= LONGEST_STEP_NS
    ]
    return (
        np.linalg.norm(truth - places, axis=1)[chosen],
        np.linalg.norm(truth - foretold, axis=1)[chosen],
    )
