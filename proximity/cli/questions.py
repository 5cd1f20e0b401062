"""What is asked on the command line: points in chunks, as they come, and the answers to them."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import proximity
from proximity.cli import answers
from proximity.cli.lengths import in_units
from proximity.cli.points import Points
from proximity.cli.views.wording import number
from proximity.errors import QueryError

FAR = 1000.0
"""Sizes of the scene: points beyond are noted."""

Fields = dict[str, list[Any]]
Ask = Callable[[np.ndarray], Fields]


class FarPoints:
    """Counts the points that are much farther away than the scene is large.

    Parameters
    ----------
    scene : Scene
        What is asked.
    units : str
        What points are in.
    metres : float
        Metres in one unit.
    """

    def __init__(self, scene: "proximity.Scene", units: str, metres: float) -> None:
        self._lower, self._upper = (in_units(corner, metres) for corner in scene.bounds)
        self._size = float((self._upper - self._lower).max())
        self._units = units
        self._asked, self._count, self._farthest = 0, 0, 0.0

    def look_at(self, points: np.ndarray) -> None:
        """Count those of *points*, (N, 3) float64 in the unit; what is not finite is left out."""
        with np.errstate(over="ignore", invalid="ignore"):
            gaps = np.maximum(np.maximum(self._lower - points, points - self._upper), 0.0)
        is_far = (gaps.max(axis=1, initial=0.0) > FAR * self._size) & np.isfinite(points).all(axis=1)
        distances = [math.hypot(*gap) for gap in gaps[is_far].tolist()]
        self._asked += len(points)
        self._count += len(distances)
        self._farthest = max([self._farthest, *distances])

    def note(self) -> str | None:
        """Return a sentence about them, or None where there are none."""
        if not self._count:
            return None
        return (
            f"{self._count} of {self._asked} points are more than {FAR:g} scene sizes of "
            f"{number(self._size)} {self._units} away, the farthest {number(self._farthest)} {self._units}: "
            f"points or file may be in another unit than {self._units}"
        )


@dataclass(frozen=True, slots=True)
class Questions:
    """What is asked, and how."""

    mode: str  # "closest", "ray" or "segment"
    points: Iterable[Points]  # in the unit; chunks of an even number of points, but for the last
    ask: Ask  # rows of points -> answers
    far: FarPoints  # counts as chunks are asked

    def chunks(self) -> Iterator[Fields]:
        """Answer chunk by chunk; at least one chunk, which may be empty.

        Raises
        ------
        QueryError
            Behind all answers, where a segment lacks its end.
        """
        count = 0
        for chunk in self.points:
            rows = np.array(chunk.coordinates, dtype=np.float64).reshape(-1, 3)
            count += len(rows)
            self.far.look_at(rows)
            if self.mode == "segment":
                rows = rows[: len(rows) // 2 * 2]
            yield _names(chunk.names, self.mode, len(rows)) | self.ask(rows)
        if self.mode == "segment" and count % 2 == 1:
            raise QueryError(f"points are taken in pairs (start, end), but there are {count}")


def asker(
    scene: "proximity.Scene", mode: str, direction: tuple[float, ...] | None, metres: float, workers: int
) -> Ask:
    """Return what answers rows of points.

    Parameters
    ----------
    scene : Scene
        Where to look.
    mode : str
        As of `Questions`.
    direction : tuple of 3 floats
        Of rays.
    metres : float
        Metres in one unit.
    workers : int
        Threads; -1 is all cores.
    """
    if mode == "ray":
        return lambda rows: answers.cast(scene, rows, np.array(direction), metres, workers)
    if mode == "segment":
        return lambda rows: answers.closest_to_segments(scene, rows, metres, workers)
    return lambda rows: answers.closest(scene, rows, metres, workers)


def count_of(fields: Fields) -> int:
    """Return how many answers there are.

    Parameters
    ----------
    fields : dict
        Answers, field by field.
    """
    return len(next(iter(fields.values())))


def _names(names: list[str] | None, mode: str, count: int) -> Fields:
    """Fields of the names of the first *count* points."""
    if names is None:
        return {}
    names = names[:count]
    return {"start_name": names[0::2], "end_name": names[1::2]} if mode == "segment" else {"name": names}
