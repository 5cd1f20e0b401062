"""Requirements, their measurements, and whether they are met."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verdict:
    """A requirement, its measurement, and whether it is met."""

    requirement: str
    measured: str
    is_met: bool


def at_most(what: str, limit: float, measured: float, unit: str = "µs") -> Verdict:
    """Require that a figure is at most *limit*."""
    return Verdict(f"{what} at most {limit:g} {unit}", f"{measured:.4g} {unit}", bool(measured <= limit))


def at_least(what: str, limit: float, measured: float, spread: str = "") -> Verdict:
    """Require that one time is at least *limit* times another."""
    return Verdict(
        f"{what}: at least {limit:g} times as fast", f"{measured:.2f}{spread}", bool(measured >= limit)
    )
