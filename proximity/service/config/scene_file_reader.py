"""Reader of scene files, which converts the text to settings and reports the line of every mistake.

The keys, with their types and ranges, are the fields of the classes in `settings`; constraints between keys
are checked here.
"""

import os
from dataclasses import replace
from typing import Any

from proximity.scene.scene import Scene
from proximity.service.config.record_fields import keys_of, read_fields, read_table, read_tables
from proximity.service.config.settings import (
    FingerSettings,
    GloveSettings,
    HeldEntry,
    InputSettings,
    PartEntry,
    RecordingEntry,
    SceneFile,
    ServiceSettings,
    WebSettings,
)
from proximity.service.config.table_fields import Table
from proximity.service.config.toml_document import Document, read_document

KEYS = {
    "service": keys_of(ServiceSettings),
    "fingers": keys_of(FingerSettings),
    "parts": keys_of(PartEntry),
    "input": keys_of(InputSettings, RecordingEntry),
    "held": keys_of(HeldEntry),
    "glove": keys_of(GloveSettings),
    "web": keys_of(WebSettings),
}
"""The keys of each table."""
SOURCES = ("recording", "poses", "sensor")
EITHER = "recording, poses or sensor"
WITHOUT_GEOMETRY = "cannot be used: distances come from input.sensor, without geometry"
MAX_NAMES = 12
"""Maximum number of parts named in a message."""


def read_scene_file(path: str | os.PathLike[str]) -> SceneFile:
    """Read and validate a scene file, and return its settings. ``meshes/demo.toml`` explains every key."""
    document = read_document(path)
    Table(document, (), document.data, tuple(KEYS))  # reports unknown keys
    inputs = document.data.get("input")
    is_measured = isinstance(inputs, dict) and "sensor" in inputs
    settings = SceneFile(
        path=os.fsdecode(path),
        service=read_table(ServiceSettings, document, "service"),
        fingers=_read_fingers(document, is_measured),
        parts=_read_parts(document, is_measured),
        input=_read_input(document),
        held=tuple(entry for _, entry in read_tables(HeldEntry, document, "held")),
        glove=read_table(GloveSettings, document, "glove") if "glove" in document.data else None,
        web=read_table(WebSettings, document, "web"),
        document=document,
    )
    _check_together(settings)
    document.raise_complaints()
    return settings


def override(settings: SceneFile, overrides: dict[str, Any]) -> SceneFile:
    """Return settings in which some values of [service] are replaced.

    *overrides*: new values by key; None keeps the value of the file. A path is relative to the working
    directory.
    """
    document = Document("", "")
    given = {key: _as_in_toml(value) for key, value in overrides.items() if value is not None}
    document.data["service"] = given
    service = read_table(ServiceSettings, document, "service")
    document.raise_complaints()
    changed = {key: getattr(service, key) for key in given}
    settings = replace(settings, service=replace(settings.service, **changed))
    _check_together(settings)
    settings.document.raise_complaints()
    return settings


def _read_fingers(document: Document, is_measured: bool) -> FingerSettings:
    fingers: FingerSettings = read_table(FingerSettings, document, "fingers")
    names, count = fingers.names, fingers.count
    if names is not None and len(names) != count:
        document.complain(
            ("fingers", "names"),
            f"fingers.names has {len(names)} names, expected {count}, the number in fingers.count",
        )
    declared = document.data.get("fingers", {})
    for key in KEYS["fingers"]:
        if is_measured and key not in ("count", "names") and key in declared:
            document.complain(("fingers", key), f"fingers.{key} {WITHOUT_GEOMETRY}")
    return fingers


def _read_parts(document: Document, is_measured: bool) -> tuple[PartEntry, ...]:
    """Read the entries of parts in the order of the file."""
    if is_measured and document.data.get("parts"):
        document.complain(("parts", 0), f"[[parts]] {WITHOUT_GEOMETRY}")
        return ()
    entries = [entry for _, entry in read_tables(PartEntry, document, "parts", is_needed=not is_measured)]
    for index, entry in enumerate(entries):
        earlier = [other.name for other in entries[:index]]
        if entry.name is not None and entry.name in earlier:
            first = document.line_of(("parts", earlier.index(entry.name), "name"))
            document.complain(
                ("parts", index, "name"),
                f"parts[{index}].name is {entry.name!r}, as of the part on line {first}, "
                "expected names that differ",
            )
    return tuple(entries)


