"""Classification of pairs of parts as clash, fit or contact, by their penetration."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Any

from proximity.errors import MeshError
from proximity.scene.overlap import overlap
from proximity.scene.pairs import SHARING, Clearance, Relation, deepest_of
from proximity.scene.scene import Scene

CONTACT = 1e-8  # m
"""Depth up to which parts of a triangle file count as touching.

The import of STEP rounds by about this length.
"""
TOLERANCE, EXIT_TOLERANCE = 0.001, 0.01
"""Relative tolerances of the deepest point and of the penetration depth."""


@dataclass(frozen=True, slots=True)
class MeasuredPair:
    """Measurements of two parts, in m and in the scene's frame. An unknown volume is None."""

    clearance: Clearance
    relation: Relation
    deepest: float = 0.0
    deepest_lower: float = 0.0
    deepest_point: Any = None
    is_clash: bool = False
    volume: float | None = 0.0
    depth: float = 0.0
    direction: Any = None

    @property
    def names(self) -> frozenset[str]:
        """Names of both parts."""
        return frozenset(self.clearance[:2])

    @property
    def is_fit(self) -> bool:
        """Whether the parts overlap by more than rounding, but at most by the contact limit."""
        return not self.is_clash and self.deepest_lower > CONTACT

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Key for sorting. Clashes come first, from the deepest on; then other pairs, from the nearest on."""
        return (not self.is_clash, -self.deepest if self.is_clash else 0.0, self.clearance.distance)


def contact_limit(scene: Scene) -> float:
    """Return the depth, m, up to which parts count as touching.

    It is the deviation of triangles from the surfaces of the file.
    """
    return (scene.report and scene.report.approximation) or CONTACT


def _measure(scene: Scene, pair: Clearance, contact: float, *, is_cad: bool) -> MeasuredPair:
    """Measure the penetration of two parts. They count as touching up to a depth of *contact*, m."""
    touching = Relation.TOUCHING
    deviation = sum(scene.part(name).deviation for name in pair[:2]) if is_cad else 0.0
    contact += deviation if deviation < inf else 0.0
    if pair.relation not in SHARING:
        return MeasuredPair(pair, touching if pair.distance <= contact else pair.relation)
    upper, lower, point, _ = deepest_of(scene, pair.first, pair.second, TOLERANCE)
    volume = _volume(scene, pair)
    is_open = not all(scene.part(name).solid.has_inside for name in pair[:2])
    if upper <= contact and not is_open:
        return MeasuredPair(pair, touching, upper, lower, point, volume=volume)
    deep = scene.penetration(pair.first, pair.second, tolerance=EXIT_TOLERANCE)
    return MeasuredPair(pair, pair.relation, upper, lower, point, True, volume, deep.depth, deep.direction)


def _volume(scene: Scene, pair: Clearance) -> float | None:
    """Return the common volume of two parts, or None if a part is open."""
    try:
        common = overlap(scene, pair.first, pair.second)
    except MeshError:
        return None
    return 0.0 if common is None else common.volume


def measure_pairs(
    scene: Scene, pairs: Iterable[Clearance], contact: float, *, is_cad: bool = False
) -> list[MeasuredPair]:
    """Measure pairs of parts and sort them by `MeasuredPair.rank`.

    *contact*: depth, m, up to which parts count as touching. *is_cad*: plus the deviations of both, up to
    which their CAD surfaces may fit.
    """
    found = (_measure(scene, pair, contact, is_cad=is_cad) for pair in pairs)
    return sorted(found, key=lambda pair: pair.rank)
