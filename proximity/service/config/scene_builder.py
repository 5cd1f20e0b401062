"""Build the objects of a scene file: the scene, the tracker, and the recording placed in the scene.

Error messages name the line of the invalid setting.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from proximity.errors import ProximityError, ServiceError
from proximity.formats.step.conversion import converter
from proximity.pose import Pose
from proximity.recording import Recording, read_recording
from proximity.scene.loader import load, notes_on_sizes
from proximity.scene.part import LoadReport, Part
from proximity.scene.scene import Scene
from proximity.service.config.settings import FingerSettings, PartEntry, SceneFile
from proximity.tracker.placement import fitted_pose, turn_about_axes
from proximity.tracker.tracker import Tracker

DEFAULT_FINGERS = 5
NOT_OF_TRACKER = ("count", "names")
"""Settings of fingers that are not passed to a tracker."""
_Kept = dict[tuple[str, str], tuple[Any, tuple[Part, ...], tuple[str, ...], float]]
"""Stamp, parts, notes and approximation (m) of each loaded file, by its name and unit."""


class PartFiles:
    """Cache of loaded part files, so that a reloaded scene reads only the files that changed.

    *options*: options of `load`, used for every file.
    """

    def __init__(self, **options: Any) -> None:
        self._kept: _Kept = {}
        self._options = options

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on files of the last scene whose parts have an unlikely size."""
        return tuple(note for _, _, notes, _ in self._kept.values() for note in notes)

    def scene(self, settings: SceneFile) -> Scene:
        """Load the parts of a scene file and return them as a scene."""
        with converter():
            return self._scene(settings)

    def _scene(self, settings: SceneFile) -> Scene:
        kept: _Kept = {}
        parts: list[Part] = []
        entry_of: dict[str, int] = {}  # number of the entry of each part, by the part's name
        for index, entry in enumerate(settings.parts):
            try:
                loaded = self._load(entry, kept)
            except ProximityError as unusable:
                raise settings.error(
                    ("parts", index, "file"), f"parts[{index}].file: {unusable}"
                ) from unusable
            for part in _placed(entry, loaded):
                if part.name in entry_of:
                    raise _name_in_use(settings, index, part.name, entry_of[part.name])
                entry_of[part.name] = index
                parts.append(part)
        try:
            scene = Scene(parts)
        except ProximityError as unusable:
            raise settings.error(("parts",), f"parts: {unusable}") from unusable
        self._kept = kept
        approximation = max((deviation for *_, deviation in kept.values()), default=0.0)
        scene.report = LoadReport(settings.path, "scene file", "m", True, self.notes, approximation)
        return scene

    def _load(self, entry: PartEntry, kept: _Kept) -> tuple[Part, ...]:
        key, stamp = (entry.file, entry.units), stamp_of(entry.file)
        found = kept.get(key) or self._kept.get(key)
        if found is None or found[0] != stamp:
            loaded = load(entry.file, units=entry.units, **self._options)
            notes = tuple(f"{entry.file}: {note}" for note in notes_on_sizes(loaded))
            found = stamp, tuple(loaded.parts), notes, loaded.report.approximation if loaded.report else 0.0
        kept[key] = found
        return found[1]


def stamp_of(path: str) -> tuple[int, ...] | None:
    """Return a value that changes whenever the file changes, or None if the file is missing.

    Date and size are not enough: the files of an unpacked archive may share a date, and parts with equal face
    counts have equal sizes.
    """
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size


def finger_count(settings: SceneFile, recording: Recording | None) -> int:
    """Return the number of fingers.

    It comes from the scene file, else from the recording, else it is five.
    """
    count = settings.fingers.count
    if recording is None:
        return DEFAULT_FINGERS if count is None else count
    if count not in (None, len(recording.fingers)):
        raise settings.error(
            ("fingers", "count"),
            f"fingers.count is {count}, expected {len(recording.fingers)}, as {recording.path} has",
        )
    return len(recording.fingers)


