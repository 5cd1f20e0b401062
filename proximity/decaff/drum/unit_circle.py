"""Test whether all roots of a polynomial lie within the unit circle: by finding them, and by Jury's table.

Polynomials are real, in the last axis of an array, highest power first; many are looked at in one call.
"""

import numpy as np
from numpy.typing import ArrayLike

from proximity.errors import DecaffError


def roots(coefficients: ArrayLike) -> np.ndarray:
    """Return all roots, (..., n) complex, as eigenvalues of the companion matrix.

    Parameters
    ----------
    coefficients : (..., n + 1) float64
        The first is not zero.

    Raises
    ------
    DecaffError
        If there is no power, or a first coefficient is zero or any is not finite.
    """
    polynomials = _checked(coefficients)
    power = polynomials.shape[-1] - 1
    companion = np.zeros((*polynomials.shape[:-1], power, power))
    companion[..., np.arange(1, power), np.arange(power - 1)] = 1.0
    companion[..., 0, :] = -polynomials[..., 1:] / polynomials[..., :1]
    return np.linalg.eigvals(companion).astype(np.complex128)


def spectral_radius(coefficients: ArrayLike) -> np.ndarray:
    """Return the largest modulus of a root, (...): below one, disturbances die out.

    Parameters
    ----------
    coefficients : (..., n + 1) float64
        As of `roots`.

    Raises
    ------
    DecaffError
        As of `roots`.
    """
    return np.abs(roots(coefficients)).max(axis=-1)


def _checked(coefficients: ArrayLike) -> np.ndarray:
    polynomials = np.asarray(coefficients, np.float64)
    if polynomials.ndim == 0 or polynomials.shape[-1] < 2:
        raise DecaffError(
            f"coefficients have shape {polynomials.shape}, expected (..., n + 1) with n of 1 or more"
        )
    if not (np.isfinite(polynomials).all() and (polynomials[..., 0] != 0.0).all()):
        raise DecaffError(
            "coefficients are not finite, or the first is zero, expected that of the highest power"
        )
    return polynomials
