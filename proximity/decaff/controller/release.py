"""Release of a contact of which nothing is known any more: unchanged at first, then ramped to no force."""

from proximity.decaff.controller.controller_states import Trust
from proximity.decaff.controller.drum_limits import Limits


class Release:
    """Time since which nothing is known, and the share of the force that is left.

    Parameters
    ----------
    limits : Limits
        Of the time of freezing and of the ramp.
    """

    share: float
    """1 while frozen, then down to 0."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._since_ns: int | None = None
        self.share = 1.0

    def take(self, trust: Trust, sample_ns: int) -> float:
        """Return the share of the force that is left.

        Parameters
        ----------
        trust : Trust
            In the newest frames.
        sample_ns : int, ns
            Of the servo's sample, on its own clock.
        """
        if trust <= Trust.OLD and (trust is Trust.FRESH or self._since_ns is None):
            self._since_ns, self.share = None, 1.0
            return 1.0
        if self._since_ns is None:
            self._since_ns = sample_ns
        ramped_ns = sample_ns - self._since_ns - self._limits.freeze_ns
        self.share = min(max(1.0 - ramped_ns / self._limits.ramp_ns, 0.0), 1.0)
        return self.share

    def is_over(self, force: float, gone_force: float) -> bool:
        """Return whether the drum may leave the finger: the force has gone, or should have.

        Parameters
        ----------
        force : float, N
            On the finger; nan: not known.
        gone_force : float, N
            Less is gone.
        """
        return self.share == 0.0 or (self.share < 1.0 and force < gone_force)
