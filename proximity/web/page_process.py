"""Run a page, whose parts, service and bridge are in one process and are stopped by one event."""

import asyncio
import errno
import os
import socket
import ssl
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ProximityError, ServiceError
from proximity.formats import metres_per_unit
from proximity.message import PATH_CORNERS
from proximity.recording import Recording, read_recording
from proximity.scene.clashes import MeasuredPair
from proximity.scene.scene import Scene
from proximity.service.config import (
    FingerSettings,
    InputSettings,
    PartEntry,
    PartFiles,
    SceneFile,
    ServiceSettings,
    WebSettings,
    finger_count,
    read_input,
    read_scene_file,
)
from proximity.service.config.toml_document import Document
from proximity.system.extras import needed
from proximity.tracker.placement import fitted_pose
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET
from proximity.web.page_content import scene_page_files, shown_contents
from proximity.web.page_inbox import PageInbox
from proximity.web.saved_page import save_page
from proximity.web.server.access import LOOPBACK, Access, new_token
from proximity.web.sources import LiveFrames, LoggedFrames, OtherPrograms, Shown

if TYPE_CHECKING:
    from proximity.web.bridge import Bridge

LOOK_S = 0.05
RECORDED_STEP_S = 1 / 90
MAX_RECORDED_S = 300.0
"""Maximum duration of a recorded hand that a page replays."""
FINGERS_OF_PAGE = 10
"""Number of fingers of two hands, from thumb to little finger with the left hand first."""
TRACKER = ("working_range", "tolerance", "horizon", "max_speed", "max_acceleration")
"""Settings of fingers in a scene file that the tracker of a page uses."""
FRAMED_BY_NOTEBOOKS = "'self' http://localhost:* http://127.0.0.1:*"


@dataclass(frozen=True, slots=True)
class PageSettings:
    """Contents and addresses of a page."""

    files: tuple[str, ...]  # files of parts, a scene file, or a log of frames and files of parts
    units: str = "mm"
    reading: tuple[tuple[str, float], ...] = ()  # more options of `load`, for every file
    recording: str | None = None  # recording of a hand to replay
    is_recording_fitted: bool = False  # whether to place the hand so that it touches
    first_input: str = ""  # "replay": the recording from the start; "mouse": a hand
    points_name: str = ""  # name of the points shown with their distances
    points: bytes = b""  # coordinates of the points, m, float64
    find_clashes: Callable[[Scene], Sequence[MeasuredPair]] | None = None  # None: clashes are not listed
    radius: float | None = None  # m; None: that of the scene file
    port: int = 0
    bind: str = "127.0.0.1"
    names: tuple[str, ...] = ()  # further names of this machine
    certificate: str | None = None
    key: str | None = None
    beside: str | None = None  # address of the frames of a running service of the scene file
    may_be_framed: bool = False  # whether a notebook on this machine may show it in a frame


def run_page(
    settings: PageSettings,
    *,
    stop: threading.Event,
    say: Callable[[str], None],
    begun: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """Show a page until stopped. Return the numbers of refused requests.

    *begun*: function that is called with ``url`` and more when the page can be opened.
    """
    with needed("the page needs", "web"):
        from proximity.web.bridge import Bridge
    tls, port = _tls(settings), _free_port(settings)
    with ExitStack() as opened:
        shown = _shown(settings, opened)
        if shown.frames is not None:
            opened.callback(shown.frames.close)
        opened.callback(shown.feed.close)
        for note in shown.notes:
            say(note)
        token = new_token()
        access = Access.of((token,), _names(settings), port, is_secure=tls is not None)
        files = scene_page_files(FRAMED_BY_NOTEBOOKS if settings.may_be_framed else "'self'")
        bridge = Bridge(shown, access, files)
        url = f"{access.scheme}://{_shown_host(settings.bind)}:{port}/#token={token}"

        async def serve() -> None:
            server = await bridge.server.listen(settings.bind, port, tls)
            try:
                await _until_stopped(bridge, shown, stop, lambda: begun({"url": url, "pid": os.getpid()}))
            finally:
                server.close()

        asyncio.run(serve())
        return {"refused": bridge.server.refused}


async def _until_stopped(
    bridge: "Bridge", shown: Shown, stop: threading.Event, begun: Callable[[], None]
) -> None:
    """Send frames to pages until *stop* is set."""
    publishing = asyncio.create_task(bridge.publish_frames())
    begun()
    while not stop.is_set():
        await asyncio.sleep(LOOK_S)
        if publishing.done():
            publishing.result()
    shown.feed.release()
    publishing.cancel()


def _free_port(settings: PageSettings) -> int:
    """Return the port to listen on. Raise an error if it is in use, before parts are read."""
    try:
        family = socket.AF_INET6 if ":" in settings.bind else socket.AF_INET
        with socket.create_server((settings.bind, settings.port), family=family) as free:
            return int(free.getsockname()[1])
    except OSError as failure:
        is_in_use = failure.errno == errno.EADDRINUSE
        why = "is in use by another program" if is_in_use else f"cannot be opened ({failure.strerror})"
        raise ServiceError(f"port {settings.port} of {settings.bind} {why}") from None


def _shown_host(bind: str) -> str:
    """Return the host in the URL of a listening address."""
    if bind in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{bind}]" if ":" in bind else bind


