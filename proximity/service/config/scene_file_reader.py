"""Reader of scene files: from text to settings, with the keys and values that are allowed.

``meshes/demo.toml`` shows and explains every key.
"""

import os
from dataclasses import replace
from typing import Any

from proximity.errors import MeshError, PublishError
from proximity.formats import metres_per_unit
from proximity.message import MAX_RECORDS
from proximity.service.config.held_entries import WITHOUT_GEOMETRY, check_held_together, read_held
from proximity.service.config.settings import (
    ORIGIN,
    FingerSettings,
    GloveSettings,
    InputSettings,
    PartEntry,
    RecordingEntry,
    SceneFile,
    ServiceSettings,
    WebSettings,
)
from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, Path, read_document
from proximity.tracker.tracker_arguments import LARGEST_RADIUS, LARGEST_WORKING_RANGE, length_error
from proximity.transport.address import parse
from proximity.transport.link import TRANSPORTS

TABLES = ("service", "fingers", "parts", "input", "held", "glove", "web")
SERVICE_KEYS = ("rate_hz", "latency", "valid_for", "publish", "log", "real_time", "core")
TRACKER_KEYS = (
    "radius", "budget", "working_range", "tolerance", "horizon", "max_speed", "max_acceleration",
)  # fmt: skip
FINGER_KEYS = ("count", "names", *TRACKER_KEYS)
PART_KEYS = ("file", "units", "name", "position", "turn_degrees", "kind", "stiffness", "damping")
SOURCES = ("recording", "poses", "sensor")
RECORDING_KEYS = ("repeat", "fast", "fit", "position", "turn_degrees", "scale")
PLACE_KEYS = ("position", "turn_degrees")
INPUT_KEYS = (*SOURCES, "moves", "changes", "parts_from", *RECORDING_KEYS)
GLOVE_KEYS = ("calibration", "max_age_days")
WEB_KEYS = ("feed",)

RATE_RANGE = Range("Hz", 1.0, 100_000.0)
LATENCY_RANGE = Range("s", 0.0, 1.0)
VALIDITIES = Range("s", 1e-5, 0.1)  # poses of 100 ms are worth nothing
CORE_RANGE = Range("", 0, 4095)
COUNT_RANGE = Range("", 1, MAX_RECORDS)
BUDGETS = Range("nodes and leaves", 1, 2**31 - 1)
LENGTH_RANGE = Range("m", 0.0, 1e6, is_above=True)
RANGES = Range("m", 0.0, 1e6)
TOLERANCES = Range("", 0.0, 1.0)
TIME_RANGE = Range("s", 0.0, 1e3, is_above=True)
SPEED_RANGE = Range("m/s", 0.0, 1e6, is_above=True)
ACCELERATIONS = Range("m/s²", 0.0, 1e9, is_above=True)
AGES = Range("days", 0.0, 36_500.0, is_above=True)
COORDINATE_RANGE = Range("m", -1e6, 1e6)
ANGLES = Range("degrees", -1e6, 1e6)
SCALES = Range("", 1e-6, 1e6)
STIFFNESS_RANGE = Range("N/m", 0.0, 1e12, is_above=True)
DAMPING_RANGE = Range("N s/m", 0.0, 1e12)


def read_scene_file(path: str | os.PathLike[str]) -> SceneFile:
    """Return what a scene file says; ``meshes/demo.toml`` explains every key."""
    document = read_document(path)
    reader = _Reader(document, os.path.dirname(os.path.abspath(os.fsdecode(path))))
    settings = SceneFile(
        path=os.fsdecode(path),
        service=reader.service(),
        fingers=reader.fingers(),
        parts=reader.parts(),
        input=reader.input(),
        held=read_held(document, reader.checked_address),
        glove=reader.glove(),
        web=reader.web(),
        document=document,
    )
    _check_together(settings)
    document.raise_complaints()
    return settings


def override(settings: SceneFile, overrides: dict[str, Any]) -> SceneFile:
    """Return what a scene file says, but for some of its [service].

    *overrides*: what holds instead, by its key in [service]; None: what the file says. A path is relative to
    the present folder.
    """
    document = Document("", "")
    reported = {key: _as_in_toml(value) for key, value in overrides.items() if value is not None}
    document.data["service"] = reported
    service = _Reader(document, os.getcwd()).service()
    document.raise_complaints()
    changed = {key: getattr(service, key) for key in reported}
    settings = replace(settings, service=replace(settings.service, **changed))
    _check_together(settings)
    settings.document.raise_complaints()
    return settings


