"""Check of the bounds after a replay, by queries independent of tracks and budgets."""

from dataclasses import dataclass

import numpy as np

from benchmarks.replay.replay_loop import Replay
from proximity.message import ContactFlag
from proximity.recording import NANOSECONDS
from proximity.scene.scene import Scene

CHECKED_COUNT = 20_000  # finger-ticks, evenly chosen
CHECK_ROUNDING = 1e-12  # of a distance: maximum difference of two methods of computing it
VELOCITY_SHARE = 0.05
"""Maximum distance of a finger from the path at constant velocity, as a share of its displacement."""
ROUNDING_OF_PATH = 1e-9  # m, and of a radius: positions are differences of a recording's coordinates
COORDINATE_ROUNDING = 8.0 * 2.0**-52  # of the largest coordinate: error of a distance of 0


@dataclass(frozen=True, slots=True)
class BoundsKept:
    """lower <= true <= upper, over a sample of the finger-ticks."""

    checked_count: int
    broken_count: int
    worst: float  # m, excess of the worst broken bound; 0 if none
    first_broken: str  # tick and finger of the first; empty if none


@dataclass(frozen=True, slots=True)
class PredictionsKept:
    """predicted_lower <= distance <= predicted_upper at the predicted instant.

    Not guaranteed for a recorded hand: it may exceed the given acceleration.
    """

    checked_count: int
    kept_count: int
    error_p50: float  # m, of predicted_distance; nan without predictions
    error_p95: float  # m


@dataclass(frozen=True, slots=True)
class CertifiedTimes:
    """time_to_contact_lower, while the finger kept its velocity: no surface was touched before.

    A certified time is checked if the finger was seen until then, or until it touched, and was never farther
    from the straight path at its velocity than `VELOCITY_SHARE` of the displacement.
    """

    checked_count: int
    broken_count: int
    first_broken: str  # instant and finger of the first; empty if none


def judge_bounds(scene: Scene, run: Replay, radius: float) -> BoundsKept:
    """Compare the bounds of a sample of all finger-ticks with the exact distance."""
    ticks, rows = _sample(_is_tracked(run))
    contacts = run.contacts[ticks, rows]
    points = run.recording.positions[ticks, rows]
    true = scene.signed_distance(points) - radius
    workspace = CHECK_ROUNDING * (np.abs(true) + radius) + COORDINATE_ROUNDING * _largest_coordinate(
        scene, points
    )
    workspace[np.isinf(true)] = 0.0  # no part is shown: rounding of inf is 0
    # written so that nan counts as broken
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
    """Compare predicted distances with the finger's true ones, between two ticks."""
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


def judge_certified_times(scene: Scene, run: Replay, radius: float) -> CertifiedTimes:
    """Compare the certified times of a sample of finger-ticks with the contacts of the fingers.

    Notes
    -----
    A touch before the certified time breaks it only if the path at constant velocity touches before it as
    well, by an exact query: else the permitted change of velocity led to the touch.
    """
    lower = run.contacts["time_to_contact_lower"]
    is_certified = _is_tracked(run) & _has(run, ContactFlag.PREDICTED) & (lower > 0.0) & (lower < np.inf)
    ticks, rows = _sample(is_certified)
    is_checked, touch_at = _followed(run, ticks, rows)
    suspects = np.flatnonzero(touch_at >= 0)
    contacts = run.contacts[ticks[suspects], rows[suspects]]
    starts = run.recording.positions[ticks[suspects], rows[suspects]]
    ends = starts + contacts["time_to_contact_lower"][:, None] * contacts["velocity"]
    clearance = scene.closest_to_segments(starts, ends).distance - radius
    broken = suspects[clearance < -ROUNDING_OF_PATH * radius]
    first = ""
    if len(broken):
        tick, row, touch = ticks[broken[0]], rows[broken[0]], touch_at[broken[0]]
        times = run.recording.times_ns / NANOSECONDS
        first = (
            f"{run.recording.finger_name(int(row))} at {times[tick]:.6f} s: touched after "
            f"{times[touch] - times[tick]:.6f} s, certified {lower[tick, row]:.6f} s"
        )
    return CertifiedTimes(int(is_checked.sum()), len(broken), first)


def _followed(run: Replay, ticks: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which certified times can be checked, and the tick of a touch before them, or -1."""
    times_ns, positions, is_touching = run.recording.times_ns, run.recording.positions, touching(run)
    velocity, lower = (run.contacts[name][ticks, rows] for name in ("velocity", "time_to_contact_lower"))
    speed = np.linalg.norm(velocity, axis=1)
    is_checked, touch_at = np.zeros(len(ticks), dtype=bool), np.full(len(ticks), -1)
    going, step = np.arange(len(ticks)), 0
    while len(going):
        step += 1
        going = going[ticks[going] + step < len(times_ns)]
        at, row = ticks[going] + step, rows[going]
        elapsed = (times_ns[at] - times_ns[ticks[going]]) / NANOSECONDS
        straight = positions[ticks[going], row] + elapsed[:, None] * velocity[going]
        off = np.linalg.norm(positions[at, row] - straight, axis=1)
        # Written so that a lost finger, whose position is nan, is left out.
        is_steady = off <= VELOCITY_SHARE * speed[going] * elapsed + ROUNDING_OF_PATH
        is_over = elapsed >= lower[going]
        is_touch = is_touching[at, row] & ~is_over
        is_checked[going[is_steady & (is_touch | is_over)]] = True
        touch_at[going[is_steady & is_touch]] = at[is_steady & is_touch]
        going = going[is_steady & ~is_touch & ~is_over]
    return is_checked, touch_at


def touching(run: Replay) -> np.ndarray:
    """Return whether a fingertip touches or is inside, by the answers, (T, N)."""
    return _is_tracked(run) & ~_has(run, ContactFlag.SKIPPED) & (run.contacts["signed_distance"] <= 0.0)


def _is_tracked(run: Replay) -> np.ndarray:
    return _has(run, ContactFlag.TRACKED)


def _has(run: Replay, flag: ContactFlag) -> np.ndarray:
    return (run.contacts["flags"] & np.uint32(flag)) != 0


def _sample(is_meant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return tick and finger of at most `CHECKED_COUNT` answers, evenly chosen."""
    ticks, rows = np.nonzero(is_meant)
    step = max(1, -(-len(ticks) // CHECKED_COUNT))
    if step > 1 and is_meant.shape[1] % step == 0:
        step += 1  # else the same fingers would be chosen at every tick
    return ticks[::step], rows[::step]


def _positions_at(run: Replay, at_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return positions of fingers *rows* at *at_ns*, (K, 3), between two ticks; nan if either has none."""
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
