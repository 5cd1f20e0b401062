"""Penetration of two parts: the displacement that frees one of the other, and the deepest point."""

from typing import Any, NamedTuple

import numpy as np

from proximity.kernels.answers import DEEPEST_ANSWER, EXIT_ANSWER
from proximity.kernels.entries import deepest_point, find_exit
from proximity.scene.model.assembly import Model

DEEPEST_BUDGET = 2_000_000
"""Steps in each direction, about 2 s, after which the search returns the present bounds."""


class Penetration(NamedTuple):
    """Penetration of two parts.

    ``first`` and ``second`` are the parts' names. *Way out*: moved by ``depth``, m, along ``direction``,
    (3,), scene's frame, the first part does not overlap the second; moved by less than ``lower``, m, it does.
    *Deepest point*: no point of either part is farther inside the other than ``deepest``, m;
    ``deepest_point``, (3,) m, scene's frame, is at least ``deepest_lower``, m, inside. For parts that do not
    overlap all are 0 and the point is nan.
    """

    first: str
    second: str
    depth: float
    lower: float
    direction: np.ndarray
    deepest: float
    deepest_lower: float
    deepest_point: np.ndarray


class DeepestPoint(NamedTuple):
    """Bounds, m, of the largest depth of a point of either part in the other, the point, and the steps."""

    upper: float
    lower: float
    point: np.ndarray
    steps: int


def find_deepest(
    model: Model, first: int, second: int, tolerance: float, budget: int = DEEPEST_BUDGET
) -> DeepestPoint:
    """Search both parts for their deepest point in the other; *tolerance*: relative, between its bounds."""
    found = np.empty(1, DEEPEST_ANSWER)
    deepest_point(model.packed, first, second, tolerance, budget, found)
    lower, upper, _, steps = found[0].tolist()
    return DeepestPoint(upper, lower, found["point"][0], steps)


def measure_exit(
    model: Model,
    pair: tuple[int, int],
    faces: tuple[np.ndarray, np.ndarray],
    direction: np.ndarray,
    tolerance: float,
) -> Any:
    """Search for the displacement that frees the first part; *faces*: one of each surface of either part."""
    found = np.empty(1, EXIT_ANSWER)
    find_exit(model.packed, *pair, *faces, direction, tolerance, 0, found)
    return found[0]
