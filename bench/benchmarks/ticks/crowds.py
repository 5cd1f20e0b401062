"""Ticks of large scenes: many moving parts, skins of many points, and the middle of a hollow ball."""

import numpy as np

from benchmarks.support.verdicts import Verdict, at_most
from benchmarks.ticks import motions, scenes
from benchmarks.ticks.timing import (
    REPEATS,
    TickLog,
    TickRow,
    best_of,
    remark_on,
    row_of,
    tick_all,
    time_calls,
    without_collector,
)
from proximity import Tracker

SHOWN_SHARE = 10  # ratio of fewer ticks for cases without requirements
SKIN_RADIUS = 0.001  # m
ANYWHERE = 1000  # positions in the cavity
MAX_WIDTH = 0.05  # of a bracket, of the distance
CHECKED_TICKS = 40  # compared with exact distances
SKIN_SETTINGS = {
    "default": {},
    "tolerance 5 %": {"tolerance": 0.05},
    "tolerance 5 %, horizon 10 ms": {"tolerance": 0.05, "horizon": 0.01},
    "tolerance 5 %, working range 20 mm": {"tolerance": 0.05, "working_range": 0.02, "horizon": 0.01},
    "working range 10 mm": {"working_range": 0.01, "horizon": 0.01},
}
JUDGED_SKIN = "tolerance 5 %, working range 20 mm"
"""Settings for contacts on a skin: 20 mm are more than ten ticks away at 1 m/s, and farther away there are
bounds. A horizon of 10 ms goes with both working ranges."""


def measure_moving(options) -> list[TickRow]:
    """Measure ten fingers among 200 parts, 20 of them moved before each tick: with the move, and without."""
    sizes = options.sizes
    scene = scenes.many_parts(sizes)
    motion = motions.moving_parts(scene, sizes.moving_count, options.ticks)
    positions = motions.wandering_hands(scene, options.ticks)
    count = positions.shape[1]
    moves, logs = zip(*[_run_moving(scene, motion, positions) for _ in range(REPEATS)], strict=True)
    both = [_sum(*pair) for pair in zip(moves, logs, strict=True)]
    rows = []
    for name, runs in (("move_many and tick", both), ("tick", logs)):
        p99 = np.percentile(runs[0].thread_ns, 99.0) / 1e3
        rows.append(
            row_of(
                f"moving: {name}",
                scene,
                count,
                runs[0],
                best=best_of(runs),
                verdicts=[at_most(f"moving: p99 of thread time, {name}", 100.0, p99)],
                remarks=[remark_on(runs[0])] if name == "tick" else [],
            )
        )
    return rows


def _run_moving(scene, motion, positions):
    """Return the times of the moves, and of the ticks."""
    tracker = Tracker(scene, fingers=positions.shape[1], radius=scenes.RADIUS)
    moves, log = TickLog(), TickLog()

    def move(k, log=moves):
        moves_of_tick = motion.names, motion.poses[k], motion.velocities[k], motion.angular_velocities[k]
        time_calls([lambda: scene.move_many(*moves_of_tick)], log)

    with without_collector():
        move(0, TickLog())  # the first takes longer: parts leave the static tree
        tick_all(tracker, positions[:3], TickLog(), first=-3)
        tick_all(tracker, positions, log, before=move)
    return moves, log


def _sum(one, other):
    """Return sums of the times of two consecutive calls."""
    return TickLog(
        [a + b for a, b in zip(one.thread_ns, other.thread_ns, strict=True)],
        [a + b for a, b in zip(one.wall_ns, other.wall_ns, strict=True)],
    )


def measure_skin(options) -> list[TickRow]:
    """Measure two thousand points of a hand's skin as fingers, over even triangles and over needles."""
    sizes, rows = options.sizes, []
    for name in ("freeform", "plate"):
        mesh = (
            scenes.freeform(sizes.skin_ground, 0.3) if name == "freeform" else scenes.plate(sizes.skin_plate)
        )
        scene = scenes.scene_of(mesh)
        positions = motions.skin_motion(scene, sizes.skin_count)
        for words, settings in SKIN_SETTINGS.items():
            rows.append(_measure_skin(f"skin/{name}: {words}", scene, positions, settings, words, options))
    return rows


