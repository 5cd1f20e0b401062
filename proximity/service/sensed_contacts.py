"""Teleoperation: publish distances measured by a sensor as contacts, without any geometry.

What a sensor does not report stays unknown: positions, parts and faces. The speed of approach is
estimated from successive distances as `kernels.tracking.motion` does from poses, along one axis.
"""

import numpy as np

from proximity.errors import ServiceError
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES, MAX_ACCELERATION, MAX_SPEED
from proximity.message import CONTACT, ContactFlag, Mode, Source, Surface
from proximity.service import finger_kernels
from proximity.service.description import PartLabels
from proximity.service.samples import Measurements
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import HORIZON
from proximity.transport import forget

OBSERVED = int(ContactFlag.TRACKED | ContactFlag.PREDICTED | ContactFlag.JUMPED)
"""Flags that follow from successive distances."""
PASSED_ON = ("position", "velocity", "normal", "bend", "bend_rate", "surface", "force", "force_is_valid")
"""Fields of a measurement that a contact has as well."""


class SensedContacts:
    """Contacts as a sensor measured them.

    *latency*: from a tick until the controller acts on its answer: predictions are for then. *max_speed*: by
    which a distance changes at most; faster is a jump of the sensor. *max_acceleration*: bounds of
    predictions hold as long as it is not exceeded, and distances are no farther off than reported.

    Notes
    -----
    Where a sensor reports bend and bend rate, the bend at contact is reported as well, on the assumption that
    both bend and distance go on as they do; how far it is off is not known.
    """

    source = Source.TELEOPERATION
    is_ticked_by_loop = False
    epoch = 0
    refused = 0, 0, 0
    is_late = False

    def __init__(
        self,
        count: int,
        *,
        latency: float = 0.001,
        horizon: float = HORIZON,
        max_speed: float = MAX_SPEED,
        max_acceleration: float = MAX_ACCELERATION,
    ) -> None:
        if not (
            0.0 <= latency <= 1.0 and all(number > 0.0 for number in (horizon, max_speed, max_acceleration))
        ):
            raise ServiceError(
                f"latency {latency!r} s, horizon {horizon!r} s, max_speed {max_speed!r} m/s and "
                f"max_acceleration {max_acceleration!r} m/s², expected a latency of 0 to 1 s and the others "
                "above zero"
            )
        self.count = count
        self.notes: list[str] = []
        self._latency_ns = round(NS_PER_S * latency)
        self._horizon, self._max_speed, self._max_acceleration = horizon, max_speed, max_acceleration
        self._motions = np.zeros((count, ESTIMATES), ESTIMATE)
        self._error_sums = np.zeros((count, finger_kernels.ERROR_SUMS_SIZE))
        self._followed = np.zeros((count, finger_kernels.FOLLOWED_SIZE))
        self._write_to(np.zeros(count, CONTACT))

    def labels(self) -> PartLabels:
        """Return that there are no parts."""
        return (), np.zeros(0, bool)

    def new_samples(self) -> Measurements:
        """Return measurements, all unknown."""
        return Measurements(self.count)

    def rehearse(self) -> None:
        """Make contacts of nothing; the estimates are reset afterwards."""
        self.fill(np.zeros(self.count, CONTACT), Measurements(self.count), 0)
        self._motions[:] = 0
        self._error_sums[:] = 0.0

    def fill(self, contacts: np.ndarray, samples: Measurements, now_ns: int) -> None:
        """Make the contacts."""
        if contacts is not self._contacts:
            self._write_to(contacts)
        with np.errstate(over="ignore", invalid="ignore"):  # whatever a sensor reports
            self._fill(samples, now_ns)

    def close(self) -> None:
        """Do nothing."""

    def _write_to(self, contacts: np.ndarray) -> None:
        self._contacts, self._bytes = contacts, contacts.view(np.uint8).reshape(self.count, -1)
        forget(contacts)
        contacts["finger"], contacts["source"] = np.arange(self.count), self.source
        contacts["work"] = 0
        self._unknown = self._bytes.copy()

    def _fill(self, samples: Measurements, now_ns: int) -> None:
        acts_ns = now_ns + self._latency_ns
        reported, contacts = samples.records, self._contacts
        finger_kernels.follow_distances(
            self._motions, self._error_sums, samples.pose_ns, samples.distances,
            np.ascontiguousarray(reported["error"]), -reported["approach_speed"], acts_ns, self._max_speed,
            self._max_acceleration, self._followed,
        )  # fmt: skip
        status = self._followed[:, finger_kernels.FOLLOWED_STATUS].astype(np.uint32)
        self._write_distances(samples.distances[:, 0], reported["error"], status)
        self._write_times(status)
        for name in PASSED_ON:
            contacts[name] = reported[name]
        self._write_surface(reported)
        self._write_bend(reported)
        is_unknown = status == 0
        if is_unknown.any():
            self._bytes[is_unknown] = self._unknown[is_unknown]
        contacts["pose_ns"], contacts["age_ns"] = samples.pose_ns, now_ns - samples.pose_ns
        contacts["predicted_ns"] = np.maximum(acts_ns, samples.pose_ns)

    def _write_distances(self, distance: np.ndarray, error: np.ndarray, status: np.ndarray) -> None:
        """Write distances, now and predicted, their bounds and what is known of them."""
        contacts, followed = self._contacts, self._followed
        has_error = (error >= 0.0) & (error < np.inf)
        error = np.where(has_error, error, np.inf)
        lower, upper = distance - error, distance + error
        step, spread = followed[:, finger_kernels.FOLLOWED_STEP], followed[:, finger_kernels.FOLLOWED_SPREAD]
        contacts["signed_distance"], contacts["lower"], contacts["upper"] = distance, lower, upper
        contacts["predicted_distance"] = distance + step
        contacts["predicted_lower"] = lower + (step - spread)
        contacts["predicted_upper"] = upper + (step + spread)
        is_predicted = (status & ContactFlag.PREDICTED) != 0
        contacts["approach_speed"] = np.where(
            is_predicted, -followed[:, finger_kernels.FOLLOWED_RATE], np.nan
        )
        flags = status & OBSERVED | int(ContactFlag.SIGNED | ContactFlag.IN_RANGE)
        flags |= np.where(error == 0.0, int(ContactFlag.EXACT), 0).astype(np.uint32)
        flags |= np.where(has_error, 0, int(ContactFlag.BOUNDED)).astype(np.uint32)
        contacts["flags"] = flags

    def _write_times(self, status: np.ndarray) -> None:
        """Write the time to contact at the present speed, and the time that is free for certain."""
        contacts = self._contacts
        distance, clearance = contacts["signed_distance"], np.maximum(contacts["lower"], 0.0)
        is_predicted = (status & ContactFlag.PREDICTED) != 0
        closing = np.where(is_predicted, contacts["approach_speed"], self._max_speed)
        is_closing = closing > 0.0
        free = np.where(clearance > 0.0, self._horizon, 0.0)
        np.divide(clearance, closing, out=free, where=is_closing)
        expected = np.full(self.count, np.inf)
        np.divide(distance, closing, out=expected, where=is_closing & is_predicted)
        expected[expected > self._horizon] = np.inf
        is_touching = distance <= 0.0
        expected[is_touching] = free[is_touching] = 0.0
        contacts["time_to_contact"] = expected
        contacts["time_to_contact_lower"] = np.minimum(free, self._horizon)

    def _write_surface(self, reported: np.ndarray) -> None:
        """Write how the object answers a touch, and what the controller is advised to do."""
        contacts = self._contacts
        has_force = (reported["force_is_valid"] != 0) & np.isfinite(reported["force"])
        contacts["force_is_valid"] = has_force
        contacts["force"][~has_force] = 0.0
        is_deformable = reported["surface"] == Surface.DEFORMABLE
        for name in ("stiffness", "damping"):
            contacts[name] = np.where(is_deformable & np.isfinite(reported[name]), reported[name], 0.0)
        is_near = contacts["time_to_contact"] < np.inf
        contacts["mode"] = np.where(is_near, np.where(is_deformable, Mode.FORCE, Mode.POSITION), Mode.RETRACT)

    def _write_bend(self, reported: np.ndarray) -> None:
        """Write the bend at contact where it follows from bend, bend rate and time to contact."""
        contacts = self._contacts
        time_left, bend = contacts["time_to_contact"], reported["bend"]
        is_touching = contacts["signed_distance"] <= 0.0
        is_bending = (time_left < np.inf) & (reported["bend_rate"] > 0.0)
        contact_bend = np.full(self.count, np.nan)
        contact_bend[is_bending] = (
            bend[is_bending] + reported["bend_rate"][is_bending] * time_left[is_bending]
        )
        contact_bend[contact_bend > 1.0] = np.nan
        contact_bend[is_touching] = bend[is_touching]
        is_sure = is_touching & (contacts["upper"] <= 0.0)
        contacts["contact_bend"] = contact_bend
        contacts["contact_bend_error"] = np.where(
            np.isnan(contact_bend), np.nan, np.where(is_sure, 0.0, np.inf)
        )
        contacts["contact_bend_rate"] = np.nan
