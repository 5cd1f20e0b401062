"""Tables of the numbers in a figure, column by column, and as CSV.

What is drawn is read from such a table, so that the file beside a figure holds exactly what the figure shows.
Columns are in SI units, which their names end in: ``time_s``, ``force_N``.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike

from proximity.errors import ArgumentError


class Table:
    """Columns of equal length, by name."""

    def __init__(self, columns: Mapping[str, ArrayLike]) -> None:
        self.columns = {name: np.asarray(values) for name, values in columns.items()}
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ArgumentError(f"columns have lengths {lengths}, expected one length")

    @classmethod
    def of_rows(cls, names: Sequence[str], rows: Iterable[Sequence[float | str]]) -> "Table":
        """Return a table of what was found row by row."""
        return cls(dict(zip(names, zip(*rows, strict=True), strict=True)))

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column."""
        return self.columns[name]

    def where(self, **values: float | str) -> "Table":
        """Return the rows in which some columns have some values."""
        is_meant = np.logical_and.reduce([self.columns[name] == value for name, value in values.items()])
        return Table({name: column[is_meant] for name, column in self.columns.items()})

    def write_csv(self, stream: TextIO) -> None:
        """Write a line of names and a line a row; reading a number gives the same number."""
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
