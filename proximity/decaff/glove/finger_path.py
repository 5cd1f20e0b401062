"""Tables of the positions of fingertip and drum along the finger's path, in metres.

A *position* is the fingertip's path length from the flat hand. The drum's position is the one where it meets
the finger. Larger positions are farther from the finger. A controller evaluates them many times per
millisecond, so that tables replace the equations of the linkage, which would have to be inverted.
"""

from bisect import bisect_right

import numpy as np

from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.glove import CONTACT_BEND, Glove
from proximity.errors import ArgumentError

BENDS = np.linspace(-0.05, 1.05, 2201)
"""Bends of the tables. Interpolation between two neighbours is exact to a micrometre."""

MIN_BEND, MAX_BEND = -0.1, 1.1
"""Limits of a plausible bend, as a warm hand bends a little farther than when it was measured. Assumed."""


class FingerPath:
    """Positions of fingertip and drum, as tables."""

    retracted: float
    """Position of the drum farthest from the finger, m. It may be beyond the fist."""
    drum_angles: tuple[float, float]
    """Angles of the drum, rad, at the flat hand or slightly beyond it, and when retracted."""
    drum: Drum
    """The drum at the fingertip, at `CONTACT_BEND`."""
    play: float
    """Backlash of the cable at the fingertip, m, at the same bend."""
    designed_retracted: float
    """Angle of the retracted drum by the design alone, rad, which is the origin of homing.

    It is the same before and after a calibration.
    """

    def __init__(self, glove: Glove | CalibratedGlove) -> None:
        angles = np.asarray(glove.drum_angle(BENDS), np.float64)
        flat = int(np.searchsorted(BENDS, 0.0))
        rises = np.diff(angles) > 0.0  # nan does not
        stops = np.flatnonzero(~rises[flat:])
        last = flat + int(stops[0]) if len(stops) else len(BENDS) - 1
        starts = np.flatnonzero(~rises[:flat])
        first = int(starts[-1]) + 1 if len(starts) else 0
        if last <= flat:
            raise ArgumentError(
                "the drum moves backwards at the flat hand, expected a drum that follows the finger"
            )
        bends = BENDS[first : last + 1]
        # Lists are used, as NumPy takes ten times longer for a single number.
        self._bends, self._angles = bends.tolist(), angles[first : last + 1].tolist()
        self._positions = np.asarray(glove.finger.path_length(0.0, bends), np.float64).tolist()
        self.retracted = self._positions[-1]
        self.drum_angles = self._angles[0], self._angles[-1]
        self.designed_retracted = self.drum_angles[1]
        worn = glove.glove if isinstance(glove, CalibratedGlove) else glove
        if worn is not glove:
            self.designed_retracted = FingerPath(worn).drum_angles[1]
        self.drum, self.play = worn.tip_drum(), float(worn.tip_play(CONTACT_BEND))

    def tables(self) -> tuple[list[float], list[float], list[float]]:
        """Return the tables of bends, positions, m, and angles of the drum, rad, each of them increasing."""
        return self._bends, self._positions, self._angles

    def position(self, bend: float) -> float:
        """Return the position of the fingertip at a bend, m. It is constant beyond the table."""
        return _between(bend, self._bends, self._positions)

    def bend(self, position: float) -> float:
        """Return the bend at a position of the fingertip."""
        return _between(position, self._positions, self._bends)

    def drum_position(self, angle: float) -> float:
        """Return the position where the drum meets the finger, m.

        Beyond the table it is extrapolated linearly.
        """
        return _along(angle, self._angles, self._positions)

    def drum_angle(self, position: float) -> float:
        """Return the angle at which the drum meets the finger, rad.

        Beyond the table it is extrapolated linearly.
        """
        return _along(position, self._positions, self._angles)

    def lever(self, angle: float) -> float:
        """Return the displacement of the fingertip per radian of the drum, m.

        It is also the torque of the drum, N m, per newton at the fingertip.
        """
        i = min(max(bisect_right(self._angles, angle), 1), len(self._angles) - 1)
        along = self._positions[i] - self._positions[i - 1]
        return along / (self._angles[i] - self._angles[i - 1]) if angle == angle else float("nan")


def _between(x: float, xs: list[float], ys: list[float]) -> float:
    """Interpolate linearly, with constant values beyond the ends and nan for nan."""
    return _along(min(max(x, xs[0]), xs[-1]) if x == x else x, xs, ys)


def _along(x: float, xs: list[float], ys: list[float]) -> float:
    """Interpolate linearly, and extrapolate beyond the ends with the last slope."""
    i = min(max(bisect_right(xs, x) - 1, 0), len(xs) - 2)
    return ys[i] + (ys[i + 1] - ys[i]) * ((x - xs[i]) / (xs[i + 1] - xs[i]))
