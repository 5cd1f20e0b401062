"""Requirements, what was measured for them, and whether they are met."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verdict:
    """A requirement, what was measured for it, and whether that is enough."""

    requirement: str
    measured: str
    is_met: bool


def at_most(what: str, limit: float, measured: float, unit: str = "µs") -> Verdict:
    """Require that a figure is no larger than *limit*."""
    return Verdict(f"{what} at most {limit:g} {unit}", f"{measured:.4g} {unit}", bool(measured <= limit))


def at_least(what: str, limit: float, measured: float, spread: str = "") -> Verdict:
    """Require that something is *limit* times as fast as something else."""
    return Verdict(
        f"{what}: at least {limit:g} times as fast", f"{measured:.2f}{spread}", bool(measured >= limit)
    )
