"""Cost of distances in a whole VR application: from the pose of a hand to the frame that answers it.

The paper ends with "At the present time a complete VR application has not been implemented to verify the
precise performance cost of these intersection checks." This is one, complete except for the screen: *native*,
a program that publishes poses and subscribes to frames in shared memory; and *page*, the work of a page of
``proximity serve --web``, over the bridge and its web socket. Both are timed from outside, on one clock.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ServiceError
from proximity.message import FRAME, MOVES, POSES, Message, parts_of
from proximity.recording import Recording
from proximity.scene.loader import load
from proximity.scene.scene import Scene
from proximity.service.hosting import start_service
from proximity.system.extras import needed
from proximity.tracker.placement import fitted_pose
from proximity.transport import open_publisher, open_subscriber
from proximity.web.running_page import Addresses, RunningPage, own_addresses

PATHS = ("native", "page")
VALID_FOR = 0.1
"""s: hands of a headset come 30 to 90 times a second."""
TICK_S = 1e-3
RADIUS = 0.007  # m, of fingertips
HEADINGS = (
    "application", "faces", "poses, Hz", "fingers", "to distance p50, ms", "p99", "p99.9", "of a frame",
    "tick with a new pose p50, µs", "p99", "of 1 ms", "without one p50, µs", "service", "bridge, cores",
)  # fmt: skip
WARM_S = 1.0  # poses before counting: clocks are estimated in that time
MAX_S = 60.0  # without a frame at the start
LOOK_S = 5e-5
SERVED = "served.toml"
NO_POSES = 'poses = "mailbox:none"'
SAME_NS = 3_000_000
"""The bridge puts poses on the service's clock; farther off, a frame answers another pose."""
SWAY_M, BEAT = 0.002, 6.0


@dataclass(frozen=True, slots=True)
class VrCase:
    """One application."""

    path: str = "native"  # of PATHS
    pose_rate_hz: float = 90.0
    finger_count: int = 10
    is_moving: bool = False  # one part moves with the poses
    seconds: float = 10.0


@dataclass(frozen=True, slots=True)
class VrRow:
    """Measurements of it; times in s."""

    case: VrCase
    face_count: int
    pose_count: int
    answered_count: int  # poses with a frame; a newer pose may have come before its tick
    motion_to_distance_p50: float
    motion_to_distance_p99: float
    motion_to_distance_p999: float
    tick_p50: float  # with a new pose, from its start to its publication
    tick_p99: float
    idle_tick_p50: float | None  # without a new pose; None: no such frame
    missed: int  # ticks of the service
    service_share: float | None  # of a core; None: psutil is not installed
    bridge_share: float | None  # likewise, or without a bridge

    @classmethod
    def of(cls, document: dict[str, Any]) -> "VrRow":
        """Return the row in a JSON document."""
        return cls(**{**document, "case": VrCase(**document["case"])})

    @property
    def cells(self) -> list[str]:
        """Return the cells below `HEADINGS`."""
        case = self.case
        delays = (self.motion_to_distance_p50, self.motion_to_distance_p99, self.motion_to_distance_p999)
        return [
            case.path + (", moving" if case.is_moving else ""),
            f"{self.face_count:,}",
            f"{case.pose_rate_hz:g}",
            f"{case.finger_count}",
            *(f"{1e3 * each:.2f}" for each in delays),
            f"{self.motion_to_distance_p50 * case.pose_rate_hz:.0%}",
            f"{1e6 * self.tick_p50:.0f}",
            f"{1e6 * self.tick_p99:.0f}",
            f"{self.tick_p50 / TICK_S:.1%}",
            "" if self.idle_tick_p50 is None else f"{1e6 * self.idle_tick_p50:.0f}",
            *("" if each is None else f"{each:.2f}" for each in (self.service_share, self.bridge_share)),
        ]


Serving = Callable[[Path, Addresses, VrCase], AbstractContextManager[int]]
"""Serves a scene file at these addresses while it is open; yields the process."""


@contextmanager
def own_service(scene_file: Path, addresses: Addresses, case: VrCase) -> Iterator[int]:
    """Serve by ``proximity serve``."""
    del case
    listening = "\n".join(f'{key} = "{getattr(addresses, key)}"' for key in ("poses", "moves", "changes"))
    text = scene_file.read_text(encoding="utf-8").replace(NO_POSES, listening)
    service_table = f"rate_hz = {1.0 / TICK_S}\nvalid_for = {VALID_FOR}\nreal_time = false\n"
    served = scene_file.with_name(SERVED)
    served.write_text(f'[service]\npublish = ["{addresses.frames}"]\n{service_table}{text}', encoding="utf-8")
    with start_service(served, say=_nothing) as service:
        yield int(service.beginning["pid"])


