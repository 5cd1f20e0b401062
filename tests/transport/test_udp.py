"""Datagrams: accepted senders, source addresses, and errors on the way."""

import re
import socket
import time

import numpy as np
import pytest
from ports import free_port

from proximity.errors import PublishError
from proximity.message import Defect
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber, udp
from proximity.transport.link import NOTHING

PATIENCE = 20.0  # s, for a loaded machine


def has_ipv6():
    try:
        free_port("::1")
    except OSError:
        return False
    return True


needs_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")


@pytest.fixture
def opened():
    """Open ends of an address; close them after the test."""
    ends = []

    def open_with(opener, address):
        ends.append(opener(address))
        return ends[-1]

    yield open_with
    for end in ends:
        end.close()


@pytest.fixture
def port():
    return free_port()


def array(data):
    return np.frombuffer(data, np.uint8)


def take(inlet, size=100):
    """Return size and bytes of the next message, or None."""
    room = np.zeros(size, np.uint8)
    deadline = time.monotonic() + PATIENCE
    while (taken := inlet.receive(room)) == NOTHING:
        if not inlet.wait(deadline - time.monotonic()):
            return None
    return taken, room[:taken].tobytes()


def datagram(data, port, source="127.0.0.1", source_port=0, count=1):
    """Send bytes to a port of this machine, *count* times."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, source_port))
        for _ in range(count):
            sender.sendto(data, ("127.0.0.1", port))


@pytest.mark.parametrize("host", ["localhost", pytest.param("[::1]", marks=needs_ipv6)])
def test_host_may_be_a_name_or_of_ipv6(host, opened):
    address = f"udp://{host}:{free_port(host.strip('[]'))}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    outlet.send(array(b"one"))

    assert take(inlet) == (3, b"one") and inlet.shares_clock


@needs_ipv6
def test_who_listens_to_ipv6_leaves_ipv4_to_others(opened):
    port = free_port("::")
    opened(open_inlet, f"udp://[::]:{port}?from=[::1]")
    opened(open_inlet, f"udp://127.0.0.1:{port}")


PLACE = r"expected HOST:PORT, the port a number from 1 to 65535"
BOTH, SENDER, READER = (open_publisher, open_subscriber), (open_publisher,), (open_subscriber,)


@pytest.mark.parametrize(
    ("openers", "address", "message"),
    [
        (BOTH, "127.0.0.1", rf"'127.0.0.1' \({PLACE}\)"),
        (BOTH, "127.0.0.1:65536", PLACE),
        (BOTH, "127.0.0.1:٣", PLACE),
        (BOTH, ":9100", PLACE),
        (BOTH, "::1:9100", r"'::1:9100' is of IPv6 and has no brackets \(expected \[::1:9100\]\)"),
        (BOTH, f"{'a' * 300}.invalid:9100", r"there is no 'a+.invalid' \("),
        (SENDER, "127.0.0.1:9100?from=127.0.0.1", r"unknown option 'from' \(expected bind, key\)$"),
        (READER, "127.0.0.1:9100?bind=127.0.0.1", r"unknown option 'bind' \(expected from, key\)$"),
        (READER, "0.0.0.0:9100", r"0.0.0.0 can be reached by others \(expected \?from=HOST"),
        (SENDER, "192.0.2.7:9100", r"192.0.2.7 is not on this machine.* \(expected \?bind=ADDRESS"),
        (SENDER, "192.0.2.7:9100?bind=127.0.0.1", r"cannot send there from 127.0.0.1 \("),
        (SENDER, "127.0.0.1:9100?bind=192.0.2.7", r"cannot use 192.0.2.7, port 0 \("),
        (SENDER, "127.0.0.1:9100?bind=::1", r"'::1' is of IPv6 and has no brackets"),
        (SENDER, "127.0.0.1:9100?bind=[::1]", r"there is no '::1' as IPv4 \("),
        (SENDER, "127.0.0.1:9100?bind=127.0.0.1:0", r"'127.0.0.1:0' \(expected HOST or HOST:PORT"),
    ],
)
def test_place_that_cannot_be_used_is_refused(openers, address, message):
    for opener in openers:
        with pytest.raises(PublishError, match=rf"^udp://{re.escape(address)}: .*{message}"):
            opener(f"udp://{address}")


def test_name_that_nobody_has_is_told(monkeypatch):
    def look_up(*_):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with pytest.raises(PublishError, match=r"^udp://nobody:9100: there is no 'nobody' \(Name or service"):
        open_publisher("udp://nobody:9100")


def test_port_in_use_is_refused_even_with_who_would_share_it(opened, port):
    opened(open_subscriber, f"udp://127.0.0.1:{port}")
    with pytest.raises(PublishError, match=rf"^udp://localhost:{port}: port {port} of 127.0.0.1 is in use"):
        open_subscriber(f"udp://localhost:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", 0))
        with pytest.raises(PublishError, match="in use"):
            open_inlet(f"udp://127.0.0.1:{other.getsockname()[1]}")


def test_sender_is_bound_where_it_was_told(opened, port):
    inlet = opened(open_inlet, f"udp://0.0.0.0:{port}?from=127.0.0.1")
    source_port = free_port()
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}?bind=0.0.0.0:{source_port}")
    outlet.send(array(b"here"))

    assert outlet._socket.getsockname()[1] == source_port
    assert take(inlet) == (4, b"here")


def test_strangers_are_left_out_and_counted(opened, port):
    source_port = free_port()
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}?from=127.0.0.1:{source_port}")
    datagram(b"a stranger", port, "127.0.0.2", source_port)
    datagram(b"another program", port)
    datagram(b"the one", port, source_port=source_port)

    assert take(inlet) == (7, b"the one")
    assert inlet.refused == 2


def test_flood_of_strangers_leaves_the_reader_its_time(opened, port):
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}?from=127.0.0.1")
    datagram(b"me", port, "127.0.0.2", count=udp.MAX_STRANGERS + 1)
    datagram(b"friend", port)
    assert inlet.wait(PATIENCE)

    assert inlet.receive(np.zeros(100, np.uint8)) == NOTHING
    assert inlet.refused == udp.MAX_STRANGERS
    assert take(inlet) == (6, b"friend")


@pytest.mark.parametrize(
    ("place", "source", "shares_clock"),
    [("127.0.0.1", "127.0.0.1", True), ("127.0.0.1", "192.0.2.7", False), ("0.0.0.0", "127.0.0.1", False)],
)
def test_sender_elsewhere_has_a_clock_of_its_own(opened, port, place, source, shares_clock):
    assert opened(open_inlet, f"udp://{place}:{port}?from={source}").shares_clock is shares_clock


def test_largest_datagram_travels_and_a_larger_message_is_refused(opened, port):
    address = f"udp://127.0.0.1:{port}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    data = np.arange(udp.MAX_DATAGRAM_BYTES, dtype=np.uint32).astype(np.uint8)
    outlet.send(data)

    assert take(inlet, 100_000) == (udp.MAX_DATAGRAM_BYTES, data.tobytes())
    with pytest.raises(PublishError, match=rf"^{address}: .* 65508 bytes .*\(expected at most 65507 bytes\)"):
        outlet.send(np.zeros(udp.MAX_DATAGRAM_BYTES + 1, np.uint8))


@pytest.mark.parametrize("tells_size", [True, False])
def test_what_does_not_fit_into_the_room_is_seen_to_be_too_large(opened, port, tells_size, monkeypatch):
    """Also where the system does not report the size: there a full buffer counts as too small."""
    if not tells_size:
        monkeypatch.setattr(udp, "_RETURNS_SIZE", 0)
    address = f"udp://127.0.0.1:{port}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    for size in (7, 9, 5000):
        outlet.send(np.arange(size).astype(np.uint8))
    sizes = [take(inlet, 8)[0] for _ in range(3)]

    assert sizes[0] == 7 and all(size > 8 for size in sizes[1:])


def test_empty_datagram_is_a_message_of_no_bytes(opened, port):
    subscriber = opened(open_subscriber, f"udp://127.0.0.1:{port}")
    datagram(b"", port)
    deadline = time.monotonic() + PATIENCE
    while not subscriber.counts.flawed and time.monotonic() < deadline:
        subscriber.wait(0.01)

    assert subscriber.counts.flawed == {Defect.SHORT: 1}


class Failing:
    """A socket whose sends fail with given errors."""

    def __init__(self, names):
        self.failures = [name and getattr(udp.errno, name) for name in names]
        self.sent = 0

    def send(self, data):
        if self.failures and (number := self.failures.pop(0)):
            raise OSError(number, "told so")
        self.sent += 1

    def close(self):
        pass


REFUSED = "ECONNREFUSED"


@pytest.mark.parametrize(
    ("failures", "sends", "sent", "lost"),
    [
        (["ENOBUFS"], 2, 1, 1),  # no buffer space: lost and counted
        ([REFUSED, "", REFUSED, REFUSED, ""], 3, 2, 0),  # sent again when the error belongs to an earlier one
        (["ENETUNREACH"], 1, None, 0),
        ([REFUSED, "EPERM"], 1, None, 0),
    ],
)
def test_send_that_fails_is_lost_or_tried_again_or_an_error(opened, port, failures, sends, sent, lost):
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}")
    outlet._socket.close()
    outlet._socket = Failing(failures)
    if sent is None:
        with pytest.raises(PublishError, match=rf"^udp://127.0.0.1:{port}: cannot send \(told so\)$"):
            outlet.send(array(b"data"))
    else:
        for _ in range(sends):
            outlet.send(array(b"data"))
    assert (outlet._socket.sent, outlet.lost) == (sent or 0, lost)


def test_waiting_works_where_there_is_no_poll(opened, port, monkeypatch):
    monkeypatch.delattr(udp.select, "poll")
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}")
    assert not inlet.wait(0.0)
    datagram(b"now", port)

    assert inlet.wait(PATIENCE)
