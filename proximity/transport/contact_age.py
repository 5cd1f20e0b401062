"""Ageing of contacts: bounds widen with time until nothing is known.

Both functions change records in place and leave every field with the meaning it has when it is published.
"""

import numpy as np

from proximity.message import CONTACT, ContactFlag, Mode, Source, Surface
from proximity.message.contact import BOUNDED_BIT, PREDICTED_BIT, TRACKED_BIT

_NOT_PREDICTED = np.uint32(
    ~(ContactFlag.EXACT | ContactFlag.SKIPPED | ContactFlag.PREDICTED | ContactFlag.CONTACT_FOUND)
    & 0xFFFF_FFFF
)
_FLOATS = [name for name in CONTACT.names or () if CONTACT[name].base.kind == "f"]


def widen(contacts: np.ndarray, now_ns: int, max_speed: float, max_acceleration: float) -> None:
    """Make contacts hold at a later instant: as far as finger and parts may have come, less is known.

    Bounds hold at *now_ns*, and so do the predictions, which are the bounds; the distance is the lower one.
    Nothing is exact or predicted any more, no force is valid, and the place of contact is kept without a
    promise. Times to contact go on counting from the pose. A finger that is not tracked stays so.

    *contacts*: (N,) CONTACT. *now_ns*: the instant, on the clock of the poses, not before them.

    Notes
    -----
    The bounds hold as long as the finger keeps to both limits and every part to the velocity, of translation
    and rotation, that the scene had for it at the tick.
    ``part_velocity`` is that of one point. How much faster other parts and other points are, and how far off
    the finger's velocity may be, is in the published predictions: their bounds are apart by what both may
    have done until ``predicted_ns``. Where a publisher predicts for the pose's own instant that is not
    reported: then no part is thought to be faster than the nearest point of the nearest one.
    """
    AgedContacts(contacts, max_speed, max_acceleration).update(now_ns)


class AgedContacts:
    """Quantities computed once for contacts whose bounds are widened again and again.

    *contacts*: (N,) CONTACT; as they were published. Changed in place: at once what does not depend on time,
    the rest by `update`.
    """

    def __init__(self, contacts: np.ndarray, max_speed: float, max_acceleration: float) -> None:
        flags = contacts["flags"]
        self._contacts = contacts
        self._is_tracked = (flags & TRACKED_BIT) != 0
        self._pose_ns = contacts["pose_ns"].copy()
        self._lower, self._upper = contacts["lower"].copy(), contacts["upper"].copy()
        self._free = contacts["time_to_contact_lower"].copy()
        with np.errstate(all="ignore"):  # a publisher's numbers may be anything
            self._set_rates((flags & PREDICTED_BIT) != 0, max_speed, max_acceleration)
        contacts["flags"] = (flags & _NOT_PREDICTED) | np.where(self._is_tracked, BOUNDED_BIT, np.uint32(0))
        contacts["contact_bend_error"] += np.inf
        contacts["force_is_valid"] = 0

    def _set_rates(self, is_predicted: np.ndarray, max_speed: float, max_acceleration: float) -> None:
        """Largest rate of change of a distance, m/s: at first, more each second, at last, and ever.

        Relative to the nearest part the finger goes by its velocity, less the part's; of a sensor's distance
        it is known how fast it changes. Acceleration adds to that. The *spread* of the predictions, m/s,
        holds how far off that velocity may be, and by how much surfaces may be faster than that part; and
        where a finger may go anywhere, how fast its publisher thinks it can be.
        """
        contacts = self._contacts
        part_velocity = contacts["part_velocity"]
        part_speed = np.fmax(_lengths(part_velocity), 0.0)  # nan where there is no part
        limit = max_speed + part_speed
        is_geometry = contacts["source"] == Source.GEOMETRY
        going = np.where(
            is_geometry, _lengths(contacts["velocity"] - part_velocity), np.abs(contacts["approach_speed"])
        )
        lead_time = 1e-9 * (contacts["predicted_ns"] - self._pose_ns)
        spread = contacts["predicted_upper"] - contacts["predicted_lower"]
        # A sensor's error stays; of a bracket it is not known how much narrower it is at the predicted place.
        spread -= np.where(is_geometry, 0.0, self._upper - self._lower)
        spread *= 0.5 / lead_time
        is_finite = (lead_time > 0.0) & (spread < np.inf)
        spread[~is_finite] = 0.0
        # So wide a spread may be the top speed of a finger that could turn round: what it did tells nothing.
        going = np.where(spread < max_speed, going, np.fmax(going, part_speed))
        is_known = is_predicted & is_finite
        # Where there is no velocity it is nan, and fmin passes over it.
        self._at_first = np.where(is_known, going + spread, np.nan)
        self._each_second = 0.5 * max_acceleration
        self._at_last = np.where(is_known, limit + spread, np.fmax(limit, part_speed + spread))
        self._ever = np.maximum(limit + spread, np.finfo(float).tiny)

    def update(self, now_ns: int) -> None:
        """Write what holds at an instant."""
        contacts = self._contacts
        with np.errstate(all="ignore"):
            age_ns = now_ns - self._pose_ns
            elapsed = np.maximum(1e-9 * age_ns, 0.0)
            drift = np.fmin(self._at_first + self._each_second * elapsed, self._at_last) * elapsed
            lower, upper = self._lower - drift, self._upper + drift
            free = elapsed + np.maximum(lower, 0.0) / self._ever
        contacts["lower"] = contacts["predicted_lower"] = lower
        contacts["upper"] = contacts["predicted_upper"] = upper
        np.copyto(contacts["signed_distance"], lower, where=self._is_tracked)
        np.copyto(contacts["predicted_distance"], lower, where=self._is_tracked)
        contacts["time_to_contact_lower"] = np.minimum(self._free, free)
        contacts["predicted_ns"], contacts["age_ns"] = now_ns, age_ns


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def forget(contacts: np.ndarray) -> None:
    """Leave nothing of contacts but whose they are, where they come from and when that was.

    *contacts*: (N,) CONTACT; changed in place: as of fingers that are not tracked.
    """
    for name in _FLOATS:
        contacts[name] = np.nan
    contacts["lower"] = contacts["predicted_lower"] = -np.inf
    contacts["upper"] = contacts["predicted_upper"] = np.inf
    contacts["time_to_contact_lower"] = 0.0
    contacts["flags"] = 0
    contacts["part"] = contacts["face"] = -1
    contacts["surface"], contacts["mode"] = Surface.UNKNOWN, Mode.HOLD
    contacts["force_is_valid"] = 0
