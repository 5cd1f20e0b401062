"""Choice of a local frame for a box, by shifting and scaling without rounding. See `mesh.bvh.LocalFrame`."""

from math import frexp, ldexp

import numpy as np

from proximity.kernels.thresholds import MAX_COORDINATE, SMALLEST_SIZE
from proximity.native import entry, inlined


@inlined
def _power_above(value):
    """Return the exponent of the least power of two that is not below a positive number."""
    share, exponent = frexp(value)
    return exponent - 1 if share == 0.5 else exponent


@entry("float64[:], float64[:], float64[:] -> float")
def frame_of_box(lower, upper, centre):
    """Write the centre of the local frame of a box, (3,) m, and return its scale. See `mesh.bvh.LocalFrame`.

    The scale is 0 if the box is too far away or too small for the arithmetic.
    """
    extent, largest, reach = 0.0, 0.0, 0.0
    for axis in range(3):
        extent = max(extent, upper[axis] - lower[axis])
        largest = max(largest, abs(lower[axis]), abs(upper[axis]))
    if largest > MAX_COORDINATE or 0.0 < extent < SMALLEST_SIZE:
        return 0.0
    grain = ldexp(1.0, _power_above(extent)) if extent > 0.0 else largest
    for axis in range(3):
        middle = 0.5 * lower[axis] + 0.5 * upper[axis]
        centre[axis] = 0.0
        # Within two sizes of the origin the difference could round; farther away it is exact.
        if abs(middle) >= 2.0 * grain:
            centre[axis] = np.rint(middle / grain) * grain if grain > 0.0 else middle
        if extent == 0.0:
            centre[axis] = lower[axis]
        reach = max(reach, abs(lower[axis] - centre[axis]), abs(upper[axis] - centre[axis]))
    return ldexp(1.0, -_power_above(reach)) if reach > 0.0 else 1.0
