"""Bits and fields of a contact record; `message.CONTACT` documents them, a test compares both."""

import numpy as np

from proximity.kernels.layout import NO_FACE, NO_PART
from proximity.native import record

TRACKED = 1
PREDICTED = 2
EXACT = 4
BOUNDED = 8
SKIPPED = 16
SIGNED = 32
INSIDE = 64
IN_RANGE = 128
PART_CHANGED = 256
JUMPED = 512
ON_PATH = 1024
CONTACT_FOUND = 2048

SURFACE_UNKNOWN = 0
SURFACE_RIGID = 1
SURFACE_DEFORMABLE = 2

MODE_RETRACT = 0
MODE_POSITION = 1
MODE_FORCE = 2
MODE_HOLD = 3

CONTACT_RECORD = record(
    "Contact",
    finger="u4",
    flags="u4",
    pose_ns="i8",
    age_ns="i8",
    position="(3,)f8",
    velocity="(3,)f8",
    signed_distance="f8",
    lower="f8",
    upper="f8",
    point_on_finger="(3,)f8",
    point_on_part="(3,)f8",
    normal="(3,)f8",
    part_velocity="(3,)f8",
    approach_speed="f8",
    predicted_ns="i8",
    predicted_distance="f8",
    predicted_lower="f8",
    predicted_upper="f8",
    time_to_contact="f8",
    time_to_contact_lower="f8",
    bend="f8",
    bend_rate="f8",
    contact_bend="f8",
    contact_bend_error="f8",
    contact_bend_rate="f8",
    stiffness="f8",
    damping="f8",
    force="f8",
    part="i4",
    face="i4",
    work="u4",
    surface="u1",
    mode="u1",
    source="u1",
    force_is_valid="u1",
)
"""Contact record of one finger; `message.CONTACT` documents its fields.

Kernels write ``record["flags"]``: interpreted, ``record.flags`` would be those of the NumPy object."""


def unknown_contact():
    """Return the record, (1,), of a finger without any measurement."""
    unknown = np.zeros(1, CONTACT_RECORD)
    for name in CONTACT_RECORD.names:
        if unknown[name].dtype == np.float64:
            unknown[name] = np.nan
    unknown["lower"] = unknown["predicted_lower"] = -np.inf
    unknown["upper"] = unknown["predicted_upper"] = np.inf
    for name in ("time_to_contact_lower", "stiffness", "damping", "force"):
        unknown[name] = 0.0
    unknown["part"], unknown["face"] = NO_PART, NO_FACE
    return unknown