def measure(
    files: list[str],
    case: VrCase,
    recording: Recording,
    *,
    units: str = "mm",
    serving: Serving = own_service,
) -> VrRow:
    """Run an application and time it.

    *recording*: of a hand, placed so that it touches the parts.
    """
    scene = Scene([part for name in files for part in load(name, units=units).parts])
    hand = _hand(scene, recording, case)
    with ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="proximity-vr-")))
        scene_file, part = _scene_file(folder, files, units, case.finger_count), scene.parts[0].name
        application = (
            _native(scene_file, part, case, serving)
            if case.path == "native"
            else _page(scene_file, part, case, serving)
        )
        running = opened.enter_context(application)
        timed = _drive(running, hand, case)
    return _row(case, timed, sum(part.solid.mesh.face_count for part in scene.parts))


def _scene_file(folder: Path, files: list[str], units: str, finger_count: int) -> Path:
    """Write a scene file of the given parts, for *finger_count* fingers."""
    # A scene file must name a source of poses, which the service overrides.
    lines = [
        "[input]",
        NO_POSES,
        "[fingers]",
        f"count = {finger_count}",
        f"radius = {RADIUS}",
        "[web]",
        "feed = true",
    ]
    for name in files:
        lines += ["[[parts]]", f"file = {json.dumps(os.path.abspath(name))}", f'units = "{units}"']
    path = folder / "application.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@dataclass(slots=True)
class _Application:
    """A running application: how to send poses and receive frames."""

    send: Callable[[Message], None]
    receive: Callable[[float], list[np.ndarray]]  # frames, as bytes; waits for a time, s, at most
    part: str
    service_pid: int | None
    bridge_pid: int | None = None


@contextmanager
def _native(scene_file: Path, part: str, case: VrCase, serving: Serving) -> Iterator[_Application]:
    addresses = own_addresses()
    with ExitStack() as opened:
        service_pid = opened.enter_context(serving(scene_file, addresses, case))
        subscriber = opened.enter_context(open_subscriber(addresses.frames))
        publishers = {
            POSES.name: opened.enter_context(open_publisher(addresses.poses)),
            MOVES.name: opened.enter_context(open_publisher(addresses.moves)),
        }

        def receive(timeout: float) -> list[np.ndarray]:
            ends = time.monotonic() + timeout
            while not (found := [np.array(frame) for frame in subscriber.frames()]):
                if time.monotonic() > ends:
                    break
                time.sleep(LOOK_S)
            return found

        yield _Application(
            lambda message: publishers[message.kind.name].publish(message), receive, part, service_pid
        )


@contextmanager
def _page(scene_file: Path, part: str, case: VrCase, serving: Serving) -> Iterator[_Application]:
    """Run the work of a page next to a service, without drawing."""
    addresses = own_addresses()
    with needed("the page needs", "web"):
        connect = import_module("websockets.sync.client").connect
    with ExitStack() as opened:
        service_pid = opened.enter_context(serving(scene_file, addresses, case))
        served = str(scene_file.with_name(SERVED))
        page = RunningPage([served, "--beside", addresses.frames], scene_file.name, _nothing)
        opened.callback(page.stop)
        address, _, token = page.url.partition("/#token=")
        socket = opened.enter_context(
            connect(address.replace("http", "ws", 1) + "/live", origin=address, max_size=None)
        )
        socket.send(json.dumps({"hello": token}))
        sequence = iter(range(1, 1 << 62))

        def receive(timeout: float) -> list[np.ndarray]:
            ends = time.monotonic() + timeout
            while True:  # returned moves, and sentences
                try:
                    data = socket.recv(max(ends - time.monotonic(), 0.0))
                except TimeoutError:
                    return []
                if isinstance(data, bytes) and int.from_bytes(data[:4], "little") == FRAME.magic:
                    socket.send("ok")
                    return [np.frombuffer(data, np.uint8)]

        def send(message: Message) -> None:
            socket.send(message.seal(1, next(sequence)).tobytes())

        bridge = int(page.beginning["pid"])
        yield _Application(send, receive, part, service_pid, bridge)


def _nothing(_: str) -> None:
    """Ignore messages."""