class _Reader:
    """The tables of one document, one after the other."""

    def __init__(self, document: Document, folder: str) -> None:
        self._document, self._folder = document, folder
        Table(document, (), document.data, TABLES)  # complains of others
        declared = document.data.get("input")
        self._is_measured = isinstance(declared, dict) and "sensor" in declared

    def service(self) -> ServiceSettings:
        """The loop."""
        table, default = self._table("service", SERVICE_KEYS), ServiceSettings()
        named = table.texts("publish", default.publish, meaning="an address such as shm://proximity")
        publish = tuple(self.checked_address(table, "publish", address) for address in named)
        if len(set(publish)) < len(publish):
            table.complain("publish", "has an address twice, expected different addresses")
        return ServiceSettings(
            rate_hz=table.number("rate_hz", default.rate_hz, RATE_RANGE),
            latency=table.number("latency", default.latency, LATENCY_RANGE),
            valid_for=table.number("valid_for", default.valid_for, VALIDITIES),
            publish=publish,
            log=self._from_here(table.text("log", None, meaning="the file to write")),
            real_time=table.truth("real_time", default.real_time),
            core=table.whole("core", None, CORE_RANGE),
        )

    def fingers(self) -> FingerSettings:
        """The fingertips."""
        table, default = self._table("fingers", FINGER_KEYS), FingerSettings()
        names = table.texts("names", None, meaning="what a finger is called")
        count = table.whole("count", None if names is None else len(names), COUNT_RANGE)
        if names is not None and len(names) != count:
            table.complain("names", f"has {len(names)} names, expected {count}, the number in fingers.count")
        for key in TRACKER_KEYS:
            if self._is_measured and table.has(key):
                table.complain(key, WITHOUT_GEOMETRY)
        radius = table.number_or_numbers("radius", default.radius, count, LENGTH_RANGE)
        working_range = table.number("working_range", None, RANGES)
        largest = max(radius) if isinstance(radius, tuple) else radius
        for key, length, most in (
            ("radius", largest, LARGEST_RADIUS),
            ("working_range", working_range or 0.0, LARGEST_WORKING_RANGE),
        ):
            if length > most:
                table.complain(key, f"is {length_error(length, most)}")
        return FingerSettings(
            count=count,
            names=names,
            radius=radius,
            budget=table.whole("budget", None, BUDGETS),
            working_range=working_range,
            tolerance=table.number("tolerance", None, TOLERANCES),
            horizon=table.number("horizon", None, TIME_RANGE),
            max_speed=table.number("max_speed", None, SPEED_RANGE),
            max_acceleration=table.number("max_acceleration", None, ACCELERATIONS),
        )

    def parts(self) -> tuple[PartEntry, ...]:
        """The parts, in the order of the file."""
        listed = self._document.data.get("parts", [])
        if not isinstance(listed, list):
            self._document.complain(
                ("parts",), "parts are not a list of tables, expected [[parts]] above each"
            )
            return ()
        if self._is_measured and listed:
            self._document.complain(("parts", 0), f"[[parts]] {WITHOUT_GEOMETRY}")
            return ()
        if not self._is_measured and not listed:
            self._document.complain((), "[[parts]] is missing, expected at least one")
        entries = [self._part(("parts", index), content) for index, content in enumerate(listed)]
        for index, entry in enumerate(entries):
            earlier = [other.name for other in entries[:index]]
            if entry.name is not None and entry.name in earlier:
                first = ("parts", earlier.index(entry.name), "name")
                self._document.complain(
                    ("parts", index, "name"),
                    f"parts[{index}].name is {entry.name!r}, as of the part on line "
                    f"{self._document.line_of(first)}, expected names that differ",
                )
        return tuple(entries)

    def input(self) -> InputSettings:
        """The source of poses."""
        if "input" not in self._document.data:
            self._document.complain((), f"[input] is missing, expected it to have {_either(SOURCES)}")
            return InputSettings()
        table = self._table("input", INPUT_KEYS)
        declared = [key for key in SOURCES if table.has(key)]
        if not declared:
            self._document.complain(("input",), f"[input] has no source, expected {_either(SOURCES)}")
        for more in declared[1:]:
            table.complain(
                more, f"is given together with input.{declared[0]}, expected only one of {_either(SOURCES)}"
            )
        for key in RECORDING_KEYS:
            if table.has(key) and "recording" not in declared:
                table.complain(key, "requires input.recording")
        return InputSettings(
            recording=self._recording(table) if table.has("recording") else None,
            poses=self._address(table, "poses"),
            sensor=self._address(table, "sensor"),
            moves=self._address(table, "moves"),
            changes=self._address(table, "changes"),
            parts_from=self._folders(table, "parts_from"),
        )

    def glove(self) -> GloveSettings | None:
        """The glove or gloves of the hand."""
        if "glove" not in self._document.data:
            return None
        table, meaning = self._table("glove", GLOVE_KEYS), "a calibration of a glove"
        named = table.texts("calibration", REQUIRED, meaning=meaning)
        files = () if named is REQUIRED else named
        return GloveSettings(
            calibration=tuple(self._existing(table, "calibration", each, meaning) for each in files),
            max_age_days=table.number("max_age_days", None, AGES),
        )

    def web(self) -> WebSettings:
        """The page beside the service."""
        table = self._table("web", WEB_KEYS)
        return WebSettings(feed=table.truth("feed", WebSettings().feed))

    def _part(self, path: Path, content: Any) -> PartEntry:
        table = Table(self._document, path, content, PART_KEYS)
        kind = table.one_of("kind", None, ("rigid", "deformable"))
        if kind == "deformable":
            stiffness = table.number("stiffness", REQUIRED, STIFFNESS_RANGE)
            damping = table.number("damping", 0.0, DAMPING_RANGE)
        else:
            stiffness, damping = None, 0.0
            for key in ("stiffness", "damping"):
                if table.has(key):
                    table.complain(key, 'is of a deformable part, expected kind = "deformable" beside it')
        units = table.text("units", "mm", meaning="a unit such as mm")
        try:
            metres_per_unit(units)
        except MeshError as unknown:
            table.complain("units", f"cannot be used: {unknown}")
        return PartEntry(
            file=self._file(table, "file", "a file of parts"),
            units=units,
            name=table.text("name", None, meaning="what the part is to be called"),
            position=table.numbers("position", ORIGIN, 3, COORDINATE_RANGE),
            turn_degrees=table.numbers("turn_degrees", ORIGIN, 3, ANGLES),
            kind=kind,
            stiffness=stiffness,
            damping=damping,
        )

    def _recording(self, table: Table) -> RecordingEntry:
        is_fitted = table.truth("fit", False)
        if is_fitted and table.has("position"):
            table.complain("position", "is given together with fit = true, expected only one of them")
        return RecordingEntry(
            file=self._file(table, "recording", "a recording"),
            repeat=table.truth("repeat", False),
            fast=table.truth("fast", False),
            fit=is_fitted,
            position=table.numbers("position", ORIGIN, 3, COORDINATE_RANGE),
            turn_degrees=table.numbers("turn_degrees", ORIGIN, 3, ANGLES),
            scale=table.number("scale", 1.0, SCALES),
        )

    def _table(self, name: str, known: tuple[str, ...]) -> Table:
        return Table(self._document, (name,), self._document.data.get(name, {}), known)

    def _file(self, table: Table, key: str, what: str) -> str:
        """A file that is there."""
        named = table.text(key, REQUIRED, meaning=what)
        return "" if named is REQUIRED else self._existing(table, key, named, what)

    def _existing(self, table: Table, key: str, named: str, what: str) -> str:
        path = str(self._from_here(named))
        if not os.path.isfile(path):
            is_folder = "is a folder" if os.path.isdir(path) else "is not there"
            table.complain(key, f"is {named!r}, but {path} {is_folder}, expected {what}")
        return path

    def _folders(self, table: Table, key: str) -> tuple[str, ...]:
        """Folders that are there."""
        named = table.texts(key, (), meaning="a folder of parts that messages may add")
        if named and not table.has("changes"):
            table.complain(key, "requires input.changes")
        folders = tuple(str(self._from_here(each)) for each in named)
        for each, folder in zip(named, folders, strict=True):
            if not os.path.isdir(folder):
                what = "is a file" if os.path.exists(folder) else "is not there"
                table.complain(key, f"is {each!r}, but {folder} {what}, expected a folder")
        return folders

    def _address(self, table: Table, key: str) -> str | None:
        address = table.text(key, None, meaning="an address such as shm://NAME")
        return None if address is None else self.checked_address(table, key, address)

    def checked_address(self, table: Table, key: str, text: str) -> str:
        """An address, with files that it names as seen from the scene file."""
        try:
            address = parse(text)
        except PublishError as unfit:
            table.complain(key, f"cannot be used: {unfit}")
            return text
        if address.scheme not in TRANSPORTS:
            schemes = ", ".join(TRANSPORTS)
            table.complain(
                key, f"is {text}, but no transport is called {address.scheme!r}: expected {schemes}"
            )
        return address.with_files_in(self._folder)

    def _from_here(self, path: Any) -> Any:
        """A path that is relative to the scene file."""
        return None if path is None else os.path.join(self._folder, path)