def _read_input(document: Document) -> InputSettings:
    """Read the table [input], which declares the source of poses."""
    if "input" not in document.data:
        document.complain((), f"[input] is missing, expected it to have {EITHER}")
        return InputSettings()
    table = Table(document, ("input",), document.data["input"], KEYS["input"])
    declared = [key for key in SOURCES if table.has(key)]
    if not declared:
        document.complain(("input",), f"[input] has no source, expected {EITHER}")
    for key in declared[1:]:
        table.complain(key, f"is given together with input.{declared[0]}, expected only one of {EITHER}")
    if table.has("parts_from") and not table.has("changes"):
        table.complain("parts_from", "requires input.changes")
    return InputSettings(**read_fields(InputSettings, table))


def _as_in_toml(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fsdecode(value)
    return list(value) if isinstance(value, tuple) else value


def _check_together(settings: SceneFile) -> None:
    """Report values that are valid separately but contradict each other."""
    inputs, complain = settings.input, settings.document.complain
    for key in ("moves", "changes"):
        if getattr(inputs, key) is not None and inputs.sensor is not None:
            complain(("input", key), f"input.{key} {WITHOUT_GEOMETRY}")
    for key in ("poses", "sensor", "moves", "changes"):
        address = getattr(inputs, key)
        if address is not None and address in settings.service.publish and not address.startswith("ws:"):
            complain(("input", key), f"input.{key} is {address}, which is also in service.publish")
    _check_held(settings)
    if settings.web.feed and inputs.poses is None and inputs.moves is None:
        complain(("web", "feed"), "web.feed is true, which requires input.poses or input.moves")
    if settings.glove is not None and inputs.poses is None:
        complain(("glove",), "[glove] requires input.poses")
    for key, other in (("moves", "poses"), ("changes", "poses"), ("changes", "moves")):
        if getattr(inputs, key) is not None and getattr(inputs, key) == getattr(inputs, other):
            complain(("input", key), f"input.{key} is input.{other}, expected another address")


def _check_held(settings: SceneFile) -> None:
    """Report entries of tracked parts that contradict the rest of the file."""
    inputs = settings.input
    parts: dict[str, str] = {}  # name of the [[held]] key that uses each part
    used = dict.fromkeys(settings.service.publish, "service.publish")
    for key in ("poses", "sensor", "moves", "changes"):
        used.setdefault(getattr(inputs, key), f"input.{key}")
    for row, entry in enumerate(settings.held):
        where, complain = f"held[{row}]", settings.document.complain
        if inputs.sensor is not None:
            complain(("held", row), f"[[held]] {WITHOUT_GEOMETRY}")
        elif inputs.moves is None:
            complain(("held", row), "[[held]] requires input.moves, where the poses of the part come in")
        if inputs.recording is not None and inputs.recording.fast:
            complain(("held", row), "[[held]] cannot be used together with input.fast = true")
        for key, values, taken in (("part", entry.part, parts), ("publish", entry.publish, used)):
            for value in values:
                if value in taken:
                    complain(
                        ("held", row, key),
                        f"{where}.{key} has {value}, which is also in {taken[value]}, expected another",
                    )
                taken[value] = f"{where}.{key}"


def check_held(settings: SceneFile, scene: Scene) -> None:
    """Raise an error if the scene lacks a tracked part."""
    names = scene.snapshot().names
    for row, entry in enumerate(settings.held):
        for name in entry.part:
            if name not in names:
                known = ", ".join(names[:MAX_NAMES]) + (", …" if len(names) > MAX_NAMES else "")
                sentence = f"held[{row}].part is {name!r}, expected one of {known}"
                raise settings.error(("held", row, "part"), sentence)
