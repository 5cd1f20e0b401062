"""Queries of the command line: points are read in chunks, and answered in the user's unit.

Lengths have at most 15 significant digits, as `lengths` rounds them; directions and barycentric coordinates
are exact.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

import proximity
from proximity.cli.lengths import distances_in_units, in_units
from proximity.cli.output import number, report
from proximity.cli.parts.points import Points
from proximity.errors import ArgumentError
from proximity.scene.loader import notes_on_sizes
from proximity.scene.queries.results import NO_FACE, Feature

FAR = 1000.0
"""Sizes of the scene: points beyond are noted."""
FEATURE_WORDS = {int(feature): feature.name.lower() for feature in Feature}

Answers = dict[str, list[Any]]
"""By names of fields: an entry an answer, which is a number, three numbers, a word, or None for nothing.

Fields are named as in the library's results; ``face`` is the row of the file's faces, ``face_id`` that of the
part's mesh.
"""


class Question:
    """A kind of query of a scene, asked in a unit; counts the points that are far away."""

    def __init__(
        self,
        scene: "proximity.Scene",
        units: str,
        metres: float,
        direction: list[float] | None,
        workers: int,
        *,
        is_segment: bool,
    ) -> None:
        self.scene, self.units, self._metres, self._workers = scene, units, metres, workers
        self.mode = "segment" if is_segment else "closest" if direction is None else "ray"
        self._direction = direction
        self._bounds = in_units(np.array(scene.bounds), metres)
        self._size = float((self._bounds[1] - self._bounds[0]).max())
        self._asked, self._far_count, self._farthest = 0, 0, 0.0

    def answers(self, chunks: Iterable[Points]) -> Iterator[Answers]:
        """Answer chunk by chunk; at least one chunk, which may be empty."""
        ask = {"closest": self._closest, "ray": self._first_hits, "segment": self._closest_to_segments}
        is_pair = self.mode == "segment"
        for chunk in chunks:
            rows = np.array(chunk.coordinates, dtype=np.float64).reshape(-1, 3)
            self._count_far(rows)
            rows = rows[: len(rows) // 2 * 2] if is_pair else rows
            names = None if chunk.names is None else chunk.names[: len(rows)]
            with np.errstate(over="ignore"):  # too far for a float64 is not finite, and answered so
                points = rows * self._metres
            found: dict[str, Any] = {}
            if names is not None:
                pair = {"start_name": names[0::2], "end_name": names[1::2]}
                found = pair if is_pair else {"name": names}
            found |= ask[self.mode](rows, points)
            yield {
                name: values.tolist() if isinstance(values, np.ndarray) else values
                for name, values in found.items()
            }
        if is_pair and self._asked % 2 == 1:
            raise ArgumentError(f"points are taken in pairs (start, end), but there are {self._asked}")

    def _closest(self, rows: np.ndarray, points: np.ndarray) -> dict[str, Any]:
        hits = self.scene.closest(points, workers=self._workers)
        words = zip(hits.feature.tolist(), hits.face_id.tolist(), strict=True)
        return {
            "query": rows,
            "signed_distance": distances_in_units(hits.signed_distance, self._metres, points, hits.point),
            "is_signed": hits.is_signed,
            "point": in_units(hits.point, self._metres),
            "gradient": hits.gradient,
            **self._faces(hits),
            "feature": [None if face == NO_FACE else FEATURE_WORDS.get(feature) for feature, face in words],
            "barycentric": hits.barycentric,
        }

    def _first_hits(self, rows: np.ndarray, starts: np.ndarray) -> dict[str, Any]:
        directions = np.broadcast_to(np.array(self._direction), rows.shape)
        hits = self.scene.cast(starts, directions, workers=self._workers)
        return {
            "origin": rows,
            "direction": directions,
            "distance": distances_in_units(hits.distance, self._metres, starts, hits.point),
            "point": in_units(hits.point, self._metres),
            "normal": hits.normal,
            **self._faces(hits),
            "barycentric": hits.barycentric,
        }

    def _closest_to_segments(self, rows: np.ndarray, ends: np.ndarray) -> dict[str, Any]:
        hits = self.scene.closest_to_segments(ends[0::2], ends[1::2], workers=self._workers)
        both = hits.point_on_segment, hits.point_on_solid
        return {
            "start": rows[0::2],
            "end": rows[1::2],
            "distance": distances_in_units(hits.distance, self._metres, *both),
            "fraction": hits.fraction,
            "point_on_segment": in_units(hits.point_on_segment, self._metres),
            "point_on_solid": in_units(hits.point_on_solid, self._metres),
            **self._faces(hits),
        }

    def _faces(self, hits: Any) -> dict[str, Any]:
        """Name part and face of each hit; None where nothing was found."""
        parts = hits.part.tolist()
        faces = np.full(hits.face_id.shape, NO_FACE, dtype=np.int64)
        for index in {*parts} - {NO_FACE}:
            here = hits.part == index
            faces[here] = self.scene.parts[index].source_faces[hits.face_id[here]]
        names = [None if index == NO_FACE else self.scene.parts[index].name for index in parts]
        ids = {"part": hits.part, "part_name": names, "face": faces, "face_id": hits.face_id}
        return {
            name: values if name == "part_name" else [None if id == NO_FACE else id for id in values.tolist()]
            for name, values in ids.items()
        }

    def write_notes_on_sizes(self) -> None:
        """Say on stderr if the file is probably in another unit."""
        for note in notes_on_sizes(self.scene):
            report(f"note: {note}")

    def _count_far(self, points: np.ndarray) -> None:
        """Count points much farther away than the scene is large; what is not finite is left out."""
        lower, upper = self._bounds
        with np.errstate(over="ignore", invalid="ignore"):
            gaps = np.maximum(np.maximum(lower - points, points - upper), 0.0)
        is_far = (gaps.max(axis=1, initial=0.0) > FAR * self._size) & np.isfinite(points).all(axis=1)
        distances = [math.hypot(*gap) for gap in gaps[is_far].tolist()]
        self._asked += len(points)
        self._far_count += len(distances)
        self._farthest = max([self._farthest, *distances])

    def write_note_on_far_points(self) -> None:
        """Say on stderr how many points were much farther away than the scene is large."""
        if self._far_count:
            report(
                f"note: {self._far_count} of {self._asked} points are more than {FAR:g} scene sizes of "
                f"{number(self._size)} {self.units} away, the farthest {number(self._farthest)} "
                f"{self.units}: points or file may be in another unit than {self.units}"
            )
