"""Publisher: messages are numbered, given a checksum and handed to a transport."""

import threading
import time
from types import TracebackType
from typing import Any

from proximity.message import Message
from proximity.transport.link import Outlet

ASLEEP_NS = 1_000_000_000
"""Where the calendar gains more on the monotonic clock between two messages, the machine slept."""

_lock = threading.Lock()
_newest_session = 0


def _next_session() -> int:
    """The time of the calendar, ns; where its clock is coarse, more than that of the session before."""
    global _newest_session
    with _lock:
        _newest_session = max(time.time_ns(), _newest_session + 1)
        return _newest_session


def _calendar_offset_ns() -> int:
    return time.time_ns() - time.monotonic_ns()


class Publisher:
    """Publishes messages at an address; made by `open_publisher`.

    ``session`` is the calendar time, ns, at which it started: receivers recognise a restart by it.

    Parameters
    ----------
    outlet : Outlet
        The transport's sending end.
    address : str
        Address that it was opened with.

    Notes
    -----
    Thread: one thread publishes.
    """

    address: str
    session: int  # ns of the calendar at which the run began: receivers tell a restart by it

    def __init__(self, outlet: Outlet, address: str) -> None:
        self.address = address
        self.session = _next_session()
        self._outlet = outlet
        self._sequences: dict[int, int] = {}  # number of the next message, by the magic of its kind
        self._awake_ns = _calendar_offset_ns()

    @property
    def sequence(self) -> int:
        """Number of messages of this run, of all kinds; with one kind, its next sequence number."""
        return sum(self._sequences.values())

    def publish(self, message: Message) -> None:
        """Number, seal and send a message. Its number is used up even if sending fails.

        After the machine slept a new session begins: its monotonic clock stood still, and receivers on
        other machines must estimate it again.

        Parameters
        ----------
        message : Message
            Of any kind; its header's session, sequence and checksum are written here.

        Raises
        ------
        PublishError
            If the transport cannot send it.
        """
        before, self._awake_ns = self._awake_ns, _calendar_offset_ns()
        if self._awake_ns > before + ASLEEP_NS:
            self.session = _next_session()
            self._sequences.clear()
        magic = message.kind.magic
        sequence = self._sequences.get(magic, 0)
        self._sequences[magic] = sequence + 1
        self._outlet.send(message.seal(self.session, sequence))

    def close(self) -> None:
        """Release the address. Closing again does nothing."""
        self._outlet.close()

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def numbering(publisher: Publisher) -> dict[str, int]:
    """What whoever numbers and seals messages in place of a publisher has to know."""
    return {"session": publisher.session, "awake_ns": publisher._awake_ns}


def outlet_of(publisher: Publisher) -> Any:
    """The outlet of a publisher, for messages that are sealed already."""
    return publisher._outlet
