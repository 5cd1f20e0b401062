"""The contract of all transports, tested over mailbox, UDP, shared memory and Zenoh."""

import gc
import os
import socket
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from far_end import PATIENCE, FarEnd, new_name, touch, until, until_valid
from far_end import frame as untracked_frame
from growing import traced_growth
from ports import free_port
from wire import frame

import proximity
from proximity.errors import PublishError
from proximity.message import State
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

SCHEMES = ("mailbox", "udp", "shm", "zenoh")
LIBRARIES = {"zenoh": "zenoh"}
WHOLE_SKIN = 96 + 4096 * 328
"""Size in bytes of the largest frame."""

all_schemes = pytest.mark.parametrize("scheme", SCHEMES)
between_processes = pytest.mark.parametrize("scheme", SCHEMES[1:])


@pytest.fixture
def ends(scheme, request):
    """Addresses of the sending and the receiving end."""
    if scheme == "shm" and sys.platform != "linux":
        pytest.skip("mailboxes in shared memory are for Linux")
    if scheme in LIBRARIES:
        pytest.importorskip(LIBRARIES[scheme], reason=f"there is no {LIBRARIES[scheme]} here")
    if scheme == "udp":
        return (f"udp://127.0.0.1:{free_port()}",) * 2
    if scheme == "shm":
        request.addfinalizer(
            lambda: [left.unlink() for left in Path("/dev/shm").glob(f"proximity.test-{os.getpid()}-*")]
        )
    if scheme == "zenoh":
        key, place = f"zenoh://{new_name()}", f"tcp/127.0.0.1:{free_port(kind=socket.SOCK_STREAM)}"
        return f"{key}?listen={place}", f"{key}?connect={place}"
    return (f"{scheme}:{'//' * (scheme == 'shm')}{new_name()}",) * 2


class Link:
    """Two connected ends without waiting messages."""

    def __init__(self, ends, size=WHOLE_SKIN):
        self.inlet, self.outlet = open_inlet(ends[1]), open_outlet(ends[0])
        self.room = np.zeros(size, np.uint8)
        if ends[0].startswith("zenoh"):
            until(lambda: self.arrives(0, 0.05))
            while self.inlet.wait(0.2):
                self.inlet.receive(self.room)

    def send(self, number, size=100):
        self.outlet.send(np.full(size, number, np.uint8))

    def arrives(self, number, seconds=PATIENCE, size=100):
        self.send(number, size)
        return self.inlet.wait(seconds)

    def taken(self):
        """Return first byte and size of each waiting message; check that each is whole."""
        found = []
        while (size := self.inlet.receive(self.room)) != NOTHING:
            assert (self.room[:size] == self.room[0]).all()
            found.append((int(self.room[0]), size))
        return found

    def close(self):
        self.outlet.close()
        self.inlet.close()


@pytest.fixture
def link(ends):
    opened = Link(ends)
    yield opened
    opened.close()


@all_schemes
def test_messages_arrive_whole_and_in_order_by_whichever_thread(link):
    """Of any size; the sender may change its buffer immediately."""
    assert link.inlet.receive(link.room) == NOTHING
    sizes, found = [1, 1736, 8192, 8193, 60_000, 1736, 1], []

    def send_all():
        for number, size in enumerate(sizes):
            data = np.full(size, number, np.uint8)
            link.outlet.send(data)
            data[:] = 99
            assert link.inlet.wait(PATIENCE)
            found.extend(link.taken())

    thread = threading.Thread(target=send_all)
    thread.start()
    thread.join()
    assert found == list(enumerate(sizes))
    assert link.inlet.refused == 0 and not link.inlet.is_keyed


@pytest.mark.parametrize("scheme", ["mailbox", "shm", "zenoh"])
def test_whole_skin_arrives(link):
    until(lambda: link.arrives(7, 0.5, WHOLE_SKIN))  # a loaded machine may make Zenoh drop it
    assert link.taken()[0] == (7, WHOLE_SKIN)