def _measure_skin(case, scene, positions, settings, words, options):
    if words != JUDGED_SKIN:
        log = _run_skin(scene, positions, settings, max(100, options.ticks // SHOWN_SHARE))
        return row_of(case, scene, positions.shape[1], log, remarks=[remark_on(log)])
    logs = [_run_skin(scene, positions, settings, options.ticks) for _ in range(REPEATS)]
    p99 = np.percentile(logs[0].thread_ns, 99.0) / 1e3
    return row_of(
        case,
        scene,
        positions.shape[1],
        logs[0],
        best=best_of(logs),
        verdicts=[at_most(f"{case}: p99 of thread time", 1000.0, p99)],
        remarks=[remark_on(logs[0])],
    )


def _run_skin(scene, positions, settings, ticks):
    """Run the motion, repeated for *ticks* ticks, with a new tracker."""
    tracker = Tracker(scene, fingers=positions.shape[1], radius=SKIN_RADIUS, **settings)
    log = TickLog()
    with without_collector():
        tick_all(tracker, positions[:3], TickLog(), first=-3)
        for first in range(0, ticks, len(positions)):
            tick_all(tracker, positions[: ticks - first], log, first=first)
    return log


def measure_cavity(options) -> list[TickRow]:
    """Measure five fingers about the centre of a hollow ball, nearly equally far from all faces."""
    scene = scenes.scene_of(scenes.cavity(options.sizes))
    # name: distances from the centre, m; speed, m/s
    cases = {
        "at rest in the centre": (np.zeros(5), 0.0),
        "at rest 0 to 10 mm beside it": (np.array([0.0, 1e-3, 1e-3, 1e-2, 1e-2]), 0.0),
        "slow, 0 to 10 mm beside it": (np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2]), 0.02),
        "fast, 1 to 10 mm beside it": (np.array([1e-3, 2e-3, 3e-3, 5e-3, 1e-2]), 0.2),
    }
    rows = [_measure_cavity(scene, name, *case, options) for name, case in cases.items()]
    return [*rows, _measure_cavity_anywhere(scene, options)]


def _measure_cavity_anywhere(scene, options):
    """Measure many positions near the centre, five at a time: the first five ticks of a track."""
    rng = np.random.default_rng(4)
    count = min(ANYWHERE, options.ticks) // 5 * 5
    outward = rng.normal(size=(count, 3))
    radii = rng.uniform(0.0, 0.01, count)
    positions = (radii / np.linalg.norm(outward, axis=1))[:, None] * outward
    tracker = Tracker(scene, radius=scenes.RADIUS)
    widths = np.empty((5, count))
    for first in range(0, count, 5):
        tracker.reset()
        for k in range(5):
            contacts = tracker.tick(
                positions[first : first + 5], k * scenes.PERIOD_NS, (k + 1) * scenes.PERIOD_NS
            )
            widths[k, first : first + 5] = (contacts["upper"] - contacts["lower"]) / contacts["lower"]
    shares = [float((width >= MAX_WIDTH).mean()) for width in widths]
    verdict = Verdict(
        "cavity, anywhere within 10 mm of the centre: bracket below 5 % of the distance",
        f"wider at {shares[0]:.1%} of {count} places at the first tick, {shares[-1]:.1%} at the fifth; "
        f"widest {max(width.max() for width in widths):.1%}",
        not any(shares),
    )
    faces = scenes.face_count(scene)
    return TickRow("cavity: anywhere within 10 mm", 1, faces, count, len(widths), verdicts=(verdict,))


def _measure_cavity(scene, name, radii, speed, options):
    positions = motions.cavity_motion(radii, options.ticks, speed)
    runs = [_run_cavity(scene, positions) for _ in range(REPEATS)]
    log, lower, upper = runs[0]
    checked = np.linspace(0, len(positions) - 1, min(CHECKED_TICKS, len(positions))).astype(int)
    true = scene.signed_distance(positions[checked].reshape(-1, 3)).reshape(-1, len(radii)) - scenes.RADIUS
    tolerance = 1e-12 * np.abs(true)
    is_kept = (lower[checked] <= true + tolerance) & (true <= upper[checked] + tolerance)
    widths = (upper - lower) / lower
    p999 = np.percentile(log.thread_ns, 99.9) / 1e3
    widest = "; ".join(
        f"{1e3 * radius:g} mm {width:.2%}" for radius, width in zip(radii, widths.max(0), strict=True)
    )
    case = f"cavity, {name}"
    verdicts = [
        at_most(f"{case}: p99.9 of thread time", 200.0, p999),
        Verdict(f"{case}: brackets hold", f"{is_kept.sum()} of {is_kept.size}", bool(is_kept.all())),
        Verdict(
            f"{case}: bracket below 5 % of the distance",
            f"{widths.max():.2%} at most",
            bool(widths.max() < MAX_WIDTH),
        ),
    ]
    remarks = [remark_on(log), f"widest bracket by distance from the centre: {widest}"]
    best = best_of([run[0] for run in runs])
    return row_of(f"cavity: {name}", scene, len(radii), log, best=best, verdicts=verdicts, remarks=remarks)


def _run_cavity(scene, positions):
    """Return the ticks, and the bounds of each, (T, N) m."""
    tracker = Tracker(scene, fingers=positions.shape[1], radius=scenes.RADIUS)
    log, kept, contacts = TickLog(), [], tracker.contacts

    def keep(_=0):
        kept.append((contacts["lower"].copy(), contacts["upper"].copy()))

    with without_collector():
        tick_all(tracker, positions, log, before=keep)
    keep()
    lower, upper = (
        np.stack(values) for values in zip(*kept[1:], strict=True)
    )  # each is kept before the next tick
    return log, lower, upper
