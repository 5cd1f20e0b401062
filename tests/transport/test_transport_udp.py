"""Datagrams: what is sent, from whom it is taken, and what happens when nobody is there."""

import socket
import threading
import time

import numpy as np
import pytest
from ports import free_port
from wire import frame

from proximity.errors import PublishError
from proximity.message import Flaw
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber, udp
from proximity.transport.link import NOTHING

PATIENCE = 20.0  # s, for a machine that is busy with something else


def has_ipv6():
    try:
        free_port("::1")
    except OSError:
        return False
    return True


@pytest.fixture
def opened():
    """Open ends of an address, and close them in the end."""
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
    """What arrives next, as bytes; None: nothing did."""
    room = np.zeros(size, np.uint8)
    deadline = time.monotonic() + PATIENCE
    while (taken := inlet.receive(room)) == NOTHING:
        if not inlet.wait(deadline - time.monotonic()):
            return None
    return taken, room[:taken].tobytes()


def datagram(data, port, source="127.0.0.1", source_port=0):
    """Send bytes to a port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, source_port))
        sender.sendto(data, ("127.0.0.1", port))


@pytest.mark.parametrize("host", ["localhost", "[::1]"])
def test_messages_arrive_in_their_order(host, opened):
    if host == "[::1]" and not has_ipv6():
        pytest.skip("this machine has no IPv6")
    address = f"udp://{host}:{free_port(host.strip('[]'))}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    assert inlet.receive(np.zeros(10, np.uint8)) == NOTHING
    for data in (b"one", b"two", b"three"):
        outlet.send(array(data))

    assert [take(inlet) for _ in range(3)] == [(3, b"one"), (3, b"two"), (5, b"three")]
    assert inlet.refused == 0 and inlet.shares_clock


def test_frames_travel_by_public_names(opened, port):
    address = f"udp://127.0.0.1:{port}"
    subscriber, publisher = opened(open_subscriber, address), opened(open_publisher, address)
    message = frame(time.monotonic_ns(), valid_for=10**10)
    publisher.publish(message)
    reading = subscriber.wait(PATIENCE)

    assert reading.is_new and reading.header["sequence"] == 0
    assert str(subscriber.counts) == "1 received, 0 lost"
    assert not subscriber.read().is_new


def test_nobody_listening_is_no_error_and_who_comes_is_heard(opened, port):
    address = f"udp://127.0.0.1:{port}"
    outlet = opened(open_outlet, address)
    for _ in range(20):
        outlet.send(array(b"to nobody"))
    inlet = opened(open_inlet, address)
    outlet.send(array(b"to somebody"))  # not lost for what the system tells of the one before

    assert take(inlet) == (11, b"to somebody")
    assert outlet.lost == 0


def test_port_in_use_is_told_in_a_sentence(opened, port):
    opened(open_subscriber, f"udp://127.0.0.1:{port}")

    with pytest.raises(
        PublishError,
        match=rf"^udp://localhost:{port}: port {port} of 127.0.0.1 is in use by another program$",
    ):
        open_subscriber(f"udp://localhost:{port}")


def test_port_cannot_be_shared_even_with_who_would(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", port))
        with pytest.raises(PublishError, match="in use"):
            open_inlet(f"udp://127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("127.0.0.1", r"'127.0.0.1' \(expected HOST:PORT, the port a number from 1 to 65535\)"),
        ("127.0.0.1:65536", r"expected HOST:PORT"),
        ("127.0.0.1:٣", r"expected HOST:PORT"),
        (":9100", r"expected HOST:PORT"),
        ("::1:9100", r"'::1:9100' is of IPv6 and has no brackets \(expected \[::1:9100\]\)"),
        (f"{'a' * 300}.invalid:9100", r"there is no 'a+.invalid' \("),
    ],
)
@pytest.mark.parametrize("opener", [open_publisher, open_subscriber])
def test_place_that_is_none_is_told_what_was_expected(opener, place, message):
    with pytest.raises(PublishError, match=message):
        opener(f"udp://{place}")


def test_name_that_nobody_has_is_told(monkeypatch):
    def look_up(*_):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with pytest.raises(
        PublishError, match=r"^udp://nobody:9100: there is no 'nobody' \(Name or service not known\)$"
    ):
        open_publisher("udp://nobody:9100")


@pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")
def test_who_listens_to_ipv6_leaves_ipv4_to_others(opened):
    port = free_port("::")
    opened(open_inlet, f"udp://[::]:{port}?from=[::1]")

    opened(open_inlet, f"udp://127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("opener", "option", "known"),
    [(open_publisher, "from", "bind, key"), (open_subscriber, "bind", "from, key")],
)
def test_option_of_the_other_end_is_refused(opener, option, known, port):
    with pytest.raises(PublishError, match=rf"there is no option '{option}' \(expected {known}\)$"):
        opener(f"udp://127.0.0.1:{port}?{option}=127.0.0.1")


# --- whom to listen to, and where to send from ---


def test_who_listens_for_others_must_say_to_whom(port):
    with pytest.raises(
        PublishError, match=r": 0.0.0.0 can be reached by others \(expected \?from=HOST, that of the one to "
    ):
        open_subscriber(f"udp://0.0.0.0:{port}")


def test_who_sends_to_others_must_say_from_where():
    with pytest.raises(
        PublishError,
        match=r"^udp://192.0.2.7:9100: 192.0.2.7 is not on this machine, and messages are sent from "
        r"loopback by default \(expected \?bind=ADDRESS, the address of the network card to send from, or ",
    ):
        open_publisher("udp://192.0.2.7:9100")


def test_sender_is_bound_where_it_was_told(opened, port):
    inlet = opened(open_inlet, f"udp://0.0.0.0:{port}?from=127.0.0.1")
    source_port = free_port()
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}?bind=0.0.0.0:{source_port}")
    outlet.send(array(b"here"))

    assert outlet._socket.getsockname()[1] == source_port
    assert take(inlet) == (4, b"here")


def test_place_that_cannot_be_sent_from_is_told(port):
    with pytest.raises(PublishError, match=r": cannot use 192.0.2.7, port 0 \("):
        open_publisher(f"udp://127.0.0.1:{port}?bind=192.0.2.7")
    with pytest.raises(PublishError, match=r": '::1' is of IPv6 and has no brackets"):
        open_publisher(f"udp://127.0.0.1:{port}?bind=::1")
    with pytest.raises(PublishError, match=r": there is no '::1' as IPv4 \("):
        open_publisher(f"udp://127.0.0.1:{port}?bind=[::1]")
    with pytest.raises(PublishError, match=r"'127.0.0.1:0' \(expected HOST or HOST:PORT, the port"):
        open_publisher(f"udp://127.0.0.1:{port}?bind=127.0.0.1:0")


def test_place_that_cannot_be_reached_from_there_is_told():
    with pytest.raises(PublishError, match=r": cannot send there from 127.0.0.1 \("):
        open_publisher("udp://192.0.2.7:9100?bind=127.0.0.1")


def test_strangers_are_left_out_and_counted(opened, port):
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}?from=127.0.0.1")
    datagram(b"a stranger", port, source="127.0.0.2")
    datagram(b"a friend", port)

    assert take(inlet) == (8, b"a friend")
    assert inlet.refused == 1


def test_port_of_the_sender_may_be_told(opened, port):
    source_port = free_port()
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}?from=127.0.0.1:{source_port}")
    datagram(b"another program", port)
    datagram(b"the one", port, source_port=source_port)

    assert take(inlet) == (7, b"the one")
    assert inlet.refused == 1


def test_sender_elsewhere_has_a_clock_of_its_own(opened):
    for place, source, shares_clock in [
        ("127.0.0.1", "127.0.0.1", True),
        ("127.0.0.1", "192.0.2.7", False),
        ("0.0.0.0", "127.0.0.1", False),
    ]:
        inlet = opened(open_inlet, f"udp://{place}:{free_port()}?from={source}")
        assert inlet.shares_clock is shares_clock


def test_flood_of_strangers_leaves_the_reader_its_time(opened, port):
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}?from=127.0.0.1")
    room = np.zeros(100, np.uint8)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.2", 0))
        for _ in range(udp.MOST_STRANGERS + 1):
            stranger.sendto(b"me", ("127.0.0.1", port))
    datagram(b"friend", port)
    assert inlet.wait(PATIENCE)

    assert inlet.receive(room) == NOTHING
    assert inlet.refused == udp.MOST_STRANGERS
    assert take(inlet) == (6, b"friend")


# --- sizes ---


def test_largest_datagram_travels_and_a_larger_message_is_refused(opened, port):
    address = f"udp://127.0.0.1:{port}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    data = np.arange(udp.MOST_DATAGRAM_BYTES, dtype=np.uint32).astype(np.uint8)
    outlet.send(data)

    assert take(inlet, 100_000) == (udp.MOST_DATAGRAM_BYTES, data.tobytes())
    with pytest.raises(
        PublishError,
        match=rf"^{address}: a message of 65508 bytes does not fit into a datagram \(expected at most 65507 ",
    ):
        outlet.send(np.zeros(udp.MOST_DATAGRAM_BYTES + 1, np.uint8))


@pytest.mark.parametrize("tells_size", [True, False])
def test_what_does_not_fit_into_the_room_is_seen_to_be_too_large(opened, port, tells_size, monkeypatch):
    """Where the system does not tell the size, too: there a full room is one that was too small."""
    if not tells_size:
        monkeypatch.setattr(udp, "_RETURNS_SIZE", 0)
    address = f"udp://127.0.0.1:{port}"
    inlet, outlet = opened(open_inlet, address), opened(open_outlet, address)
    for size in (7, 9, 5000):
        outlet.send(np.arange(size).astype(np.uint8))
    sizes = [take(inlet, 8)[0] for _ in range(3)]

    assert sizes[0] == 7
    assert all(size > 8 for size in sizes[1:])


def test_empty_datagram_is_a_message_of_no_bytes(opened, port):
    subscriber = opened(open_subscriber, f"udp://127.0.0.1:{port}")
    datagram(b"", port)
    deadline = time.monotonic() + PATIENCE
    while not subscriber.counts.flawed and time.monotonic() < deadline:
        subscriber.wait(0.01)

    assert subscriber.counts.flawed == {Flaw.SHORT: 1}


# --- what else goes wrong ---


class Failing:
    """A socket whose sends fail, each in its way."""

    def __init__(self, *failures):
        self.failures = list(failures)
        self.sent = []

    def send(self, data):
        if self.failures and (number := self.failures.pop(0)):
            raise OSError(number, "told so")
        self.sent.append(bytes(data))

    def close(self):
        pass


@pytest.mark.parametrize("name", ["ENOBUFS"])
def test_datagram_without_room_is_lost_and_counted(opened, port, name):
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}")
    outlet._socket.close()
    outlet._socket = Failing(getattr(udp.errno, name))
    for data in (b"lost", b"sent"):
        outlet.send(array(data))

    assert outlet.lost == 1
    assert outlet._socket.sent == [b"sent"]


@pytest.mark.parametrize("name", ["ECONNREFUSED"])
def test_datagram_is_sent_again_when_the_system_tells_of_an_earlier_one(opened, port, name):
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}")
    outlet._socket.close()
    number = getattr(udp.errno, name)
    outlet._socket = Failing(number, 0, number, number, 0)
    for data in (b"one", b"two", b"three"):
        outlet.send(array(data))

    assert outlet._socket.sent == [b"one", b"three"]


def test_network_that_is_down_is_an_error(opened, port):
    outlet = opened(open_outlet, f"udp://127.0.0.1:{port}")
    outlet._socket.close()
    outlet._socket = Failing(udp.errno.ENETUNREACH, udp.errno.ECONNREFUSED, udp.errno.EPERM)

    for _ in range(2):
        with pytest.raises(PublishError, match=rf"^udp://127.0.0.1:{port}: cannot send \(told so\)$"):
            outlet.send(array(b"data"))


def test_closed_ends_say_so(port):
    address = f"udp://127.0.0.1:{port}"
    outlet, inlet = open_outlet(address), open_inlet(address)
    for end in (outlet, inlet):
        end.close()
        end.close()

    with pytest.raises(PublishError, match=r": cannot send \("):
        outlet.send(array(b"data"))
    with pytest.raises(PublishError, match=r": cannot receive \("):
        inlet.receive(np.zeros(10, np.uint8))
    with pytest.raises(PublishError, match=r": cannot receive \(it is closed\)$"):
        inlet.wait(0.0)


def test_waiting_ends_with_a_datagram(opened, port):
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}")
    assert not inlet.wait(0.0)
    timer = threading.Timer(0.02, datagram, [b"now", port])
    timer.start()
    try:
        assert inlet.wait(PATIENCE)
    finally:
        timer.join()


def test_waiting_works_where_there_is_no_poll(opened, port, monkeypatch):
    monkeypatch.delattr(udp.select, "poll")
    inlet = opened(open_inlet, f"udp://127.0.0.1:{port}")
    assert not inlet.wait(0.0)
    datagram(b"now", port)

    assert inlet.wait(PATIENCE)


def test_reader_slower_than_the_rate_loses_frames_and_counts_them(opened, port):
    address = f"udp://127.0.0.1:{port}"
    subscriber, publisher = opened(open_subscriber, address), opened(open_publisher, address)
    message = frame(time.monotonic_ns(), count=100, valid_for=10**10)
    for _ in range(1000):
        publisher.publish(message)
    while subscriber.read().is_new:
        pass
    publisher.publish(message)
    reading = subscriber.wait(PATIENCE)
    counts = subscriber.counts

    assert reading.header["sequence"] == 1000
    assert counts.lost > 0
    assert counts.received + counts.lost == publisher.sequence
