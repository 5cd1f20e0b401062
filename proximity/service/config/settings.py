"""Settings of a scene file, in metres and seconds. Each field is a key and declares its reader.

``meshes/demo.toml`` explains every key. Paths are absolute; the file gives them relative to its folder. The
files that they name have not been loaded yet.
"""

# ruff: noqa: RUF009 -- the calls make fields

import sys
from dataclasses import dataclass, field
from typing import Any

from proximity.errors import ServiceError
from proximity.message import MAX_RECORDS
from proximity.service.config import place_fields as place
from proximity.service.config.record_fields import (
    key,
    keys_of,
    number,
    numbers,
    read_fields,
    text,
    texts,
    truth,
    whole,
    word,
)
from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, Path
from proximity.tracker.tracker_arguments import MAX_RADIUS, MAX_WORKING_RANGE, length_error

USUAL_PUBLISH = ("shm://proximity",) if sys.platform == "linux" else ("udp://127.0.0.1:9100",)
"""Default address of frames."""
Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
SHARE = Range("", 0.0, 1.0)
STEPS = Range("nodes and leaves", 1, 2**31 - 1)
LENGTH = Range("m", 0.0, 1e6, is_above=True)
HORIZON = Range("s", 0.0, 1e3, is_above=True)
STIFFNESS = Range("N/m", 0.0, 1e12, is_above=True)
DAMPING = Range("N s/m", 0.0, 1e12)


def _position() -> Any:
    return numbers(Range("m", -1e6, 1e6), 3, ORIGIN)


def _turn() -> Any:
    return numbers(Range("degrees", -1e6, 1e6), 3, ORIGIN)


