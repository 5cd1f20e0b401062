"""Queries of the command line: points are read in chunks, and answers converted to the user's unit.

An answer is a mapping from a field's name to a list with one entry a query: a number, three numbers, a word,
or None where there is nothing. Fields are named as in the library's results; ``face`` is the row of the
file's faces, ``face_id`` that of the part's mesh. Lengths have at most 15 significant digits, as
`lengths` rounds them; directions and barycentric coordinates are exact.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import proximity
from proximity.cli.lengths import distances_in_units, in_units
from proximity.cli.points import Points
from proximity.cli.wording import number
from proximity.errors import ArgumentError
from proximity.scene.queries.results import NO_FACE, Feature

FAR = 1000.0
"""Sizes of the scene: points beyond are noted."""

FEATURE_WORDS = {int(feature): feature.name.lower() for feature in Feature}

Fields = dict[str, list[Any]]
Ask = Callable[[np.ndarray], Fields]


class FarPoints:
    """Counts the points that are much farther away than the scene is large."""

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
    """The kind of query, and its options."""

    mode: str  # "closest", "ray" or "segment"
    points: Iterable[Points]  # in the unit; chunks of an even number of points, but for the last
    ask: Ask  # rows of points -> answers
    far: FarPoints  # counts as chunks are asked

    def chunks(self) -> Iterator[Fields]:
        """Answer chunk by chunk; at least one chunk, which may be empty."""
        count = 0
        for chunk in self.points:
            rows = np.array(chunk.coordinates, dtype=np.float64).reshape(-1, 3)
            count += len(rows)
            self.far.look_at(rows)
            if self.mode == "segment":
                rows = rows[: len(rows) // 2 * 2]
            yield _names(chunk.names, self.mode, len(rows)) | self.ask(rows)
        if self.mode == "segment" and count % 2 == 1:
            raise ArgumentError(f"points are taken in pairs (start, end), but there are {count}")


def asker(
    scene: "proximity.Scene", mode: str, direction: tuple[float, ...] | None, metres: float, workers: int
) -> Ask:
    """Return what answers rows of points."""
    ask = {"closest": _closest, "ray": _first_hits, "segment": _closest_to_segments}[mode]

    def answers_to(rows: np.ndarray) -> Fields:
        with np.errstate(over="ignore"):  # too far for a float64 is not finite, and answered so
            points = rows * metres
        found = ask(scene, rows, points, direction, metres, workers)
        return {name: _listed(values) for name, values in found.items()}

    return answers_to


def _listed(values: np.ndarray | list[Any]) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else values


def _closest(
    scene: "proximity.Scene", rows: np.ndarray, points: np.ndarray, _: Any, metres: float, workers: int
) -> dict[str, Any]:
    hits = scene.closest(points, workers=workers)
    words = zip(hits.feature.tolist(), hits.face_id.tolist(), strict=True)
    return {
        "query": rows,
        "signed_distance": distances_in_units(hits.signed_distance, metres, points, hits.point),
        "is_signed": hits.is_signed,
        "point": in_units(hits.point, metres),
        "gradient": hits.gradient,
        **_faces(scene, hits),
        "feature": [None if face == NO_FACE else FEATURE_WORDS.get(feature) for feature, face in words],
        "barycentric": hits.barycentric,
    }


def _first_hits(
    scene: "proximity.Scene",
    rows: np.ndarray,
    starts: np.ndarray,
    direction: Any,
    metres: float,
    workers: int,
) -> dict[str, Any]:
    directions = np.broadcast_to(np.array(direction), rows.shape)
    hits = scene.cast(starts, directions, workers=workers)
    return {
        "origin": rows,
        "direction": directions,
        "distance": distances_in_units(hits.distance, metres, starts, hits.point),
        "point": in_units(hits.point, metres),
        "normal": hits.normal,
        **_faces(scene, hits),
        "barycentric": hits.barycentric,
    }


def _closest_to_segments(
    scene: "proximity.Scene", rows: np.ndarray, ends: np.ndarray, _: Any, metres: float, workers: int
) -> dict[str, Any]:
    hits = scene.closest_to_segments(ends[0::2], ends[1::2], workers=workers)
    return {
        "start": rows[0::2],
        "end": rows[1::2],
        "distance": distances_in_units(hits.distance, metres, hits.point_on_segment, hits.point_on_solid),
        "fraction": hits.fraction,
        "point_on_segment": in_units(hits.point_on_segment, metres),
        "point_on_solid": in_units(hits.point_on_solid, metres),
        **_faces(scene, hits),
    }


def _faces(scene: "proximity.Scene", hits: Any) -> Fields:
    """Name part and face of each hit; None where nothing was found."""
    names = [*(part.name for part in scene.parts), None]  # NO_FACE, -1, takes the last
    faces = np.full(hits.face_id.shape, NO_FACE, dtype=np.int64)
    for index in np.unique(hits.part[hits.face_id != NO_FACE]):
        here = hits.part == index
        faces[here] = scene.parts[index].source_faces[hits.face_id[here]]
    return {
        "part": _or_none(hits.part),
        "part_name": [names[index] for index in hits.part.tolist()],
        "face": _or_none(faces),
        "face_id": _or_none(hits.face_id),
    }


def _or_none(ids: np.ndarray) -> list[int | None]:
    return [None if number == NO_FACE else number for number in ids.tolist()]


def count_of(fields: Fields) -> int:
    """Return how many answers there are."""
    return len(next(iter(fields.values())))


def _names(names: list[str] | None, mode: str, count: int) -> Fields:
    """Fields of the names of the first *count* points."""
    if names is None:
        return {}
    names = names[:count]
    return {"start_name": names[0::2], "end_name": names[1::2]} if mode == "segment" else {"name": names}
