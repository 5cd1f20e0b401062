"""What distances cost in a whole VR application: from the pose of a hand to the frame that answers it.

The paper ends with "At the present time a complete VR application has not been implemented to verify the
precise performance cost of these intersection checks." Here it is, with nothing left out but the screen:
*native*, a program that publishes poses and subscribes to frames in shared memory; and *page*, what
``proximity view`` runs, with the bridge and its web socket. Both are timed from outside, on one clock.
"""

import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
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
from proximity.tracker.replay import fitted_pose
from proximity.transport import open_publisher, open_subscriber
from proximity.web.served_scene import Addresses, own_addresses, write_scene_file
from proximity.web.viewing import RunningPage

PATHS = ("native", "page")
TICK_S = 1e-3
RADIUS = 0.007
WARM_S = 1.0  # poses before anything is counted: clocks are learnt meanwhile
LONGEST_S = 60.0  # without a frame at the beginning
LOOK_S = 5e-5
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
    """What was measured of it; times in s."""

    case: VrCase
    face_count: int
    pose_count: int
    answered_count: int  # poses of which a frame came; a newer pose may have come before its tick
    motion_to_distance_p50: float
    motion_to_distance_p99: float
    motion_to_distance_p999: float
    tick_p50: float  # from the begin of a tick to its publication
    tick_p99: float
    missed: int  # ticks of the service
    service_share: float  # of a core; nan without psutil
    bridge_share: float  # likewise; nan where there is none

    @property
    def frame_share(self) -> float:
        """The middle motion-to-distance as a share of the time between two poses."""
        return self.motion_to_distance_p50 * self.case.pose_rate_hz

    @property
    def sample_share(self) -> float:
        """The middle tick as a share of a haptic sample, 1 ms."""
        return self.tick_p50 / TICK_S


def measure(files: list[str], case: VrCase, recording: Recording, *, units: str = "mm") -> VrRow:
    """Run an application and time it.

    Parameters
    ----------
    files : list of str
        Of parts.
    case : VrCase
        Which application.
    recording : Recording
        Of a hand, put where it touches the parts.
    units : str
        Of files that declare none.

    Raises
    ------
    ServiceError
        If it cannot be run, or nothing is answered.
    """
    scene = Scene([part for name in files for part in load(name, units=units).parts])
    hand = _hand(scene, recording, case)
    with ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="proximity-vr-")))
        begin = _native if case.path == "native" else _page
        running = opened.enter_context(begin(files, folder, units, scene.parts[0].name))
        timed = _drive(running, hand, case)
    return _row(case, timed, sum(part.solid.mesh.face_count for part in scene.parts))


@dataclass(slots=True)
class _Application:
    """One that runs: how poses go in, and how frames come out."""

    send: Callable[[Message], None]
    receive: Callable[[float], list[np.ndarray]]  # frames, as bytes; waits so many s at most
    part: str
    service_pid: int
    bridge_pid: int | None = None


@contextmanager
def _native(files: list[str], folder: Path, units: str, part: str) -> Iterator[_Application]:
    addresses = own_addresses()
    served = write_scene_file(
        folder, [str(Path(name).resolve()) for name in files], addresses, units=units, rate_hz=1.0 / TICK_S,
        radius=RADIUS,
    )  # fmt: skip
    with ExitStack() as opened:
        service = opened.enter_context(start_service(served.path, say=_nothing))
        subscriber = opened.enter_context(open_subscriber(addresses.frames))
        publishers = _publishers(addresses, opened)

        def receive(timeout: float) -> list[np.ndarray]:
            ends = time.monotonic() + timeout
            while not (found := [np.array(frame) for frame in subscriber.frames()]):
                if time.monotonic() > ends:
                    break
                time.sleep(LOOK_S)
            return found

        yield _Application(
            lambda message: publishers[message.kind.name].publish(message),
            receive,
            part,
            int(service.beginning["pid"]),
        )


def _publishers(addresses: Addresses, opened: ExitStack) -> dict[str, Any]:
    return {
        POSES.name: opened.enter_context(open_publisher(addresses.poses)),
        MOVES.name: opened.enter_context(open_publisher(addresses.moves)),
    }


@contextmanager
def _page(files: list[str], folder: Path, units: str, part: str) -> Iterator[_Application]:
    """What a page does, without drawing."""
    del folder
    try:
        connect = import_module("websockets.sync.client").connect
    except ModuleNotFoundError as missing:
        raise ServiceError('the page needs websockets: pip install "proximity[web]"') from missing
    words = [*files, "--units", units, "--rate", f"{1.0 / TICK_S:g}", "--radius", f"{1e3 * RADIUS:g}"]
    with ExitStack() as opened:
        page = RunningPage(words, files[0], _nothing)
        opened.callback(page.stop)
        address, _, token = page.url.partition("/#token=")
        socket = opened.enter_context(
            connect(address.replace("http", "ws", 1) + "/live", origin=address, max_size=None)
        )
        socket.send(json.dumps({"hello": token}))
        sequence = iter(range(1, 1 << 62))

        def receive(timeout: float) -> list[np.ndarray]:
            try:
                data = socket.recv(timeout)
            except TimeoutError:
                return []
            if isinstance(data, bytes) and int.from_bytes(data[:4], "little") == FRAME.magic:
                socket.send("ok")
                return [np.frombuffer(data, np.uint8)]
            return []

        def send(message: Message) -> None:
            socket.send(message.seal(1, next(sequence)).tobytes())

        bridge = int(page.beginning["pid"])
        yield _Application(send, receive, part, _service_of(bridge), bridge)


