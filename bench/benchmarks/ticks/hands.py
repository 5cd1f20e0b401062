"""Ticks of recorded hands: five fingers at one part, and a kept track against one that is reset."""

from collections.abc import Iterator

import numpy as np

from benchmarks.rivals import registry
from benchmarks.rivals.open3d import Open3D
from benchmarks.support.verdicts import at_least, at_most
from benchmarks.ticks import motions, scenes
from benchmarks.ticks.timing import (
    REPEATS,
    TickLog,
    TickRow,
    best_of,
    has_all_fingers,
    remark_on,
    row_of,
    tick_all,
    time_calls,
    without_collector,
)
from proximity import Scene, Tracker

BLOCK = 200  # ticks of ours before the other library's turn
OUT_OF_RANGE = 0.3  # m above its fitted position a hand is out of the working range


def blocks(
    scene: Scene, options, rise: float = 0.0, *, only_whole: bool = False
) -> Iterator[tuple[int, str, int, np.ndarray]]:
    """Yield blocks of the motions of all hands in turn, until there are ticks enough.

    Yields the number of the hand, its name, the number of its first tick, and (T, 5, 3) positions; the time
    of a repeated hand continues. Only ticks with all fingers count; *only_whole*: no others are given.
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
    """Measure five fingers of recorded hands at one part, and Open3D's distances at the same positions."""
    return [
        *_measure_fingers("fingers/plate", scenes.plate(options.sizes.plate), options),
        *_measure_fingers("fingers/freeform", scenes.freeform(options.sizes.freeform), options),
    ]


def _measure_fingers(case, mesh, options):
    scene = scenes.scene_of(mesh)
    found, missing = registry.available((Open3D,))
    other = found[0] if found else None
    if other is not None:
        other.build(*mesh)
    runs = [_run_fingers(scene, options, other) for _ in range(REPEATS)]
    log, others, ratios = runs[0]
    is_whole = has_all_fingers(log)
    thread_us = np.array(log.thread_ns)[is_whole] / 1e3
    p50, p999 = np.percentile(thread_us, (50.0, 99.9))
    verdicts = [
        at_most(f"{case}: p50 of thread time", 10.0, p50),
        at_most(f"{case}: p99.9 of thread time", 50.0, p999),
    ]
    remarks = [remark_on(log), f"ticks whose five fingers were all seen; {len(log.wall_ns)} in all"]
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
    """Run all blocks once: return the ticks, the other's times there, and the ratio of each block."""
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
    """Measure a tracker with its tracks, one reset before each tick, and `Scene.closest`, in turn."""
    sizes, rows = options.sizes, []
    for name, mesh in (("plate", scenes.plate(sizes.plate)), ("freeform", scenes.freeform(sizes.freeform))):
        scene = scenes.scene_of(mesh)
        rows += _measure_warm(f"warm/{name}, outside", scene, options, rise=OUT_OF_RANGE)
        rows += _measure_warm(f"warm/{name}, inside", scene, options)
    return rows


def _measure_warm(case, scene, options, rise=0.0):
    """Inside the working range both get velocities, so that both predict: a reset tracker has none. Outside
    neither predicts."""
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
        verdicts, remarks = [], [remark_on(logs[name])] if name != "closest" else []
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
