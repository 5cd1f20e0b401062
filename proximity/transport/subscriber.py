"""Subscriber that provides the newest frame and its present validity (docs/reference/messages.md)."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from proximity.checks import as_number, not_negative
from proximity.core.receiver_state import STALE_AFTER_NS
from proximity.errors import ArgumentError
from proximity.message import CONTACT, DESCRIPTION, FRAME, Defect, Kind, State
from proximity.message.contact import TRACKED_BIT, Contact, Contacts
from proximity.message.description import Description, DescriptionMessages
from proximity.transport.contact_age import forget, widen
from proximity.transport.link import Inlet
from proximity.transport.message_reader import Counts, MessageReader
from proximity.transport.publisher_clock import ForeignClock
from proximity.transport.received_frame import ReceivedFrame

STALE_AFTER = 1e-9 * STALE_AFTER_NS
"""Time after ``valid_until`` when a frame becomes useless, s. Its poses are then 100 ms old."""
MAX_SPEED = 3.0
"""Maximum speed of a finger, m/s, which is the tracker's default."""
MAX_ACCELERATION = 120.0
"""Maximum acceleration of a finger, m/s², which is the tracker's default."""
MAX_WAIT = 3600.0
"""Maximum time of one wait, s. A longer wait is split."""

_VALID = (State.OK, State.DEGRADED)
_USED = (*_VALID, State.LATE)
_NO_CONTACTS = np.zeros(0, CONTACT).view(Contacts)
_BYTES = np.dtype((np.void, CONTACT.itemsize))


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """State of a subscriber, which is the newest frame and its validity.

    Until ``valid_until``, and at most a second after its oldest pose, a frame is reported as published. After
    that, or if the frame itself is LATE, only the bounds hold, and they widen with time; the distance stays
    that of the pose. Later, or if the frame itself says so, the fingers are unknown: STALE or STOPPING.

    ``state`` gives the trust in the frame, ``is_new`` whether it is new since the previous reading.
    ``contacts`` are records of `CONTACT`; ``header`` has the fields of the frame, None before the first
    frame. The next reading overwrites both: copy values needed later. ``now_ns`` is the instant of the
    reading on the publisher's clock, ``age_ns`` the time since the oldest pose of a tracked finger, -1 before
    the first frame.
    """

    state: State  # state of the frame, or a worse one
    is_new: bool  # whether no previous reading had this frame
    now_ns: int  # instant of the reading, on the publisher's clock
    age_ns: int  # time since the oldest pose of a tracked finger; -1 without a frame
    header: Any  # FRAME_HEADER, overwritten by a later reading; None: no frame yet
    contacts: Contacts  # (N,) CONTACT, read-only, overwritten by a later reading

    @property
    def is_valid(self) -> bool:
        """Whether the distances may be used unchanged, because the frame is neither LATE nor STALE."""
        return self.state in _VALID


