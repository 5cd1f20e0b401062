"""Arguments of a tracker: validation, arrays of a tick, and notes on poses of a wrong clock or unit.

Each check raises an `ArgumentError` with the expected value.
"""

import logging
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np

from proximity.checks import FLOAT64, as_float64, not_negative, positive, shown, whole
from proximity.core.receiver_state import AHEAD_NS
from proximity.errors import ArgumentError
from proximity.kernels.contact_record import unknown_contact
from proximity.kernels.layout import PART
from proximity.kernels.point.coherent_search import FRONTIER_SIZE
from proximity.kernels.tracking import track
from proximity.kernels.tracking.conservative_advancement import BALLS_SIZE
from proximity.kernels.tracking.finger_distance import CROWD
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES, FUTURE, TOO_OLD
from proximity.kernels.tracking.part_drift import POSE_COLUMNS, movers_workspace
from proximity.kernels.tracking.tick import ALL_IN_MILLIMETRES, DONE, HAS_DEFECT
from proximity.kernels.tracking.track import MAX_NS
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE
from proximity.message import ContactFlag
from proximity.message.instant_advice import FROM_FUTURE, OTHER_CLOCK_NS, on_future, on_too_old
from proximity.scene.model.assembly import Model
from proximity.scene.queries.checked_query import in_millimetres, size_of

LOGGER = logging.getLogger("proximity.tracker")
DEFAULT_BUDGET = 250
"""Nodes and leaves a finger and tick. Near CAD parts a traversal takes 10 to 60; near free forms 3 in 100 000
take more than this. At the centre of a ball of 1.3 M faces it takes 13 to 28 µs, limited by memory, and
bounds the distance within 4.1 %. With 350 it is 2.5 %, but on a busy machine one tick in a hundred of five
fingers took longer than 0.2 ms there; with 175 it is 6.4 %."""
MOST = 2**31 - 1
"""Nodes and leaves: more than in any scene."""
LONGEST_LATENCY = 1.0
"""s, as in a scene file; 20 ms given as 20 exceed it."""
MAX_RADIUS = 0.1
"""m; larger than any fingertip; 7 mm given as 7 exceed it."""
MAX_WORKING_RANGE = 10.0
"""m; 120 mm given as 120 exceed it."""
SHORTEST_NS = 1000
"""Shortest time between ticks, and from a clock's 0 to the first: a tick takes longer."""
EARLY_NS = 100_000
"""Smaller instants are in seconds if the other instant of the tick is more than `OTHER_CLOCK_NS` away."""
MAX_SECONDS = 10_000_000_000
"""More seconds than any clock or calendar shows."""
NOT_NANOSECONDS = "expected nanoseconds, as time.monotonic_ns() gives them: it looks like seconds"
TWO_CLOCKS = "t_pose_ns and now_ns may be of two clocks: take both from time.monotonic_ns()"


def length_error(length: float, most: float) -> str:
    """Return the reason why a length is probably in millimetres; follows "… is "."""
    return f"{length:g} m ({1e3 * length:g} mm), expected at most {most:g} m: was it meant in millimetres?"