def finger_names(settings: SceneFile, recording: Recording | None, count: int) -> tuple[str, ...]:
    """Return the names of the fingers from the scene file, else from the recording, else their numbers."""
    names = settings.fingers.names
    if names is not None:
        return names
    if recording is not None:
        return tuple(recording.finger_name(row) for row in range(count))
    return tuple(map(str, range(count)))


def finger_radii(settings: SceneFile, count: int) -> tuple[float, ...]:
    """Return the radii of the fingertips, m. They are nan if a sensor measures the distances."""
    radius = math.nan if settings.input.sensor is not None else settings.fingers.radius
    return radius if isinstance(radius, tuple) else (radius,) * count


def make_tracker(settings: SceneFile, scene: Scene, count: int) -> Tracker:
    """Return a tracker with the settings of the scene file."""
    reported = {one.name: getattr(settings.fingers, one.name) for one in fields(FingerSettings)}
    reported = {
        name: value for name, value in reported.items() if value is not None and name not in NOT_OF_TRACKER
    }
    service = settings.service
    try:
        return Tracker(scene, fingers=count, period=service.period, latency=service.latency, **reported)
    except ProximityError as unfit:
        raise settings.error(("fingers", "radius"), f"fingers: {unfit}") from unfit


def read_input(settings: SceneFile) -> Recording | None:
    """Read the recording of the scene file, not yet placed. Return None for other inputs."""
    entry = settings.input.recording
    if entry is None:
        return None
    try:
        return read_recording(entry.file)
    except ProximityError as unusable:
        raise settings.error(("input", "recording"), f"input.recording: {unusable}") from unusable


def place_recording(settings: SceneFile, recording: Recording, scene: Scene) -> Recording:
    """Transform a recording into the scene's frame.

    The pose is that of the scene file, or it is fitted to the parts.
    """
    entry = settings.input.recording
    if entry is None:
        raise ServiceError(f"{settings.path}: the input is not a recording")
    try:
        rotation = turn_about_axes(entry.turn_degrees)
        pose = Pose(rotation, entry.position)
        if entry.fit:
            radius = settings.fingers.radius
            largest = radius if isinstance(radius, float) else max(radius)
            pose = fitted_pose(scene, recording, largest, rotation=rotation, scale=entry.scale)
        return recording.placed(pose, entry.scale)
    except ProximityError as unusable:
        raise settings.error(("input", "recording"), f"input.recording: {unusable}") from unusable


def placed_parts(loaded: Sequence[Part], name: str | None, world_from_file: Pose) -> list[Part]:
    """Return the parts of a file with new names and transformed poses.

    *name*: name of the only part, or prefix of the names of several parts; None keeps the names in the file.
    """
    parts = []
    for part in loaded:
        if name is not None:
            part = replace(part, name=name if len(loaded) == 1 else f"{name}/{part.name}")
        if not world_from_file.is_identity:
            part = replace(
                part,
                pose=world_from_file @ part.pose,
                velocity=world_from_file.rotation @ part.velocity,
                angular_velocity=world_from_file.rotation @ part.angular_velocity,
            )
        parts.append(part)
    return parts


def _placed(entry: PartEntry, loaded: tuple[Part, ...]) -> list[Part]:
    """Return the parts of a file with the name, pose and surface that its entry specifies."""
    parts = placed_parts(loaded, entry.name, Pose(turn_about_axes(entry.turn_degrees), entry.position))
    if entry.kind is None:
        return parts
    return [replace(part, stiffness=entry.stiffness, damping=entry.damping) for part in parts]


def _name_in_use(settings: SceneFile, index: int, name: str, earlier: int) -> ServiceError:
    line = settings.document.line_of(("parts", earlier))
    return settings.error(
        ("parts", index),
        f"parts[{index}] has a part {name!r}, as the one on line {line} has: give one of them another name",
    )
