"""The tables [[held]] of a scene file: parts that are followed, and where their connections are published."""

from collections.abc import Callable
from typing import Any

from proximity.scene.scene import Scene
from proximity.service.config.settings import HeldEntry, SceneFile
from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, Path

HELD_KEYS = ("part", "publish", "connections", "working_range", "tolerance", "budget", "horizon")
WITHOUT_GEOMETRY = "cannot be used: distances are measured by input.sensor, there is no geometry"
CONNECTIONS = Range("", 1, 16)
DISTANCES = Range("m", 0.0, 1e6, is_above=True)
TOLERANCES = Range("", 0.0, 1.0)
STEPS = Range("steps", 1, 2**31 - 1)
HORIZONS = Range("s", 0.0, 1e3, is_above=True)
MOST_NAMES = 12
"""Of parts, in a message."""

AddressReader = Callable[[Table, str, str], str]
"""Checks the address that a key of a table has."""


def read_held(document: Document, address: AddressReader) -> tuple[HeldEntry, ...]:
    """Return the tables [[held]] of a document."""
    listed = document.data.get("held", [])
    if not isinstance(listed, list):
        document.complain(("held",), "held is not a list of tables, expected [[held]] above each")
        return ()
    return tuple(_entry(document, ("held", row), content, address) for row, content in enumerate(listed))


def _entry(document: Document, path: Path, content: Any, address: AddressReader) -> HeldEntry:
    table, default = Table(document, path, content, HELD_KEYS), HeldEntry((), ())
    parts = table.texts("part", REQUIRED, meaning="the name of a part")
    publish = table.texts("publish", REQUIRED, meaning="an address such as shm://NAME")
    addresses = () if publish is REQUIRED else publish
    return HeldEntry(
        part=() if parts is REQUIRED else parts,
        publish=tuple(address(table, "publish", each) for each in addresses),
        connections=table.whole("connections", default.connections, CONNECTIONS),
        working_range=table.number("working_range", None, DISTANCES),
        tolerance=table.number("tolerance", default.tolerance, TOLERANCES),
        budget=table.whole("budget", None, STEPS),
        horizon=table.number("horizon", None, HORIZONS),
    )


def check_held_together(settings: SceneFile) -> None:
    """Complain of held parts that do not fit the rest of the file."""
    inputs = settings.input
    parts: dict[str, str] = {}  # and where they are held
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
    """Raise if a part that is to be held is not in the scene."""
    names = scene.snapshot().names
    for row, entry in enumerate(settings.held):
        for name in entry.part:
            if name not in names:
                known = ", ".join(names[:MOST_NAMES]) + (", …" if len(names) > MOST_NAMES else "")
                sentence = f"held[{row}].part is {name!r}, expected one of {known}"
                raise settings.error(("held", row, "part"), sentence)
