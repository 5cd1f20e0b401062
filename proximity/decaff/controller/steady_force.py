"""Rules by which a contact force is steady, and a controller changes from position to force."""

import math
from dataclasses import dataclass, field

from proximity.checks import not_negative, positive
from proximity.decaff.controller.compiled import MOST_STEADY, SETTINGS, STEADY, in_c, memory
from proximity.errors import ArgumentError

LEAST_WINDOW = 2  # samples


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


class SteadyForce:
    """Watches a force, sample by sample at a *rate* in hertz, until it is steady, as the controller does."""

    def __init__(self, rate: float, rule: SteadyRule | None = None) -> None:
        _, settings, content = memory(SETTINGS)
        for name, number in steady_numbers(rate, rule or SteadyRule()).items():
            settings[name] = number
        _, self._watch, watched = memory(STEADY)
        self._content = watched[0], content[0]

    @property
    def filtered(self) -> float:
        """The force, low-passed, N."""
        return float(self._watch.twice)

    def take(self, force: float, speed: float) -> bool:
        """Return whether the force, N, is steady by now; *speed*, m/s, is the finger's."""
        return bool(in_c("is_steady")(*self._content, force, speed))


def steady_numbers(rate: float, rule: SteadyRule) -> dict[str, float]:
    """Return a rule at a rate in hertz, as the settings in C have it."""
    period = 1.0 / positive("rate", rate, "hertz")
    samples = max(LEAST_WINDOW, round(rule.window * rate))
    if samples > MOST_STEADY:
        raise ArgumentError(
            f"a steady force is looked back on for {samples} samples ({rule.window:g} s at {rate:g} Hz), "
            f"expected at most {MOST_STEADY}"
        )
    numbers = {
        f"steady_{name}": getattr(rule, name) for name in ("ripple", "ripple_share", "least", "slow_speed")
    }
    return numbers | {
        "steady_samples": samples,
        "steady_share": low_pass(rule.cutoff, period),
        "steady_slope_of_window": rule.slope * samples * period,
    }


def low_pass(cutoff: float, period: float) -> float:
    """Return the share of what is new that a low-pass of a cutoff in hertz takes in."""
    return 1.0 - math.exp(-2.0 * math.pi * cutoff * period)
