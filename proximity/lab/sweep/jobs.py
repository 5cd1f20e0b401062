"""Jobs, their factors and their measures: what a study may vary, who computes, and what is reported."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

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
