"""Calibrations of gloves for tests, as careful measurement would give."""

from datetime import UTC, datetime, timedelta

import numpy as np

from proximity.decaff.glove.calibration import Calibration, write_calibration
from proximity.decaff.glove.glove import Glove
from proximity.decaff.glove.transmission import Cable

HAND = Glove(cable=Cable(hand_pulley=0.0205, backlash=0.15e-3))
"""The true glove: its pulley and cable differ slightly from the design."""
BENDS = np.linspace(0.0, 1.0, 7)
MOUNTED = 0.031
"""Offset of the drum's encoder from the geometry, rad."""


def write(path, *, days_ago=1.0, **changes):
    """Write a calibration to a file; return its path."""
    values = {
        "made": datetime.now(UTC) - timedelta(days=days_ago),
        "counts": HAND.counts(BENDS),
        "bends": BENDS,
        "touch_offset": MOUNTED,
        "cable_compliance": 1.0 / 20e3,
        "backlash": 0.15e-3,
        "latency": 0.9e-3,
        "phalanges": HAND.finger.phalanges,
    }
    write_calibration(path, Calibration(**(values | changes)))
    return path
