"""Shared memory between processes: what comes through, to whom comes late, is slow, or sees the other die."""

import errno
import gc
import os
import signal
import sys
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from far_end import PATIENCE, FarEnd, frame, new_name, touch, until, until_valid

from proximity.errors import PublishError
from proximity.message import State
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

iceoryx2 = pytest.importorskip("iceoryx2", reason="there is no iceoryx2 for this machine")
iceoryx_names = pytest.importorskip("proximity.transport.iceoryx_names")


@pytest.fixture
def address():
    return f"iox2://{new_name()}"


def numbered(number, size=100):
    return np.full(size, number, np.uint8)


def take_all(inlet, room_size=1_400_000):
    """First bytes and sizes of what waits."""
    room, taken = np.zeros(room_size, np.uint8), []
    while (size := inlet.receive(room)) != NOTHING:
        assert (room[:size] == room[0]).all()
        taken.append((int(room[0]), size))
    return taken


def test_messages_arrive_in_order_at_every_subscriber(address):
    with open_publisher(address) as publisher:
        subscribers = [open_subscriber(address) for _ in range(2)]
        for _ in range(50):
            publisher.publish(touch(frame()))
        for subscriber in subscribers:
            sequences = [int(data[24:32].view("<u8")[0]) for data in subscriber.frames()]
            assert sequences == list(range(50))
            assert (subscriber.counts.received, subscriber.counts.lost) == (50, 0)
            subscriber.close()


def test_frame_of_another_process_is_read_and_valid(address):
    with FarEnd("publish", address, 3), open_subscriber(address) as subscriber:
        reading = subscriber.wait(PATIENCE)
        assert reading.is_new and len(reading.contacts) == 3
        until_valid(subscriber)


def test_late_subscriber_gets_the_latest_with_the_next(address):
    outlet = open_outlet(address)
    for number in range(3):
        outlet.send(numbered(number))
    inlet = open_inlet(address)
    outlet.send(numbered(3))

    assert take_all(inlet) == [(2, 100), (3, 100)]
    inlet.close()
    outlet.close()


def test_slow_subscriber_loses_the_oldest_and_counts_them(address):
    with open_publisher(address) as publisher, open_subscriber(address) as subscriber:
        publisher.publish(touch(frame()))
        assert subscriber.read().is_new
        for _ in range(200):
            publisher.publish(touch(frame()))

        reading = subscriber.read()
        assert reading.header["sequence"] == 200
        assert subscriber.counts.received == 1 + iceoryx_names.BUFFER
        assert subscriber.counts.lost == 200 - iceoryx_names.BUFFER


def test_memory_is_enough_for_all_subscribers_at_their_own_pace(address):
    outlet = open_outlet(address)
    inlets = [open_inlet(address) for _ in range(iceoryx_names.SUBSCRIBERS)]
    room = np.zeros(200, np.uint8)
    for number in range(1500):
        outlet.send(numbered(number % 256))
        for pace, inlet in enumerate(inlets[:-1], start=1):
            if number % pace == 0:
                inlet.receive(room)

    assert [number for number, _ in take_all(inlets[-1])] == [k % 256 for k in range(1500 - 64, 1500)]
    for end in (outlet, *inlets):
        end.close()


