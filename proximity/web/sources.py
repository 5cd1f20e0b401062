"""Sources of the frames that a page shows, which are a running service or a log.

Other programs that change the scene are a source of moves and changes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from proximity.errors import ProximityError, RecordingError
from proximity.message import CHANGES, FRAME_HEADER, MOVES, Kind, Message, PartAction
from proximity.message.envelope import unpack_prefix
from proximity.pose import Pose
from proximity.recording import FrameReader
from proximity.scene.scene import Scene
from proximity.service.inputs.changes_input import carry_out
from proximity.service.inputs.inbox import Inbox
from proximity.transport import open_subscriber
from proximity.web.page_content import shown_contents
from proximity.web.page_inbox import PageInbox

MAX_LOG = 2_000_000_000
"""Maximum size of the frames of a log, bytes. They are in memory while the log is shown."""
SHARED = ("shm://", "zenoh://")
"""Addresses at which any number of programs can listen."""
_POSE_AT = FRAME_HEADER.fields["pose_ns"][1]  # type: ignore[index]


class NewFrame(NamedTuple):
    """The newest frame as bytes, and how it differs from the previous frame."""

    data: bytes
    is_new_run: bool  # whether the service has restarted
    is_answer: bool  # whether its poses differ from those of the previous frame


class LiveFrames:
    """Frames that a service publishes. Invalid frames are never returned."""

    def __init__(self, address: str) -> None:
        self._subscriber = open_subscriber(address)
        self._session: int | None = None
        self._poses = b""

    def newest(self) -> NewFrame | None:
        """Return the newest frame that has arrived since the last call, or None."""
        taken = b""
        for frame in self._subscriber.frames():
            taken = frame.tobytes()  # copied now: the next message, even an invalid one, overwrites it
        if not taken:
            return None
        session = unpack_prefix(taken)[5]
        is_new_run = self._session is not None and session != self._session
        self._session = session
        poses, self._poses = self._poses, taken[_POSE_AT : _POSE_AT + 8]
        return NewFrame(taken, is_new_run, poses != self._poses)

    def close(self) -> None:
        """Close the address."""
        self._subscriber.close()


class OtherPrograms:
    """Receives moves, hiding and showing by other programs, for pages that only display.

    Addresses that can have only one listener are left to the service. *addresses*: addresses of moves and
    changes, or None.
    """

    def __init__(self, addresses: Sequence[str | None] = (), scene: Scene | None = None) -> None:
        self._scene = scene
        self._receptions = [
            Inbox(address, [MOVES, CHANGES])
            for address in dict.fromkeys(addresses)
            if address is not None and address.startswith(SHARED)
        ]

    def messages(self) -> Iterator[bytes]:
        """Apply arrived messages to the scene, and yield them."""
        for reception in self._receptions:
            for kind, records, ahead_ns in reception.messages():
                message = Message(kind, len(records))
                message.records[...] = records
                if kind is MOVES:
                    message.records["pose_ns"] += ahead_ns
                for record in message.records:
                    self._change(kind, record)
                yield bytes(message.seal(0, 0))

    def close(self) -> None:
        """Close the addresses."""
        for reception in self._receptions:
            reception.close()

    def _change(self, kind: Kind, record: Any) -> None:
        assert self._scene is not None
        name = record["name"].decode("utf-8", "replace")
        try:
            if kind is MOVES:
                self._scene.move(name, Pose(record["rotation"], record["translation"]))
            elif record["action"] in (PartAction.HIDE, PartAction.SHOW):
                carry_out(self._scene, ((name, PartAction(record["action"])),))
        except ProximityError:
            return  # the service reports the error


class LoggedFrames:
    """Frames of a log, which can be read by index or by time."""

    def __init__(self, path: Any) -> None:
        reader = FrameReader(path)
        self._runs: list[np.ndarray] = []
        begins, size = [0], 0
        for run in reader:
            self._runs.append(run)
            begins.append(begins[-1] + len(run))
            size += run.nbytes
            if size > MAX_LOG:
                raise RecordingError(f"{reader.path}: has more than 2 GB of frames, expected a shorter log")
        if not self._runs:
            raise RecordingError(f"{reader.path}: has no frame yet")
        self._begins = np.array(begins)
        self._times_ns = np.concatenate(list(_times(self._runs)))
        self.notes = reader.notes

    def close(self) -> None:
        """Release the frames."""
        self._runs.clear()

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._times_ns)

    @property
    def finger_count(self) -> int:
        """Number of fingers in the first frame."""
        return int(self._runs[0]["header"]["count"][0])

    @property
    def duration_ms(self) -> float:
        """Time from the first frame to the last, ms."""
        return float(self._times_ns[-1]) / 1e6

    def at(self, place: int) -> bytes:
        """Return the frame at an index.

        *place*: index from 0. Beyond the ends it is the first or the last frame.
        """
        place = min(max(place, 0), self.count - 1)
        run = int(np.searchsorted(self._begins, place, side="right")) - 1
        return self._runs[run][place - int(self._begins[run])].tobytes()

    def place_at(self, ms: float) -> int:
        """Return the index of the last frame at or before a time, in ms from the first frame."""
        return max(int(np.searchsorted(self._times_ns, ms * 1e6, side="right")) - 1, 0)

    def ms_at(self, place: int) -> float:
        """Return the time of a frame, in ms from the first frame."""
        return float(self._times_ns[min(max(place, 0), self.count - 1)]) / 1e6


def _times(runs: list[np.ndarray]) -> Iterator[np.ndarray]:
    """Yield arrays with the instants of frames, ns from the first frame.

    The first frame of another session has the instant of the last one of the previous session.
    """
    offset, last, session = -int(runs[0]["header"]["start_ns"][0]), 0, runs[0]["header"]["session"][0]
    for run in runs:
        starts, sessions = run["header"]["start_ns"], run["header"]["session"]
        times = np.empty(len(run), np.int64)
        for part in np.split(np.arange(len(run)), np.flatnonzero(np.diff(sessions)) + 1):
            if sessions[part[0]] != session:
                offset, session = last - int(starts[part[0]]), sessions[part[0]]
            times[part] = starts[part] + offset
            last = int(times[part].max())
        yield times


@dataclass(slots=True, eq=False)
class Shown:
    """Contents that pages show."""

    title: str
    scene: Scene | None
    frames: LiveFrames | LoggedFrames | None  # None: pages compute distances themselves
    feed: PageInbox
    content: dict[str, bytes] = field(default_factory=lambda: shown_contents(None))
    others: OtherPrograms = field(default_factory=OtherPrograms)
    about: dict[str, Any] = field(default_factory=dict)  # first data sent to pages
    notes: tuple[str, ...] = ()  # notes on the files of parts
