"""Roots of polynomials against the unit circle: where they lie, and for which parameter one reaches it.

Polynomials are real, in the last axis of an array, highest power first.
"""

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from proximity.errors import ArgumentError

NEGLIGIBLE = 1e-15  # of the largest coefficient: a power with less is none
REAL_ENOUGH = 1e-7  # imaginary part of a real root; a double one splits by the root of the rounding
LEAST_EFFECT = 1e-7  # of what varies, on the circle, as a share of its coefficients; less has no crossing


def roots(coefficients: ArrayLike) -> np.ndarray:
    """Return all roots, (..., n) complex, as eigenvalues of the companion matrix."""
    polynomials = _checked(coefficients)
    power = polynomials.shape[-1] - 1
    companion = np.zeros((*polynomials.shape[:-1], power, power))
    companion[..., np.arange(1, power), np.arange(power - 1)] = 1.0
    companion[..., 0, :] = -polynomials[..., 1:] / polynomials[..., :1]
    return np.linalg.eigvals(companion).astype(np.complex128)


def spectral_radius(coefficients: ArrayLike) -> np.ndarray:
    """Return the largest modulus of a root, (...): below one, disturbances die out."""
    return np.abs(roots(coefficients)).max(axis=-1)


def crossings(fixed: ArrayLike, varied: ArrayLike) -> np.ndarray:
    """Return every real s, ascending, for which ``fixed + s varied`` has a root on the unit circle."""
    fixed, varied = _checked(fixed), np.asarray(varied, np.float64)
    power = len(fixed) - 1
    products = np.correlate(fixed[::-1], varied[::-1], "full")  # of powers -n to n of z
    sines = products[power + 1 :] - products[:power][::-1]
    series = np.zeros(power)
    for m, sine in enumerate(sines):  # sin((m + 1) w) / sin w = 2 cos(m w) + 2 cos((m - 2) w) + ...
        series[m::-2] += 2.0 * sine
        series[0] -= sine if m % 2 == 0 else 0.0
    found = chebyshev.chebroots(chebyshev.chebtrim(series, NEGLIGIBLE * float(np.abs(series).max())))
    is_angle = (np.abs(found.imag) < REAL_ENOUGH) & (np.abs(found.real) < 1.0)
    z = np.exp(1j * np.arccos(np.append(found.real[is_angle], -1.0)))
    effect = np.polyval(varied, z)
    has_effect = np.abs(effect) > LEAST_EFFECT * np.abs(varied).sum()
    return np.sort(-(np.polyval(fixed, z)[has_effect] / effect[has_effect]).real)


def _checked(coefficients: ArrayLike) -> np.ndarray:
    polynomials = np.asarray(coefficients, np.float64)
    if polynomials.ndim == 0 or polynomials.shape[-1] < 2:
        raise ArgumentError(
            f"coefficients have shape {polynomials.shape}, expected (..., n + 1) with n of 1 or more"
        )
    if not (np.isfinite(polynomials).all() and (polynomials[..., 0] != 0.0).all()):
        raise ArgumentError(
            "coefficients are not finite, or the first is zero, expected that of the highest power"
        )
    return polynomials
