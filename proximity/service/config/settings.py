"""Settings of a scene file, in metres and seconds, with every value checked.

Paths are complete: those in the file are relative to it. Whether files can be loaded is not known yet.
"""

import sys
from dataclasses import dataclass, field
from typing import Any

from proximity.errors import ServiceError
from proximity.service.config.toml_document import Document, Path

USUAL_PUBLISH = ("shm://proximity",) if sys.platform == "linux" else ("udp://127.0.0.1:9100",)
"""Where frames go unless the file says otherwise."""
Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ServiceSettings:
    """Rate and timing of the loop, and the addresses it publishes to."""

    rate_hz: float = 1000.0
    latency: float = 0.001  # s, from a tick until the controller acts
    valid_for: float = 0.020  # s, from a pose on
    publish: tuple[str, ...] = USUAL_PUBLISH
    log: str | None = None  # file of all frames
    real_time: bool = False  # whether the system is asked for priority, locked memory and a core
    core: int | None = None  # with real_time; None: the service chooses

    @property
    def period(self) -> float:
        """Between ticks, s."""
        return 1.0 / self.rate_hz


@dataclass(frozen=True, slots=True)
class FingerSettings:
    """The fingertips, and what a tracker is given besides; None: its own default."""

    count: int | None = None  # None: as many as there are names, as a recording has, else five
    radius: float | tuple[float, ...] = 0.007  # m, one for all or one each
    budget: int | None = None
    working_range: float | None = None  # m
    tolerance: float | None = None
    horizon: float | None = None  # s
    max_speed: float | None = None  # m/s
    max_acceleration: float | None = None  # m/s²
    names: tuple[str, ...] | None = None  # None: as a recording has them, else numbers


@dataclass(frozen=True, slots=True)
class PartEntry:
    """A file of one part or several, where it is put, and how it answers a touch."""

    file: str
    units: str = "mm"
    name: str | None = None  # None: as in the file
    position: Vector = ORIGIN  # m
    turn_degrees: Vector = ORIGIN  # about x, then y, then z
    kind: str | None = None  # "rigid" or "deformable"; None: as in the file
    stiffness: float | None = None  # N/m, of a deformable part
    damping: float = 0.0  # N s/m


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """A recorded hand, and where it is put."""

    file: str
    repeat: bool = False
    fast: bool = False  # as fast as possible instead of in real time
    fit: bool = False  # so that it touches; *position* means nothing then
    position: Vector = ORIGIN  # m, of its origin
    turn_degrees: Vector = ORIGIN
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class InputSettings:
    """Source of poses: exactly one of the first three."""

    recording: RecordingEntry | None = None
    poses: str | None = None  # address
    sensor: str | None = None  # address: distances are measured, there is no geometry
    moves: str | None = None  # address: parts move
    changes: str | None = None  # address: parts are hidden, shown, removed, added, deformed
    parts_from: tuple[str, ...] = ()  # folders that parts may be added from; none: they may not be added


@dataclass(frozen=True, slots=True)
class GloveSettings:
    """Calibrations of the gloves on the hand whose poses come in."""

    calibration: tuple[str, ...]  # files: one for all fingers, or one each
    max_age_days: float | None = None  # of a calibration; None: as `decaff.calibration` has it


@dataclass(frozen=True, slots=True)
class HeldEntry:
    """A part that is followed, or a rigid group of them, and where its connections go."""

    part: tuple[str, ...]  # the first is the one whose moves count
    publish: tuple[str, ...]
    connections: int = 1
    working_range: float | None = None  # m; None: any distance
    tolerance: float = 0.0
    budget: int | None = None
    horizon: float | None = None  # s; None: the tracker's own

    @property
    def tracker_settings(self) -> dict[str, Any]:
        """What a `PartTracker` is given besides; what is None is its own default."""
        names = ("connections", "working_range", "tolerance", "budget", "horizon")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True, slots=True)
class WebSettings:
    """The page beside the service, where one was asked for."""

    feed: bool = False  # it may send to input.poses and input.moves; otherwise it only watches


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene file that was read and checked."""

    path: str
    service: ServiceSettings
    fingers: FingerSettings
    parts: tuple[PartEntry, ...]
    input: InputSettings
    glove: GloveSettings | None  # None: poses are of fingertips
    web: WebSettings
    document: Document = field(repr=False, compare=False)
    held: tuple[HeldEntry, ...] = ()

    def error(self, path: Path, sentence: str) -> ServiceError:
        """Return the error that says something of a value, with file and line."""
        return self.document.error(path, sentence)
