"""Transport ``udp://HOST:PORT``, which sends datagrams to a microcontroller or across a network.

Datagrams can be lost, but never delay their sender. For a publisher HOST:PORT is the destination. Its socket
is bound to loopback unless ``?bind=ADDRESS`` or ``?bind=ADDRESS:PORT`` is given. For a subscriber HOST:PORT
is the listening address, and ``?from=HOST`` or ``?from=HOST:PORT`` the accepted sender: by default loopback
if HOST is loopback, otherwise it is required. Datagrams of other senders are dropped and counted. Names are
resolved once, when the address is opened; of several addresses the first IPv4 one counts. IPv6 addresses are
in brackets: ``udp://[::1]:9100``.

Sending never waits. A datagram for which the system has no buffer space is lost and counted in
`UdpOutlet.lost`; a missing listener is not an error. The system buffers datagrams for a reader, the oldest
first, about 0.1 s at 1 kHz; then the newest are lost. A slow reader finds old messages first and must read
until none is left. Ethernet carries 1472 bytes in one packet: four fingers. Longer datagrams are fragmented,
and lost with any fragment.

Any program on this machine, and on the other one, can send valid messages. With ``?key=FILE`` at both ends a
tag follows each message (`key`), and datagrams without the right one are dropped and counted. It prevents
forgery, but neither eavesdropping nor flooding.
"""

import errno
import select
import socket
import sys
from ipaddress import ip_address
from typing import Any, NamedTuple

import numpy as np

from proximity.errors import PublishError
from proximity.transport.address import Address
from proximity.transport.link import NOTHING
from proximity.transport.message_key import TAG_BYTES, Key, key_of

MAX_DATAGRAM_BYTES = 65507
"""Maximum size of a datagram over IPv4."""
MAX_STRANGERS = 64
"""Maximum number of datagrams of other senders dropped in one call, so that a flood cannot block a reader."""
MAX_FORGED_BYTES = 1 << 17
"""Maximum number of unverified bytes read in one call, which takes some 0.3 ms."""
MAX_DATAGRAM = 1 << 16
"""Number of bytes that is larger than any datagram."""
BUFFER_BYTES = 1 << 19
"""Size of a reader's buffer that is requested from the system, which may provide less."""

# Errors that report a temporarily unreachable receiver, not a defect of the message.
_NOBODY = {
    getattr(errno, name)
    for name in ("ECONNREFUSED", "ECONNRESET", "EHOSTUNREACH", "EHOSTDOWN")
    if hasattr(errno, name)  # not every system has them all
}
_NO_BUFFERS = {errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOBUFS, errno.ENOMEM}
# Linux then returns the full size of a truncated datagram. Elsewhere one that fills the buffer counts as
# truncated.
_RETURNS_SIZE = getattr(socket, "MSG_TRUNC", 0) if sys.platform == "linux" else 0
_IS_CUT_OFF = 10040  # WSAEMSGSIZE, the error of Windows


class _Endpoint(NamedTuple):
    """Network address of a socket or of its peer."""

    family: int
    name: Any  # in the format of the socket module
    port: int

    @property
    def host(self) -> str:
        return str(self.name[0])

    @property
    def is_loopback(self) -> bool:
        return ip_address(self.host).is_loopback


