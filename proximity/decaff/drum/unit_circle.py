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


def is_within_by_jury(coefficients: ArrayLike) -> np.ndarray:
    """Return whether all roots lie within the unit circle, (...) bool, without finding them.

    Parameters
    ----------
    coefficients : (..., n + 1) float64
        As of `roots`.

    Raises
    ------
    DecaffError
        As of `roots`.

    Notes
    -----
    Degenerate: a root on the circle is not within.
    Source: Jury 1964, in the form of Schur and Cohn: the last coefficient must be smaller than the first,
    and so it must be in the polynomial of one power less that what they have in common leaves.
    """
    rows = _checked(coefficients)
    is_within = np.ones(rows.shape[:-1], bool)
    while rows.shape[-1] > 1:
        # Scaled, so that the coefficients of many powers neither vanish nor overflow.
        rows = rows / np.where(rows[..., :1] == 0.0, 1.0, rows[..., :1])
        last = rows[..., -1:]
        is_within &= np.abs(last[..., 0]) < 1.0
        rows = np.where(is_within[..., None], rows - last * rows[..., ::-1], 1.0)[..., :-1]
    return is_within


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
