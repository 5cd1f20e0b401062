"""The receiving side: the newest frame, and how far it can be trusted now (PAPER 8 and 10)."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from proximity.message import CONTACT, FRAME, ContactFlag, Flaw, Kind, Mode, Source, State, parts_of
from proximity.transport.clocks import ForeignClock
from proximity.transport.examining import Counts, Examiner
from proximity.transport.links import Inlet

STALE_AFTER = 0.08
"""s after ``valid_until`` at which a frame is worth nothing; poses are then 100 ms old (PAPER 10)."""
AHEAD_NS = 5_000_000
"""A pose farther in the future than this is a mistake (PAPER 10)."""
MAX_SPEED = 3.0
"""m/s: no finger is faster, as the tracker has it by default."""
MAX_ACCELERATION = 120.0
"""m/s², likewise."""
UNIT_ERROR = 1e-3
"""By which a normal's length may differ from 1 (PAPER 10)."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What a subscriber knows now.

    Up to ``valid_until`` it is what was published. From then on the contacts are made worse: their bounds
    hold for now and widen, times to contact shorten, and what was exact is not any more. In the end nothing
    is left but STALE.
    """

    state: State  # what the frame says, or worse
    is_new: bool  # no reading before had this frame
    now_ns: int  # instant of the reading, on the publisher's clock
    age_ns: int  # since the oldest pose of a tracked finger; -1 where there is no frame
    header: Any  # FRAME_HEADER, a copy; None: no frame yet
    contacts: np.ndarray  # (N,) CONTACT, overwritten by the next reading

    @property
    def is_valid(self) -> bool:
        """Whether distances may be used as they are: neither late nor worse."""
        return self.state in (State.OK, State.DEGRADED)


class Subscriber:
    """Receives frames at an address and distrusts them; made by `open_subscriber`.

    Size, version, checksum and number of each frame are verified, and that its contacts make sense. What
    does not hold is dropped and counted, and the frame before goes on ageing.

    Parameters
    ----------
    inlet : Inlet
        The transport's receiving end.
    address : str
        What it was opened as.
    stale_after : float, s
        After a frame's ``valid_until``, until it is worth nothing.
    max_speed : float, m/s
        Of a finger: how fast bounds widen meanwhile.
    max_acceleration : float, m/s²
        Of a finger, likewise.
    clock : callable
        Gives now, ns, monotonic.
    """

    address: str

    def __init__(
        self,
        inlet: Inlet,
        address: str,
        *,
        stale_after: float = STALE_AFTER,
        max_speed: float = MAX_SPEED,
        max_acceleration: float = MAX_ACCELERATION,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.address = address
        self._inlet = inlet
        self._examiner = Examiner(inlet, [FRAME], clock)
        self._clock = clock
        self._foreign = None if inlet.shares_clock else ForeignClock()
        self._stale_after_ns = round(1e9 * stale_after)
        self._max_speed, self._max_acceleration = max_speed, max_acceleration
        self._kept = np.zeros(0, np.uint8)  # the newest frame, as it came
        self._header: np.ndarray | None = None
        self._received = np.zeros(0, CONTACT)
        self._told = np.zeros(0, CONTACT)

    @property
    def counts(self) -> Counts:
        """What was received, lost and refused so far."""
        return self._examiner.counts

    def read(self) -> Reading:
        """Take what has arrived and say what is known now; never waits.

        Returns
        -------
        Reading
            Of the newest frame that can be used, or of the one before, older now.
        """
        is_new = False
        for data in self.frames():
            is_new = True
            self._keep(data)
        return self._reading(is_new)

    def wait(self, timeout: float) -> Reading:
        """Like `read`, but wait for a new frame, no longer than that.

        Parameters
        ----------
        timeout : float, s
            How long to wait at most.
        """
        ends = time.monotonic() + timeout
        while True:
            reading = self.read()
            left = ends - time.monotonic()
            if reading.is_new or left <= 0.0:
                return reading
            self._inlet.wait(left)

    def frames(self) -> Iterator[np.ndarray]:
        """Give every frame that has arrived and can be used, oldest first, as its bytes: for recorders.

        The bytes are overwritten by the next frame.
        """
        for _, data, now in self._examiner.messages(self._content_flaw):
            if self._foreign is not None:
                header, _ = parts_of(data, FRAME)
                self._foreign.arrived(int(header["publish_ns"]), now)
            yield data

    def close(self) -> None:
        """Give the address back; closing twice is once."""
        self._inlet.close()

    def __enter__(self) -> "Subscriber":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _keep(self, data: np.ndarray) -> None:
        if len(self._kept) != len(data):
            self._kept = np.empty(len(data), np.uint8)
            header, self._received = parts_of(self._kept, FRAME)
            self._told = np.zeros(len(self._received), CONTACT)
            self._header = header
        self._kept[:] = data

    def _content_flaw(self, kind: Kind, data: np.ndarray, now: int) -> Flaw | None:
        """Whether the instants of a frame and what it says of its fingers cannot be."""
        header, contacts = parts_of(data, kind)
        if self._foreign is None and int(header["pose_ns"]) - now > AHEAD_NS:
            return Flaw.FUTURE
        is_tracked = (contacts["flags"] & ContactFlag.TRACKED) != 0
        lower, distance, upper = contacts["lower"], contacts["signed_distance"], contacts["upper"]
        makes_sense = (lower <= distance) & (distance <= upper)
        # A sensor may know a distance without a place.
        makes_sense &= (contacts["source"] != Source.GEOMETRY) | ~np.isnan(contacts["position"]).any(axis=1)
        normals = contacts["normal"]
        length_sq = (normals * normals).sum(axis=1)
        makes_sense &= (abs(length_sq - 1.0) <= 2.0 * UNIT_ERROR) | np.isnan(length_sq)
        return None if (makes_sense | ~is_tracked).all() else Flaw.CONTENT

    def _reading(self, is_new: bool) -> Reading:
        now = self._clock()
        if self._foreign is not None:
            now = self._foreign.theirs(now)
        if self._header is None:
            return Reading(State.STALE, False, now, -1, None, self._told)
        header = self._header[()].copy()
        state, expires = State(int(header["state"])), int(header["valid_until_ns"])
        age = now - int(header["pose_ns"])
        np.copyto(self._told.view(np.uint8), self._received.view(np.uint8))
        if now > expires + self._stale_after_ns:
            state = State.STALE
            forget(self._told)
        elif now > expires:
            state = max(state, State.LATE)
            widen(self._told, now, self._max_speed, self._max_acceleration)
        return Reading(state, is_new, now, age, header, self._told)


def widen(contacts: np.ndarray, now_ns: int, max_speed: float, max_acceleration: float) -> None:
    """Make contacts hold at a later instant: as far as finger and part may have come, less is known.

    Parameters
    ----------
    contacts : (N,) CONTACT
        Changed in place: bounds, distances, times to contact, flags.
    now_ns : int
        The instant, on the clock of the poses.
    max_speed : float, m/s
        Of a finger.
    max_acceleration : float, m/s²
        Of a finger: one whose velocity is known does not depart from it faster.
    """
    elapsed = 1e-9 * np.maximum(now_ns - contacts["pose_ns"], 0)
    speed = np.where(
        (contacts["flags"] & ContactFlag.PREDICTED) != 0,
        np.where(
            contacts["source"] == Source.GEOMETRY,
            np.sqrt((contacts["velocity"] ** 2).sum(axis=1)),
            np.abs(contacts["approach_speed"]),
        ),
        max_speed,
    )
    part_speed = np.sqrt((contacts["part_velocity"] ** 2).sum(axis=1))
    way = np.minimum(max_speed, speed + 0.5 * max_acceleration * elapsed) * elapsed
    way += np.nan_to_num(part_speed) * elapsed
    contacts["lower"] -= way
    contacts["upper"] += way
    contacts["signed_distance"] = contacts["lower"]
    contacts["predicted_distance"] = contacts["predicted_lower"] = contacts["lower"]
    contacts["predicted_upper"] = contacts["upper"]
    contacts["predicted_ns"] = now_ns
    contacts["age_ns"] = now_ns - contacts["pose_ns"]
    left = contacts["time_to_contact_lower"] - elapsed
    contacts["time_to_contact_lower"] = np.maximum(np.minimum(left, contacts["lower"] / max_speed), 0.0)
    contacts["flags"] &= ~np.uint32(ContactFlag.EXACT | ContactFlag.PREDICTED | ContactFlag.CONTACT_FOUND)
    contacts["flags"] |= np.uint32(ContactFlag.BOUNDED)


def forget(contacts: np.ndarray) -> None:
    """Leave nothing of contacts but whose they are and when that was.

    Parameters
    ----------
    contacts : (N,) CONTACT
        Changed in place.
    """
    for name in CONTACT.names or ():
        if CONTACT[name].base.kind == "f":
            contacts[name] = np.nan
    contacts["lower"] = contacts["predicted_lower"] = -np.inf
    contacts["upper"] = contacts["predicted_upper"] = np.inf
    contacts["time_to_contact_lower"] = 0.0
    contacts["flags"] = 0
    contacts["part"] = contacts["face"] = -1
    contacts["mode"], contacts["force_is_valid"] = Mode.HOLD, 0
