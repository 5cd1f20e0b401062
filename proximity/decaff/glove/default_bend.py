"""Bend assumed where none is reported: the finger bends straight into what is nearest.

For simulated drums only, so that they have something to do behind a service that knows fingertips alone. A
real drum without a bend stays retracted.
"""

import math
from typing import Any

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import CONTACT_BEND
from proximity.message import Mode

SLOPE_STEP = 1e-3  # m, of a difference
NEAR = (Mode.POSITION, Mode.FORCE)


def with_bend(contact: Any, path: FingerPath) -> Any:
    """Return a record as if the finger bent straight into what is nearest; itself where nothing is near."""
    distance, closing = float(contact["signed_distance"]), float(contact["approach_speed"])
    if not math.isfinite(distance):
        return contact
    position = path.position(CONTACT_BEND) - distance
    reported, bend = contact.copy(), path.bend(position)
    reported["bend"] = bend
    reported["bend_rate"] = (path.bend(position + SLOPE_STEP) - bend) / SLOPE_STEP * closing
    if int(contact["mode"]) in NEAR:
        reported["contact_bend"], reported["contact_bend_error"] = CONTACT_BEND, 0.0
    else:
        reported["bend_rate"] = math.nan  # nothing will be touched: nothing is to be extrapolated
    return reported
