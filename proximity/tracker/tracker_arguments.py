"""Checks of a tracker's arguments; each function raises a `ArgumentError` that says what was expected."""

import operator
from typing import Any

import numpy as np

from proximity.checks import FLOAT64, as_float64, shown
from proximity.errors import ArgumentError
from proximity.kernels.tracking.track import MOST_NS

LONGEST_LATENCY = 1.0
"""s, as in a scene file; 20 ms that are given as 20 are more."""
LARGEST_RADIUS = 0.1
"""m; no fingertip is larger, and 7 mm that are given as 7 are."""
LARGEST_WORKING_RANGE = 10.0
"""m; likewise 120 mm that are given as 120."""


def too_long(length: float, most: float) -> str:
    """Say of a length that cannot be meant what it is and what was expected; follows "… is "."""
    return f"{length:g} m ({1e3 * length:g} mm), expected at most {most:g} m: was it meant in millimetres?"


def shaped(values: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers as a float64 array of that shape."""
    # Nothing to do, as at nearly every tick, is seen first.
    if type(values) is np.ndarray and values.dtype is FLOAT64 and values.shape == shape:
        return values
    array = as_float64(values, f"values of {name}", expected=f"numbers of shape {shape}")
    if array.shape != shape:
        raise ArgumentError(f"{name} have shape {array.shape}, expected {shape}")
    return array


def instant(now_ns: Any) -> int:
    """Return an instant in nanoseconds."""
    try:
        now = operator.index(now_ns)
    except TypeError:
        now = MOST_NS + 1
    if not -MOST_NS <= now <= MOST_NS:
        raise ArgumentError(
            f"now_ns is {now_ns!r}, expected whole nanoseconds, at most 2**62, as of time.monotonic_ns()"
        )
    return now


def instants(t_pose_ns: Any, count: int) -> np.ndarray:
    """Return the instants of poses, ns, () or (count,)."""
    try:
        array = np.asarray(t_pose_ns)
        if array.dtype.kind not in "iu" or ((array < -MOST_NS) | (array > MOST_NS)).any():
            raise ValueError("no instants")
        return np.broadcast_to(array, (count,))
    except ValueError as unfit:
        raise ArgumentError(
            f"t_pose_ns is {shown(t_pose_ns)}, expected whole nanoseconds, at most 2**62: one number, or "
            f"one for each of {count} fingers"
        ) from unfit


def radii(radius: Any, count: int) -> np.ndarray:
    """Return the radius of each finger, m, (count,)."""
    array = as_float64(radius, "radii", expected="one radius in metres, or one a finger")
    if array.shape not in ((), (count,)) or not (np.isfinite(array) & (array >= 0.0)).all():
        raise ArgumentError(
            f"radius is {shown(radius)}, expected metres of 0 or more: one, or one for each of {count} "
            "fingers"
        )
    if (array > LARGEST_RADIUS).any():
        raise ArgumentError(f"radius is {too_long(float(array.max()), LARGEST_RADIUS)}")
    return np.broadcast_to(array, (count,))