class Subscriber:
    """Receives frames at an address and verifies them. It is created by `open_subscriber`.

    Size, version, checksum, sequence number and the values of the contacts of each frame are checked. A frame
    that fails is dropped and counted; the previous frame stays and ages. After STOPPING, a later frame of the
    same publisher is used again.

    Parameters
    ----------
    inlet : Inlet
        The transport's receiving end.
    address : str
        Address that it was opened with.
    stale_after : float, s
        Time after a frame's ``valid_until`` until it is STALE.
    max_speed : float, m/s
        Largest speed of a finger, by which bounds widen.
    max_acceleration : float, m/s²
        Largest acceleration of a finger, by which bounds widen.
    clock : callable
        Returns the present instant, ns, monotonic.

    Raises
    ------
    ArgumentError
        If one of the three numbers is not a finite number of 0 or more.

    Notes
    -----
    Cost: 20 µs with a new frame of five fingers, 5 without.
    Thread: one thread reads.
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
        self._reader = MessageReader(inlet, [FRAME, DESCRIPTION], clock, uncounted=DESCRIPTION)
        self._description = DescriptionMessages()
        self._clock = clock
        self._foreign = None if inlet.shares_clock else ForeignClock()
        self._stale_after_ns = round(1e9 * not_negative("stale_after", stale_after, "seconds"))
        self._max_speed = not_negative("max_speed", max_speed, "metres a second")
        self._max_acceleration = not_negative("max_acceleration", max_acceleration, "m/s²")
        self._newest: ReceivedFrame | None = None  # the newest frame
        self._spare: ReceivedFrame | None = (
            None  # buffer of the next one: the newest stays until that is verified
        )
        self._is_new = False
        self._as_published = self._shown = _NO_CONTACTS  # of an aged frame; a read-only view
        self._is_forgotten = False
        self._valid, self._valid_of = _NO_CONTACTS, (0, 0)  # newest of each finger; session and epoch
        self._now_ns: int | None = None  # instant of the last reading; None: clock not known

    @property
    def counts(self) -> Counts:
        """Numbers of frames received and lost, and of messages refused, until now."""
        return self._reader.counts

    @property
    def description(self) -> Description | None:
        """Newest description of the service, or None before the first one.

        It has the names of parts and fingers, the hidden parts and the radii. It is sent next to frames, ten
        times a second (once a second with more than 640 names), and on request.
        """
        return self._description.newest

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts, in the order of ``contacts["part"]`` of the last reading.

        They are empty until they are known, and after a change of the scene until the service has described
        it again.
        """
        newest, held = self._description.newest, self._newest
        if newest is None or held is None:
            return ()
        is_of_frame = (held.header["session"], held.header["epoch"]) == (newest.session, newest.epoch)
        return newest.part_names if is_of_frame else ()

    def part_name(self, contact: Any) -> str | None:
        """Return the name of the part that a contact of the last reading refers to.

        Parameters
        ----------
        contact : CONTACT
            One of ``contacts``.

        Returns
        -------
        str or None
            None if the contact refers to no part, or until the name is known.
        """
        names, row = self.part_names, int(contact["part"])
        return names[row] if 0 <= row < len(names) else None

    def last_valid(self, finger: int, max_age: float = 0.1) -> Contact | None:
        """Return the newest valid contact of a finger as it was published, to display while frames are late.

        Parameters
        ----------
        finger : int
            Number of the finger.
        max_age : float, s
            Largest age of its pose at the last reading.

        Returns
        -------
        CONTACT or None
            None if there is none, or if parts have been renumbered since. A later frame overwrites it.
        """
        if self._now_ns is None or not 0 <= finger < len(self._valid):
            return None
        contact: Contact = self._valid[finger]
        is_used = contact["flags"] & TRACKED_BIT and self._now_ns - int(contact["pose_ns"]) <= 1e9 * max_age
        return contact if is_used else None

    @property
    def finger_names(self) -> tuple[str, ...]:
        """Names of the fingers of a frame. They are empty until they are known."""
        newest = self._description.newest
        return () if newest is None else newest.finger_names

    def read(self) -> Reading:
        """Return the present state after reading all arrived messages. The call never waits.

        Returns
        -------
        Reading
            State with the newest usable frame, which may be that of the previous reading.

        Raises
        ------
        PublishError
            If the transport cannot receive, for example because a socket was closed.
        """
        for kind, _, now in self._reader.messages(self._decode):
            if kind is FRAME:
                self._accept(now)
        return self._reading()

    def wait(self, timeout: float) -> Reading:
        """Wait for a new frame, but at most *timeout* seconds. Return the same as `read`.

        Parameters
        ----------
        timeout : float, s
            Longest wait. inf: no limit. 0 or less: no wait.

        Raises
        ------
        ArgumentError
            If *timeout* is not a number.
        PublishError
            See `read`.
        """
        if math.isnan(as_number(timeout)):
            raise ArgumentError(f"timeout is {timeout!r}, expected a number of seconds")
        ends = time.monotonic() + timeout
        while True:
            reading = self.read()
            left = ends - time.monotonic()
            if reading.is_new or left <= 0.0:
                return reading
            self._inlet.wait(min(left, MAX_WAIT))

    def frames(self) -> Iterator[np.ndarray]:
        """Yield the bytes of every usable frame that has arrived, oldest first, for recorders.

        The bytes are overwritten by the next frame. The next reading is of the last frame.
        """
        for kind, data, now in self._reader.messages(self._decode):
            if kind is FRAME:
                self._accept(now)
                yield data

    def close(self) -> None:
        """Close the address. Closing again has no effect."""
        self._inlet.close()

    def __enter__(self) -> "Subscriber":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _decode(self, kind: Kind, data: np.ndarray, now: int) -> Defect | None:
        """Decode a message into the spare buffer, or append it to the description.

        Return the defect of its content, or None.
        """
        if kind is DESCRIPTION:
            return self._description.add(data)
        count = (len(data) - kind.header_size) // kind.record_size
        if self._spare is None or self._spare.count != count:
            self._spare = ReceivedFrame(count)
        return self._spare.decode(data, now if self._foreign is None else None)

    def _accept(self, now: int) -> None:
        """Make the frame in the spare buffer the newest."""
        self._newest, self._spare = self._spare, self._newest
        self._is_new, self._is_forgotten = True, False
        assert self._newest is not None, "a frame was decoded"
        self._keep_valid(self._newest)
        if self._foreign is not None:
            self._foreign.arrived(self._newest.publish_ns, now, is_new_run=self._reader.is_new_run)

    def _keep_valid(self, frame: ReceivedFrame) -> None:
        """Store the contacts that `last_valid` returns."""
        of = int(frame.header["session"]), int(frame.header["epoch"])
        if of != self._valid_of or len(self._valid) != frame.count:
            self._valid, self._valid_of = np.zeros(frame.count, CONTACT).view(Contacts), of
        if frame.state in _VALID:
            is_tracked = (frame.contacts["flags"] & TRACKED_BIT) != 0
            np.copyto(self._valid.view(_BYTES), frame.contacts.view(_BYTES), where=is_tracked)

    def _reading(self) -> Reading:
        now, foreign, held = self._clock(), self._foreign, self._newest
        if foreign is not None:
            now = foreign.theirs(now)
        self._now_ns = now if foreign is None or foreign.is_certain else None
        if held is None:
            return Reading(State.STALE, False, now, -1, None, _NO_CONTACTS)
        is_new, self._is_new = self._is_new, False
        state, contacts = held.state, held.contacts
        if now > held.expires_ns or state not in _VALID or (foreign is not None and not foreign.is_certain):
            state, contacts = self._worsened(held, now)
        return Reading(state, is_new, now, max(now - held.pose_ns, 0), held.header, contacts)

    def _worsened(self, held: ReceivedFrame, now: int) -> tuple[State, Contacts]:
        """Return the state and the contacts of a frame that has aged or cannot be trusted."""
        is_believed = self._foreign is None or self._foreign.is_certain
        if not is_believed or now > held.expires_ns + self._stale_after_ns:
            state = max(held.state, State.STALE)
        else:
            state = max(held.state, State.LATE) if now > held.expires_ns else held.state
        if state is State.LATE and held.state in _USED:
            self._copy(held)
            widen(self._as_published, now, self._max_speed, self._max_acceleration)
            self._is_forgotten = False
        elif not self._is_forgotten:
            self._copy(held)
            forget(self._as_published)
            self._is_forgotten = True
        return state, self._shown

    def _copy(self, held: ReceivedFrame) -> None:
        if len(self._as_published) != held.count:
            self._as_published = np.empty(held.count, CONTACT).view(Contacts)
            self._shown = self._as_published.view()
            self._shown.flags.writeable = False
        np.copyto(self._as_published.view(np.uint8), held.contacts.view(np.uint8))
