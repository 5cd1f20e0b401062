"""Recorded hands: predicted positions compared with positions recorded shortly after."""

from functools import cache

import numpy as np
import pytest
from fingers import Finger
from project import RECORDED_HANDS

from proximity.kernels.contact_record import PREDICTED
from proximity.kernels.tracking.motion import JUMP_SLACK, MAX_SPEED

pytestmark = pytest.mark.internals


@cache
def recordings():
    """Times (s) and positions (m) of each finger of all recordings."""
    fingers = []
    for path in RECORDED_HANDS:
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        for hand, finger in np.unique(rows[:, 1:3], axis=0):
            own = rows[(rows[:, 1] == hand) & (rows[:, 2] == finger)]
            fingers.append((own[:, 0], own[:, 3:6]))
    return fingers


def predictions(h):
    """Errors of each pose, held and predicted, *h* later; the predicted bound; two masks.

    The recording is interpolated linearly; poses before a gap of more than 30 ms are skipped. A pose is
    *moving* when the last difference is faster than 0.1 m/s, and *clean* when its velocity is known and no
    tracking jump lies between the previous pose and the compared position.
    """
    found = []
    for times, places in recordings():
        finger = Finger()
        steps = np.diff(times)
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        is_jump = lengths > MAX_SPEED * steps + JUMP_SLACK
        for pose, (time, place) in enumerate(zip(times, places, strict=True)):
            status = finger.see(10**18 + round(1e9 * time), place)
            after = np.searchsorted(times, time + h)
            if pose == 0 or after == len(times) or steps[pose:after].max() > 0.03:
                continue
            truth = np.array([np.interp(time + h, times, places[:, axis]) for axis in range(3)])
            step, rho = finger.after(h)
            found.append(
                (
                    np.linalg.norm(truth - place),
                    np.linalg.norm(truth - place - step),
                    rho,
                    lengths[pose - 1] > 0.1 * steps[pose - 1],
                    bool(status & PREDICTED) and not is_jump[pose - 1 : after].any(),
                )
            )
    held, error, rho, is_moving, is_clean = np.array(found).T
    return held, error, rho, is_moving > 0.0, is_clean > 0.0


@pytest.mark.usefixtures("shared_data")
def test_recorded_fingers_are_predicted_over_nine_milliseconds():
    held, error, _, is_moving, is_clean = predictions(0.009)

    assert len(held) > 15_000 and is_moving.sum() > 7_500 and (~is_clean).sum() < 20
    assert np.quantile(held[is_moving], 0.95) == pytest.approx(8.54e-3, abs=0.05e-3)
    # including jumps; and for all poses, including those at rest
    assert 2.4e-3 < np.quantile(error[is_moving], 0.95) <= 2.6e-3
    assert 1.9e-3 < np.quantile(error, 0.95) <= 2.1e-3


@pytest.mark.usefixtures("shared_data")
def test_bound_holds_for_recorded_fingers():
    _, error, rho, _, is_clean = predictions(0.009)
    is_kept = error <= rho

    assert 0.999 <= is_kept[is_clean].mean() < 0.9999
    assert 9e-3 < np.median(rho) < 11e-3
