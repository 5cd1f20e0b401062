"""Metres in people's units, with the digits that people's numbers have."""

import numpy as np

DIGITS = 15
"""Significant decimal digits that every float64 keeps; the two behind them are rounding of the conversion."""
EXACT_POWERS = np.array([10.0**exponent for exponent in range(23)])
"""Powers of ten that float64 holds exactly: one product or quotient with them is rounded once."""


def in_units(lengths: np.ndarray, metres: float) -> np.ndarray:
    """Return *lengths* in the unit, rounded to `DIGITS` significant digits.

    Parameters
    ----------
    lengths : (N, ...) float64, m
        Also areas or volumes, with the power of *metres* that fits them.
    metres : float
        Metres in one unit.
    """
    with np.errstate(over="ignore"):
        return rounded(np.asarray(lengths, dtype=np.float64) / metres)


def in_unit(length: float, metres: float) -> float:
    """Return one length in the unit, as `in_units`.

    Parameters
    ----------
    length : float, m
        Also nan and inf.
    metres : float
        Metres in one unit.
    """
    return float(in_units(np.array([length]), metres)[0])


def rounded(values: np.ndarray) -> np.ndarray:
    """Return *values* rounded to `DIGITS` significant digits; zero has no sign, nan and inf stay.

    Parameters
    ----------
    values : (N, ...) float64
        Any.
    """
    sizes = np.abs(values)
    is_plain = (sizes > 1e-7) & (sizes < 1e36)  # so that both powers of ten below are exact
    exponents = np.floor(np.log10(np.where(is_plain, sizes, 1.0))).astype(np.intp)
    shifts = DIGITS - 1 - exponents
    up, down = EXACT_POWERS[np.maximum(shifts, 0)], EXACT_POWERS[np.maximum(-shifts, 0)]
    with np.errstate(over="ignore", invalid="ignore"):
        result = np.rint(values * up / down) * down / up + 0.0  # -0.0 + 0.0 is 0.0
    is_extreme = ~is_plain & np.isfinite(values) & (sizes > 0.0)
    if is_extreme.any():
        result[is_extreme] = [float(f"{value:.{DIGITS}g}") for value in values[is_extreme].tolist()]
    return result