class UdpOutlet:
    """Sends messages to HOST:PORT.

    *address*: address of the destination, whose options are ``bind``, the local address, and ``key``, the
    file of a key.
    """

    lost: int  # number of messages for which the system had no buffer space

    def __init__(self, address: Address) -> None:
        address.check_options("bind", "key")
        self.lost = 0
        self._text = address.text
        self._key = key_of(address)
        endpoint = _look_up(address, address.location, needs_port=True)
        bind = address.options.get("bind")
        if bind is None and not endpoint.is_loopback:
            raise address.refuse(
                f"{endpoint.host} is not on this machine, and messages are sent from loopback by "
                "default (expected ?bind=ADDRESS, the address of the network card to send from, or "
                "?bind=0.0.0.0 for any)"
            )
        loopback = "::1" if endpoint.family == socket.AF_INET6 else "127.0.0.1"
        source = _look_up(address, _bracketed(loopback) if bind is None else bind, family=endpoint.family)
        self._socket = _open(address, source)
        try:
            self._socket.connect(endpoint.name)
        except OSError as failure:
            self._socket.close()
            raise address.refuse(f"cannot send there from {source.host} ({_reason(failure)})") from None

    def send(self, data: np.ndarray) -> None:
        """Send a message as one datagram."""
        most = MAX_DATAGRAM_BYTES if self._key is None else MAX_DATAGRAM_BYTES - TAG_BYTES
        if len(data) > most:
            raise PublishError(
                f"{self._text}: a message of {len(data)} bytes does not fit into a datagram "
                f"(expected at most {most} bytes)"
            )
        datagram = data.data if self._key is None else data.tobytes() + self._key.tag(data)
        try:
            self._socket.send(datagram)
        except OSError as failure:
            self._failed(failure, datagram)

    def loop_end(self, largest: int) -> dict[str, Any]:
        """Return the data with which a service's loop sends messages here, of up to *largest* bytes."""
        return {"socket": self._socket.fileno(), "key": _address_of(self._key)}

    def _failed(self, failure: OSError, datagram: memoryview | bytes) -> None:
        """Handle a failure to send.

        If the error belongs to an earlier datagram, this one is sent again.
        """
        if failure.errno in _NOBODY:
            # An error here reports that an earlier datagram had no receiver; this one was not sent.
            try:
                self._socket.send(datagram)
                return
            except OSError as again:
                failure = again
        if failure.errno in _NO_BUFFERS:
            self.lost += 1
        elif failure.errno not in _NOBODY:
            raise PublishError(f"{self._text}: cannot send ({_reason(failure)})") from failure

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class UdpInlet:
    """Receives messages at HOST:PORT."""

    shares_clock: bool
    is_keyed: bool
    refused: int
    unverified: int

    def __init__(self, address: Address) -> None:
        address.check_options("from", "key")
        self.refused = self.unverified = 0
        self._text = address.text
        self._key = key_of(address)
        self.is_keyed = self._key is not None
        self._datagram = memoryview(bytearray(MAX_DATAGRAM if self.is_keyed else 0))
        endpoint = _look_up(address, address.location, needs_port=True)
        source = address.options.get("from")
        if source is not None:
            sender = _look_up(address, source, family=endpoint.family)
            self._hosts, self._port = {sender.host}, sender.port
            self.shares_clock = endpoint.is_loopback and sender.is_loopback
        elif endpoint.is_loopback:
            self._hosts, self._port = {endpoint.host, "127.0.0.1", "::1"}, 0
            self.shares_clock = True
        else:
            raise address.refuse(
                f"{endpoint.host} can be reached by others (expected ?from=HOST, the sender to listen to)"
            )
        self._socket = _open(address, endpoint)
        self._poll = select.poll() if hasattr(select, "poll") else None
        if self._poll is not None:
            self._poll.register(self._socket, select.POLLIN)

    def loop_end(self) -> dict[str, Any] | None:
        """Return the data with which a service's loop receives here, or None if it cannot."""
        hosts = [host for host in sorted(self._hosts) if ":" not in host]
        if not self.shares_clock or self._socket.family != socket.AF_INET:
            return None
        packed = [int.from_bytes(socket.inet_aton(host), sys.byteorder) for host in hosts]
        hosts_of = {"hosts": packed + [0] * (4 - len(packed)), "host_count": len(packed), "port": self._port}
        return {"socket": self._socket.fileno(), "key": _address_of(self._key), **hosts_of}

    def receive(self, buffer: np.ndarray) -> int:
        """Receive the next datagram from the accepted sender."""
        if self._key is not None:
            return self._receive_verified(buffer, self._key)
        for _ in range(MAX_STRANGERS):
            size, is_expected = self._receive_from(buffer.data)
            if is_expected or size == NOTHING:
                return size
        return NOTHING

    def _receive_verified(self, buffer: np.ndarray, key: Key) -> int:
        """Receive the next datagram that the key verifies, and remove its tag."""
        forged_bytes = 0
        for _ in range(MAX_STRANGERS):
            size, is_expected = self._receive_from(self._datagram)
            if size == NOTHING:
                return NOTHING
            if not is_expected:
                continue
            if key.verifies(self._datagram[:size]):
                size -= TAG_BYTES
                taken = min(size, len(buffer))
                buffer.data[:taken] = self._datagram[:taken]
                return size
            self.unverified += 1
            forged_bytes += size
            if forged_bytes > MAX_FORGED_BYTES:
                break
        return NOTHING

    def _receive_from(self, buffer: memoryview) -> tuple[int, bool]:
        """Receive a datagram. Return its size, or `NOTHING`, and whether it is from the accepted sender."""
        try:
            size, sender = self._socket.recvfrom_into(buffer, 0, _RETURNS_SIZE)
        except BlockingIOError:
            return NOTHING, False
        except OSError as failure:
            if getattr(failure, "winerror", None) != _IS_CUT_OFF:
                raise PublishError(f"{self._text}: cannot receive ({_reason(failure)})") from failure
            return len(buffer) + 1, True
        if sender[0] in self._hosts and (not self._port or sender[1] == self._port):
            return size if _RETURNS_SIZE or size < len(buffer) else size + 1, True
        self.refused += 1
        return size, False

    def wait(self, timeout: float) -> bool:
        """Wait for a datagram of any sender."""
        if self._socket.fileno() < 0:
            raise PublishError(f"{self._text}: cannot receive (it is closed)")
        if self._poll is not None:
            return bool(self._poll.poll(1000.0 * timeout))
        return bool(select.select([self._socket], [], [], timeout)[0])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _look_up(address: Address, text: str, *, family: int = 0, needs_port: bool = False) -> _Endpoint:
    """Resolve ``HOST:PORT`` to an endpoint. Unless *needs_port*, the port may be omitted and is 0 then."""
    host, port = _split(address, text, needs_port)
    try:
        found = socket.getaddrinfo(host, port, family, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as failure:
        other = "" if not family else f" as {'IPv6' if family == socket.AF_INET6 else 'IPv4'}"
        raise address.refuse(f"there is no {host!r}{other} ({_reason(failure)})") from None
    found = [entry for entry in found if entry[0] in (socket.AF_INET, socket.AF_INET6)]
    if not found:
        raise address.refuse(f"{host!r} is not an IPv4 or IPv6 address")
    first = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return _Endpoint(first[0], first[4], port)


def _split(address: Address, text: str, needs_port: bool) -> tuple[str, int]:
    """Split ``HOST:PORT`` into host and port."""
    if text.startswith("["):
        host, _, port = text[1:].partition("]")
    elif text.count(":") > 1:
        raise address.refuse(f"{text!r} is of IPv6 and has no brackets (expected [{text}])")
    else:
        host, colon, port = text.partition(":")
        port = colon + port
    has_port = port.startswith(":")
    port = port.removeprefix(":")
    number = int(port) if has_port and port.isascii() and port.isdigit() else 0
    if not host or not (0 < number < 65536 if has_port or needs_port else not port):
        expected = "HOST:PORT" if needs_port else "HOST or HOST:PORT"
        raise address.refuse(f"{text!r} (expected {expected}, the port a number from 1 to 65535)")
    return host, number


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _open(address: Address, endpoint: _Endpoint) -> socket.socket:
    """Open a socket bound exclusively to an endpoint."""
    opened = socket.socket(endpoint.family, socket.SOCK_DGRAM)
    try:
        # SO_REUSEADDR stays off: with it two subscribers could share a port, and one of them would starve.
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows would let another socket bind
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        if endpoint.family == socket.AF_INET6:
            opened.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        opened.setblocking(False)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        opened.bind(endpoint.name)
    except OSError as failure:
        opened.close()
        if failure.errno == errno.EADDRINUSE:
            raise address.refuse(
                f"port {endpoint.port} of {endpoint.host} is in use by another program"
            ) from None
        raise address.refuse(
            f"cannot use {endpoint.host}, port {endpoint.port} ({_reason(failure)})"
        ) from None
    return opened


def _address_of(key: Key | None) -> int:
    """Return the memory address of a key's bytes, or 0 without a key."""
    return 0 if key is None else int(key.secret.ctypes.data)


def _reason(failure: Exception) -> str:
    return str(getattr(failure, "strerror", None) or failure)


open_outlet = UdpOutlet
open_inlet = UdpInlet