@dataclass(frozen=True, slots=True)
class ServiceSettings:
    """Rate and timing of the loop, and the addresses to which it publishes."""

    rate_hz: float = number(Range("Hz", 1.0, 100_000.0), 1000.0)
    latency: float = number(Range("s", 0.0, 1.0), 0.001)  # time from a tick until the controller acts
    valid_for: float = number(Range("s", 1e-5, 0.1), 0.020)  # time after a pose; 100 ms or more are useless
    publish: tuple[str, ...] = place.addresses(USUAL_PUBLISH)
    log: str | None = place.new_file("the file to write")  # log of all frames
    real_time: bool = truth()  # requests priority, locked memory and a core from the system
    core: int | None = whole(Range("", 0, 4095), None)  # used with real_time; None: the service chooses

    @property
    def period(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.rate_hz


def _read_radius(table: Table, name: str, default: float) -> Any:
    radius = table.number_or_numbers(name, default, _count_of(table), LENGTH)
    _limit(table, name, max(radius) if isinstance(radius, tuple) else radius, MAX_RADIUS)
    return radius


def _read_working_range(table: Table, name: str, default: None) -> Any:
    working_range = table.number(name, default, Range("m", 0.0, 1e6))
    _limit(table, name, working_range or 0.0, MAX_WORKING_RANGE)
    return working_range


def _limit(table: Table, name: str, length: float, most: float) -> None:
    if length > most:
        table.complain(name, f"is {length_error(length, most)}")


def _count_of(table: Table) -> int | None:
    names = table.texts("names", None, meaning="what a finger is called")
    count: int | None = table.whole("count", names and len(names), Range("", 1, MAX_RECORDS))
    return count


@dataclass(frozen=True, slots=True)
class FingerSettings:
    """Number, names and radii of the fingertips, and further options of the tracker.

    An option of None has the tracker's default.
    """

    # None: that of names or recording, or five
    count: int | None = key(lambda table, name, default: _count_of(table), None)
    radius: float | tuple[float, ...] = key(_read_radius, 0.007)  # m; one for all fingers or for each
    budget: int | None = whole(STEPS, None)
    working_range: float | None = key(_read_working_range, None)  # m
    tolerance: float | None = number(SHARE, None)
    horizon: float | None = number(HORIZON, None)
    max_speed: float | None = number(Range("m/s", 0.0, 1e6, is_above=True), None)
    max_acceleration: float | None = number(Range("m/s²", 0.0, 1e9, is_above=True), None)
    names: tuple[str, ...] | None = texts("what a finger is called", None)  # None: names in the recording


def _deformable(accepted: Range, needed: Any, default: Any) -> Any:
    """Declare a number that only deformable parts have. Their default is *needed*."""

    def read(table: Table, name: str, default: Any) -> Any:
        if table.value("kind") == "deformable":
            return table.number(name, needed, accepted)
        if table.has(name):
            table.complain(name, 'is for deformable parts, expected kind = "deformable" with it')
        return default

    return key(read, default)


@dataclass(frozen=True, slots=True)
class PartEntry:
    """A file of one or several parts, with its pose and the response of the parts to contact."""

    file: str = place.file("a file of parts")
    units: str = place.unit("mm")
    name: str | None = text("what the part is to be called", None)  # None: as in the file
    position: Vector = _position()
    turn_degrees: Vector = _turn()  # about x, then y, then z
    kind: str | None = word(("rigid", "deformable"), None)  # None: as in the file
    stiffness: float | None = _deformable(STIFFNESS, REQUIRED, None)  # N/m
    damping: float = _deformable(DAMPING, 0.0, 0.0)  # N s/m


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """A recorded hand and its pose in the scene."""

    file: str
    repeat: bool = truth()
    fast: bool = truth()  # play it as fast as possible instead of in real time
    fit: bool = truth()  # position the hand so that it touches the parts; *position* is ignored then
    position: Vector = _position()  # position of the recording's origin
    turn_degrees: Vector = _turn()
    scale: float = number(Range("", 1e-6, 1e6), 1.0)


def _read_recording(table: Table, name: str, default: None) -> RecordingEntry | None:
    if not table.has(name):
        for key in keys_of(RecordingEntry):
            if table.has(key):
                table.complain(key, "requires input.recording")
        return default
    values = read_fields(RecordingEntry, table)
    if values["fit"] and table.has("position"):
        table.complain("position", "is given together with fit = true, expected only one of them")
    return RecordingEntry(place.read_file(table, name, "a recording"), **values)


@dataclass(frozen=True, slots=True)
class InputSettings:
    """Source of poses, which is exactly one of the first three settings."""

    recording: RecordingEntry | None = key(_read_recording, None)
    poses: str | None = place.address(None)
    sensor: str | None = place.address(None)  # measured distances, without geometry
    moves: str | None = place.address(None)  # messages that move parts
    changes: str | None = place.address(None)  # hide, show, remove, add or deform parts
    # folders of files that may be added as parts
    parts_from: tuple[str, ...] = place.folders("a folder of parts that messages may add")


@dataclass(frozen=True, slots=True)
class GloveSettings:
    """Files with the calibrations of the gloves on the hand whose poses are received."""

    calibration: tuple[str, ...] = place.files("a calibration of a glove")  # one for all fingers or for each
    max_age_days: float | None = number(Range("days", 0.0, 36_500.0, is_above=True), None)


@dataclass(frozen=True, slots=True)
class HeldEntry:
    """A tracked part, or a rigid group of tracked parts, and the addresses of its contacts."""

    part: tuple[str, ...] = texts("the name of a part")  # the first one's moves count
    publish: tuple[str, ...] = place.addresses()
    connections: int = whole(Range("", 1, 16), 1)
    working_range: float | None = number(LENGTH, None)  # None: any distance
    tolerance: float = number(SHARE, 0.0)
    budget: int | None = whole(STEPS, None)
    horizon: float | None = number(HORIZON, None)  # None: the tracker's own

    @property
    def tracker_settings(self) -> dict[str, Any]:
        """Return the options of the `PartTracker`. Options of None are left to its defaults."""
        names = ("connections", "working_range", "tolerance", "budget", "horizon")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True, slots=True)
class WebSettings:
    """Settings of the web page that the service may start."""

    feed: bool = truth()  # whether the page may send poses and moves


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A validated scene file."""

    path: str
    service: ServiceSettings
    fingers: FingerSettings
    parts: tuple[PartEntry, ...]
    input: InputSettings
    glove: GloveSettings | None  # None: received poses are those of fingertips
    web: WebSettings
    document: Document = field(repr=False, compare=False)
    held: tuple[HeldEntry, ...] = ()

    def error(self, path: Path, sentence: str) -> ServiceError:
        """Return an error about a value. Its message names the file and the line."""
        return self.document.error(path, sentence)
