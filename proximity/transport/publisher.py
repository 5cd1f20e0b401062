"""Publisher that numbers messages, adds checksums and passes them to a transport."""

import threading
import time
from types import TracebackType
from typing import Any

from proximity.message import Message
from proximity.transport.link import Outlet

ASLEEP_NS = 1_000_000_000
"""Minimum gain of calendar time on the monotonic clock between two messages that shows a suspension."""

_lock = threading.Lock()
_newest_session = 0


def _next_session() -> int:
    """Return the calendar time, ns, or the previous session plus one if that is greater."""
    global _newest_session
    with _lock:
        _newest_session = max(time.time_ns(), _newest_session + 1)
        return _newest_session


def _calendar_offset_ns() -> int:
    return time.time_ns() - time.monotonic_ns()


class Publisher:
    """Publishes messages at an address. It is created by `open_publisher`.

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
        self._sequences: dict[int, int] = {}  # number of the next message of each kind, by its magic
        self._awake_ns = _calendar_offset_ns()

    @property
    def sequence(self) -> int:
        """Number of messages published in this run, of all kinds."""
        return sum(self._sequences.values())

    def publish(self, message: Message) -> None:
        """Number a message, add its checksum and send it.

        A message that cannot be sent still uses its number. After a suspension of the machine a new session
        begins, since the monotonic clock stopped and receivers on other machines must estimate it again.

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
    """Return the state with which other code can number and checksum messages instead of the publisher."""
    return {"session": publisher.session, "awake_ns": publisher._awake_ns}


def outlet_of(publisher: Publisher) -> Any:
    """Return the outlet of a publisher, which sends messages that are numbered already."""
    return publisher._outlet
