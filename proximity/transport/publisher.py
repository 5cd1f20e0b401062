"""The sending side: messages are numbered, checksummed and handed to a transport."""

import time
from types import TracebackType

from proximity.message import Message
from proximity.transport.links import Outlet


class Publisher:
    """Publishes messages at an address; made by `open_publisher`.

    Parameters
    ----------
    outlet : Outlet
        The transport's sending end.
    address : str
        What it was opened as.
    """

    address: str
    session: int  # ns, instant at which the publisher was opened: receivers tell a restart by it
    sequence: int  # number of the next message

    def __init__(self, outlet: Outlet, address: str) -> None:
        self.address = address
        self.session = time.time_ns()
        self.sequence = 0
        self._outlet = outlet

    def publish(self, message: Message) -> None:
        """Number, seal and send a message; its number is spent even where sending fails.

        Parameters
        ----------
        message : Message
            Of any kind; its header's session, sequence and checksum are written here.

        Raises
        ------
        PublishError
            If the transport refuses it.
        """
        data = message.seal(self.session, self.sequence)
        self.sequence += 1
        self._outlet.send(data)

    def close(self) -> None:
        """Give the address back; closing twice is once."""
        self._outlet.close()

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