def _shown(settings: PageSettings, opened: ExitStack) -> Shown:
    """Load and open the contents of a page."""
    logs = [name for name in settings.files if name.endswith(".frames")]
    parts = tuple(name for name in settings.files if name not in logs)
    for name in settings.files:
        if not os.path.exists(name):
            raise ServiceError(f"{name}: there is no such file")
    if len(logs) > 1:
        raise ServiceError(f"{logs[1]}: one log is shown at a time")
    if settings.beside is not None:
        return _attach_to_service(settings, parts[0], settings.beside, opened)
    if logs:
        return _open_log(settings, logs[0], page_settings(parts, settings) if parts else None)
    return _open_parts(settings)


def page_settings(files: Sequence[str], settings: PageSettings) -> SceneFile:
    """Return the parts and fingers of a page as settings.

    They are read from a scene file, or refer to files of parts.
    """
    if len(files) == 1 and files[0].endswith(".toml"):
        given = read_scene_file(files[0])
    else:
        parts = tuple(PartEntry(os.path.abspath(name), settings.units) for name in files)
        nothing = ServiceSettings(), FingerSettings(), parts, InputSettings(), None, WebSettings()
        given = SceneFile("", *nothing, Document("", ""))
    fingers = replace(given.fingers, count=given.fingers.count or FINGERS_OF_PAGE)
    fingers = fingers if settings.radius is None else replace(fingers, radius=settings.radius)
    return replace(given, fingers=fingers, input=InputSettings(), glove=None)


def _attach_to_service(settings: PageSettings, path: str, frames: str, opened: ExitStack) -> Shown:
    """Return the contents of a page of a running service.

    The page may send poses and moves if the scene file permits it.
    """
    served = read_scene_file(path)
    scene = PartFiles().scene(served) if served.parts else None
    given = served.input if served.web.feed else InputSettings()
    count = finger_count(served, read_input(served))
    feed = PageInbox(given.poses, given.moves, given.changes, scene, count)
    shown = Shown(_title(settings), scene, LiveFrames(frames), feed)
    if not served.web.feed and scene is not None:
        shown.others = opened.enter_context(
            closing(OtherPrograms([served.input.moves, served.input.changes], scene))
        )
    if scene is not None:
        shown.content = shown_contents(scene)
        shown.about = _about(settings if feed.may_pose else _without_hand(settings), served, scene, count)
    return shown


def _open_log(settings: PageSettings, log: str, served: SceneFile | None) -> Shown:
    """Return the contents of a page that plays the log of a service, with its parts if given."""
    frames, files = LoggedFrames(log), PartFiles(**dict(settings.reading))
    scene = None if served is None else files.scene(served)
    count = frames.finger_count
    shown = Shown(_title(settings), scene, frames, PageInbox(None, None, None, scene, count))
    shown.notes = files.notes
    if served is not None and scene is not None:
        shown.content = shown_contents(scene, points=settings.points)
        shown.about = _about(_without_hand(settings), served, scene, count)
    shown.about["log"] = {"count": frames.count, "duration_ms": frames.duration_ms, "notes": frames.notes}
    return shown


def _open_parts(settings: PageSettings) -> Shown:
    """Return the contents of pages that compute distances to parts themselves, each for its own hands."""
    served, files = page_settings(settings.files, settings), PartFiles(**dict(settings.reading))
    scene, count = files.scene(served), finger_count(served, None)
    shown = Shown(_title(settings), scene, None, PageInbox(None, None, None, scene, count))
    welcome = page_welcome(shown.title, settings, served, scene)
    shown.content, shown.notes = shown_contents(scene, welcome, settings.points), files.notes
    return shown


def page_welcome(title: str, settings: PageSettings, served: SceneFile, scene: Scene) -> dict[str, Any]:
    """Return the data for a page that computes distances to the parts of a scene itself."""
    count = finger_count(served, None)
    return {
        "title": title,
        **dict.fromkeys(("feeds", "may_pose", "may_move", "may_hide", "has_geometry"), True),
        "finger_count": count,
        "tracker": {name: value for name in TRACKER if (value := getattr(served.fingers, name)) is not None},
        **_about(settings, served, scene, count),
    }


