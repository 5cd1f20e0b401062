"""Checks of the numbers that models are made of."""

import math
import operator
from typing import Any

from proximity.errors import DecaffError


def positive(name: str, value: Any, unit: str, *, may_be_infinite: bool = False) -> float:
    """Return *value* as a float above zero.

    Parameters
    ----------
    name : str
        What the caller calls it, for the message.
    value : number
        Booleans and text are none.
    unit : str
        For the message.
    may_be_infinite : bool
        Whether inf is meant, as for a rigid wall.

    Raises
    ------
    DecaffError
        If it is no such number.
    """
    number = _number(value)
    if not (number > 0.0 and (may_be_infinite or math.isfinite(number))):
        raise DecaffError(f"{name} is {value!r}, expected a positive number of {unit}")
    return number


def not_negative(name: str, value: Any, unit: str, *, may_be_infinite: bool = False) -> float:
    """Return *value* as a float of zero or more; the rest as `positive`.

    Parameters
    ----------
    name, value, unit, may_be_infinite
        As of `positive`.

    Raises
    ------
    DecaffError
        If it is no such number.
    """
    number = _number(value)
    if not (number >= 0.0 and (may_be_infinite or math.isfinite(number))):
        raise DecaffError(f"{name} is {value!r}, expected a number of {unit} of 0 or more")
    return number


def finite(name: str, value: Any, unit: str) -> float:
    """Return *value* as a float of either sign; the rest as `positive`.

    Parameters
    ----------
    name, value, unit
        As of `positive`.

    Raises
    ------
    DecaffError
        If it is no such number.
    """
    number = _number(value)
    if not math.isfinite(number):
        raise DecaffError(f"{name} is {value!r}, expected a number of {unit}")
    return number


def whole(name: str, value: Any, least: int) -> int:
    """Return *value* as an int.

    Parameters
    ----------
    name : str
        What the caller calls it, for the message.
    value : int
        Booleans are none.
    least : int
        The smallest that is allowed.

    Raises
    ------
    DecaffError
        If it is no whole number, or a smaller one.
    """
    try:
        number = operator.index(value) if not isinstance(value, bool) else least - 1
    except TypeError:
        number = least - 1
    if number < least:
        raise DecaffError(f"{name} is {value!r}, expected a whole number of {least} or more")
    return number


def _number(value: Any) -> float:
    try:
        return float(value) if not isinstance(value, (bool, str, bytes)) else math.nan
    except (TypeError, ValueError, OverflowError):
        return math.nan
