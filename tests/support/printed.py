"""Numbers as printed on a page, accurate to their last digit."""

from decimal import Decimal

import pytest


def printed(*texts, digits=0.5):
    """Return the number with a tolerance of *digits* units of its last printed digit."""
    numbers = [_number(text, digits) for text in texts]
    return numbers[0] if len(numbers) == 1 else numbers


def _number(text, digits):
    exact = Decimal(text)
    # Slightly more, since the page may round a number that was already rounded.
    allowed = digits * 10.0 ** exact.as_tuple().exponent * (1.0 + 1e-6)
    return pytest.approx(float(exact), rel=0.0, abs=allowed)
