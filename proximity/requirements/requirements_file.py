"""Reader of requirement files, from TOML to requirements in metres. Every error names line and key."""

# ruff: noqa: RUF009 -- the calls make fields

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from proximity.errors import ArgumentError, MeshError
from proximity.formats import metres_per_unit, unit_name
from proximity.formats.pose_rows import read_poses
from proximity.requirements.measurements import KINDS
from proximity.requirements.records import Limits, Requirement
from proximity.scene.motion import Motion, unit_vector
from proximity.service.config import place_fields as place
from proximity.service.config.record_fields import key, keys_of, number, numbers, read_fields, text
from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, read_document
from proximity.service.config.toml_document import Path as KeyPath

LENGTH, LENGTH_ABOVE_0 = Range("units of the file"), Range("units of the file", 0.0, is_above=True)
LENGTH_FROM_0, NUMBER = Range("units of the file", 0.0), Range("of any length", -1e9, 1e9)
DEGREES, DEGREE = Range("degrees or units of the file", -1e9, 1e9), math.pi / 180.0
MOTIONS = ("hinge", "slide", "poses")
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a requirement file: its models, and the options for reading them."""

    model: tuple[str, ...] = place.files("a file of parts")
    units: str = place.unit("mm")
    scale: float = number(Range("", 0.0, is_above=True), 1.0)
    step_tolerance: float = number(Range("mm", 0.0, is_above=True), 0.01)


@dataclass(frozen=True, slots=True)
class Hinge:
    """A turn about an axis."""

    point: Vector = numbers(LENGTH, 3)
    axis: Vector = numbers(NUMBER, 3)
    end: float = number(DEGREES)
    start: float = number(DEGREES, 0.0)


@dataclass(frozen=True, slots=True)
class Slide:
    """A displacement along a line."""

    direction: Vector = numbers(NUMBER, 3)
    end: float = number(DEGREES)
    start: float = number(DEGREES, 0.0)


def _read_allowed(table: Table, name: str, default: Any) -> tuple[tuple[str, str], ...]:
    """Read pairs of names or patterns."""
    if not table.has(name):
        return ()
    pairs: Any = table.value(name)
    listed = pairs if isinstance(pairs, list) and pairs else [None]
    if not all(isinstance(each, list) and [*map(type, each)] == [str, str] for each in listed):
        table.complain(name, 'is not a list of pairs, expected [["screw*", "plate"]]')
        return ()
    return tuple((first, second) for first, second in pairs)


def _read_direction(table: Table, name: str, default: None) -> Vector | None:
    """Read a direction of any length."""
    numbers: Vector | None = table.numbers(name, default, 3, NUMBER)
    try:
        return None if numbers is None else tuple(unit_vector(name, numbers).tolist())
    except ArgumentError:
        table.complain(name, "has no length, expected three numbers, not all 0")
    return None


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of the file, without its limits, parts and motions."""

    name: str = text("a name")
    allowed: tuple[tuple[str, str], ...] = key(_read_allowed, ())
    along: Vector | None = key(_read_direction, None)


class RequirementsFile(NamedTuple):
    """A requirement file that was read, but whose models were not."""

    document: Document
    settings: Settings
    units: str
    requirements: tuple[Requirement, ...]
    pose_files: tuple[str, ...]


def read_requirements(path: str | os.PathLike[str]) -> RequirementsFile:
    """Read and validate a requirement file. The models are not opened."""
    document = read_document(path, "a file of requirements")
    table = Table(document, (), document.data, (*keys_of(Settings), "require"))
    settings = Settings(**read_fields(Settings, table))
    try:
        units = unit_name(settings.units)
    except MeshError:  # it was collected already
        units = "mm"
    listed: Any = document.data.get("require", [])
    if not isinstance(listed, list) or not listed:
        document.complain(("require",), "[[require]] is missing, expected one or more")
        listed = []
    reader = _Reader(document, units)
    requirements = [reader.read(index, content) for index, content in enumerate(listed)]
    lines: dict[str, int] = {}
    for each in requirements:
        key_path = ("require", each.index, "name")
        if each.name in lines:
            sentence = f"is {each.name!r}, as on line {lines[each.name]}, expected names that differ"
            document.complain(key_path, f"require[{each.index}].name {sentence}")
        lines.setdefault(each.name, document.line_of(key_path))
    document.raise_complaints()
    return RequirementsFile(document, settings, units, tuple(requirements), tuple(reader.pose_files))


