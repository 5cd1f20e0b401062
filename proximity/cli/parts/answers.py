"""Answers to queries, and as JSON and CSV for programs.

`FIELDS` defines all fields. Points are read, answered and written in chunks. Lengths are in the user's unit
with at most 15 significant digits; numbers in JSON and CSV read back as the same float64. CSV writes nan and
inf as NumPy and pandas read them; missing values are empty, and text is never a formula.
"""

import csv
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple, TextIO

import numpy as np

import proximity
from proximity.cli import progress
from proximity.cli.output import (
    DIGITS as MAX_DIGITS,
)
from proximity.cli.output import (
    MISSING,
    in_units,
    length,
    number,
    plain,
    printable,
    report,
)
from proximity.cli.parts.points import Points
from proximity.errors import ArgumentError, ProximityError
from proximity.scene.queries.results import NO_FACE, NO_PART, Feature

NUMBER_WIDTH = 9  # of a column, as -123.4567
SMALLEST_M = 1e-7  # in a table: 4 decimals of a millimetre
DIRECTION_DECIMALS = 9
DIGITS = 9  # significant, of numbers in lines
FAR = 1000.0
"""Scene sizes beyond which points are noted."""


@dataclass(frozen=True, slots=True)
class Field:
    """Field of an answer, in JSON and CSV; in a table if it has a title, in lines if it has a label."""

    title: str = ""  # of its column in a table; the axis follows
    label: str = ""  # of its line
    axes: str = ""  # of three numbers
    is_length: bool = False  # in the user's unit
    is_text: bool = False

    def shown(self, value: Any, digits: int = DIGITS) -> str:
        """Return a value as text; rounding errors in components of directions are zero."""
        if self.is_text:
            return MISSING if value is None else printable(str(value))
        if self.is_length:
            return length(value, digits)
        return number(round(value, DIRECTION_DECIMALS) if self.axes else value, DIGITS)


_text = partial(Field, is_text=True)
FIELDS = {
    "name": _text("name", "name"),
    "start_name": _text("name", "start name"),
    "end_name": _text(label="end name"),
    "ray": _text("ray"),
    "point_number": _text("#"),
    "rank": Field(),
    "query": Field("{}_{unit}", axes="xyz", is_length=True),
    "origin": Field("{}_{unit}", axes="xyz", is_length=True),
    "direction": Field(axes="xyz"),
    "start": Field(axes="xyz", is_length=True),
    "end": Field(axes="xyz", is_length=True),
    "signed_distance": Field("distance_{unit}", "signed distance", is_length=True),
    "distance": Field("distance_{unit}", "distance", is_length=True),
    "lower": Field("lower_{unit}", "CAD surface, from", is_length=True),
    "upper": Field("upper_{unit}", "CAD surface, to", is_length=True),
    "side": _text("side"),
    "crossing": _text("crossing", "the ray"),
    "is_signed": Field(),
    "fraction": Field(label="fraction"),
    "point": Field("point_{}", "closest point", axes="xyz", is_length=True),
    "point_on_segment": Field("segment_{}", "on segment", axes="xyz", is_length=True),
    "point_on_solid": Field("solid_{}", "on solid", axes="xyz", is_length=True),
    "gradient": Field(label="normal", axes="xyz"),
    "normal": Field(label="normal", axes="xyz"),
    "part": Field(),
    "part_name": _text("part", "part"),
    "face": _text(label="face"),
    "face_id": Field(),
    "feature": _text(label="on"),
    "barycentric": Field(axes="012"),
}
TITLED = ("name", "start_name", "end_name")
GIVEN = _text()
"""Field of a column that is copied from the points."""
TEXT_WIDTHS = {
    "name": 10, "start_name": 10, "ray": 5, "point_number": 5, "side": len("outside"),
    "crossing": len("crossing"), "part_name": 24,
}  # fmt: skip
FACES = ("part", "part_name", "face", "face_id")
"""``face`` is the row in the faces of the file, ``face_id`` that in the mesh of the part."""
CLOSEST = ("signed_distance", "is_signed", "point", "gradient", *FACES, "feature", "barycentric")
HIT_FIELDS = [name for name in CLOSEST if name not in ("part_name", "face")]
ANSWERED = {  # by kind of query, after the query points; named as in the library's results
    "closest": CLOSEST,
    "cad": ("signed_distance", "lower", "upper", *CLOSEST[1:]),
    "nearest": ("point_number", "rank", *CLOSEST),
    "ray": ("distance", "point", "normal", *FACES, "barycentric"),
    "crossings": ("ray", "distance", "crossing", "point", "normal", *FACES, "barycentric"),
    "segment": ("distance", "fraction", "point_on_segment", "point_on_solid", *FACES),
}
Answers = dict[str, list[Any]]
"""By field name, a value per answer: a number, three numbers, a word, or None."""


