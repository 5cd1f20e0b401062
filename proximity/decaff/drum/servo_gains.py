"""Gains of a sampled position servo such as the drum's.

Far below the largest stiffness there is a damping with which disturbances die out quickly.
"""

from scipy.optimize import minimize_scalar

from proximity.checks import positive
from proximity.decaff.drum.sampled_mass import (
    Gains,
    SampledMass,
    characteristic,
    damping_window,
    maximum_stiffness,
)
from proximity.decaff.drum.unit_circle import spectral_radius
from proximity.errors import ArgumentError

WELL_DAMPED_SHARE = 0.2  # of the largest stiffness, at which a servo is damped well


def best_damped(device: SampledMass, share: float = WELL_DAMPED_SHARE) -> Gains:
    """Return a stiffness, and the damping with which disturbances die out fastest."""
    if not positive("share", share, "shares") < 1.0:
        raise ArgumentError(f"share is {share!r}, expected one below 1 of the largest stiffness")
    stiffness = share * maximum_stiffness(device).stiffness
    found = minimize_scalar(
        lambda damping: float(spectral_radius(characteristic(device, stiffness, damping))),
        bounds=damping_window(device, stiffness),
        method="bounded",
        options={"xatol": 1e-9 * device.damping_unit},
    )
    return Gains(stiffness, float(found.x))