class _Reader:
    """Reader of the entries of a document."""

    def __init__(self, document: Document, units: str) -> None:
        self._document, self._units, self._metres = document, units, metres_per_unit(units)
        self.pose_files: list[str] = []

    def read(self, index: int, content: Any) -> Requirement:
        """Read an entry."""
        path: KeyPath = ("require", index)
        more = ("between", "part", "motion", "pose", *KINDS)
        table = Table(self._document, path, content, (*keys_of(Entry), *more))
        entry = Entry(**read_fields(Entry, table))
        name, *others = [*filter(table.has, KINDS)] or [""]
        if not name:
            self._document.complain(path, f"require[{index}] has no limits, expected {' or '.join(KINDS)}")
        kind = KINDS.get(name, KINDS["gap"])
        excluded = [(other, name) for other in (*others, *({"along", "motion", "pose"} - {*kind.takes}))]
        for one, other in [*excluded, ("motion", "along"), ("pose", "motion")]:
            if table.has(one) and table.has(other):
                table.complain(one, f"cannot be used together with {other}")
        motion, scale, unit = self._motion(table, (*path, "motion"))
        pose, _, _ = self._motion(table, (*path, "pose"))
        return Requirement(
            index, str(entry.name), name or "gap", self._limits(table, path, name), self._names(table, name),
            entry.allowed, entry.along, motion, pose, scale, unit,
        )  # fmt: skip

    def _limits(self, table: Table, path: KeyPath, name: str) -> Limits:
        """Read the limits of a kind, in m."""
        if not name:
            return Limits()
        keys = KINDS[name].limits
        limits = Table(self._document, (*path, name), table.value(name), tuple(keys))
        found: dict[str, float] = {}
        for each, field in keys.items():
            accepted = LENGTH_ABOVE_0 if field == "least" else LENGTH_FROM_0
            value = limits.number(each, None, LENGTH if table.has("along") else accepted)
            if value is not None:
                found[field] = value * self._metres
        if not any(map(limits.has, keys)):
            table.complain(name, f"has no limit, expected {' or '.join(keys)}")
        made = Limits(**found)
        if made.least > made.greatest:
            table.complain(name, "has a least length above the greatest, expected least <= greatest")
        if table.has("motion") and limits.has("greatest"):
            limits.complain("greatest", "cannot be used over a motion, expected least only")
        return made

    def _names(self, table: Table, name: str) -> tuple[str, ...]:
        """Read the names or patterns of the parts."""
        kind = KINDS.get(name, KINDS["gap"])
        for other in {"between", "part"} - {kind.names}:
            if table.has(other):
                table.complain(other, f"cannot be used together with {name}, expected {kind.names}")
        is_pair = kind.names == "between"
        meaning = "two names or patterns of parts" if is_pair else "a name or pattern of parts"
        names: tuple[str, ...] = table.texts(kind.names, kind.default or REQUIRED, meaning=meaning)
        if is_pair and names and len(names) != 2:
            table.complain("between", f"has {len(names)} names, expected {meaning}")
        return names

    def _motion(self, table: Table, path: KeyPath) -> tuple[Motion | None, float, str]:
        """Read a motion. Return it with the length and the name of the unit of its positions."""
        none, name = (None, 1.0, ""), str(path[-1])
        if not table.has(name):
            return none
        content = Table(self._document, path, table.value(name), MOTIONS)
        given = [*filter(content.has, MOTIONS)]
        if len(given) != 1:
            table.complain(name, f"has {len(given)} motions, expected one of {', '.join(MOTIONS)}")
            return none
        (word,) = given
        try:
            if word == "poses":
                file = place.read_file(content, word, "a file of poses (.csv)")
                if not os.path.isfile(file):  # it was collected already
                    return none
                self.pose_files.append(file)
                positions, poses = read_poses(Path(file), self._metres)
                return Motion.through(poses, positions), 1.0, "position"
            record = Hinge if word == "hinge" else Slide
            fields = Table(self._document, (*path, word), content.value(word), keys_of(record))
            values = read_fields(record, fields)
            if REQUIRED in values.values():
                return none
            start, end = values["start"], values["end"]
            if word == "hinge":
                centre = [self._metres * each for each in values["point"]]
                return Motion.hinge(centre, values["axis"], DEGREE * start, DEGREE * end), DEGREE, "degrees"
            motion = Motion.slide(values["direction"], self._metres * start, self._metres * end)
            return motion, self._metres, self._units
        except ArgumentError as unfit:
            content.complain(word, f"cannot be used: {unfit}")
        return none