def _nothing(_: str) -> None:
    """What is said meanwhile is of no interest here."""


def _hand(scene: Scene, recording: Recording, case: VrCase) -> np.ndarray:
    """Fingertips at the rate of poses, (T, N, 3), m; nan where a finger is missing."""
    recording = replace(recording).resampled(1.0 / case.pose_rate_hz)
    placed = recording.placed(fitted_pose(scene, recording, RADIUS)).positions
    columns = np.arange(case.finger_count) % placed.shape[1]
    # A second hand is the first one, a little later.
    return np.stack(
        [np.roll(placed[:, column], 9 * (k // placed.shape[1]), axis=0) for k, column in enumerate(columns)],
        axis=1,
    )


@dataclass(slots=True)
class _Timed:
    """Instants of an application, ns, and what its processes took, s."""

    sent: list[int]
    answered: list[tuple[int, int]]  # pose_ns and arrival of frames
    ticks: list[int]
    missed: int
    shares: tuple[float, float]


def _drive(running: _Application, hand: np.ndarray, case: VrCase) -> _Timed:
    """Send poses at their rate, and take frames meanwhile."""
    sent: list[Any] = []
    answered: list[Any] = []
    ticks: list[Any] = []
    missed = [0, 0]
    _until_answered(running, hand)
    begins = time.monotonic() + WARM_S
    counted, ends = False, begins + case.seconds
    due, row = time.monotonic(), 0
    before = _cpu(running)
    while (now := time.monotonic()) < ends:
        if not counted and now >= begins:
            counted, before = True, _cpu(running)
            for each in (sent, answered, ticks):
                each.clear()
            missed[0] = missed[1]
        if now >= due:
            sent.append(_send(running, hand[row % len(hand)], case))
            row, due = row + 1, due + 1.0 / case.pose_rate_hz
        for frame in running.receive(max(min(due, ends) - time.monotonic(), 0.0)):
            arrived = time.monotonic_ns()
            header, _ = parts_of(frame, FRAME)
            answered.append((int(header["pose_ns"]), arrived))
            ticks.append(int(header["publish_ns"]) - int(header["start_ns"]))
            missed[1] = int(header["missed"])
    took = [(after - start) / case.seconds for after, start in zip(_cpu(running), before, strict=True)]
    return _Timed(sent, answered, ticks, missed[1] - missed[0], (took[0], took[1]))


def _until_answered(running: _Application, hand: np.ndarray) -> None:
    ends = time.monotonic() + LONGEST_S
    while not running.receive(0.1):
        if time.monotonic() > ends:
            raise ServiceError("no frame came within a minute")
        _send(running, hand[0], VrCase(finger_count=hand.shape[1]))


def _send(running: _Application, tips: np.ndarray, case: VrCase) -> int:
    """Send a pose, and a move where a part moves; the pose's instant."""
    message = Message(POSES, len(tips))
    message.records["finger"] = np.arange(len(tips))
    message.records["position"], message.records["velocity"] = tips, np.nan
    message.records["bend"] = np.nan
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
    first: dict[int, int] = {}  # the first frame that answers each pose
    for pose, arrived in timed.answered:
        k = int(np.argmin(np.abs(poses - pose)))
        if abs(int(poses[k]) - pose) < SAME_NS:
            first.setdefault(k, arrived)
    if not first:
        raise ServiceError("no frame answered a pose")
    delays = np.array([arrived - timed.sent[k] for k, arrived in first.items()]) / 1e9
    p50, p99, p999 = np.percentile(delays, [50, 99, 99.9])
    tick_p50, tick_p99 = np.percentile(np.array(timed.ticks) / 1e9, [50, 99])
    return VrRow(
        case, face_count, len(poses), len(first), float(p50), float(p99), float(p999),
        float(tick_p50), float(tick_p99), timed.missed, *timed.shares,
    )  # fmt: skip


def _cpu(running: _Application) -> tuple[float, float]:
    """Time that service and bridge have had of a core, s; nan where it is not known."""
    return _cpu_of(running.service_pid), _cpu_of(running.bridge_pid)


def _cpu_of(pid: int | None) -> float:
    psutil = _psutil()
    if pid is None or psutil is None:
        return np.nan
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def _service_of(bridge: int) -> int:
    psutil = _psutil()
    if psutil is None:
        return 0
    return int(next(each.pid for each in psutil.Process(bridge).children() if "serve" in each.cmdline()))


def _psutil() -> Any:
    try:
        return import_module("psutil")
    except ModuleNotFoundError:
        return None
