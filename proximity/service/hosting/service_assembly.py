"""Assemble a service from a scene file: its publishers, log, input and source of contacts."""

from contextlib import ExitStack
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Lock

import numpy as np

from proximity.errors import ArgumentError, DecaffError, RecordingError
from proximity.recording import FrameLog, Recording
from proximity.scene.scene import Scene
from proximity.service import (
    ChangesInput,
    ContactSource,
    Describer,
    GloveChoices,
    HeldContacts,
    MessageInput,
    MovesInput,
    NoPoses,
    PoseInput,
    RealTime,
    RecordingInput,
    SensedContacts,
    Service,
    SkippingClock,
    TrackedContacts,
)
from proximity.service.config import (
    HeldEntry,
    PartFiles,
    SceneFile,
    check_held,
    finger_count,
    finger_names,
    finger_radii,
    make_tracker,
    place_recording,
    read_input,
)
from proximity.service.realtime import PRIORITY
from proximity.transport import Publisher, open_publisher

COUNTS_TABLE = 4097
"""Number of rows in a table of counts. Interpolation is then exact to a hundredth of a count."""


@dataclass(frozen=True, slots=True, eq=False)
class ServiceSetup:
    """A service ready to run, with the data needed to replace its scene."""

    service: Service
    files: PartFiles  # cache of part files
    scene: Scene | None  # None: a sensor measures the distances
    moves: MovesInput | None
    changes: ChangesInput | None
    count: int  # number of fingers
    held: tuple[Service, ...]  # a service for each held part


def make_service(settings: SceneFile) -> ServiceSetup:
    """Open and load all objects of a scene file and return them as a service."""
    service, files = settings.service, PartFiles()
    with ExitStack() as opened:
        # Addresses and the log are opened first: they may be in use, and opening them is fast.
        publishers = [opened.enter_context(open_publisher(address)) for address in service.publish]
        log = None if service.log is None else opened.enter_context(FrameLog(service.log))
        recording = read_input(settings)
        count = finger_count(settings, recording)
        scene = None if settings.input.sensor is not None else files.scene(settings)
        real_time = RealTime(core=service.core) if service.real_time else None
        describer = Describer(finger_names(settings, recording, count), finger_radii(settings, count))
        pose_input = _input(settings, recording, scene, count)
        opened.callback(pose_input.close)
        recorded = settings.input.recording
        clock = SkippingClock() if recorded is not None and recorded.fast else None
        held_publishers = [
            [opened.enter_context(open_publisher(address)) for address in entry.publish]
            for entry in settings.held
        ]
        moves, deforming = None, Lock()
        if settings.input.moves is not None:
            moves = MovesInput(
                settings.input.moves,
                skipped=lambda: 0 if clock is None else clock.skipped_ns,
                refuse=describer.refuse,
            )
        changes = None
        if settings.input.changes is not None:
            changes = ChangesInput(
                settings.input.changes, SimpleQueue(), describer.ask, deforming, describer.refuse
            )
        contact_source: ContactSource
        if scene is None:
            contact_source = SensedContacts(count, latency=service.latency)
        else:
            check_held(settings, scene)
            contact_source = TrackedContacts(make_tracker(settings, scene, count), moves, changes)
        opened.callback(contact_source.close)
        loop = Service(
            contact_source,
            pose_input,
            publishers,
            period=service.period,
            valid_for=service.valid_for,
            clock=clock,
            log=log,
            real_time=real_time,
            describer=describer,
        )
        held = tuple(
            _held_service(settings, entry, loop, moves, deforming, to)
            for entry, to in zip(settings.held, held_publishers, strict=True)
            if moves is not None
        )
        opened.pop_all()  # closed by the loops from here on
    return ServiceSetup(loop, files, scene, moves, changes, count, held)


def _held_service(
    settings: SceneFile,
    entry: HeldEntry,
    fingers: Service,
    moves: MovesInput,
    deforming: Lock,
    publishers: list[Publisher],
) -> Service:
    """Return the service of a tracked part. It reads the scene of the service of *fingers*."""

    def scene() -> Scene:
        source = fingers.contact_source
        assert isinstance(source, TrackedContacts), "held parts are of a scene"
        return source.tracker.scene

    latency, period = settings.service.latency, settings.service.period
    settings_of_part = entry.tracker_settings
    source = HeldContacts(
        scene, moves.reported, entry.part, deforming=deforming, latency=latency, **settings_of_part
    )
    name = "+".join(entry.part)
    names = [name] if source.count == 1 else [f"{name} {number + 1}" for number in range(source.count)]
    service = Service(
        source,
        NoPoses(moves.address),
        publishers,
        period=period,
        valid_for=settings.service.valid_for,
        real_time=RealTime(priority=PRIORITY - 1, is_pinned=False) if settings.service.real_time else None,
        describer=Describer(names, [np.nan] * source.count),
    )
    moves.follow(scene(), entry.part, service.wake)
    return service


def _input(settings: SceneFile, recording: Recording | None, scene: Scene | None, count: int) -> PoseInput:
    source = settings.input
    if source.poses is not None:
        return MessageInput(source.poses, count, gloves=read_gloves(settings, count))
    if source.sensor is not None:
        return MessageInput(source.sensor, count, is_measured=True)
    assert recording is not None and scene is not None and source.recording is not None
    placed = place_recording(settings, recording, scene)
    try:
        resampled = placed.resampled(settings.service.period)
    except RecordingError as too_long:
        raise settings.error(("input", "recording"), f"input.recording: {too_long}") from too_long
    return RecordingInput(resampled, repeat=source.recording.repeat)


def read_gloves(settings: SceneFile, count: int) -> GloveChoices | None:
    """Read the calibrations of the gloves. Return paths of fingertips over bends, or None without [glove]."""
    glove = settings.glove
    if glove is None:
        return None
    # Imported only if there is a glove: the models take half a second to import.
    from proximity.decaff.glove.calibrated_glove import as_many, read_glove

    try:
        worn = as_many([read_glove(path, glove.max_age_days) for path in glove.calibration], count)
    except (ArgumentError, DecaffError) as unfit:
        raise settings.error(("glove", "calibration"), f"glove.calibration: {unfit}") from unfit
    tables = [each.counts_table(COUNTS_TABLE) for each in worn]
    return GloveChoices(
        corners=np.stack([each.path_finger() for each in worn]),
        counts=np.stack([counts for counts, _ in tables]),
        bends=np.stack([bends for _, bends in tables]),
    )