@all_schemes
def test_of_a_message_longer_than_the_room_the_beginning_is_taken(link):
    link.outlet.send(np.arange(200, dtype=np.uint8))
    assert link.inlet.wait(PATIENCE)
    assert link.inlet.receive(link.room[:10]) == 200
    assert link.room[:11].tolist() == [*range(10), 0]
    assert link.inlet.receive(link.room) == NOTHING


@pytest.mark.parametrize(("scheme", "most"), [("mailbox", 1), ("udp", 200), ("shm", 200), ("zenoh", 66)])
def test_who_reads_too_seldom_gets_the_latest(link, most):
    for number in range(200):
        link.send(number)
        time.sleep(0.001)
    time.sleep(0.2)
    numbers = [number for number, _ in link.taken()]

    assert numbers == sorted(set(numbers)) and numbers[-1] == 199
    assert len(numbers) == most or (most == 66 and len(numbers) < most)


@pytest.mark.parametrize(
    ("scheme", "at_once", "with_the_next"),
    [
        ("mailbox", [2], [3]),
        ("udp", [], [3]),
        ("shm", [2], [3]),
        ("zenoh", [], [3]),
    ],
)
def test_who_comes_late_gets_the_latest_or_the_next(ends, at_once, with_the_next):
    """Sending without a receiver is not an error."""
    outlet = open_outlet(ends[0])
    for number in range(3):
        outlet.send(np.full(100, number, np.uint8))
    late = open_inlet(ends[1])
    found, room = [], np.zeros(100, np.uint8)

    def take_all():
        numbers = []
        while late.receive(room) != NOTHING:
            numbers.append(int(room[0]))
        return numbers

    found.append(take_all())
    until(lambda: outlet.send(np.full(100, 3, np.uint8)) or late.wait(0.05))
    found.append(sorted(set(take_all())))
    assert found == [at_once, with_the_next]
    outlet.close()
    late.close()


@all_schemes
def test_wait_ends_with_a_message_or_with_the_time(link):
    assert not link.inlet.wait(0.0)
    assert not link.inlet.wait(0.01)
    sender = threading.Timer(0.05, link.send, [7])
    sender.start()
    assert link.inlet.wait(PATIENCE)
    sender.join()
    assert link.taken() == [(7, 100)]


@pytest.mark.parametrize("scheme", ["mailbox", "udp", "shm"])
def test_what_was_sent_last_is_received_after_the_publisher_has_closed(link):
    assert link.arrives(1) and link.taken()
    link.send(3)
    link.outlet.close()

    assert link.taken() == [(3, 100)]


@pytest.mark.parametrize("scheme", ["mailbox", "udp", "shm"])
def test_nothing_grows(link):
    def to_and_fro(count):
        for _ in range(count):
            for size in (416, 1736):
                link.send(1, size)
                assert link.inlet.wait(PATIENCE) and link.inlet.receive(link.room) == size

    to_and_fro(10)
    gc.disable()  # as in the loop of a service
    try:
        assert traced_growth(lambda: to_and_fro(1000)) < 2000
    finally:
        gc.enable()


CLOSED = {
    "mailbox": (None, None),
    "udp": (r": cannot send \(", r": cannot receive \("),
    "shm": ("is closed, it cannot send", None),
    "zenoh": ("is closed, it cannot send", None),
}


@pytest.mark.parametrize(("scheme", "sent", "received"), [(name, *each) for name, each in CLOSED.items()])
def test_closing_twice_is_once_and_nothing_is_sent_or_received_after(link, sent, received):
    for end in (link.outlet, link.inlet, link.outlet, link.inlet):
        end.close()

    if sent is not None:
        with pytest.raises(PublishError, match=sent):
            link.send(1)
    if received is None:
        assert link.inlet.receive(link.room) in (NOTHING, 100) and not link.inlet.wait(0.0)
        return
    for receive in (lambda: link.inlet.receive(link.room), lambda: link.inlet.wait(0.0)):
        with pytest.raises(PublishError, match=received):
            receive()


