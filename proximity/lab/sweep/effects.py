"""Effects of factors on measures: levels of a factor, their means, and the share of variance they explain."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.lab.sweep.jobs import Job, Kind

MOST_LEVELS = 12
"""More values of a number are put into bins of equal counts; a word of more levels has no effect to show."""
BINS = 8
NOT_USED = "not used"
"""Level of a factor in conditions where it does not matter."""

Level = Any
"""A value of a factor: text, a number, or (lowest, highest) of a bin; None where the factor is absent."""


class Rows:
    """Rows of a study as columns, without those that failed."""

    def __init__(self, job: Job, table: Any) -> None:
        self.job, self.table = job, table.filter(table["failure"].is_null())
        self._columns: dict[str, list[Any]] = {}  # those that were asked for

    def values(self, name: str) -> list[Any]:
        """Return a column of those that did not fail; points are tuples."""
        if name not in self._columns:
            self._columns[name] = self._read(name)
        return self._columns[name]

    def _read(self, name: str) -> list[Any]:
        values = [_hashable(value) for value in self.table[name].to_pylist()]
        others = self.job.factors[name].only if name in self.job.factors else {}
        if not others:
            return values
        given = {other: self.values(other) for other in others}
        return [
            value if self.job.matters(name, {other: of[row] for other, of in given.items()}) else NOT_USED
            for row, value in enumerate(values)
        ]

    def measure(self, name: str) -> np.ndarray:
        """Return a column of numbers, nan where there is none, (N,)."""
        absent = (None, NOT_USED)
        return np.array([np.nan if value in absent else value for value in self.values(name)], np.float64)

    def varied(self) -> list[str]:
        """Return the factors with more than one value."""
        return [name for name in self.job.factors if len(set(self.values(name)) - {NOT_USED}) > 1]

    def is_number(self, name: str) -> bool:
        """Return whether a factor is a number, which can be drawn along an axis."""
        return self.job.factors[name].kind in (Kind.NUMBER, Kind.WHOLE)

    def levels(self, name: str, most: int = MOST_LEVELS) -> tuple[list[Level], np.ndarray]:
        """Return the levels of a factor, and which of them each row has, (N,); none where there are too many.

        *most*: levels of a number, before it is put into bins.
        """
        values = self.values(name)
        given = sorted(set(values) - {None, NOT_USED})
        levels: list[Level] = list(given)
        ids = {value: number for number, value in enumerate(given)}
        if len(given) > most:
            if not self.is_number(name):
                return [], np.zeros(len(values), int)
            edges = np.quantile(given, np.linspace(0.0, 1.0, min(BINS, most) + 1))
            bins = np.clip(np.searchsorted(edges, given, side="right") - 1, 0, len(edges) - 2)
            levels = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
            ids = dict(zip(given, bins.tolist(), strict=True))
        for absent in (None, NOT_USED):
            if absent in values:
                ids[absent] = len(levels)
                levels.append(absent)
        return levels, np.array([ids[value] for value in values], int)

    def label(self, name: str, level: Level) -> str:
        """Return a level in words."""
        if level is None:
            return self.job.factors[name].absent
        if isinstance(level, tuple) and len(level) == 2:
            return f"{level[0]:.3g} to {level[1]:.3g}"
        if isinstance(level, tuple):
            return ", ".join(f"{number:g}" for number in level)
        return f"{level:.4g}" if isinstance(level, float) else str(level)


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect of one factor on one measure."""

    factor: str
    measure: str
    share: float  # of the variance, between the means of its levels: 0 to 1
    labels: tuple[str, ...]
    counts: tuple[int, ...]
    means: tuple[float, ...]


def effect(rows: Rows, factor: str, measure: str) -> Effect | None:
    """Return the effect of a factor on its own, the others as they come; None where it cannot be seen."""
    levels, ids = rows.levels(factor)
    numbers = rows.measure(measure)
    is_known = np.isfinite(numbers)
    ids, numbers = ids[is_known], numbers[is_known]
    is_used = np.array([levels[level] != NOT_USED for level in ids.tolist()], bool) if levels else ids < 0
    ids, numbers = ids[is_used], numbers[is_used]
    present = [level for level in range(len(levels)) if (ids == level).any()]
    if len(present) < 2 or not numbers.var() > 0.0:
        return None
    counts = [int((ids == level).sum()) for level in present]
    if max(counts) < 2 and not rows.is_number(factor):  # names of rows, such as files
        return None
    means = [float(numbers[ids == level].mean()) for level in present]
    between = np.average((np.array(means) - numbers.mean()) ** 2, weights=counts)
    labels = tuple(rows.label(factor, levels[level]) for level in present)
    return Effect(factor, measure, float(between / numbers.var()), labels, tuple(counts), tuple(means))


def _hashable(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
