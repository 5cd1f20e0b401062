"""Tick times of parts that are held, led through the scene as a hand leads its fingers."""

import time
from collections.abc import Iterator

import numpy as np

from proximity.lab.certificate.measurement import REHEARSAL, REPEATS, MotionTiming, TickLog, without_collector
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.worst_positions import Progress
from proximity.message import CONTACT, ContactFlag
from proximity.scene.scene import Scene
from proximity.service import HeldContacts, ReportedMotion
from proximity.service.config import HeldEntry
from proximity.system.time_units import NS_PER_S
from proximity.tracker.replay import motions, turn_about_axes

TURNING = np.array([60.0, 40.0, 25.0])
"""Degrees a second about each axis."""


def measure_held_parts(
    subject: Subject, tick_count: int, seed: int, progress: Progress = lambda _, __: None
) -> tuple[MotionTiming, ...]:
    """Return what ticks of each held part take."""
    timings = []
    for done, entry in enumerate(subject.held):
        name = f"held {'+'.join(entry.part)}"
        progress(f"timing: {name}", done / len(subject.held))
        logs = [_ticked(subject, entry, tick_count, seed) for _ in range(REPEATS)]
        kinds = (ContactFlag.EXACT, ContactFlag.BOUNDED, ContactFlag.SKIPPED)
        timings.append(
            MotionTiming(
                name,
                entry.connections,
                np.array(logs[0].thread_ns),
                np.array(logs[0].wall_ns),
                np.min([log.thread_ns for log in logs], axis=0),
                int(max(each.max() for each in logs[0].work)),
                {str(kind.name).lower(): logs[0].share(kind) for kind in kinds},
            )
        )
    return tuple(timings)


def _ticked(subject: Subject, entry: HeldEntry, tick_count: int, seed: int) -> TickLog:
    """Times of all ticks of a held part, after a few that are not counted."""
    scene, log = subject.scene, TickLog()
    reported: dict[str, ReportedMotion] = {}
    held = HeldContacts(
        lambda: scene, lambda: reported, entry.part, latency=subject.latency, **entry.tracker_settings
    )
    contacts, period_ns = np.zeros(held.count, CONTACT), round(NS_PER_S * subject.period)
    held.rehearse()
    poses = _path_through(scene, entry.part, tick_count + REHEARSAL, seed, subject.period)
    with without_collector():
        for tick, matrices in enumerate(poses):
            now_ns = (tick + 1) * period_ns
            reported |= {
                name: ReportedMotion(matrix, np.zeros(3), np.zeros(3), now_ns, False, False)
                for name, matrix in zip(entry.part, matrices, strict=True)
            }
            wall_ns, thread_ns = time.perf_counter_ns(), time.thread_time_ns()
            held.fill(contacts, None, now_ns)
            if tick >= REHEARSAL:
                log.thread_ns.append(time.thread_time_ns() - thread_ns)
                log.wall_ns.append(time.perf_counter_ns() - wall_ns)
                log.work.append(contacts["work"].copy())
                log.flags.append(contacts["flags"].copy())
    return log


def _path_through(
    scene: Scene, names: tuple[str, ...], tick_count: int, seed: int, period: float
) -> Iterator[list[np.ndarray]]:
    """Poses (4, 4) of parts at each tick: the middle of the first goes where a hand goes, others with it."""
    parts = [scene.part(name) for name in names]
    lower, upper = parts[0].solid.bounds
    middle = 0.5 * (lower + upper)
    offsets = [parts[0].pose.inverse @ part.pose for part in parts]
    places = motions.wandering_hands(scene, tick_count, 1, seed=seed, rate=1.0 / period)[:, 0]
    for tick, place in enumerate(places):
        matrix = np.eye(4)
        matrix[:3, :3] = turn_about_axes((tick * period * TURNING).tolist())
        matrix[:3, 3] = place - matrix[:3, :3] @ middle
        yield [matrix @ offset.matrix for offset in offsets]
