"""Records of requirements and of their verification. Lengths are in m, in the scene's frame."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import Any, NamedTuple

import numpy as np

from proximity.scene.motion import Motion
from proximity.scene.queries.html_table import html_table

ROUNDING = 1e-9
"""Allowance of a comparison with a limit, as a share of the longest side of the model's box."""


class Verdict(StrEnum):
    """Verdict on a requirement.

    ``HOLDS`` and ``VIOLATED`` follow from bounds of the measured length. ``UNDECIDED``: the limit is between
    the bounds.
    """

    HOLDS = "holds"
    VIOLATED = "is violated"
    UNDECIDED = "cannot be decided"


RANKS = (Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.HOLDS)
"""Verdicts from the worst on."""


class Limits(NamedTuple):
    """Least and greatest accepted length, m. A missing limit is infinite."""

    least: float = -inf
    greatest: float = inf

    def judge(self, lower: float, upper: float, rounding: float) -> Verdict:
        """Return the verdict on a length between two bounds. A length equal to its limit is accepted."""
        if upper < self.least - rounding or lower > self.greatest + rounding:
            return Verdict.VIOLATED
        if lower >= self.least - rounding and upper <= self.greatest + rounding:
            return Verdict.HOLDS
        return Verdict.UNDECIDED

    def margin(self, lower: float, upper: float) -> float:
        """Return the length by which the bounds are within the limits; negative if they exceed one."""
        return min(lower - self.least, self.greatest - upper)


@dataclass(frozen=True, slots=True, eq=False)
class Requirement:
    """A requirement of the file, not verified yet."""

    index: int  # in the list of the file
    name: str
    kind: str  # key of `measurements.KINDS`
    limits: Limits
    between: tuple[str, ...]  # two names or patterns of parts
    allowed: tuple[tuple[str, str], ...] = ()  # pairs that are left out
    along: tuple[float, ...] | None = None  # unit vector, axis of the gap; None: in any direction
    motion: Motion | None = None  # of the first part
    pose: Motion | None = None  # the first part is measured at its end
    scale: float = 1.0  # rad or m in a unit of the positions of the motion
    unit: str = ""  # of these positions


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPair:
    """Verdict on two parts, whose names are ``first`` and ``second``.

    ``verdict`` is a `Verdict`. The true length of the requirement, a gap or a depth, is between ``lower`` and
    ``upper``, m. The bounds include ``deviation``, m, of the triangles of both parts from the CAD surfaces.
    ``point_on_first`` and ``point_on_second``, (3,) m, are the ends of the measured length. ``position`` is
    that of a motion, in degrees or in the unit of the file, else None. ``reason`` explains a verdict that
    cannot be decided, and ``tolerance``, m, is the step tolerance that may decide it, else None.
    """

    first: str
    second: str
    verdict: Verdict
    lower: float
    upper: float
    deviation: float
    point_on_first: np.ndarray
    point_on_second: np.ndarray
    position: float | None = None
    reason: str = ""
    tolerance: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedRequirement:
    """Verdict on a requirement, and on each of its pairs.

    ``name``, ``kind`` and ``limits`` (least and greatest, m) are those of the file. ``pairs`` begins with the
    pair that decides: the one that exceeds a limit by most, or is nearest to it. ``unit`` is that of the
    positions of a motion. ``allowed_count`` pairs were left out, and ``seconds`` is the time of the
    measurement.
    """

    name: str
    kind: str
    limits: Limits
    pairs: tuple[VerifiedPair, ...]
    unit: str
    allowed_count: int
    seconds: float

    @property
    def verdict(self) -> Verdict:
        """Verdict of the pair that decides."""
        return self.pairs[0].verdict


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """Verdicts on all requirements of a file.

    ``path`` is that of the file, and ``requirements`` are in its order. ``units`` is the unit of its lengths,
    and ``settings`` are its other settings. ``files`` has the SHA-256 of every file that was read, by its
    path; ``geometry`` is the SHA-256 of the names, poses and triangles of the parts. ``notes`` are sentences
    for the user, and ``seconds`` is the time taken, with reading the files.
    """

    path: str
    requirements: tuple[VerifiedRequirement, ...]
    units: str
    settings: Mapping[str, Any]
    files: Mapping[str, str]
    geometry: str
    notes: tuple[str, ...]
    seconds: float

    @property
    def verdict(self) -> Verdict:
        """The worst verdict: the file holds if every requirement holds."""
        return min((each.verdict for each in self.requirements), key=RANKS.index)

    @property
    def holds(self) -> bool:
        """Whether every requirement certainly holds."""
        return self.verdict is Verdict.HOLDS

    def counts(self) -> dict[Verdict, int]:
        """Return the number of requirements with each verdict."""
        found = Counter(each.verdict for each in self.requirements)
        return {verdict: found[verdict] for verdict in Verdict}

    def __str__(self) -> str:
        return "\n".join(f"{each.name}: {each.verdict}" for each in self.requirements)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.counts().items() if count)
        return f"Verification({self.path!r}, {counts})"

    def _repr_html_(self) -> str:
        names = "first", "second", "lower", "upper"
        rows = (
            [each.name, each.kind, each.verdict, *(getattr(each.pairs[0], name) for name in names)]
            for each in self.requirements
        )
        return html_table(repr(self), ("name", "kind", "verdict", *names), rows, len(self.requirements))