class Question:
    """Query of a scene in a unit; counts points that are far away."""

    def __init__(
        self,
        scene: "proximity.Scene",
        units: str,
        metres: float,
        direction: list[float] | None,
        workers: int,
        *,
        is_segment: bool,
        is_all: bool = False,
        min_distance: float = 0.0,
        nearest: int | None = None,
        is_cad: bool = False,
    ) -> None:
        self.scene, self.units, self._metres, self._workers = scene, units, metres, workers
        ray_mode, point_mode = "crossings" if is_all else "ray", "nearest" if nearest else "closest"
        self.mode = "segment" if is_segment else point_mode if direction is None else ray_mode
        self._nearest = min(nearest or 1, len(scene.parts))
        self._direction, self._min_distance = direction, min_distance * metres
        self._lower, self._upper = in_units(np.array(scene.bounds), metres)
        self._size = float((self._upper - self._lower).max())
        self._fields = ANSWERED["cad" if is_cad else self.mode]
        self._asked, self._far_count, self._farthest = 0, 0, 0.0
        self.decimals = max(1, min(7, round(math.log10(metres / SMALLEST_M))))
        whole = len(f"{max(*np.abs(self._lower), *np.abs(self._upper)):.0f}")  # digits before the point
        self.digits = max(DIGITS, min(whole + 4, MAX_DIGITS))
        self.width = max(NUMBER_WIDTH, min(whole, MAX_DIGITS) + 5)  # of a column of coordinates
        self._own = {each.name_in_csv for each in columns_of({key: [] for key in self._fields}, units)}

    def answers(self, chunks: Iterable[Points]) -> Iterator[Answers]:
        """Yield the answers chunk by chunk; at least one chunk, which may be empty."""
        is_pair = self.mode == "segment"
        for chunk in chunks:
            rows = np.array(chunk.coordinates, dtype=np.float64).reshape(-1, 3)
            self._count_far(rows)
            rows = rows[: len(rows) // 2 * 2] if is_pair else rows
            yield self._answered(rows, self._given(chunk.kept, len(rows)))
        if is_pair and self._asked % 2 == 1:
            raise ArgumentError(f"points are taken in pairs (start, end), but there are {self._asked}")

    def _given(self, kept: dict[str, list[str]], count: int) -> Answers:
        """Return the other columns of the points; earlier answers without the fields computed again."""
        kept = {name: kept[name] for name in kept if name not in self._own} if self._own <= {*kept} else kept
        texts: Answers = {name: values[:count] for name, values in kept.items()}
        if self.mode == "segment":
            starts = {f"start_{name}": values[0::2] for name, values in texts.items()}
            texts = starts | {f"end_{name}": values[1::2] for name, values in texts.items()}
        return {
            f"given_{name}" if name in self._own or (name in FIELDS and name not in TITLED) else name: values
            for name, values in texts.items()
        }

    def _answered(self, rows: np.ndarray, texts: Answers) -> Answers:
        """Return the fields of the answers behind *texts*, those of the points."""
        with np.errstate(over="ignore"):  # beyond float64 the point is not finite
            points = rows * self._metres
        if self.mode == "closest":
            hits: Any = self._closest(points)
            given, ends = {"query": rows}, (points, hits.point)
        elif self.mode == "nearest":
            numbers, ranks, hits = self._nearest_parts(points)
            texts = {name: [values[row] for row in numbers.tolist()] for name, values in texts.items()}
            texts["point_number"] = (self._asked - len(rows) + numbers).tolist()
            texts["rank"] = (ranks + 1).tolist()
            given, ends = {"query": rows[numbers]}, (points[numbers], hits.point)
        elif self.mode == "ray":
            directions = np.broadcast_to(np.array(self._direction), rows.shape)
            # Without a least distance the answers are the same, and faster.
            least: dict[str, Any] = {"min_distance": self._min_distance} if self._min_distance else {}
            hits = self.scene.cast(points, directions, workers=self._workers, **least)
            given, ends = {"origin": rows, "direction": directions}, (points, hits.point)
        elif self.mode == "crossings":
            directions = np.broadcast_to(np.array(self._direction), rows.shape)
            hits = self.scene.cast_all(
                points, directions, min_distance=self._min_distance, workers=self._workers
            )
            first_ray, rays = self._asked - len(rows), hits.ray
            texts = {name: [values[ray] for ray in rays.tolist()] for name, values in texts.items()}
            texts["ray"] = (first_ray + rays).tolist()
            given, ends = {"origin": rows[rays], "direction": directions[rays]}, (points[rays], hits.point)
        else:
            hits = self.scene.closest_to_segments(points[0::2], points[1::2], workers=self._workers)
            given, ends = (
                {"start": rows[0::2], "end": rows[1::2]},
                (hits.point_on_segment, hits.point_on_solid),
            )
        found = texts | {name: values.tolist() for name, values in given.items()}
        for name in self._fields:
            if FIELDS[name].is_length:
                between = ends if name.endswith("distance") else ()
                found[name] = in_units(getattr(hits, name), self._metres, *between).tolist()
            elif name == "crossing":
                found[name] = ["enters" if each else "leaves" for each in hits.is_entering.tolist()]
            elif name not in (*FACES, "feature", "ray", "point_number", "rank"):
                found[name] = getattr(hits, name).tolist()
            elif name == "part":
                found |= self._faces(hits)
            elif name == "feature":
                words = zip(hits.feature.tolist(), found["face_id"], strict=True)
                found[name] = [None if face is None else Feature(each).name.lower() for each, face in words]
        return found

    def _closest(self, points: np.ndarray) -> Any:
        """Return the answers for points, with bounds of the distance to CAD surfaces if they are reported."""
        hits = self.scene.closest(points, workers=self._workers)
        if "lower" not in self._fields:
            return hits
        lower, upper = self.scene.signed_distance_bounds(points, workers=self._workers)
        return SimpleNamespace(lower=lower, upper=upper, **{name: getattr(hits, name) for name in HIT_FIELDS})

    def _nearest_parts(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, Any]:
        """Return the row of the point and the rank of each answer, and the answers.

        A point without any part has one answer, that of rank 0.
        """
        found = self.scene.closest_parts(points, most=self._nearest, workers=self._workers)
        is_kept = (found.part != NO_PART) | (np.arange(self._nearest) == 0)
        hits = SimpleNamespace(**{name: getattr(found, name)[is_kept] for name in HIT_FIELDS})
        numbers, ranks = np.nonzero(is_kept)
        return numbers, ranks, hits

    def _faces(self, hits: Any) -> Answers:
        """Return part and face of each hit; None without a hit."""
        parts, scene = hits.part.tolist(), self.scene.parts
        faces = np.full(hits.face_id.shape, NO_FACE, dtype=np.int64)
        for index in {*parts} - {NO_FACE}:
            here = hits.part == index
            faces[here] = scene[index].source_faces[hits.face_id[here]]
        ids = {"part": parts, "part_name": parts, "face": faces.tolist(), "face_id": hits.face_id.tolist()}
        found = {name: [None if id == NO_FACE else id for id in values] for name, values in ids.items()}
        found["part_name"] = [None if index is None else scene[index].name for index in found["part"]]
        return found

    def _count_far(self, points: np.ndarray) -> None:
        """Count finite points that are much farther away than the scene size."""
        with np.errstate(over="ignore", invalid="ignore"):
            gaps = np.maximum(np.maximum(self._lower - points, points - self._upper), 0.0)
        is_far = (gaps.max(axis=1, initial=0.0) > FAR * self._size) & np.isfinite(points).all(axis=1)
        distances = [math.hypot(*gap) for gap in gaps[is_far].tolist()]
        self._asked += len(points)
        self._far_count += len(distances)
        self._farthest = max([self._farthest, *distances])

    def note_far_points(self) -> None:
        """Report the number of points that are much farther away than the scene size."""
        if self._far_count:
            report(
                f"note: {self._far_count} of {self._asked} points are more than {FAR:g} scene sizes of "
                f"{number(self._size)} {self.units} away, the farthest {number(self._farthest)} "
                f"{self.units}: points or file may be in another unit than {self.units}"
            )


def write_json(
    question: Question,
    file: str,
    chunks: Iterable[Answers],
    summary: Callable[[], dict[str, Any]] | None = None,
) -> None:
    """Write one JSON document: the query, then ``answers``, one per line, and optionally a ``summary``.

    If *chunks* raise an error after some answers, the document is completed by the message as ``error``.
    After an error before any answer the output is empty.
    """
    head = {"file": file, "units": question.units, "mode": question.mode}
    opening, separator, write = json.dumps(head)[:-1] + ', "answers": [', "\n", sys.stdout.write
    try:
        for chunk in counted_answers(chunks):
            write(opening)
            opening = ""
            for values in zip(*chunk.values(), strict=True):
                answer = plain(dict(zip(chunk, values, strict=True)))
                write(separator + json.dumps(answer, allow_nan=False))
                separator = ",\n"
            sys.stdout.flush()
    except ProximityError as error:
        if not opening:
            write(f'\n], "error": {json.dumps(str(error))}}}\n')
        raise
    end = "" if summary is None else f', "summary": {json.dumps(plain(summary()), allow_nan=False)}'
    write(f"\n]{end}}}\n")


def write_csv(question: Question, stream: TextIO, chunks: Iterable[Answers]) -> None:
    """Write a header and a line per answer; vectors take three columns, lengths name their unit."""
    from proximity.system.table_text import table_text  # for CSV only

    def text_cell(value: Any) -> Any:
        """Return a cell of text; numbers in copied columns are unchanged."""
        try:
            float(value)
        except (TypeError, ValueError):
            return table_text(value)
        return value

    writer, has_header = csv.writer(stream, lineterminator="\n"), False
    for chunk in counted_answers(chunks):
        columns = list(columns_of(chunk, question.units))
        if not has_header:
            writer.writerow(column.name_in_csv for column in columns)
            has_header = True
        cells = (map(text_cell, each.values) if each.field.is_text else each.values for each in columns)
        writer.writerows(zip(*cells, strict=True))
        stream.flush()


class Column(NamedTuple):
    name: str
    title: str
    name_in_csv: str
    field: Field
    values: list[Any]
    width: int  # negative: aligned to the left
    decimals: int

    def cell(self, value: Any) -> str:
        """Return a value as text, within the width of the column if possible."""
        if self.field.is_text:
            text = self.field.shown(value)
            return text if self.width > 0 or len(text) <= -self.width else f"{text[: -self.width - 1]}…"
        if not math.isfinite(value):
            return str(value)
        texts = (f"{round(value, digits) + 0.0:.{digits}f}" for digits in range(self.decimals, -1, -1))
        return next((text for text in texts if len(text) <= self.width), f"{value:.2g}")


def counted_answers(chunks: Iterable[Answers]) -> Iterator[Answers]:
    """Yield answers, and show their number on stderr unless they are printed there."""
    if sys.stdout.isatty():
        yield from chunks
        return
    with progress.spinner("answered") as show:
        yield from progress.counted(chunks, show, count_of)


def count_of(answers: Answers) -> int:
    return len(next(iter(answers.values())))


def columns_of(
    answers: Answers, units: str, decimals: int = 4, width_of_number: int = NUMBER_WIDTH
) -> Iterator[Column]:
    for name, values in answers.items():
        field = FIELDS.get(name, GIVEN)
        ending = f"_{units}" if field.is_length else ""
        for axis, letter in enumerate(field.axes or [""]):
            # Plain x, y, z for the query points, so that the output can be read as points.
            words = "_".join(filter(None, ("" if name == "query" else name, letter)))
            each = [vector[axis] for vector in values] if letter else values
            title = field.title.format(letter, unit=units)
            width = (
                -TEXT_WIDTHS.get(name, 0)
                if field.is_text
                else max(width_of_number if field.axes else NUMBER_WIDTH, len(title))
            )
            yield Column(name, title, words + ending, field, each, width, decimals)
