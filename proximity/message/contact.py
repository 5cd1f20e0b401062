"""What a tick answers for one finger, as it is kept, logged and published.

One record is `CONTACT`. Kernels write by column number (`kernels.contact`); a test holds both together.
"""

import operator
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np

from proximity.kernels import contact


class ContactFlag(IntFlag):
    """What is known about a finger at this tick; a set of bits in ``contacts["flags"]``."""

    TRACKED = contact.TRACKED
    """The pose given for this tick was a position. Otherwise the bounds promise nothing: -inf and inf."""
    PREDICTED = contact.PREDICTED
    """The velocity is known, so that predictions and times to contact mean something."""
    EXACT = contact.EXACT
    """lower = signed_distance = upper."""
    BOUNDED = contact.BOUNDED
    """The work budget ran out: the bounds hold, the distance is the nearest surface found so far."""
    SKIPPED = contact.SKIPPED
    """Nothing was searched for: out of the working range, within the tolerance, or in a crowd whose steps
    were spent. The bounds follow from what was known before, and from how far finger and parts have moved."""
    SIGNED = contact.SIGNED
    """The side is known. Otherwise the distance has no sign: the nearest part has no inside."""
    INSIDE = contact.INSIDE
    """The centre of the fingertip is inside a part."""
    IN_RANGE = contact.IN_RANGE
    """The distance is within the working range."""
    PART_CHANGED = contact.PART_CHANGED
    """The nearest part is another than at the tick before: the closest point may have jumped."""
    JUMPED = contact.JUMPED
    """The pose is farther from the one before than a hand can move: the velocity starts anew."""
    ON_PATH = contact.ON_PATH
    """The place of contact is along the path that was given. So is the time, where the finger
    goes that way: where ``bend_rate`` is positive."""
    CONTACT_FOUND = contact.CONTACT_FOUND
    """The place of contact on the path is confirmed: within ``contact_bend_error``."""

    @classmethod
    def _missing_(cls, value: Any) -> Any:
        """Take the NumPy integer of a record as well."""
        return super()._missing_(operator.index(value))


class Surface(IntEnum):
    """How a part answers a touch."""

    UNKNOWN = contact.SURFACE_UNKNOWN
    RIGID = contact.SURFACE_RIGID
    DEFORMABLE = contact.SURFACE_DEFORMABLE


class Mode(IntEnum):
    """What the controller is advised to do with the drum (PAPER 8); on doubt it does less."""

    RETRACT = contact.MODE_RETRACT
    """Nothing will be touched within the horizon."""
    POSITION = contact.MODE_POSITION
    """A rigid surface is near or touched: the drum stands where the contact is."""
    FORCE = contact.MODE_FORCE
    """A deformable surface is near or touched: the drum presses by the surface's law."""
    HOLD = contact.MODE_HOLD
    """Nothing is known of the finger."""


_VECTOR = ("<f8", (3,))

CONTACT = np.dtype(
    [
        ("finger", "<u4"),  # row of the positions
        ("flags", "<u4"),  # ContactFlag
        ("pose_ns", "<i8"),  # instant of the pose: all but the predictions hold for it
        ("age_ns", "<i8"),  # of the pose at the tick
        ("position", *_VECTOR),  # m, centre of the fingertip sphere at pose_ns
        ("velocity", *_VECTOR),  # m/s, of the finger
        ("signed_distance", "<f8"),  # m, of the sphere: of its centre, less the radius
        ("lower", "<f8"),  # m, never above the true signed distance
        ("upper", "<f8"),  # m, never below it
        ("point_on_finger", *_VECTOR),  # m, the point of the sphere that is nearest
        ("point_on_part", *_VECTOR),  # m, the point of the surface that is nearest
        ("normal", *_VECTOR),  # unit, outward: steepest increase of the signed distance
        ("part_velocity", *_VECTOR),  # m/s, of the part at point_on_part
        ("approach_speed", "<f8"),  # m/s, -d/dt of the signed distance
        ("predicted_ns", "<i8"),  # instant at which the controller acts
        ("predicted_distance", "<f8"),  # m, expected then
        ("predicted_lower", "<f8"),  # m, if the finger accelerates by no more than was said
        ("predicted_upper", "<f8"),  # m
        ("time_to_contact", "<f8"),  # s from pose_ns; 0 in contact, inf if none within the horizon
        # s: no surface is touched before, for certain, as long as velocities stay, or the finger on its path.
        ("time_to_contact_lower", "<f8"),
        ("bend", "<f8"),  # of the finger at pose_ns: where on the path it is; nan without a path
        ("bend_rate", "<f8"),  # 1/s
        ("contact_bend", "<f8"),  # where on the path it touches first; nan if it does not
        ("contact_bend_error", "<f8"),  # no farther from the true one than this
        ("contact_bend_rate", "<f8"),  # 1/s, drift of contact_bend as the part moves; nan: not known
        ("stiffness", "<f8"),  # N/m, of a deformable part
        ("damping", "<f8"),  # N s/m
        ("force", "<f8"),  # N, of a deformable part on the finger, or measured
        ("part", "<i4"),  # index into scene.parts
        ("face", "<i4"),  # row of that part's solid.mesh.faces
        ("work", "<u4"),  # nodes and leaves visited
        ("surface", "<u1"),  # Surface
        ("mode", "<u1"),  # Mode
        ("source", "<u1"),  # Source
        ("force_is_valid", "<u1"),  # 1 where the force means something
    ]
)
"""One finger at one tick."""
