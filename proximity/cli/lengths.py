"""Conversion of metres to the user's unit, with a sensible number of digits."""

import numpy as np

MM_PER_M = 1e3
DIGITS = 15
"""Significant decimal digits that every float64 keeps; the two behind them are rounding of the conversion."""
EXACT_POWERS = np.array([10.0**exponent for exponent in range(23)])
"""Powers of ten that float64 holds exactly: one product or quotient with them is rounded once."""


def in_units(lengths: np.ndarray, metres: float) -> np.ndarray:
    """Return *lengths* in the unit, rounded to `DIGITS` significant digits.

    *lengths*: (N, ...) m; also areas or volumes, with the power of *metres* that fits them.
    """
    with np.errstate(over="ignore"):
        return rounded(np.asarray(lengths, dtype=np.float64) / metres)


def in_unit(length: float, metres: float) -> float:
    """Return one length in the unit, as `in_units`."""
    return float(in_units(np.array([length]), metres)[0])


def distances_in_units(distances: np.ndarray, metres: float, *points: np.ndarray) -> np.ndarray:
    """Return *distances* in the unit, rounded where the coordinates that they are differences of end.

    *distances*: (N,) m. *points*: (N, 3) m; between which they are. Of the largest coordinate of a row
    `DIGITS` digits count: from -11 to -10 the distance is 1, where the difference alone would give
    0.999999999999999. nan is passed over.
    """
    largest = np.zeros(len(distances))
    for ends in points:
        largest = np.fmax(largest, np.fmax.reduce(np.abs(ends), axis=1))
    with np.errstate(over="ignore"):
        return rounded(distances / metres, largest / metres)


def rounded(values: np.ndarray, scales: np.ndarray | None = None) -> np.ndarray:
    """Return *values* rounded to `DIGITS` significant digits; zero has no sign, nan and inf stay.

    *values*: (N, ...). *scales*: (N, ...); digits are counted from the first of these where they are larger.
    """
    sizes = np.abs(values) if scales is None else np.fmax(np.abs(values), scales)
    is_plain = (sizes > 1e-7) & (sizes < 1e36)  # so that both powers of ten below are exact
    exponents = np.floor(np.log10(np.where(is_plain, sizes, 1.0))).astype(np.intp)
    shifts = DIGITS - 1 - exponents
    up, down = EXACT_POWERS[np.maximum(shifts, 0)], EXACT_POWERS[np.maximum(-shifts, 0)]
    with np.errstate(over="ignore", invalid="ignore"):
        result = np.rint(values * up / down) * down / up + 0.0  # -0.0 + 0.0 is 0.0
    is_extreme = ~is_plain & np.isfinite(values) & (values != 0.0)
    if is_extreme.any():
        result[is_extreme] = [float(f"{value:.{DIGITS}g}") for value in values[is_extreme].tolist()]
    return result
