"""Publisher: numbers messages, adds checksums and passes them to a transport."""

import threading
import time
from types import TracebackType
from typing import Any

from proximity.message import Message
from proximity.transport.link import Outlet

ASLEEP_NS = 1_000_000_000
"""If calendar time gains more on the monotonic clock between two messages, the machine was suspended."""

_lock = threading.Lock()
_newest_session = 0


def _next_session() -> int:
    """Return the calendar time, ns; if its clock is coarse, more than the previous session."""
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
    session: int  # ns, calendar time of the start of the run, by which receivers detect a restart

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
        """Number, seal and send a message. A failed message uses its number.

        After a suspension of the machine a new session begins: its monotonic clock stopped, and receivers on
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
        """Close the address. Closing again has no effect."""
        self._outlet.close()

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def numbering(publisher: Publisher) -> dict[str, int]:
    """Return the state needed to number and seal messages instead of a publisher."""
    return {"session": publisher.session, "awake_ns": publisher._awake_ns}


def outlet_of(publisher: Publisher) -> Any:
    """Return the outlet of a publisher, for sealed messages."""
    return publisher._outlet
