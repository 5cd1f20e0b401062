"""Error of the predicted positions of recorded fingers."""

import numpy as np

from benchmarks.support.project import project_module
from benchmarks.support.verdicts import Verdict
from benchmarks.ticks import motions
from benchmarks.ticks.timing import TickRow
from proximity import Scene, Solid, Tracker

LATENCY_NS = 9_000_000
MAX_ERROR = 2.6e-3  # m
MOVING = 0.1  # m/s
MAX_STEP_NS = 30_000_000
WALL_DISTANCE = 1.0  # m


def measure_prediction(options) -> list[TickRow]:
    """Measure the distance of fingers from their predicted positions, 9 ms after their pose.

    Three distant walls, one across each axis: the change of the predicted distance to each is the predicted
    displacement of the finger along that axis. So the tick's answer is judged. Poses are those of the sensor;
    as in the test of the kernels, a pose counts if the finger moves faster than 0.1 m/s and no step of more
    than 30 ms follows.
    """
    held, errors = [], []
    for hand in motions.hands():
        if hand.name == "generated" and not motions.missing_hands():
            continue  # its positions come from a formula
        for of_held_pose, of_prediction in _errors_of(hand.recording):
            held.append(of_held_pose)
            errors.append(of_prediction)
    held_p95, error_p95, p50 = (
        float(np.percentile(np.concatenate(values), share))
        for values, share in ((held, 95), (errors, 95), (errors, 50))
    )
    verdict = Verdict(
        f"prediction: p95 of the error 9 ms ahead at most {1e3 * MAX_ERROR:g} mm",
        f"{1e3 * error_p95:.2f} mm; holding the pose {1e3 * held_p95:.2f} mm",
        error_p95 <= MAX_ERROR,
    )
    count = sum(map(len, errors))
    remark = f"{count} poses of fingers faster than {MOVING} m/s; half of the errors below {1e3 * p50:.2f} mm"
    return [TickRow("prediction", 1, 12, 5, count, verdicts=(verdict,), remarks=(remark,))]


def _errors_of(recording):
    """Yield for each finger the distances of its position 9 ms later from pose and prediction."""
    box = project_module("tests/support", "shapes").box
    positions, times_ns = recording.positions, recording.times_ns
    lower = np.nanmin(positions, axis=(0, 1))
    trackers = []
    for axis in range(3):
        low, high = lower - 100.0, lower + 130.0  # fingers are not opposite the diagonals of its faces
        high[axis] = lower[axis] - WALL_DISTANCE
        scene = Scene([Solid(*box(low, high), name="wall")])
        trackers.append(
            Tracker(scene, fingers=positions.shape[1], latency=1e-9 * LATENCY_NS, working_range=10.0)
        )
    predicted = np.full_like(positions, np.nan)
    for k, now in enumerate(times_ns.tolist()):
        for axis, tracker in enumerate(trackers):
            contacts = tracker.tick(positions[k], now, now)
            predicted[k, :, axis] = (
                positions[k, :, axis] + contacts["predicted_distance"] - contacts["signed_distance"]
            )
            assert (contacts["predicted_ns"] == now + LATENCY_NS).all()
    for finger, seen in enumerate(recording.is_present.T):
        if np.count_nonzero(seen) > 1:
            yield _compared(times_ns[seen], positions[seen, finger], predicted[seen, finger])


def _compared(times, positions, predicted):
    steps = np.diff(times)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / (1e-9 * steps)
    later = times + LATENCY_NS
    after = np.searchsorted(times, later)
    truth = np.stack([np.interp(later, times, positions[:, axis]) for axis in range(3)], axis=1)
    chosen = [
        k
        for k in range(1, len(times))
        if speeds[k - 1] > MOVING and after[k] < len(times) and steps[k : after[k]].max() <= MAX_STEP_NS
    ]
    return (
        np.linalg.norm(truth - positions, axis=1)[chosen],
        np.linalg.norm(truth - predicted, axis=1)[chosen],
    )
