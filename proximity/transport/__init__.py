"""Messages from one process to another, by addresses: ``shm://proximity``, ``udp://127.0.0.1:9100``, ….

A transport moves bytes (`link`), independently of their contents: `Publisher` numbers and checksums them,
`Subscriber` and `MessageReader` verify and age them. Received data are never executed.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from proximity.message.description import Description
from proximity.transport.address import parse
from proximity.transport.contact_age import forget, widen
from proximity.transport.link import TRANSPORTS, Inlet, Outlet
from proximity.transport.message_reader import Counts, MessageReader
from proximity.transport.publisher import Publisher
from proximity.transport.subscriber import Reading, Subscriber

__all__ = [
    "Counts",
    "Description",
    "Inlet",
    "MessageReader",
    "Outlet",
    "Publisher",
    "Reading",
    "Subscriber",
    "forget",
    "open_inlet",
    "open_outlet",
    "open_publisher",
    "open_subscriber",
    "widen",
]


def open_publisher(address: str) -> Publisher:
    """Open an address for publishing.

    Parameters
    ----------
    address : str
        ``mailbox:NAME`` inside this process, ``shm://NAME`` on this machine (Linux), ``udp://HOST:PORT`` to
        any listener there (``?bind=ADDRESS``: address to send from, default loopback; ``?key=FILE``: append
        tags of that key), ``ws://127.0.0.1:PORT`` to web pages that connect there (``?origin=https://HOST``:
        also pages of that site), ``zenoh://KEY`` across machines.

    Returns
    -------
    Publisher
        To be closed, or to be used in a ``with`` block.

    Raises
    ------
    PublishError
        If the address is invalid, in use, or cannot be opened; the message has the expected form.
    """
    return Publisher(open_outlet(address), address)


def open_subscriber(address: str, **settings: Any) -> Subscriber:
    """Open an address to receive frames from.

    Parameters
    ----------
    address : str
        As for `open_publisher`, except ``ws://``, which only web pages read. ``udp://HOST:PORT`` is the
        address to listen on (``?from=HOST``: accept that sender, default this machine; ``?key=FILE``: accept
        only what that key verifies).
    settings
        ``stale_after`` (s after a frame's ``valid_until`` until it is STALE, 0.08), ``max_speed`` (m/s, 3)
        and ``max_acceleration`` (m/s², 120) of a finger, by which bounds widen.

    Returns
    -------
    Subscriber
        To be closed, or to be used in a ``with`` block. It is not an error if there is no publisher yet.

    Raises
    ------
    PublishError
        If the address is invalid, in use, or cannot be opened.
    ArgumentError
        If a setting is not a number of 0 or more.
    """
    parsed = parse(address)
    if parsed.scheme == "ws":
        raise parsed.refuse("is for web pages, which connect there; read shm:// or udp:// instead")
    inlet = open_inlet(address)
    try:
        return Subscriber(inlet, address, **settings)
    except Exception:
        inlet.close()
        raise


def open_outlet(address: str) -> Outlet:
    """Open the plain sending end of an address; see `open_publisher`."""
    return _open(address, "open_outlet")


def open_inlet(address: str) -> Inlet:
    """Open the plain receiving end of an address; see `open_subscriber`."""
    return _open(address, "open_inlet")


def _open(text: str, end: str) -> Any:
    address = parse(text)
    transport = TRANSPORTS.get(address.scheme)
    if transport is None:
        raise address.refuse(f"no transport is called {address.scheme!r} (expected {', '.join(TRANSPORTS)})")
    try:
        opener: Callable[..., Any] = getattr(import_module(transport.module), end)
    except ModuleNotFoundError as missing:
        raise address.refuse(f"needs {missing.name}: {transport.is_installed_by}") from missing
    return opener(address)
