"""Fit of a calibration's numbers to measurements (docs/guide/motors.md).

Each function raises an error for inconsistent measurements. The following example writes the file that
``proximity drum --glove`` and the [glove] section of a scene file read::

    from datetime import UTC, datetime

    from proximity.decaff.calibration import fit
    from proximity.decaff.glove.calibration import Calibration, write_calibration
    from proximity.decaff.glove.glove import Glove

    glove = Glove()  # as designed; lengths, pulleys and potentiometer of another glove are its arguments
    bends = [0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6, 1]  # flat hand to fist, slowly closing, the cable slack
    counts = [21845, 26681, 31072, 35008, 38430, 41287, 43559]  # what the potentiometer read there
    calibration = Calibration(
        made=datetime.now(UTC),
        counts=counts,
        bends=bends,
        touch_offset=fit.touch_offset(glove, [26681, 35008, 41287], [0.579, 1.178, 1.629]),
        cable_compliance=fit.cable_compliance(glove, [35008, 34962], tensions=[0.0, 2.0]),
        backlash=fit.backlash(glove, closing_counts=35008, opening_counts=35078),
        latency=fit.step_latency([0.0, 1e-3, 2e-3, 3e-3], [0.0, 0.0, 0.1, 1.0], step_time=1e-3),
        phalanges=glove.finger.phalanges,
    )
    write_calibration("glove.json", calibration)
"""

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import as_float64, finite
from proximity.decaff.glove.calibrated_glove import TOUCH_TOLERANCE
from proximity.decaff.glove.glove import Glove
from proximity.errors import DecaffError

MIN_TOUCHES = 3
"""Minimum number of touches. At each, the drum is driven slowly and with little force."""
STEP_SHARE = 0.1
"""Share of a step at which its response begins."""


def touch_offset(glove: Glove, counts: ArrayLike, drum_angles: ArrayLike) -> float:
    """Return the drum angle that the encoder reads at a touch, minus that of the geometry, rad.

    The angle alpha of a drum on a coaxial arm is that of the geometry plus this offset.
    """
    replica = glove.potentiometer.angle(_measured("counts", counts))
    reported = _measured("drum_angles", drum_angles)
    if len(replica) != len(reported) or len(reported) < MIN_TOUCHES:
        raise DecaffError(
            f"{len(replica)} counts and {len(reported)} drum angles at touches, "
            f"expected {MIN_TOUCHES} or more of each"
        )
    offsets = reported - glove.drum.drum_angle(replica)
    scale = glove.tip_per_radian(glove.bend(replica))
    mean = float(offsets.mean())
    off = float(np.abs((offsets - mean) * scale).max())
    if not off <= TOUCH_TOLERANCE:
        raise DecaffError(
            f"the touches disagree by {1e3 * off:.2f} mm, expected {1e3 * TOUCH_TOLERANCE:g} mm at most: "
            "repeat the touches"
        )
    return mean


def cable_compliance(glove: Glove, counts: ArrayLike, tensions: ArrayLike = (0.0, 2.0)) -> float:
    """Return the stretch of the cable per newton, m/N, measured with a fixed finger."""
    read, pulled = _measured("counts", counts), _measured("tensions", tensions)
    if not len(read) == len(pulled) == 2:
        raise DecaffError(f"{len(read)} counts and {len(pulled)} tensions, expected two of each")
    (slack, taut), (least, most) = read, pulled
    travel = (slack - taut) / glove.potentiometer.gain * glove.cable.replica_pulley
    compliance = float(travel / (most - least)) if most != least else np.nan
    if not (np.isfinite(compliance) and compliance >= 0.0):
        raise DecaffError(
            f"counts went from {slack:g} to {taut:g} as the tension went from {least:g} to {most:g} N, "
            "expected fewer under more tension"
        )
    return compliance


def backlash(glove: Glove, closing_counts: float, opening_counts: float) -> float:
    """Return the backlash of the cable, m, from the counts at one bend reached from both directions."""
    finite("closing_counts", closing_counts, "counts of the potentiometer")
    finite("opening_counts", opening_counts, "counts of the potentiometer")
    travel = (opening_counts - closing_counts) / glove.potentiometer.gain * glove.cable.replica_pulley
    if travel < 0.0:
        raise DecaffError(
            f"counts are {closing_counts:g} closing and {opening_counts:g} opening, "
            "expected at least as many opening"
        )
    return float(travel)


def step_latency(times: ArrayLike, values: ArrayLike, step_time: float) -> float:
    """Return the time from a step until its response reaches a tenth of its height, s."""
    finite("step_time", step_time, "seconds")
    instants, answer = _measured("times", times), _measured("values", values)
    is_usable = len(instants) == len(answer) >= 2
    if not (is_usable and np.isfinite(answer).all() and (np.diff(instants) > 0.0).all()):
        raise DecaffError(
            "times and values of a step test do not match, expected two or more of each, with "
            "increasing times"
        )
    before = instants <= step_time
    rest = float(answer[before].mean()) if before.any() else np.nan
    change = float(answer[-1]) - rest
    share = (answer - rest) / change if change else np.full(len(answer), np.nan)
    begun = np.flatnonzero(share >= STEP_SHARE)
    if not len(begun) or before[begun[0]]:
        raise DecaffError(
            f"no response follows the step at {step_time:g} s, expected one that begins after it"
        )
    row = int(begun[0])
    passed = np.interp(STEP_SHARE, share[row - 1 : row + 1], instants[row - 1 : row + 1])
    return float(passed - step_time)


def _measured(name: str, values: ArrayLike) -> np.ndarray:
    """Return measurements as a row of numbers."""
    return np.ravel(as_float64(values, name, expected="a row of numbers"))