def _without_hand(settings: PageSettings) -> PageSettings:
    return replace(settings, recording=None)


def _about(settings: PageSettings, served: SceneFile, scene: Scene, count: int) -> dict[str, Any]:
    """Return data on fingers, points, clashes and the recording for the page."""
    radius = served.fingers.radius
    radii = [radius] * count if isinstance(radius, float) else list(radius)
    recording = None if settings.recording is None else read_recording(settings.recording)
    return {
        "radii": radii,
        "budget": served.fingers.budget or DEFAULT_BUDGET,
        "first_input": settings.first_input,
        "points": {"name": settings.points_name} if settings.points else None,
        "unit": metres_per_unit(settings.units),
        "clashes": settings.find_clashes and [_listed(pair) for pair in settings.find_clashes(scene)],
        "drum_degrees": _drum_degrees(served, count),
        "recording": recording and _recorded(recording, scene, max(radii), settings),
    }


def _listed(clash: MeasuredPair) -> dict[str, Any]:
    """Return a clash for the list of the page, in metres and in the scene's frame."""
    return {
        "names": clash.clearance[:2],
        "deepest": clash.deepest,
        "depth": clash.depth,
        "volume": clash.volume,
        "point": clash.deepest_point.tolist() if np.isfinite(clash.deepest_point).all() else None,
    }


def write_page(settings: PageSettings, path: Path) -> int:
    """Write one file with a page that computes distances itself. Return its size in bytes."""
    if any(name.endswith(".frames") for name in settings.files):
        raise ServiceError("a log cannot be saved as a page, expected parts or a scene file")
    return save_page(path, _open_parts(settings).content)


def _title(settings: PageSettings) -> str:
    return " + ".join(os.path.basename(name) for name in settings.files)


def _drum_degrees(served: SceneFile, count: int) -> list[list[float]] | None:
    """Return drum angles of each finger at equally spaced bends from 0 to 1, or None without gloves."""
    if served.glove is None:
        return None
    from proximity.decaff.glove.calibrated_glove import as_many, read_glove

    age = served.glove.max_age_days
    gloves = as_many([read_glove(path, age) for path in served.glove.calibration], count)
    bends = np.linspace(0.0, 1.0, PATH_CORNERS)
    return [np.degrees(glove.drum_angle(bends)).round(3).tolist() for glove in gloves]


def _recorded(
    recording: Recording, scene: Scene, radius: float, settings: PageSettings
) -> dict[str, Any] | None:
    """Return a recorded hand for the page, or None if it cannot be placed."""
    try:
        recording = recording.first(MAX_RECORDED_S).resampled(RECORDED_STEP_S)
        if settings.is_recording_fitted:
            recording = recording.placed(fitted_pose(scene, recording, radius))
    except ProximityError as unfit:
        if settings.first_input:
            raise ServiceError(str(unfit)) from unfit
        return None
    positions = recording.positions.round(7)
    return {
        "name": os.path.basename(settings.recording or ""),
        "step_ms": 1e3 * RECORDED_STEP_S,
        "fingers": [5 * hand + finger for hand, finger in recording.fingers],
        "positions": [
            [None if x != x else x for x in row] for row in positions.reshape(len(positions), -1).tolist()
        ],
    }


def _tls(settings: PageSettings) -> ssl.SSLContext | None:
    """Return the TLS context, or None if it is not needed. Only the loopback address needs none."""
    is_local = settings.bind in ("127.0.0.1", "::1", "localhost")
    if settings.certificate is None or settings.key is None:
        if not is_local or settings.certificate or settings.key:
            raise ServiceError(
                f"a page at {settings.bind} needs a certificate and its key, expected --cert and --cert-key: "
                "without them others could read the connection, and browsers do not offer a headset"
            )
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(settings.certificate, settings.key)
    except (OSError, ssl.SSLError) as unfit:
        raise ServiceError(f"{settings.certificate}: cannot be used as a certificate ({unfit})") from unfit
    return context


def _names(settings: PageSettings) -> tuple[str, ...]:
    """Return the names under which this machine can be reached."""
    names = [*LOOPBACK, *settings.names]
    if settings.bind in ("0.0.0.0", "::"):
        names += [socket.gethostname(), socket.getfqdn()]
    elif settings.bind not in names:
        names.append(f"[{settings.bind}]" if ":" in settings.bind else settings.bind)
    return tuple(dict.fromkeys(names))
