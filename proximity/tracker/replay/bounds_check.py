"""Check of the bounds after a replay, by queries that know nothing of tracks and budgets."""

from dataclasses import dataclass

import numpy as np

from proximity.message import ContactFlag
from proximity.recording import NANOSECONDS
from proximity.scene.scene import Scene
from proximity.tracker.replay.replay_loop import Replay

CHECKED_COUNT = 20_000  # finger-ticks, evenly chosen
CHECK_ROUNDING = 1e-12  # of a distance: how far two methods of computing it may be apart
COORDINATE_ROUNDING = 8.0 * 2.0**-52  # of the largest coordinate: what a distance of 0 may be off


@dataclass(frozen=True, slots=True)
class BoundsKept:
    """lower <= true <= upper, over a sample of the finger-ticks."""

    checked_count: int
    broken_count: int
    worst: float  # m, by which the worst bound that was broken is off; 0 if none
    first_broken: str  # tick and finger of the first; empty if none


@dataclass(frozen=True, slots=True)
class PredictionsKept:
    """predicted_lower <= distance <= predicted_upper at the instant that was meant.

    Not a promise about a recorded hand: it may accelerate more than was said.
    """

    checked_count: int
    kept_count: int
    error_p50: float  # m, of predicted_distance; nan if nothing was predicted
    error_p95: float  # m


@dataclass(frozen=True, slots=True)
class TouchesForetold:
    """time_to_contact_lower, before touches that came: not above the time that was left.

    Not a promise about a recorded hand: it does not keep its velocity.
    """

    checked_count: int
    kept_count: int


def judge_bounds(scene: Scene, run: Replay, radius: float) -> BoundsKept:
    """Hold the bounds of a sample of all finger-ticks against the exact distance.

    Parameters
    ----------
    scene : Scene
        As it was during the run.
    run : Replay
        What was answered.
    radius : float, m
        Of the fingertips.
    """
    ticks, rows = _sample(_is_tracked(run))
    contacts = run.contacts[ticks, rows]
    points = run.recording.positions[ticks, rows]
    true = scene.signed_distance(points) - radius
    workspace = CHECK_ROUNDING * (np.abs(true) + radius) + COORDINATE_ROUNDING * _largest_coordinate(
        scene, points
    )
    workspace[np.isinf(true)] = 0.0  # no part is shown: so far is nothing by rounding
    # written so that nan is a broken promise
    is_kept = (contacts["lower"] <= true + workspace) & (true - workspace <= contacts["upper"])
    broken, found = contacts[~is_kept], true[~is_kept]
    off = np.fmax(broken["lower"] - found, found - broken["upper"])
    first = ""
    if len(off):
        worst = int(np.argmin(is_kept))
        at = run.recording.times_ns[ticks[worst]] / NANOSECONDS
        first = (
            f"{run.recording.finger_name(int(rows[worst]))} at {at:.6f} s: "
            f"{contacts['lower'][worst]:.9g} <= {true[worst]:.9g} <= {contacts['upper'][worst]:.9g} m"
        )
    return BoundsKept(len(ticks), len(off), float(np.fmax.reduce(off, initial=0.0)), first)


def judge_predictions(scene: Scene, run: Replay, radius: float) -> PredictionsKept:
    """Hold predicted distances against those where the finger really was, between two ticks.

    Parameters
    ----------
    scene : Scene
        As it was during the run.
    run : Replay
        What was answered.
    radius : float, m
        Of the fingertips.
    """
    is_predicted = _is_tracked(run) & _has(run, ContactFlag.PREDICTED)
    ticks, rows = _sample(is_predicted & np.isfinite(run.contacts["predicted_distance"]))
    contacts = run.contacts[ticks, rows]
    points = _positions_at(run, contacts["predicted_ns"], rows)
    is_known = ~np.isnan(points).any(axis=1)
    contacts, points = contacts[is_known], points[is_known]
    true = scene.signed_distance(points) - radius
    is_kept = (contacts["predicted_lower"] <= true) & (true <= contacts["predicted_upper"])
    errors = np.abs(contacts["predicted_distance"] - true)
    p50, p95 = np.percentile(errors, [50, 95]) if len(errors) else (np.nan, np.nan)
    return PredictionsKept(len(points), int(is_kept.sum()), float(p50), float(p95))


def judge_touches(run: Replay) -> TouchesForetold:
    """Hold lower bounds of the time to contact against the touches that came.

    A finger-tick counts if the finger was seen from then on until it touched.
    """
    is_tracked = _is_tracked(run)
    count = len(is_tracked)
    next_touch = _next(touching(run), count)
    next_loss = _next(~is_tracked, count)
    counts = is_tracked & _has(run, ContactFlag.PREDICTED) & (next_touch < count) & (next_touch < next_loss)
    ticks, rows = np.nonzero(counts)
    times_ns = run.recording.times_ns
    left = (times_ns[next_touch[ticks, rows]] - times_ns[ticks]) / NANOSECONDS
    lower = run.contacts["time_to_contact_lower"][ticks, rows]
    return TouchesForetold(len(ticks), int((lower <= left).sum()))


def touching(run: Replay) -> np.ndarray:
    """Where a fingertip touches or is inside, as it was answered, (T, N)."""
    return _is_tracked(run) & ~_has(run, ContactFlag.SKIPPED) & (run.contacts["signed_distance"] <= 0.0)


def _is_tracked(run: Replay) -> np.ndarray:
    return _has(run, ContactFlag.TRACKED)


def _has(run: Replay, flag: ContactFlag) -> np.ndarray:
    return (run.contacts["flags"] & np.uint32(flag)) != 0


def _sample(is_meant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tick and finger of at most `CHECKED_COUNT` answers, evenly chosen."""
    ticks, rows = np.nonzero(is_meant)
    step = max(1, -(-len(ticks) // CHECKED_COUNT))
    if step > 1 and is_meant.shape[1] % step == 0:
        step += 1  # else the same fingers would be taken at every tick
    return ticks[::step], rows[::step]


def _next(is_so: np.ndarray, none: int) -> np.ndarray:
    """For each tick and finger the first tick, from this one on, at which it is so; *none* if never."""
    ticks = np.where(is_so, np.arange(len(is_so))[:, None], none)
    return np.minimum.accumulate(ticks[::-1], axis=0)[::-1]


def _positions_at(run: Replay, at_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Positions of fingers *rows* at *at_ns*, (K, 3), between two ticks; nan where either has none."""
    times_ns, positions = run.recording.times_ns, run.recording.positions
    after = np.searchsorted(times_ns, at_ns, side="left")
    is_past = after == len(times_ns)
    after[is_past] = len(times_ns) - 1
    before = np.where(times_ns[after] == at_ns, after, np.maximum(after - 1, 0))
    span = np.maximum(times_ns[after] - times_ns[before], 1)
    start, end = positions[before, rows], positions[after, rows]
    found = start + ((at_ns - times_ns[before]) / span)[:, None] * (end - start)
    found[is_past | (at_ns < times_ns[0])] = np.nan
    return found


def _largest_coordinate(scene: Scene, points: np.ndarray) -> float:
    lower, upper = scene.bounds
    return float(max(np.abs(lower).max(), np.abs(upper).max(), np.abs(points).max(initial=0.0)))
