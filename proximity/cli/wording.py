"""Numbers and words as text for people."""

import math

MISSING = "-"
FEW_DIGITS = 6  # significant, of numbers that a reader only looks over
NO_LENGTH = 1e-12
"""Of any unit: what is smaller is rounding of lengths that people have."""


def number(value: float, digits: int = 9) -> str:
    """Return *value* with so many significant digits, and zero without a sign.

    *digits*: how many; zeros at the end are left out.
    """
    return f"{value + 0.0:.{digits}g}"


def length(value: float, digits: int = 9) -> str:
    """Return a length as `number`; one that is rounding is zero."""
    return number(0.0 if abs(value) < NO_LENGTH else value, digits)


def counted(count: int, what: str) -> str:
    """Return a number with what it counts."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def printable(text: str) -> str:
    """Return *text* with what could move a terminal's cursor replaced."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def side(signed_distance: float, is_signed: bool) -> str | None:
    """Return on which side of the surface a point is, in a word; None where there is no answer."""
    if math.isnan(signed_distance):
        return None
    if signed_distance == 0.0:
        return "surface"
    if not is_signed:
        return "unknown"
    return "inside" if signed_distance < 0.0 else "outside"
