"""Queries with all their checks: rows of any shape, limits, slices, threads.

A query takes a model, one or two arrays of rows, how far to look, and a number of workers; it returns the
table of its answers. Few plain rows are answered by compiled code alone, see `native.query`.
"""

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity import native
from proximity.checks import as_points
from proximity.errors import ProximityError, UnitsWarning
from proximity.kernels.geometry.frames import MILLIMETRES_FROM, MILLIMETRES_TO
from proximity.kernels.geometry.morton_order import SORT_FROM
from proximity.kernels.layout import FRAME_BOX_LOWER_XYZ, FRAME_BOX_UPPER_XYZ, IN_MILLIMETRES, NO_ROW
from proximity.scene.model.assembly import Model
from proximity.scene.queries.batches import OrderOf, first_slice, morton_order_of, run_batch
from proximity.scene.queries.query_arguments import broadcast_limits, broadcast_rows


def order_of_points(model: Model, count: int) -> tuple[OrderOf | None, int]:
    """Return how to order many points or segments, and how many rows to ask at first."""
    return morton_order_of, first_slice(model.reals.nbytes)


@dataclass(frozen=True, slots=True)
class CheckedQuery:
    """A query of some kind."""

    name: str  # of the entry point
    entry: Any  # the entry point itself
    names: tuple[str, ...]  # what callers call the arrays of rows
    subject: str  # what the rows are, for messages about limits
    width: int  # columns of an answer; of one column the table has no axis of columns
    refusal: Callable[[int], ProximityError]  # the error for what an entry point returns but `NO_ROW`
    order_of: Callable[[Model, int], tuple[OrderOf | None, int]] = order_of_points
    dtype: type = np.float64

    def ask(self, model: Model, *arguments: Any) -> Any:
        """Return the table of answers, in the shape of the question.

        *arguments*: arrays of rows, how far to look, and a number of workers, as the caller gave them.
        """
        *given, max_distance, workers = arguments
        rows = [as_points(each, name) for each, name in zip(given, self.names, strict=True)]
        limits, rows = broadcast_limits(max_distance, broadcast_rows(rows, self.names), self.subject)
        flat = [each.reshape(-1, 3) for each in rows]
        answers: np.ndarray = np.empty((len(flat[0]), self.width), self.dtype)
        order_of, size = self.order_of(model, len(answers))

        def ask_slice(order: np.ndarray, *arrays: np.ndarray) -> int:
            *rows, limits, answers = arrays
            return int(self.entry(model.packed, *rows, order, limits, answers))

        found = run_batch(ask_slice, [*flat, limits, answers], workers, order_of, size)
        answered = (NO_ROW, IN_MILLIMETRES)
        refused = min((first + row for first, row in found if row not in answered), default=NO_ROW)
        if refused != NO_ROW:
            raise self.refusal(refused)
        if self.names == ("points",) and self.dtype is np.float64:
            _warn_of_millimetres(model, answers[:, 0])
        shape = rows[0].shape[:-1]
        return answers.reshape((*shape, self.width) if self.width > 1 else shape)[()]

    def quick(self) -> Any:
        """Return the query as a function that answers few plain rows at once."""
        return native.query(self.name, self.width, SORT_FROM, self.ask)


def _warn_of_millimetres(model: Model, distances: np.ndarray) -> None:
    """Warn a user all of whose points are as far away as points in millimetres; called by `CheckedQuery.ask`.

    The package itself is not warned: its commands and replays say in their own words what is far away.
    """
    caller = sys._getframe(3)  # of the method that asks
    if caller.f_globals.get("__name__", "").startswith("proximity."):
        return
    nearest = float(distances.min(initial=np.inf))
    size = size_of(model)
    if MILLIMETRES_FROM * size < nearest < MILLIMETRES_TO * size:
        words = in_millimetres("the nearest point", nearest, size, "points")
        warnings.warn(words, UnitsWarning, stacklevel=4)


def size_of(model: Model) -> float:
    """Diagonal of the box of all parts, m."""
    box = model.frames[-1]
    return float(np.linalg.norm(box[FRAME_BOX_UPPER_XYZ] - box[FRAME_BOX_LOWER_XYZ]))


def in_millimetres(what: str, distance: float, size: float, names: str) -> str:
    """Say that *what* is so far away that *names* were probably given in millimetres."""
    return (
        f"{what} is {distance:.3g} m from the nearest part, {distance / size:.0f} times the size of the "
        f"scene: {names} are metres"
    )
