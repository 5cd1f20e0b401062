"""Teleoperation: distances that a sensor measured, published as contacts without any geometry."""

import numpy as np

from proximity.kernels.motion import MAX_ACCELERATION, MAX_SPEED
from proximity.message import Source
from proximity.tracker import HORIZON


class Measurements:
    """Distances of fingers, and what a sensor knows beside them.

    Parameters
    ----------
    count : int
        Of fingers.
    """

    def __init__(self, count: int) -> None:
        raise NotImplementedError


class SensorInput:
    """Distances of fingers, as `MEASURED` messages at an address.

    Parameters
    ----------
    address : str
        As of `open_subscriber`.
    count : int
        Of fingers.

    Raises
    ------
    PublishError
        If the address cannot be opened.
    """

    is_over = False

    def __init__(self, address: str, count: int) -> None:
        raise NotImplementedError

    @property
    def notes(self) -> list[str]:
        """What was left out, and why."""
        return []

    def poll(self, now_ns: int) -> Measurements | None:
        """Return the newest measurement of each finger; None where no message came.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        return None

    def close(self) -> None:
        """Give the address back."""


class SensorAnswers:
    """Contacts as a sensor measured them.

    Parameters
    ----------
    count : int
        Of fingers.
    latency : float, s
        From a tick until the controller acts on its answer: predictions are for then.
    horizon : float, s
        How far ahead contacts are looked for.
    max_speed : float, m/s
        By which a distance changes at most.
    max_acceleration : float, m/s²
        Bounds of predictions hold as long as it is not exceeded.
    """

    source = Source.TELEOPERATION
    epoch = 0

    def __init__(
        self,
        count: int,
        *,
        latency: float = 0.001,
        horizon: float = HORIZON,
        max_speed: float = MAX_SPEED,
        max_acceleration: float = MAX_ACCELERATION,
    ) -> None:
        self.count = count
        raise NotImplementedError

    @property
    def notes(self) -> list[str]:
        """What was wrong with measurements."""
        return []

    def room(self) -> Measurements:
        """Make room for measurements."""
        return Measurements(self.count)

    def rehearse(self) -> None:
        """Do all that takes long the first time, and forget it."""

    def answer(self, samples: Measurements, now_ns: int) -> np.ndarray:
        """Make the contacts.

        Parameters
        ----------
        samples : Measurements
            Newest ones; nan: nothing was measured.
        now_ns : int, ns
            Instant of the tick.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Do nothing."""