@all_schemes
def test_name_is_free_after_close(scheme, ends):
    for number in range(2 if scheme == "zenoh" else 40):
        opened = Link(ends)
        until(lambda opened=opened, number=number: opened.arrives(number, 0.1))
        assert opened.taken()[-1] == (number, 100)
        opened.close()


@pytest.mark.parametrize(
    ("address", "known"),
    [
        ("mailbox:a?from=b", "it has none"),
        ("shm://a?from=b", "it has none"),
        ("udp://127.0.0.1:9100?x=b", "expected (bind|from), key"),
        ("zenoh://a?from=b", "expected connect, listen, config"),
    ],
)
def test_option_that_a_transport_has_not_is_refused(address, known):
    pytest.importorskip(LIBRARIES.get(address.partition(":")[0], "numpy"))
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match=rf"unknown option '\w+' \({known}\)$"):
            opener(address)


def test_without_its_library_the_error_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "proximity.transport.zenoh", raising=False)
    monkeypatch.setitem(sys.modules, "zenoh", None)

    with pytest.raises(
        PublishError, match=r'zenoh://proximity: needs zenoh: pip install "cad-proximity\[zenoh\]"'
    ):
        open_publisher("zenoh://proximity")


@pytest.mark.parametrize("scheme", ["mailbox", "udp", "shm"])
def test_frames_travel_by_public_names(ends):
    with proximity.open_subscriber(ends[1]) as subscriber, proximity.open_publisher(ends[0]) as publisher:
        publisher.publish(frame(time.monotonic_ns(), 2, valid_for=10**10))
        reading = subscriber.wait(PATIENCE)

        assert reading.state is proximity.State.OK and reading.is_new and reading.is_valid
        assert len(reading.contacts) == 2 and reading.header["sequence"] == 0
        assert str(subscriber.counts) == "1 received, 0 lost"
        assert not subscriber.read().is_new


def follows(subscriber, number):
    """Test whether a new frame has this sequence number or a later one."""
    return subscriber.wait(0.1).is_new and int(subscriber.read().header["sequence"]) >= number


@all_schemes
def test_slow_subscriber_counts_what_it_lost(ends):
    message = frame(time.monotonic_ns(), count=100, valid_for=10**10)
    with open_subscriber(ends[1]) as subscriber, open_publisher(ends[0]) as publisher:
        until(lambda: publisher.publish(message) or subscriber.wait(0.1).is_new)
        first = int(subscriber.read().header["sequence"]) - subscriber.counts.received + 1
        for _ in range(400):
            publisher.publish(message)
        until(lambda: not subscriber.read().is_new)
        until(lambda: publisher.publish(message) or follows(subscriber, 401))  # some may still be under way
        last, counts = int(subscriber.read().header["sequence"]), subscriber.counts

        assert last >= 401 and counts.lost > 0
        assert counts.received + counts.lost == last - first + 1


@between_processes
def test_subscriber_ages_when_the_publisher_is_killed_and_takes_to_the_next(ends):
    """Immediately, though the name was not released."""
    with open_subscriber(ends[1], stale_after=0.5) as subscriber:
        with FarEnd("publish", ends[0], 3) as first:
            until_valid(subscriber)
            assert len(subscriber.read().contacts) == 3
            first.kill()
        states = set()
        until(lambda: states.add(subscriber.read().state) or State.STALE in states)
        assert State.LATE in states
        session = int(subscriber.read().header["session"])
        with FarEnd("publish", ends[0]) as second:
            assert second.said == "ready"
            until_valid(subscriber)
        assert int(subscriber.read().header["session"]) > session
        assert subscriber.counts.sessions == 2 and not subscriber.counts.flawed