def _hand(scene: Scene, recording: Recording, case: VrCase) -> np.ndarray:
    """Return fingertips at the rate of poses, (T, N, 3), m; nan for a missing finger."""
    recording = recording.resampled(1.0 / case.pose_rate_hz)
    placed = recording.placed(fitted_pose(scene, recording, RADIUS)).positions
    count = placed.shape[1]
    # A second hand is the first one, slightly later.
    tips = [np.roll(placed[:, k % count], 9 * (k // count), axis=0) for k in range(case.finger_count)]
    return np.stack(tips, axis=1)


@dataclass(slots=True)
class _Timed:
    """Instants of an application, ns."""

    sent: list[int] = field(default_factory=list)
    frames: list[tuple[int, int, int]] = field(default_factory=list)  # pose_ns, arrival, length of the tick
    missed: int = 0  # ticks, from the newest frame
    shares: tuple[float | None, float | None] = (None, None)  # of a core, of service and bridge


def _drive(running: _Application, hand: np.ndarray, case: VrCase) -> _Timed:
    """Send poses at their rate, and receive frames; the first ones are not counted."""
    _until_answered(running, hand, case)
    row = _drive_for(WARM_S, running, hand, case, warm := _Timed(), 0)
    before, timed = _cpu(running), _Timed()
    _drive_for(case.seconds, running, hand, case, timed, row)
    timed.missed -= warm.missed
    first, second = (
        None if start is None or end is None else (end - start) / case.seconds
        for start, end in zip(before, _cpu(running), strict=True)
    )
    timed.shares = first, second
    return timed


def _drive_for(
    seconds: float, running: _Application, hand: np.ndarray, case: VrCase, timed: _Timed, row: int
) -> int:
    """Send and receive for a time; return the next row of the hand."""
    due = time.monotonic()
    ends = due + seconds
    while (now := time.monotonic()) < ends:
        if now >= due:
            timed.sent.append(_send(running, hand[row % len(hand)], case))
            row, due = row + 1, due + 1.0 / case.pose_rate_hz
        for frame in running.receive(max(min(due, ends) - time.monotonic(), 0.0)):
            arrived = time.monotonic_ns()
            header, _ = parts_of(frame, FRAME)
            took = int(header["publish_ns"]) - int(header["start_ns"])
            timed.frames.append((int(header["pose_ns"]), arrived, took))
            timed.missed = int(header["missed"])
    return row


def _until_answered(running: _Application, hand: np.ndarray, case: VrCase) -> None:
    ends = time.monotonic() + MAX_S
    while not running.receive(0.1):
        if time.monotonic() > ends:
            raise ServiceError("no frame came within a minute")
        _send(running, hand[0], case)


def _send(running: _Application, tips: np.ndarray, case: VrCase) -> int:
    """Send a pose, and a move if a part moves; return the pose's instant."""
    message = Message(POSES, len(tips))
    message.records["finger"] = np.arange(len(tips))
    message.records["position"] = tips
    message.header["send_ns"] = message.records["pose_ns"] = now = time.monotonic_ns()
    running.send(message)
    if case.is_moving:
        moved = Message(MOVES, 1)
        moved.records["name"] = running.part.encode()
        moved.records["rotation"] = np.eye(3)
        moved.records["translation"] = (0.0, 0.0, SWAY_M * np.sin(BEAT * now / 1e9))
        moved.header["send_ns"] = moved.records["pose_ns"] = now
        running.send(moved)
    return now


def _row(case: VrCase, timed: _Timed, face_count: int) -> VrRow:
    poses = np.array(timed.sent)
    pose_ns, arrived, took = np.array(timed.frames).reshape(-1, 3).T
    is_new = np.diff(pose_ns, prepend=0) != 0
    first: dict[int, int] = {}  # the first frame that answers each pose
    for pose, arrival in zip(pose_ns[is_new].tolist(), arrived[is_new].tolist(), strict=True):
        k = int(np.argmin(np.abs(poses - pose)))
        if abs(int(poses[k]) - pose) < SAME_NS:
            first.setdefault(k, arrival)
    if not first:
        raise ServiceError("no frame answered a pose")
    delays = np.array([arrival - timed.sent[k] for k, arrival in first.items()]) / 1e9
    p50, p99, p999 = np.percentile(delays, [50, 99, 99.9]).tolist()
    tick_p50, tick_p99 = np.percentile(took[is_new] / 1e9, [50, 99]).tolist()
    idle_p50 = None if is_new.all() else float(np.median(took[~is_new]) / 1e9)
    counts = face_count, len(poses), len(first)
    return VrRow(case, *counts, p50, p99, p999, tick_p50, tick_p99, idle_p50, timed.missed, *timed.shares)


def _cpu(running: _Application) -> tuple[float | None, float | None]:
    """Return the processor time of service and bridge, s; None if unknown."""
    return _cpu_of(running.service_pid), _cpu_of(running.bridge_pid)


def _cpu_of(pid: int | None) -> float | None:
    psutil = _psutil()
    if pid is None or psutil is None:
        return None
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def _psutil() -> Any:
    try:
        return import_module("psutil")
    except ModuleNotFoundError:
        return None
