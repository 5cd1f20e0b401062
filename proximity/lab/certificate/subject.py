"""The subject of a certificate: a scene, the settings of its ticks, and the recorded hand.

It comes from a scene file of the service, with its settings, or from a file of parts, with the tracker's.
"""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ServiceError
from proximity.recording import Recording, read_recording
from proximity.scene.loader import load
from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.service.config import (
    PartFiles,
    SceneFile,
    finger_count,
    make_tracker,
    place_recording,
    read_input,
    read_scene_file,
)
from proximity.tracker.placement import fitted_pose
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET

RADIUS, WORKING_RANGE = 0.007, 0.12
"""m; the tracker's defaults."""
FINGER_COUNT = 5
OF_TRACKER = (
    "radius", "budget", "working_range", "tolerance", "horizon", "max_speed", "max_acceleration",
)  # fmt: skip
SCENE_SUFFIX = ".toml"


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A scene and the settings of its ticks."""

    scene: Scene
    fingers: int = FINGER_COUNT
    period: float = 0.001  # s
    latency: float = 0.001  # s, from a tick until the controller acts
    settings: dict[str, Any] = field(default_factory=dict)  # of a `Tracker`, if not its defaults
    recording: Recording | None = None  # placed, at the rate of the ticks
    files: tuple[str, ...] = ()  # that it came from
    real_time: bool = False  # whether the loop requests priority from the system
    core: int | None = None
    not_measured: tuple[str, ...] = ()  # inputs of the scene file that make a tick costlier

    @property
    def budget(self) -> int:
        """Nodes and leaves per finger and tick."""
        budget = self.settings.get("budget")
        return DEFAULT_BUDGET if budget is None else int(budget)

    @property
    def working_range(self) -> float:
        """Distance beyond which a tick does not search, m."""
        return float(self.settings.get("working_range", WORKING_RANGE))

    @property
    def face_count(self) -> int:
        """Number of faces of all parts."""
        return sum(part.solid.mesh.face_count for part in self.scene.parts)

    def tracker(self, fingers: int | None = None, **settings: Any) -> Tracker:
        """Return the service's tracker, for another number of fingers if given.

        Individual radii do not fit another number: the largest is then used for all.
        """
        count = self.fingers if fingers is None else fingers
        reported = {**self.settings, **settings}
        radius = reported.get("radius", RADIUS)
        if not isinstance(radius, float) and len(radius) != count:
            reported["radius"] = max(radius)
        return Tracker(self.scene, fingers=count, period=self.period, latency=self.latency, **reported)


def read_subject(
    path: str | os.PathLike[str],
    *,
    units: str = "mm",
    recording: str | os.PathLike[str] | None = None,
    fingers: int | None = None,
    period: float | None = None,
    real_time: bool | None = None,
    sample: Callable[[], Path] | None = None,
) -> Subject:
    """Return the subject of a scene file of the service (``.toml``), or of a file of parts.

    Arguments override the scene file. *sample*: returns a recording if the file has none.
    """
    if fingers is not None and fingers < 1:
        raise ServiceError(f"{fingers} fingers cannot be tracked, expected 1 or more")
    # Before the parts: mistakes here should be found before the slow reading.
    hand = None if recording is None else read_recording(recording)
    if Path(path).suffix.lower() == SCENE_SUFFIX:
        subject = _of_scene_file(read_scene_file(path), hand, period)
    else:
        subject = Subject(load(path, units=units), files=(os.fspath(path),), period=period or 0.001)
    if hand is None and subject.recording is None and sample is not None:
        hand = read_recording(sample())
    if hand is not None:
        subject = replace(subject, recording=_fitted(subject, hand), files=(*subject.files, hand.path))
    if real_time is not None:
        subject = replace(subject, real_time=real_time)
    return subject if fingers is None else replace(subject, fingers=fingers)


def _fitted(subject: Subject, hand: Recording) -> Recording:
    radius = subject.settings.get("radius", RADIUS)
    pose = fitted_pose(subject.scene, hand, radius if isinstance(radius, float) else max(radius))
    return hand.placed(pose).resampled(subject.period)


def _of_scene_file(settings: SceneFile, recording: Recording | None, period: float | None) -> Subject:
    if not settings.parts:
        raise ServiceError(
            f"{settings.path}: a scene without parts has no geometry whose latency could be certified"
        )
    scene = PartFiles().scene(settings)
    own = read_input(settings) if recording is None else None
    service, count = settings.service, finger_count(settings, own)
    make_tracker(settings, scene, count)  # raises, with the line, for settings that the tracker refuses
    reported = {name: getattr(settings.fingers, name) for name in OF_TRACKER}
    ticks = service.period if period is None else period
    return Subject(
        scene,
        count,
        ticks,
        service.latency,
        {name: value for name, value in reported.items() if value is not None},
        None if own is None else place_recording(settings, own, scene).resampled(ticks),
        (
            settings.path,
            *dict.fromkeys(part.file for part in settings.parts),
            *(() if own is None else (own.path,)),
        ),
        service.real_time,
        service.core,
        tuple(name for name, is_there in _more_inputs(settings).items() if is_there),
    )


def _more_inputs(settings: SceneFile) -> dict[str, bool]:
    """Return the scene file's inputs other than poses, and whether it has them."""
    return {
        "paths of fingers": settings.input.poses is not None,
        "parts that move": settings.input.moves is not None,
        "held parts": bool(settings.held),
    }


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of all that affects a tick's answer and cost, 64 hexadecimal digits.

    Corners, faces, poses and surfaces of the parts count; names, files and the order of the parts do not.
    """
    return hashlib.sha256(b"".join(sorted(map(_part_digest, scene.parts)))).hexdigest()


def _part_digest(part: Part) -> bytes:
    mesh = part.solid.mesh
    surface = [-1.0 if part.stiffness is None else part.stiffness, part.damping, float(part.is_hidden)]
    rows = mesh.vertices, mesh.faces, part.pose.rotation, part.pose.translation, surface
    digest = hashlib.sha256()
    for array, kind in zip(rows, ("<f8", "<i4", "<f8", "<f8", "<f8"), strict=True):
        # A zero has one sign here; the lengths separate the arrays.
        plain = np.ascontiguousarray(np.asarray(array) + 0, dtype=kind)
        digest.update(np.int64(plain.size).tobytes() + plain.tobytes())
    return digest.digest()
