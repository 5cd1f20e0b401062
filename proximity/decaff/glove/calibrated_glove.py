"""Calibrated glove, which converts potentiometer counts to bend, and bend to drum angle.

The model of cable and linkage (`glove`) is used for forces only. The bend comes from the measured table. The
position of the drum comes from the potentiometer, which is mounted on the replica that the drum touches.
"""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from proximity.checks import positive
from proximity.decaff.glove.calibration import (
    Calibration,
    check_age,
    read_calibration,
    read_glove_file,
)
from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError, DecaffError
from proximity.message import PATH_CORNERS
from proximity.pose import Pose

G = TypeVar("G")
LOGGER = logging.getLogger("proximity.gloves")
TOUCH_TOLERANCE = 0.3e-3
"""Tolerance of a touch, m at the fingertip."""
RANGE_MARGIN = 0.05
"""Share of the table's range by which counts may exceed it, as a warm hand bends farther. Assumed."""
MAX_OFF = 0.5
"""Share of the design's range of counts by which a table may differ from it, as mountings do. Assumed."""
MAX_UNEVEN = 5.0
"""Maximum ratio, either way, of the measured to the designed slope between two points. Assumed."""
INVERSE = np.linspace(0.0, 1.0, 4097)
"""Bends at which the table is inverted. Interpolation between them is exact to a hundredth of a count."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedGlove:
    """A glove with its measurements. Raises an error if the table cannot belong to the glove."""

    glove: Glove  # as designed; its finger is replaced by the measured one
    calibration: Calibration
    _table: PchipInterpolator = field(init=False, repr=False)
    _inverse: np.ndarray = field(init=False, repr=False)  # at INVERSE

    def __post_init__(self) -> None:
        counts, bends = self.calibration.counts, self.calibration.bends
        last = self.glove.potentiometer.count - 1
        if counts[0] < 0.0 or counts[-1] > last:
            raise DecaffError(
                f"the table has counts from {counts[0]:g} to {counts[-1]:g}, expected 0 to {last} of this "
                "potentiometer"
            )
        object.__setattr__(self, "glove", _as_measured(self.glove, self.calibration))
        _check_table(self.glove, self.calibration)
        object.__setattr__(self, "_table", PchipInterpolator(counts, bends))
        dense = np.linspace(counts[0], counts[-1], len(INVERSE) * 4)
        inverse = np.interp(INVERSE, self._table(dense), dense)
        object.__setattr__(self, "_inverse", inverse)

    @property
    def finger(self) -> Finger:
        """Measured finger."""
        return self.glove.finger

    def bend_of_counts(
        self, counts: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return the bend at potentiometer counts, (...), or nan for counts that no hand can reach."""
        read = np.asarray(counts, np.float64)
        behind = np.asarray(tension, np.float64) * self.calibration.cable_compliance
        ahead = np.where(is_closing, 0.0, self.calibration.backlash)
        turn = (behind - ahead) / self.glove.cable.replica_pulley
        position = read + self.glove.potentiometer.gain * turn
        first, last = self.calibration.counts[[0, -1]]
        margin = RANGE_MARGIN * (last - first)
        is_near = (position >= first - margin) & (position <= last + margin)
        return np.where(is_near, self._extended_bend(position), np.nan)

    def counts(self, bend: ArrayLike) -> np.ndarray:
        """Return the potentiometer's counts at a bend as the finger closes, (...), float64."""
        position = np.asarray(bend, np.float64)
        inside = np.clip(position, 0.0, 1.0)
        first, last = self.calibration.counts[[0, -1]]
        return np.interp(inside, INVERSE, self._inverse) + (position - inside) * (last - first)

    def counts_table(self, row_count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return evenly spaced counts over the range of a hand, (K,), and their bends, (K,)."""
        first, last = self.calibration.counts[[0, -1]]
        margin = RANGE_MARGIN * (last - first)
        counts = np.linspace(first - margin, last + margin, row_count)
        return counts, self._extended_bend(counts)

    def path_finger(self) -> np.ndarray:
        """Return the fingertip's path from flat hand to fist, (K, 3), m, in the finger's frame.

        The points are evenly spaced in bend.
        """
        return self.finger.path_world(Pose(), PATH_CORNERS)

    def drum_angle(self, bend: ArrayLike) -> np.ndarray:
        """Return the encoder's angle at which the drum meets the finger, (...), rad, or nan if it cannot."""
        replica = self.glove.potentiometer.angle(self.counts(bend))
        return self.glove.drum.drum_angle(replica) + self.calibration.touch_offset

    def _extended_bend(self, counts: np.ndarray) -> np.ndarray:
        """Return the bend by the table, extrapolated beyond its ends with its mean slope.

        The slope at the ends may be 0.
        """
        first, last = self.calibration.counts[[0, -1]]
        inside = np.clip(counts, first, last)
        return self._table(inside) + (counts - inside) / (last - first)


def _as_measured(glove: Glove, calibration: Calibration) -> Glove:
    """Return a glove with the measured finger, cable and drum."""
    compliance = calibration.cable_compliance
    cable = replace(
        glove.cable,
        stiffness=1.0 / compliance if compliance > 0.0 else np.inf,
        backlash=calibration.backlash,
    )
    finger, motor = replace(glove.finger, phalanges=calibration.phalanges), glove.motor
    if calibration.drum_inertia is not None:
        rotor = calibration.drum_inertia / glove.gear.ratio**2 - glove.gear.inertia
        motor = replace(
            motor, inertia=positive("the rotor's measured inertia", rotor, "kilogram square metres")
        )
    if calibration.drum_latency is not None:
        motor = replace(motor, latency=calibration.drum_latency)
    if calibration.drum_friction is not None:
        motor = replace(motor, friction=calibration.drum_friction / glove.gear.ratio)
    return replace(glove, finger=finger, cable=cable, motor=motor)


def _check_table(glove: Glove, calibration: Calibration) -> None:
    """Raise an error if counts differ too much from those of the designed potentiometer and linkage."""
    counts, bends = calibration.counts, calibration.bends
    designed = glove.potentiometer.counts(glove.replica_angle(bends))
    most = MAX_OFF * abs(designed[-1] - designed[0])
    off = np.abs(counts - designed)
    row = int(np.argmax(off))
    if not off[row] <= most:
        raise DecaffError(
            f"the table has {counts[row]:g} counts at bend {bends[row]:g}, expected {designed[row]:.0f}, "
            f"within {most:.0f}, from the design of this glove"
        )
    steps, expected = np.diff(counts), np.diff(designed)
    uneven = np.flatnonzero((MAX_UNEVEN * steps < expected) | (steps > MAX_UNEVEN * expected))
    if len(uneven):
        row = int(uneven[0])
        raise DecaffError(
            f"counts go up by {steps[row]:g} from bend {bends[row]:g} to {bends[row + 1]:g}, expected about "
            f"{expected[row]:.0f}, from the design of this glove"
        )


# --- reading a file ---


def read_glove(path: str | os.PathLike[str], max_days: float | None = None) -> CalibratedGlove:
    """Read a measured glove from a file. Raise an error if its calibration is too old.

    The calibration of a simulated glove is reported by a warning, once for each file.
    """
    return _worn(path, read_calibration(path), max_days)


def read_any_glove(path: str | os.PathLike[str], max_days: float | None = None) -> Glove | CalibratedGlove:
    """Read a measured glove as `read_glove` does, or a designed one from a file without measurements."""
    found = read_glove_file(path)
    return found if isinstance(found, Glove) else _worn(path, found, max_days)


def _worn(path: str | os.PathLike[str], calibration: Calibration, max_days: float | None) -> CalibratedGlove:
    if calibration.is_simulated:
        _warn_of_simulated(os.fsdecode(path))
    try:
        check_age(calibration, max_days=max_days)
        return CalibratedGlove(calibration.design, calibration)
    except (ArgumentError, DecaffError) as unfit:
        raise DecaffError(f"{os.fsdecode(path)}: {unfit}") from unfit


@cache
def _warn_of_simulated(path: str) -> None:
    LOGGER.warning("%s: this is the calibration of a simulated glove, not of a hand", path)


def as_many(gloves: Sequence[G], count: int) -> list[G]:
    """Return one glove per finger. A single glove is repeated for all fingers."""
    if len(gloves) not in (1, count):
        raise DecaffError(
            f"{len(gloves)} calibrations for {count} fingers, expected one for all, or one for each"
        )
    return list(gloves) * count if len(gloves) == 1 else list(gloves)
