"""Designs: the conditions of a study, one after the other and never all at once in memory."""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from proximity.lab.sweep.jobs import Job

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