def test_lengths_may_change_and_grow_to_a_whole_skin(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    sizes = [1, 1736, 8192, 8193, 100_000, 96 + 4096 * 328, 1736, 1]
    for number, size in enumerate(sizes):
        outlet.send(numbered(number, size))

    assert take_all(inlet) == list(enumerate(sizes))
    inlet.close()
    outlet.close()


def test_of_a_message_longer_than_the_room_the_beginning_is_taken(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    outlet.send(np.arange(200, dtype=np.uint8))
    room = np.zeros(10, np.uint8)

    assert inlet.receive(room) == 200
    assert room.tolist() == list(range(10))
    assert inlet.receive(room) == NOTHING
    inlet.close()
    outlet.close()


def test_what_was_sent_last_is_still_received_after_the_publisher_has_closed(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    outlet.send(numbered(0))
    assert len(take_all(inlet)) == 1
    for number in (1, 2, 3):
        outlet.send(numbered(number))
    outlet.close()

    assert [number for number, _ in take_all(inlet)] == [1, 2, 3]
    inlet.close()


def test_nothing_is_sent_or_received_after_close(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    outlet.send(numbered(1))
    outlet.close()
    inlet.close()

    with pytest.raises(PublishError, match="was closed, nothing can be sent"):
        outlet.send(numbered(2))
    assert inlet.receive(np.zeros(9, np.uint8)) == NOTHING
    assert not inlet.wait(0.0)


def test_subscriber_ages_when_the_publisher_is_killed_and_takes_to_the_next(address):
    with open_subscriber(address, stale_after=0.5) as subscriber:
        with FarEnd("publish", address) as first:
            until_valid(subscriber)
            first.kill()
        states = set()

        def is_stale():
            states.add(subscriber.read().state)
            return State.STALE in states

        until(is_stale)
        assert State.LATE in states
        session = int(subscriber.read().header["session"])

        with FarEnd("publish", address) as second:
            assert second.said == "ready"  # at once, though nobody gave the name back
            until_valid(subscriber)
        assert int(subscriber.read().header["session"]) > session
        assert subscriber.counts.sessions == 2
        assert not subscriber.counts.flawed


def test_wait_ends_with_a_message_or_with_the_time(address):
    outlet, inlet = open_outlet(address), open_inlet(address)

    assert not inlet.wait(0.0)
    assert not inlet.wait(0.01)
    sender = threading.Timer(0.05, outlet.send, [numbered(7)])
    sender.start()
    assert inlet.wait(PATIENCE)
    sender.join()
    assert take_all(inlet) == [(7, 100)]
    inlet.close()
    outlet.close()


def test_ends_may_be_used_by_other_threads_than_the_one_that_opened_them(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    sender = threading.Thread(target=lambda: [outlet.send(numbered(k)) for k in range(40)])
    sender.start()
    sender.join()
    taken = []
    reader = threading.Thread(target=lambda: taken.extend(take_all(inlet)))
    reader.start()
    reader.join()

    assert [number for number, _ in taken] == list(range(40))
    closer = threading.Thread(target=lambda: (outlet.close(), inlet.close()))
    closer.start()
    closer.join()


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_signals_are_left_to_python(address):
    with FarEnd("interrupted", address, 1) as program:
        program.signal(signal.SIGINT)
        assert program.ended() == (0, "interrupted\n", "")
    with FarEnd("publish", address) as program:
        program.signal(signal.SIGTERM)
        assert program.ended() == (-signal.SIGTERM, "", "")


def test_nothing_grows(address):
    outlet, inlet, room = open_outlet(address), open_inlet(address), np.zeros(2000, np.uint8)
    short, long = numbered(1, 416), numbered(2, 1736)

    def to_and_fro(count):
        for _ in range(count):
            outlet.send(short)
            outlet.send(long)
            assert inlet.receive(room) == 416
            assert inlet.receive(room) == 1736

    to_and_fro(10)
    gc.disable()  # as in the loop of a service
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        to_and_fro(2000)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
        gc.enable()

    assert grown < 2000
    inlet.close()
    outlet.close()


@pytest.mark.skipif(sys.platform != "linux", reason="where shared memory is elsewhere is not known")
def test_memory_of_messages_is_there_before_the_first_one(address):
    """A publisher that finds none left when it writes is killed by the system."""
    with open_publisher(address) as publisher:
        number = publisher._outlet._publisher.id.value
        (file,) = Path("/dev/shm").glob(f"*_{number}__0.data")

        assert file.stat().st_blocks * 512 >= file.stat().st_size > 1_000_000


@pytest.mark.skipif(sys.platform != "linux", reason="where shared memory is elsewhere is not known")
def test_shared_memory_that_is_full_is_told_and_the_name_stays_free(address, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "posix_fallocate", refuse)
        with pytest.raises(
            PublishError,
            match=r"no room for messages in /dev/shm \(No space left on device\); expected 1\.1 MB",
        ):
            open_publisher(address)
    open_publisher(address).close()


def test_without_the_library_the_error_says_what_to_install(monkeypatch):
    for module in ("proximity.transport.iceoryx", "proximity.transport.iceoryx_names"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, "iceoryx2", None)

    with pytest.raises(PublishError, match=r"iox2://decaff: needs iceoryx2: pip install iceoryx2 \(made for"):
        open_publisher("iox2://decaff")