READERS = [("udp", 1, 2), ("shm", 9, 2), ("zenoh", 1, 2)]
"""Number of subscribers per process, and number of processes killed one after the other."""


@pytest.mark.parametrize(("scheme", "count", "rounds"), READERS)
def test_killed_subscribers_keep_neither_the_publisher_nor_their_places(ends, count, rounds):
    with open_publisher(ends[0]) as publisher:
        for role in ("hold", "subscribe", "hold", "subscribe", "hold")[:rounds]:
            with FarEnd(role, ends[1], count) as reader:
                assert reader.said == "ready"
                for _ in range(100):
                    publisher.publish(touch(untracked_frame()))
                reader.kill()
                publisher.publish(touch(untracked_frame()))
        with open_subscriber(ends[1]) as subscriber:
            until(lambda: publisher.publish(touch(untracked_frame())) or subscriber.wait(0.1).is_new)


@pytest.mark.parametrize(("scheme", "count"), [("udp", 1), ("shm", 16), ("zenoh", 2)])
def test_program_that_forgets_to_close_ends_without_a_word(ends, count):
    with open_publisher(ends[0]) as publisher, FarEnd("hold", ends[1], count) as program:
        for _ in range(50):
            publisher.publish(touch(untracked_frame()))
        assert program.ended(let_go=True) == (0, "", "")
    for inlet in [open_inlet(ends[1]) for _ in range(count)]:
        inlet.close()


@pytest.fixture
def box(monkeypatch):
    """A publisher and a subscriber in one process, and a calendar clock that does not advance."""
    address, calendar = f"mailbox:{os.getpid()}/{time.time_ns()}", SimpleNamespace(now=time.time_ns())
    monkeypatch.setattr("time.time_ns", lambda: calendar.now)
    return open_publisher(address), open_subscriber(address), calendar


def test_numbers_are_counted_for_each_kind(box):
    """A receiver of one of two kinds that share an address sees no gaps."""
    publisher, inlet, room = box[0], open_inlet(box[0].address), np.zeros(5000, np.uint8)
    numbers = []
    for kind in (proximity.message.FRAME, *[proximity.message.POSES] * 2, proximity.message.FRAME):
        publisher.publish(proximity.message.Message(kind, 1))
        inlet.receive(room)
        numbers.append(int(room[24:32].view("<u8")[0]))

    assert numbers == [0, 0, 1, 1] and publisher.sequence == 4


def test_sessions_rise_even_where_the_clock_stands_still(box):
    sessions = [open_publisher(box[0].address).session for _ in range(3)]

    assert sessions == sorted(set(sessions))


def test_publisher_whose_machine_slept_begins_another_run(box):
    """Its monotonic clock was suspended; setting back or slewing the calendar clock starts no run."""
    publisher, subscriber, calendar = box
    headers = []
    for gained in (0, -5_000_000_000, 900_000_000, 3_600_000_000_000, 0):
        calendar.now += gained
        publisher.publish(frame(time.monotonic_ns(), 2))
        header = subscriber.read().header
        headers.append((int(header["session"]), int(header["sequence"])))

    assert [number for _, number in headers] == [0, 1, 2, 0, 1]
    assert headers == sorted(headers)
    assert (subscriber.counts.sessions, subscriber.counts.lost) == (2, 0)


def test_threads_see_whole_messages():
    link = Link((f"mailbox:{new_name()}",) * 2, 100)

    def write():
        for number in range(1000):
            link.send(number % 50, 50 + number % 50)

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    seen = []
    while any(writer.is_alive() for writer in writers):
        seen += link.taken()
    assert seen + link.taken()
    assert all(size == 50 + number for number, size in seen)


def test_box_that_nobody_has_is_gone():
    address = f"mailbox:{new_name()}"
    open_outlet(address).send(np.zeros(9, np.uint8))

    assert open_inlet(address).receive(np.zeros(9, np.uint8)) == NOTHING
