"""Checks of the numbers that models are made of: those of `checks`, which raise a `DecaffError` here."""

from functools import partial

from proximity import checks
from proximity.errors import DecaffError

positive = partial(checks.positive, error=DecaffError)
not_negative = partial(checks.not_negative, error=DecaffError)
finite = partial(checks.finite, error=DecaffError)
whole = partial(checks.whole, error=DecaffError)
