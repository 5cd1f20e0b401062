"""Jobs, with the factors that a study may vary and the measures that are reported; and designs of conditions.

The conditions of a study come one after the other and are never all at once in memory.
"""

import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from proximity.lab.sweep.node_files import NodeFiles
from proximity.service.config.table_fields import REQUIRED, Range

Values = Mapping[str, Any]
"""Factors of one condition by name, in SI units; None where a factor is absent or does not matter."""


class Kind(StrEnum):
    """Kinds of values that a factor has."""

    FILE = "file"
    NUMBER = "number"
    WHOLE = "whole number"
    WORD = "word"
    POINT = "three numbers"


@dataclass(frozen=True, slots=True)
class Factor:
    """What one factor may be."""

    kind: Kind
    default: Any = REQUIRED  # None: as `absent` says
    accepted: Range = field(default_factory=lambda: Range(""))  # of numbers
    words: tuple[str, ...] = ()  # of a word; of a file those that are accepted instead of one
    absent: str = ""  # the word for None, such as "rigid" for the stiffness of a cable; empty: it has none
    only: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Other factors, and with which of their values this one matters; no values: with any but None."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One number that a job finds."""

    unit: str = ""
    is_worse_high: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A function of one condition, with all that it may be asked."""

    name: str
    factors: Mapping[str, Factor]
    measures: Mapping[str, Measure]  # the first ranks conditions where the study file says nothing
    run: Callable[[Values, NodeFiles], dict[str, Any]]
    texts: tuple[str, ...] = ()  # results that are no numbers
    together: tuple[str, ...] = ()  # factors of which a condition has all as numbers, or none

    def normalised(self, values: Values) -> dict[str, Any]:
        """Return a condition with all factors: defaults filled in, and None for what does not matter.

        Two conditions that differ only in what does not matter are one.
        """
        full = {name: values.get(name, factor.default) for name, factor in self.factors.items()}
        return {name: value if self.matters(name, full) else None for name, value in full.items()}

    def matters(self, name: str, values: Values) -> bool:
        """Return whether a factor has a say in a condition."""
        return all(
            values[other] in words if words else values[other] is not None
            for other, words in self.factors[name].only.items()
        )


KEY_BYTES = 10
"""Of a key: two of a million conditions share one with a probability of 4e-13."""


class Design(StrEnum):
    """Ways to choose conditions from factors."""

    GRID = "grid"
    """Every combination of all values."""
    LIST = "list"
    """The rows of [[conditions]], each with every combination of the other factors."""
    LATIN = "latin-hypercube"
    """Samples that fill the space of all factors evenly."""


@dataclass(frozen=True, slots=True)
class Span:
    """Numbers from one to another."""

    first: float
    last: float
    count: int | None = None  # None: every number between, for a Latin hypercube
    is_log: bool = False
    is_whole: bool = False

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the numbers at shares of the way, 0 to 1."""
        if self.is_log:
            return self.first * (self.last / self.first) ** shares
        return self.first + (self.last - self.first) * shares

    def values(self) -> tuple[float | int, ...]:
        """Return all numbers, as often as `count` says; whole ones once each."""
        numbers = self.at(np.linspace(0.0, 1.0, self.count or 1)).tolist()
        numbers[-1] = self.last if (self.count or 1) > 1 else numbers[-1]
        return tuple(dict.fromkeys(map(round, numbers))) if self.is_whole else tuple(numbers)


Levels = tuple[Any, ...] | Span


@dataclass(frozen=True, slots=True)
class Exclusion:
    """Conditions that are left out: those in which all of these factors are like that."""

    words: Mapping[str, tuple[Any, ...]]  # one of these values
    bounds: Mapping[str, tuple[float, float]]  # above the first and below the second

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Whether a condition is left out."""
        is_among = all(values[name] in words for name, words in self.words.items())
        return is_among and all(
            values[name] is not None and low < values[name] < high
            for name, (low, high) in self.bounds.items()
        )


@dataclass(frozen=True, slots=True)
class Condition:
    """One row of a study."""

    key: str  # of what it is, and of what is in its files
    values: Mapping[str, Any]
    digests: Mapping[str, str]  # SHA-256 of the file that a factor names


@dataclass(frozen=True, slots=True, eq=False)
class ConditionSet:
    """All conditions of a study; iterating makes them anew, in the same order every time."""

    job: Job
    design: Design
    levels: Mapping[str, Levels]
    rows: tuple[Mapping[str, Any], ...]  # of a list
    samples: int  # of a Latin hypercube
    seed: int
    exclusions: tuple[Exclusion, ...]
    digests: Mapping[str, str]  # by file, as the study names it

    def __iter__(self) -> Iterator[Condition]:
        """Yield every condition once; those with one file follow each other."""
        seen: set[bytes] = set()
        for chosen in self._chosen():
            values = self.job.normalised(chosen)
            if any(exclusion.holds(values) for exclusion in self.exclusions):
                continue
            digests = {
                name: self.digests[value]
                for name, value in values.items()
                if isinstance(value, str) and value in self.digests
            }
            key = key_of(self.job.name, values, digests)
            if (short := bytes.fromhex(key)) not in seen:
                seen.add(short)
                yield Condition(key, values, digests)

    def _chosen(self) -> Iterator[dict[str, Any]]:
        if self.design == Design.LATIN:
            yield from self._latin()
            return
        # Files change least often: what is read and compiled for one serves all its conditions.
        names = sorted(self.levels, key=lambda name: name not in ("scene", "recording"))
        values = [_values(self.levels[name]) for name in names]
        for row in self.rows or ({},):
            for combination in itertools.product(*values):
                yield {**dict(zip(names, combination, strict=True)), **row}

    def _latin(self) -> Iterator[dict[str, Any]]:
        from scipy.stats import qmc  # 0.5 s, and only for this design

        varied = [name for name, levels in self.levels.items() if isinstance(levels, Span) or len(levels) > 1]
        fixed = {name: _values(levels)[0] for name, levels in self.levels.items() if name not in varied}
        shares = qmc.LatinHypercube(len(varied), rng=self.seed).random(self.samples)
        columns = {
            name: _sampled(self.levels[name], column) for name, column in zip(varied, shares.T, strict=True)
        }
        for row in range(self.samples):
            yield {**fixed, **{name: column[row] for name, column in columns.items()}}


def key_of(job: str, values: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    """Return the key of a condition: a hash of its job, its factors, and the content of its files."""
    said = json.dumps([job, values, digests], sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(said.encode(), digest_size=KEY_BYTES).hexdigest()


def _values(levels: Levels) -> tuple[Any, ...]:
    return levels.values() if isinstance(levels, Span) else levels


def _sampled(levels: Levels, shares: np.ndarray) -> list[Any]:
    if isinstance(levels, Span):
        numbers = levels.at(shares)
        return [round(number) for number in numbers.tolist()] if levels.is_whole else numbers.tolist()
    return [levels[int(share * len(levels))] for share in shares.tolist()]
