"""Single numbers from callers, checked once at the door; each check takes the error to raise.

A message says what was given, where, and what was expected. Booleans, text and arrays are no numbers here;
NumPy's scalars are. Whole arrays are the matter of `arrays`.
"""

import math
import operator
from typing import Any

from proximity.checks.arrays import shown
from proximity.errors import ProximityError, QueryError


def as_number(value: Any) -> float:
    """Return *value* as a float; nan where it is no single real number."""
    if isinstance(value, (bool, str, bytes)) or getattr(value, "ndim", False):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def positive(
    name: str,
    value: Any,
    unit: str,
    *,
    may_be_infinite: bool = False,
    error: type[ProximityError] = QueryError,
) -> float:
    """Return *value* as a float above zero.

    *may_be_infinite*: whether inf is meant, as for a rigid wall.
    """
    number = as_number(value)
    if not (number > 0.0 and (may_be_infinite or number < math.inf)):
        raise error(f"{name} is {shown(value)}, expected a positive number of {unit}")
    return number


def not_negative(
    name: str,
    value: Any,
    unit: str,
    *,
    most: float = math.inf,
    may_be_infinite: bool = False,
    error: type[ProximityError] = QueryError,
) -> float:
    """Return *value* as a float of zero or more."""
    number = as_number(value)
    if not (number >= 0.0 and (may_be_infinite or number < math.inf)):
        raise error(f"{name} is {shown(value)}, expected a number of {unit} of 0 or more")
    if number > most:
        raise error(f"{name} is {shown(value)}, expected a number of {unit} of {most:g} at most")
    return number


def finite(name: str, value: Any, unit: str, *, error: type[ProximityError] = QueryError) -> float:
    """Return *value* as a float of either sign."""
    number = as_number(value)
    if not math.isfinite(number):
        raise error(f"{name} is {shown(value)}, expected a number of {unit}")
    return number


def is_whole(value: Any, least: float = -math.inf) -> bool:
    """Return whether *value* is a whole number, Python's or NumPy's, from *least* on.

    *least*: the smallest that is allowed; any, where not given.
    """
    try:
        return not isinstance(value, bool) and operator.index(value) >= least
    except TypeError:
        return False


def whole(name: str, value: Any, least: int = 1, *, error: type[ProximityError] = QueryError) -> int:
    """Return *value* as an int from *least* on."""
    if not is_whole(value, least):
        raise error(f"{name} is {shown(value)}, expected a whole number of {least} or more")
    return operator.index(value)
