"""The mailbox: the latest message inside the process."""

import threading
import time
import uuid

import numpy as np
import pytest
from wire import frame

import proximity
from proximity.message import FRAME, POSES, Message
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING


@pytest.fixture
def address():
    return f"mailbox:{uuid.uuid4()}"


def text(inlet, size=100):
    """What the inlet gives, as bytes; None: nothing."""
    room = np.zeros(size, np.uint8)
    taken = inlet.receive(room)
    return None if taken == NOTHING else (taken, room[:taken].tobytes())


def array(data):
    return np.frombuffer(data, np.uint8)


def test_latest_message_is_taken_once(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    assert text(inlet) is None
    outlet.send(array(b"one"))
    outlet.send(array(b"three"))
    outlet.send(array(b"two"))

    assert text(inlet) == (3, b"two")
    assert text(inlet) is None


def test_who_comes_late_gets_the_latest_message(address):
    outlet = open_outlet(address)
    outlet.send(array(b"early"))
    outlet.close()

    assert text(open_inlet(address)) == (5, b"early")


def test_box_that_nobody_has_is_gone(address):
    open_outlet(address).send(array(b"gone"))

    assert text(open_inlet(address)) is None


def test_message_larger_than_the_room_tells_its_size(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    outlet.send(array(b"0123456789"))
    room = np.zeros(4, np.uint8)

    assert inlet.receive(room) == 10
    assert room.tobytes() == b"0123"


def test_what_was_sent_may_be_changed_afterwards(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    data = array(b"first").copy()
    outlet.send(data)
    data[:] = 0

    assert text(inlet) == (5, b"first")


def test_waiting_ends_with_a_message(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    assert not inlet.wait(0.001)
    timer = threading.Timer(0.02, outlet.send, [array(b"now")])
    timer.start()
    try:
        assert inlet.wait(30.0)
    finally:
        timer.join()

    assert text(inlet) == (3, b"now")


def test_threads_see_whole_messages(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    messages = [array(bytes([letter]) * (50 + letter)) for letter in range(50)]

    def write():
        for _ in range(20):
            for message in messages:
                outlet.send(message)

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    try:
        seen = 0
        while seen < 100 or any(writer.is_alive() for writer in writers):
            taken = text(inlet)
            if taken is not None:
                seen += 1
                size, data = taken
                assert data == bytes([data[0]]) * (50 + data[0]) and size == len(data)
            elif not any(writer.is_alive() for writer in writers):
                break
    finally:
        for writer in writers:
            writer.join()
    assert seen


def test_frames_travel_by_public_names(address):
    with proximity.open_publisher(address) as publisher, proximity.open_subscriber(address) as subscriber:
        publisher.publish(frame(time.monotonic_ns(), 2))
        reading = subscriber.wait(10.0)

    assert reading.state is proximity.State.OK and reading.is_new and reading.is_valid
    assert len(reading.contacts) == 2
    assert str(subscriber.counts) == "1 received, 0 lost"


def test_numbers_are_counted_for_each_kind(address):
    """Who receives one kind of two that share an address misses nothing."""
    publisher, inlet = open_publisher(address), open_inlet(address)
    room = np.zeros(5000, np.uint8)
    numbers = []
    for kind in (FRAME, POSES, FRAME, FRAME, POSES):
        publisher.publish(Message(kind, 1))
        inlet.receive(room)
        numbers.append(int(room[24:32].view("<u8")[0]))

    assert numbers == [0, 0, 1, 2, 1]
    assert publisher.sequence == 5


def test_sessions_rise_even_where_the_clock_stands_still(address, monkeypatch):
    monkeypatch.setattr("time.time_ns", lambda: 5)
    sessions = [open_publisher(address).session for _ in range(3)]

    assert sessions == sorted(set(sessions))


def test_publisher_whose_machine_slept_begins_another_run(address, monkeypatch):
    """Its monotonic clock stood still; a calendar that is put back or slews is nothing to it."""
    publisher, subscriber = open_publisher(address), open_subscriber(address)
    calendar, sessions, numbers = time.time_ns(), [], []
    monkeypatch.setattr("time.time_ns", lambda: calendar)
    for gained in (0, -5_000_000_000, 900_000_000, 3_600_000_000_000, 0):
        calendar += gained
        publisher.publish(frame(time.monotonic_ns(), 2))
        header = subscriber.read().header
        sessions.append(int(header["session"]))
        numbers.append(int(header["sequence"]))

    assert numbers == [0, 1, 2, 0, 1]
    assert sessions == sorted(sessions)
    assert (subscriber.counts.sessions, subscriber.counts.lost) == (2, 0)
