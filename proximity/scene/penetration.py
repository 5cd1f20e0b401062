"""Penetration of two parts: the displacement that frees one of the other, and the deepest point."""

from math import inf
from typing import NamedTuple

import numpy as np

from proximity.kernels.answers import DEEPEST_ANSWER, DEPTH_ANSWER
from proximity.kernels.entries import deepest_point, depth_along
from proximity.scene.model.assembly import Model

MOST_TURNS = 4
"""Number of times that the direction is set to the normal of the surface at which a part comes free."""
BEYOND = 0.4
"""Relative to the tolerance: the distance beyond the expected depth at which the parts should be apart."""
LEAST_GAIN = 0.25
"""Relative to the tolerance: a direction is not turned for a smaller gain."""
ROUGH = 0.1
"""Tolerance while directions are compared."""
REST = 1e-7
"""Relative to a part's size: bounds of the deepest point are brought no closer."""
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
    found, frames = np.zeros(1, DEEPEST_ANSWER), model.frames[[first, second]]
    found["point"] = np.nan
    rest = REST * float(np.linalg.norm(frames["own_upper"] - frames["own_lower"], axis=1).min())
    upper, steps = 0.0, 0
    for inner, outer in ((first, second), (second, first)):
        deepest_point(model.packed, inner, outer, tolerance, rest, budget, found)
        upper = max(upper, float(found["upper"][0]))
        steps += int(found["steps"][0])
    return DeepestPoint(upper, float(found["lower"][0]), found["point"][0].copy(), steps)


class PenetrationSearch:
    """Search for a direction in which the first of two parts of a model is soon free of the second.

    *faces*: one of each surface of either part.
    """

    def __init__(
        self, model: Model, first: int, second: int, faces: tuple[np.ndarray, np.ndarray], budget: int = 0
    ) -> None:
        self._asked = model.packed, first, second, *faces
        self._frames = model.frames[first], model.frames[second]
        self._budget, self.steps = budget, 0
        self._found = np.empty(1, DEPTH_ANSWER)
        self.depth, self.lower, self.direction = inf, 0.0, np.zeros(3)
        self._normal = np.zeros(3)

    def look_along(self, direction: np.ndarray, tolerance: float, expected: float = 0.0) -> bool:
        """Measure the depth along a direction; if it is less than the best, store it and return True.

        *expected*: depth, m; the search begins slightly beyond it.
        """
        left = max(self._budget - self.steps, 1) if self._budget else 0
        found, limit = self._found, self.depth
        found["upper"] = expected * (1.0 + BEYOND * tolerance)
        depth_along(*self._asked, direction, limit, tolerance, left, found)
        self.steps += int(found["steps"][0])
        if not found["upper"][0] < limit:
            return False
        self.depth, self.lower = float(found["upper"][0]) + 0.0, float(found["lower"][0])
        self.direction, self._normal = direction, found["normal"][0].copy()
        return True

    def search(self, tolerance: float) -> None:
        """Search for a direction with a small depth."""
        self._compare_axes()
        self.follow_normals(ROUGH)
        self.refine(tolerance)

    def _compare_axes(self) -> None:
        """Compare the axes of both parts, and the line between their middles."""
        middles = [0.5 * (frame["box_lower"] + frame["box_upper"]) for frame in self._frames]
        between = middles[0] - middles[1]
        length = float(np.linalg.norm(between))
        axes = [frame["rotation"].reshape(3, 3).T for frame in self._frames]
        axes = [*axes, between[None] / length] if length > 0.0 else axes
        directions = np.concatenate(axes)
        for direction in np.unique(np.concatenate([directions, -directions]) + 0.0, axis=0):
            self.look_along(np.ascontiguousarray(direction), ROUGH)

    def follow_normals(self, tolerance: float) -> None:
        """Turn the direction to the normal at which the part comes free, while that reduces the depth."""
        for _ in range(MOST_TURNS):
            gain = 1.0 - float(self._normal @ self.direction)  # share of the depth that turning saves, about
            if not self._normal.any() or gain < LEAST_GAIN * tolerance:
                break
            if not self.look_along(self._normal, tolerance, self.depth):
                break

    def refine(self, tolerance: float) -> None:
        """Narrow the bounds of the best direction to the tolerance."""
        if self.depth < inf and self.depth - self.lower > tolerance * self.depth:
            before, self.depth = (self.depth, self.lower), inf
            self.look_along(self.direction, tolerance, self.depth)
            if self.depth > before[0]:
                self.depth, self.lower = before
