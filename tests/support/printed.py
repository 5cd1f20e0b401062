"""Numbers as a page prints them: right to their last digit."""

from decimal import Decimal

import pytest


def printed(*texts, digits=0.5):
    """What must be met within so many of the last digit that is printed."""
    numbers = [_number(text, digits) for text in texts]
    return numbers[0] if len(numbers) == 1 else numbers


def _number(text, digits):
    exact = Decimal(text)
    # A hair more: the page rounded a number that was rounded itself.
    allowed = digits * 10.0 ** exact.as_tuple().exponent * (1.0 + 1e-6)
    return pytest.approx(float(exact), rel=0.0, abs=allowed)
