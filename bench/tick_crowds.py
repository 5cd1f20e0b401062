"""Ticks of large scenes: many parts that move, skins of many points, and the middle of a hollow ball."""

import numpy as np
import tick_cases as scenes
from results import Verdict
from tick_timing import TickLog, TickRow, at_most, row_of, tick_all, time_calls, without_collector

from proximity import Tracker

FEW = 10  # times fewer ticks for what is only shown
CHECKED_TICKS = 40  # of which the brackets are held against exact distances
SKIN_SETTINGS = {
    "default": {},
    "working range 20 mm": {"working_range": 0.02},
    "horizon 10 ms": {"horizon": 0.01},
    "working range 20 mm, horizon 10 ms": {"working_range": 0.02, "horizon": 0.01},
    "working range 5 mm, horizon 10 ms": {"working_range": 0.005, "horizon": 0.01},
}
HONEST_SKIN = "working range 20 mm, horizon 10 ms"
"""What a skin is for is touch: beyond 20 mm nothing is felt, and bounds are still told."""


def measure_moving(options) -> list[TickRow]:
    """Ten fingers among 200 parts, of which 20 are moved before each tick: with the move, and without."""
    sizes = options.sizes
    scene = scenes.many_parts(sizes)
    motion = scenes.moving_parts(scene, sizes.moving_count, options.ticks)
    positions = scenes.wandering_hands(scene, options.ticks)
    tracker = Tracker(scene, fingers=positions.shape[1], radius=scenes.RADIUS)
    moves, log = TickLog(), TickLog()

    def move(k):
        time_calls(
            [
                lambda: scene.move_many(
                    motion.names, motion.poses[k], motion.velocities[k], motion.angular_velocities[k]
                )
            ],
            moves,
        )

    with without_collector():
        move(0)  # the first is dearer: the tree over what moves is made
        tick_all(tracker, positions[:3], TickLog(), first=-3)
        moves.thread_ns.clear()
        moves.wall_ns.clear()
        tick_all(tracker, positions, log, before=move)
    both = TickLog(
        (np.array(log.thread_ns) + moves.thread_ns).tolist(), (np.array(log.wall_ns) + moves.wall_ns).tolist()
    )
    count = positions.shape[1]
    p99 = {name: np.percentile(each.thread_ns, 99.0) / 1e3 for name, each in (("both", both), ("tick", log))}
    return [
        row_of(
            "moving: move_many and tick",
            scene,
            count,
            both,
            verdicts=[at_most("moving: p99 of thread time, move_many and tick", 100.0, p99["both"])],
        ),
        row_of(
            "moving: tick",
            scene,
            count,
            log,
            verdicts=[at_most("moving: p99 of thread time, tick alone", 100.0, p99["tick"])],
            remarks=[log.remark()],
        ),
    ]


def measure_skin(options) -> list[TickRow]:
    """Two thousand points of a hand's skin as fingers."""
    sizes = options.sizes
    scene = scenes.scene_of(scenes.freeform(sizes.skin_ground, 0.3))
    positions = scenes.skin_motion(scene, sizes.skin_count)
    rows = []
    for name, settings in SKIN_SETTINGS.items():
        count = options.ticks if name == HONEST_SKIN else max(100, options.ticks // FEW)
        tracker = Tracker(scene, fingers=sizes.skin_count, radius=0.001, **settings)
        log = TickLog()
        with without_collector():
            tick_all(tracker, positions[:3], TickLog(), first=-3)
            for first in range(0, count, len(positions)):
                tick_all(tracker, positions[: count - first], log, first=first)
        verdicts = []
        if name in (HONEST_SKIN, "default"):
            for share in (50.0, 99.0):
                p = np.percentile(log.thread_ns, share) / 1e3
                verdicts.append(at_most(f"skin, {name}: p{share:g} of thread time", 1000.0, p))
        rows.append(
            row_of(f"skin: {name}", scene, sizes.skin_count, log, verdicts=verdicts, remarks=[log.remark()])
        )
    return rows


def measure_cavity(options) -> list[TickRow]:
    """Five fingers about the centre of a hollow ball, where nearly all faces are equally far."""
    scene = scenes.scene_of(scenes.cavity(options.sizes))
    # name: distances from the centre, m; speed, m/s
    cases = {
        "at rest in the centre": (np.zeros(5), 0.0),
        "at rest 0 to 10 mm beside it": (np.array([0.0, 1e-3, 1e-3, 1e-2, 1e-2]), 0.0),
        "slow, 0 to 10 mm beside it": (np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2]), 0.02),
        "fast, 1 to 10 mm beside it": (np.array([1e-3, 2e-3, 3e-3, 5e-3, 1e-2]), 0.2),
    }
    return [_measure_cavity(scene, name, *case, options) for name, case in cases.items()]


def _measure_cavity(scene, name, radii, speed, options):
    positions = scenes.cavity_motion(radii, options.ticks, speed)
    tracker = Tracker(scene, radius=scenes.RADIUS)
    log, kept = TickLog(), []
    contacts = tracker.contacts

    def keep(_):
        kept.append((contacts["lower"].copy(), contacts["upper"].copy()))

    with without_collector():
        tick_all(tracker, positions, log, before=keep)
    keep(None)
    lower, upper = (np.stack(values) for values in zip(*kept[1:], strict=True))  # a tick later than asked
    checked = np.linspace(0, len(positions) - 1, min(CHECKED_TICKS, len(positions))).astype(int)
    true = scene.signed_distance(positions[checked].reshape(-1, 3)).reshape(-1, 5) - scenes.RADIUS
    room = 1e-12 * np.abs(true)
    is_kept = (lower[checked] <= true + room) & (true <= upper[checked] + room)
    widest = float(((upper - lower) / lower).max())
    p999 = np.percentile(log.thread_ns, 99.9) / 1e3
    where = f"cavity, {name}"
    verdicts = [
        at_most(f"{where}: p99.9 of thread time", 200.0, p999),
        Verdict(f"{where}: brackets hold", f"{is_kept.sum()} of {is_kept.size}", bool(is_kept.all())),
        Verdict(f"{where}: bracket below 5 % of the distance", f"{widest:.2%} at most", widest < 0.05),
    ]
    return row_of(f"cavity: {name}", scene, 5, log, verdicts=verdicts, remarks=[log.remark()])
