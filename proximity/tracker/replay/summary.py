"""The summary of a replay: times, nearest approach, touches, and whether bounds held."""

from dataclasses import dataclass

import numpy as np

from proximity.message import ContactFlag
from proximity.recording import NANOSECONDS
from proximity.scene.scene import Scene
from proximity.tracker.replay.bounds_check import (
    BoundsKept,
    CertifiedTimes,
    PredictionsKept,
    judge_bounds,
    judge_certified_times,
    judge_predictions,
    touching,
)
from proximity.tracker.replay.replay_loop import Replay

PERCENTILES = (50.0, 99.0, 99.9, 100.0)
MICROSECOND_NS = 1000


@dataclass(frozen=True, slots=True)
class TickTimes:
    """Durations of ticks, ns."""

    p50: float
    p99: float
    p999: float
    max: float
    histogram: tuple[tuple[float, float, int], ...]  # from, below (ns), ticks: powers of two in µs


@dataclass(frozen=True, slots=True)
class Approach:
    """The nearest that a fingertip came."""

    finger: str
    time_s: float
    signed_distance: float  # m
    part: str


@dataclass(frozen=True, slots=True)
class FingerTouches:
    """The touches of one finger, if any."""

    finger: str
    count: int
    first_s: float
    deepest: float  # m, below the surface, 0 where it only touched


@dataclass(frozen=True, slots=True)
class ReplaySummary:
    """All numbers of a replay, in metres and seconds."""

    tick_count: int
    finger_tick_count: int
    tracked_count: int  # of the finger-ticks; exact, bounded and skipped add up to it
    exact_count: int
    bounded_count: int
    skipped_count: int
    compute: TickTimes  # processor time of the thread
    wall: TickTimes
    nearest: Approach | None  # None: no finger came within the working range
    touches: tuple[FingerTouches, ...]  # of the fingers that touched
    bounds: BoundsKept
    predictions: PredictionsKept
    certified_times: CertifiedTimes


def summarise(scene: Scene, run: Replay, radius: float) -> ReplaySummary:
    """Return what is reported of a replay; every bound of a sample is checked against the exact distance."""
    flags = run.contacts["flags"]
    is_tracked = (flags & np.uint32(ContactFlag.TRACKED)) != 0

    def count(flag: ContactFlag) -> int:
        return int((is_tracked & ((flags & np.uint32(flag)) != 0)).sum())

    return ReplaySummary(
        tick_count=flags.shape[0],
        finger_tick_count=flags.size,
        tracked_count=int(is_tracked.sum()),
        exact_count=count(ContactFlag.EXACT),
        bounded_count=count(ContactFlag.BOUNDED),
        skipped_count=count(ContactFlag.SKIPPED),
        compute=tick_times(run.compute_ns),
        wall=tick_times(run.wall_ns),
        nearest=_nearest(scene, run, is_tracked),
        touches=tuple(_touches(run)),
        bounds=judge_bounds(scene, run, radius),
        predictions=judge_predictions(scene, run, radius),
        certified_times=judge_certified_times(scene, run, radius),
    )


def tick_times(nanoseconds: np.ndarray) -> TickTimes:
    """Return percentiles and histogram of what ticks took."""
    p50, p99, p999, longest = map(float, np.percentile(nanoseconds, PERCENTILES))
    # bin k: from 2^(k - 1) to 2^k µs; bin 0: below 1 µs
    bins = np.frexp(nanoseconds / MICROSECOND_NS)[1].clip(0)
    counts = np.bincount(bins)
    rows = [
        (0.0 if k == 0 else MICROSECOND_NS * 2.0 ** (k - 1), MICROSECOND_NS * 2.0**k, int(counts[k]))
        for k in range(int(bins.min()), len(counts))
    ]
    return TickTimes(p50, p99, p999, longest, tuple(rows))


def _nearest(scene: Scene, run: Replay, is_tracked: np.ndarray) -> Approach | None:
    # Beyond the range a few are searched for, the first above all: not those that came nearest.
    flags = run.contacts["flags"]
    is_searched = (flags & np.uint32(ContactFlag.SKIPPED)) == 0
    is_in_range = (flags & np.uint32(ContactFlag.IN_RANGE)) != 0
    distances = np.where(is_tracked & is_searched & is_in_range, run.contacts["signed_distance"], np.inf)
    tick, row = np.unravel_index(int(np.argmin(distances)), distances.shape)
    if not np.isfinite(distances[tick, row]):
        return None
    part = int(run.contacts["part"][tick, row])
    return Approach(
        finger=run.recording.finger_name(int(row)),
        time_s=float(run.recording.times_ns[tick]) / NANOSECONDS,
        signed_distance=float(distances[tick, row]),
        part=scene.parts[part].name if 0 <= part < len(scene.parts) else "",
    )


def _touches(run: Replay) -> list[FingerTouches]:
    is_touching = touching(run)
    found = []
    for row in range(is_touching.shape[1]):
        touches = is_touching[:, row]
        if not touches.any():
            continue
        begins = touches & ~np.concatenate(([False], touches[:-1]))
        found.append(
            FingerTouches(
                finger=run.recording.finger_name(row),
                count=int(begins.sum()),
                first_s=float(run.recording.times_ns[np.argmax(begins)]) / NANOSECONDS,
                deepest=float(-run.contacts["signed_distance"][touches, row].min()),
            )
        )
    return found