def as_shape(values: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers as a float64 array of that shape, as kernels read it."""
    # The usual case first: the array can be used as it is.
    if type(values) is np.ndarray and values.dtype is FLOAT64 and values.shape == shape:
        flags = values.flags
        if flags.c_contiguous and flags.aligned:
            return values
    array = as_float64(values, f"values of {name}", expected=f"numbers of shape {shape}")
    if array.shape != shape:
        raise ArgumentError(f"{name} have shape {array.shape}, expected {shape}")
    return array


def as_nanoseconds(now_ns: Any) -> int:
    """Return an instant in nanoseconds."""
    try:
        now = operator.index(now_ns)
    except TypeError:
        now = MAX_NS + 1
    if not -MAX_NS <= now <= MAX_NS:
        raise ArgumentError(
            f"now_ns is {now_ns!r}, expected whole nanoseconds, at most 2**62, as of time.monotonic_ns()"
        )
    return now


def as_instants(t_pose_ns: Any, count: int) -> np.ndarray:
    """Return the instants of poses, ns, () or (count,)."""
    try:
        array = np.asarray(t_pose_ns)
        if array.dtype.kind not in "iu" or ((array < -MAX_NS) | (array > MAX_NS)).any():
            raise ValueError("no instants")
        return np.broadcast_to(array, (count,))
    except ValueError as unfit:
        raise ArgumentError(
            f"t_pose_ns is {shown(t_pose_ns)}, expected whole nanoseconds, at most 2**62: one number, or "
            f"one for each of {count} fingers"
        ) from unfit


def refuse_seconds(pose_ns: np.ndarray, now_ns: int, last_now_ns: int) -> None:
    """Raise an error for instants, of poses and of a tick, that are probably in seconds."""
    first_ns = pose_ns.item(0)
    is_apart = abs(now_ns - first_ns) > OTHER_CLOCK_NS
    is_too_soon = 0 < now_ns - last_now_ns < SHORTEST_NS and 0 < now_ns < MAX_SECONDS
    if 0 < now_ns < (EARLY_NS if is_apart else SHORTEST_NS) or is_too_soon:
        raise ArgumentError(f"now_ns is {now_ns}, {NOT_NANOSECONDS}")
    # For one finger alone it may be a defect of its sensor.
    if is_apart and 0 < first_ns < EARLY_NS and pose_ns.max() < EARLY_NS:
        raise ArgumentError(f"t_pose_ns is {first_ns}, {NOT_NANOSECONDS}")


def as_radii(radius: Any, count: int) -> np.ndarray:
    """Return the radius of each finger, m, (count,)."""
    array = as_float64(radius, "radii", expected="one radius in metres, or one a finger")
    if array.shape not in ((), (count,)) or not (np.isfinite(array) & (array >= 0.0)).all():
        raise ArgumentError(
            f"radius is {shown(radius)}, expected metres of 0 or more: one, or one for each of {count} "
            "fingers"
        )
    if (array > MAX_RADIUS).any():
        raise ArgumentError(f"radius is {length_error(float(array.max()), MAX_RADIUS)}")
    return np.broadcast_to(array, (count,))


def as_paths(paths: Any, count: int) -> np.ndarray:
    """Return the corners of paths, m, (count, K, 3)."""
    expected = f"({count}, K, 3) with K of 2 or more"
    corners = as_float64(paths, "values of paths", expected=f"numbers of shape {expected}")
    if corners.ndim != 3 or corners.shape[::2] != (count, 3) or corners.shape[1] < 2:
        raise ArgumentError(f"paths have shape {corners.shape}, expected {expected}")
    return corners


def as_path_bends(path_bends: Any, count: int) -> np.ndarray:
    """Return the bend at each of *count* corners, increasing; by default evenly from 0 to 1."""
    if path_bends is None:
        return np.linspace(0.0, 1.0, count)
    given = as_shape(path_bends, "path_bends", (count,))
    if not (np.isfinite(given).all() and (np.diff(given) > 0.0).all()):
        raise ArgumentError("path_bends do not increase, or are not finite, expected the bend at each corner")
    return given


def new_settings(
    budget: Any,
    working_range: Any,
    latency: Any,
    tolerance: Any,
    horizon: Any,
    max_speed: Any,
    max_acceleration: Any,
) -> np.ndarray:
    """Return the settings of ticks, a record of `kernels.tracking.track`."""
    reach = not_negative("working_range", working_range, "metres")
    if reach > MAX_WORKING_RANGE:
        raise ArgumentError(f"working_range is {length_error(reach, MAX_WORKING_RANGE)}")
    settings = np.zeros(1, track.SETTINGS)
    settings["working_range"] = reach
    settings["latency"] = not_negative("latency", latency, "seconds", most=LONGEST_LATENCY)
    settings["tolerance"] = not_negative("tolerance", tolerance, "shares")
    settings["horizon"] = positive("horizon", horizon, "seconds")
    settings["max_speed"] = positive("max_speed", max_speed, "metres a second")
    settings["max_acceleration"] = positive("max_acceleration", max_acceleration, "m/s²")
    steps = DEFAULT_BUDGET if budget is None else whole("budget", budget)
    settings["budget"] = min(steps, MOST)
    settings["ahead_ns"] = AHEAD_NS
    settings["other_clock_ns"] = OTHER_CLOCK_NS
    return settings


def new_arrays(count: int, settings: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of a tick except its records, named as in `kernels.tracking.track`."""
    return {
        "settings": settings,
        "velocities": np.full((count, 3), np.nan),
        "paths": np.full((count, 2, 3), np.nan),
        "path_bends": np.array([0.0, 1.0]),
        "bends": np.full(count, np.nan),
        "path_lengths": np.zeros(2),
        "motions": np.zeros((count, ESTIMATES), ESTIMATE),
        "tracks": np.zeros(count, track.TRACK),
        "balls": np.zeros((count, BALLS_SIZE)),
        "frontiers": np.zeros((count if count <= CROWD else 0, FRONTIER_SIZE), np.float32),
        "unknown": unknown_contact(),
        "before": np.zeros((0, POSE_COLUMNS)),
        "movers": movers_workspace(0),
        "workspace": np.zeros(WORKSPACE_SIZE, np.float32),
        **ignoring_none(count),
    }


def ignoring_none(count: int) -> dict[str, np.ndarray]:
    """Return of these the arrays about parts that fingers ignore, where none ignores any."""
    return {"ignored": np.zeros((count, 0), np.bool_), "heeded": np.zeros(0, PART)}


class PoseNotes:
    """Notes on the poses of a tracker; each kind is logged once."""

    sentences: list[str]

    def __init__(self) -> None:
        self.sentences = []
        self._known = DONE

    def add(self, answer: int, contacts: np.ndarray, model: Model) -> None:
        """Add the notes in the *answer* of a tick about its poses that are new."""
        new, self._known = answer & ~self._known, answer | self._known
        for sentence in _sentences(new, contacts, model) if new else ():
            self.sentences.append(sentence)
            LOGGER.warning("%s", sentence)


def _sentences(bits: int, contacts: np.ndarray, model: Model) -> Iterator[str]:
    ages_ns = contacts["age_ns"][np.isfinite(contacts["position"]).all(axis=1)]
    if bits & HAS_DEFECT << FUTURE:
        ahead_ns = -int(ages_ns.min())
        effect = "not used" if ahead_ns > OTHER_CLOCK_NS else "predicted for their own instant"
        yield f"{FROM_FUTURE} are {effect} ({on_future(ahead_ns, TWO_CLOCKS)})"
    if bits & HAS_DEFECT << TOO_OLD:
        yield f"poses older than 1 s are not used ({on_too_old(int(ages_ns.max()), TWO_CLOCKS)})"
    if bits & ALL_IN_MILLIMETRES:
        nearest = contacts[(contacts["flags"] & np.uint32(ContactFlag.TRACKED)) != 0]
        row = int(np.argmin(nearest["signed_distance"]))
        what, distance = f"finger {nearest['finger'][row]}", float(nearest["signed_distance"][row])
        yield in_millimetres(what, distance, size_of(model), "positions")
