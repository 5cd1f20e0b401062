"""The gloves of a hand, read from their calibration files: one for each finger."""

import logging
import os
from collections.abc import Sequence
from functools import cache
from typing import TypeVar

from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.calibration import (
    Calibration,
    check_age,
    read_calibration,
    read_glove_file,
)
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError, DecaffError

G = TypeVar("G")
LOGGER = logging.getLogger("proximity.gloves")


def read_glove(path: str | os.PathLike[str], most_days: float | None = None) -> CalibratedGlove:
    """Return a glove as it was measured, unless that was too long ago.

    A calibration of a simulated glove is warned of, once for each file.
    """
    return _worn(path, read_calibration(path), most_days)


def read_any_glove(path: str | os.PathLike[str], most_days: float | None = None) -> Glove | CalibratedGlove:
    """Return a glove as it was measured, as of `read_glove`, or as designed where nobody has measured it."""
    found = read_glove_file(path)
    return found if isinstance(found, Glove) else _worn(path, found, most_days)


def _worn(path: str | os.PathLike[str], calibration: Calibration, most_days: float | None) -> CalibratedGlove:
    if calibration.is_simulated:
        _warn_of_simulated(os.fsdecode(path))
    try:
        check_age(calibration, most_days=most_days)
        return CalibratedGlove(calibration.design, calibration)
    except (ArgumentError, DecaffError) as unfit:
        raise DecaffError(f"{os.fsdecode(path)}: {unfit}") from unfit


@cache
def _warn_of_simulated(path: str) -> None:
    LOGGER.warning("%s: this is the calibration of a simulated glove, not of a hand", path)


def as_many(gloves: Sequence[G], count: int) -> list[G]:
    """Return what there is of so many fingers: one for all, or as they are."""
    if len(gloves) not in (1, count):
        raise DecaffError(
            f"{len(gloves)} calibrations for {count} fingers, expected one for all, or one for each"
        )
    return list(gloves) * count if len(gloves) == 1 else list(gloves)
