"""Teleoperation: publish distances measured by a sensor as contacts, without any geometry.

Fields that a sensor does not report stay unknown: positions, parts and faces. The speed of approach is
estimated from successive distances as `kernels.tracking.motion` does from poses, along one axis.
"""

import numpy as np

from proximity.errors import ServiceError
from proximity.kernels.contact_record import CONTACT_RECORD
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES, MAX_ACCELERATION, MAX_SPEED
from proximity.message import CONTACT, Source
from proximity.service import finger_kernels
from proximity.service.description import PartLabels
from proximity.service.samples import Measurements
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import HORIZON
from proximity.transport import forget


class SensedContacts:
    """Contacts measured by a sensor.

    *latency*: from a tick until the controller acts on its answer, the instant of predictions. *max_speed*:
    of a distance; faster is a jump of the sensor. *max_acceleration*: bounds of predictions hold if it is not
    exceeded, and errors of distances are within the reported ones.

    Notes
    -----
    If a sensor reports bend and bend rate, the bend at contact is reported as well, with both rates assumed
    constant; its error is unknown.
    """

    source = Source.TELEOPERATION
    is_ticked_by_loop = True
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
        self.latency_ns = round(NS_PER_S * latency)
        self.horizon, self.max_speed = float(horizon), float(max_speed)
        self.max_acceleration = float(max_acceleration)
        self.motions = np.zeros((count, ESTIMATES), ESTIMATE)
        self.error_sums = np.zeros((count, finger_kernels.ERROR_SUMS_SIZE))
        unknown = np.zeros(count, CONTACT)
        forget(unknown)
        unknown["finger"], unknown["source"] = np.arange(count), self.source
        self.unknown = unknown.view(CONTACT_RECORD)

    def labels(self) -> PartLabels:
        """Return empty labels: a sensor has no parts."""
        return (), np.zeros(0, bool)

    def new_samples(self) -> Measurements:
        """Return measurements, all unknown."""
        return Measurements(self.count)

    def rehearse(self) -> None:
        """Compute contacts of empty samples; the estimates are reset afterwards."""
        self.fill(np.zeros(self.count, CONTACT), Measurements(self.count), 0)
        self.motions[:] = 0
        self.error_sums[:] = 0.0

    def fill(self, contacts: np.ndarray, samples: Measurements, now_ns: int) -> None:
        """Compute the contacts."""
        finger_kernels.sense_contacts(
            self.motions, self.error_sums, samples.pose_ns, samples.distances,
            samples.records.view(finger_kernels.MEASUREMENT_RECORD), contacts.view(CONTACT_RECORD),
            self.unknown, now_ns, self.latency_ns, self.horizon, self.max_speed, self.max_acceleration,
        )  # fmt: skip

    def close(self) -> None:
        """No-op."""