def _as_in_toml(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fsdecode(value)
    return list(value) if isinstance(value, tuple) else value


def _check_together(settings: SceneFile) -> None:
    """Complain of what does not fit together, though each of it could be."""
    inputs, complain = settings.input, settings.document.complain
    for key in ("moves", "changes"):
        if getattr(inputs, key) is not None and inputs.sensor is not None:
            complain(("input", key), f"input.{key} {WITHOUT_GEOMETRY}")
    for key in ("poses", "sensor", "moves", "changes"):
        address = getattr(inputs, key)
        if address is not None and address in settings.service.publish and not address.startswith("ws:"):
            complain(("input", key), f"input.{key} is {address}, which is also in service.publish")
    check_held_together(settings)
    if settings.web.feed and inputs.poses is None and inputs.moves is None:
        complain(("web", "feed"), "web.feed is true, which requires input.poses or input.moves")
    if settings.glove is not None and inputs.poses is None:
        complain(("glove",), "[glove] requires input.poses")
    for key, other in (("moves", "poses"), ("changes", "poses"), ("changes", "moves")):
        if getattr(inputs, key) is not None and getattr(inputs, key) == getattr(inputs, other):
            complain(("input", key), f"input.{key} is input.{other}, expected another address")


def _either(words: tuple[str, ...]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"
