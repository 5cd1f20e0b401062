"""Detection of a steady contact force, and the rule by which a controller changes from position to force."""

from dataclasses import dataclass, field

import numpy as np

from proximity.decaff.arguments import not_negative, positive
from proximity.decaff.controller import steady_kernels


@dataclass(frozen=True, slots=True)
class SteadyRule:
    """Rule by which a force counts as steady."""

    cutoff: float = 50.0  # Hz, of two low-passes in a row
    window: float = 0.050  # s, looked back on
    ripple: float = 0.02  # N, that the force may vary by
    ripple_share: float = 0.05  # of the force, if that is more
    slope: float = 0.5  # N/s, over the window
    least: float = 0.05  # N, that the force must have
    slow_speed: float = 2e-3  # m/s, of the finger for a window's time; inf: not asked

    def __post_init__(self) -> None:
        positive("cutoff", self.cutoff, "hertz")
        positive("window", self.window, "seconds")
        not_negative("ripple", self.ripple, "newtons")
        not_negative("ripple_share", self.ripple_share, "shares")
        positive("slope", self.slope, "newtons a second")
        not_negative("least", self.least, "newtons")
        positive("slow_speed", self.slow_speed, "metres a second", may_be_infinite=True)

    def as_array(self) -> np.ndarray:
        """Return its numbers as the kernel reads them."""
        array = np.zeros(steady_kernels.RULE_SIZE)
        array[steady_kernels.RULE_CUTOFF] = self.cutoff
        array[steady_kernels.RULE_RIPPLE] = self.ripple
        array[steady_kernels.RULE_RIPPLE_SHARE] = self.ripple_share
        array[steady_kernels.RULE_SLOPE] = self.slope
        array[steady_kernels.RULE_LEAST] = self.least
        array[steady_kernels.RULE_SLOW_SPEED] = self.slow_speed
        return array


class SteadyForce:
    """Watches a force, sample by sample, until it is steady.

    Parameters
    ----------
    rate : float, Hz
        Samples a second.
    rule : SteadyRule
        What counts as steady.
    """

    def __init__(self, rate: float, rule: SteadyRule | None = None) -> None:
        rule = rule or SteadyRule()
        self._period = 1.0 / positive("rate", rate, "hertz")
        self._rule = rule.as_array()
        self._watch = np.zeros(steady_kernels.WATCH_SIZE)
        self._window = np.zeros(self.sample_count(rate, rule))

    @staticmethod
    def sample_count(rate: float, rule: SteadyRule) -> int:
        """Return the number of samples that are looked back on.

        Parameters
        ----------
        rate : float, Hz
            Samples a second.
        rule : SteadyRule
            What counts as steady.
        """
        return max(2, round(rule.window * rate))

    @property
    def filtered(self) -> float:
        """The force, low-passed, N."""
        return float(self._watch[steady_kernels.WATCH_TWICE])

    def take(self, force: float, speed: float) -> bool:
        """Return whether the force is steady, now that another sample is known.

        Parameters
        ----------
        force : float, N
            On the finger.
        speed : float, m/s
            Of the finger.
        """
        return bool(
            steady_kernels.watch_force(self._rule, self._watch, self._window, force, speed, self._period)
        )


@dataclass(frozen=True, slots=True)
class Handover:
    """Rule by which the modes change."""

    rule: SteadyRule = field(default_factory=SteadyRule)
    is_bumpless: bool = True  # otherwise the force starts from nothing, its integrator at 0
    lost_force: float = 0.05  # N: with less, for a while, the contact is lost
    lost_time: float = 0.020  # s
    lost_distance: float = 0.5e-3  # m, of the slave from its object: more, and the contact is lost

    def __post_init__(self) -> None:
        not_negative("lost_force", self.lost_force, "newtons")
        not_negative("lost_time", self.lost_time, "seconds")
        positive("lost_distance", self.lost_distance, "metres", may_be_infinite=True)
