"""Publishing a frame of five fingers, with pytest-benchmark: ``python -m pytest bench -k publish``.

Before timing, a subscriber in this process checks that frames arrive, and their contents. Next to the whole
publishing are the transport's bytes alone and, if there is one, the system's call with the same bytes.
`service.py` times what a reader in another process sees, and from pose to frame `bench_end_to_end.py` does.
"""

import socket
import time
from contextlib import closing

import numpy as np
import pytest

import proximity
from benchmarks.service.addresses import new_addresses
from benchmarks.service.publishing import FINGERS, stamp
from proximity.errors import PublishError
from proximity.transport import open_outlet

SCHEMES = ("mailbox", "shm", "udp", "zenoh")
ARRIVES_WITHIN = 10.0  # s: until routers and readers have found each other
HEIGHTS = np.array([0.05, 0.04, 0.03, 0.02, 0.01])  # m, of the frame
pytestmark = pytest.mark.benchmark(timer=time.perf_counter)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("what", ["publish", "bytes alone"])
def test_publish(timed, leave_out, scheme, what):
    message = a_frame()
    group = f"publish, {scheme}, {FINGERS} fingers, {len(message.data)} bytes"
    read_at, publish_at = new_addresses(scheme)
    try:
        subscriber = proximity.open_subscriber(read_at)
    except PublishError as reason:
        leave_out(scheme, reason)
    with subscriber, proximity.open_publisher(publish_at) as publisher:
        check_arrival(publisher, subscriber, message)
        if what == "publish":
            timed("proximity", group, publisher.publish, arguments=read_then(subscriber, message))
            return
        publisher.close()
        with closing(open_outlet(publish_at)) as outlet:
            send, arguments = outlet.send, read_then(subscriber, message.data)
            timed("proximity, bytes alone", group, send, arguments=arguments)


def read_then(subscriber, argument):
    """Return a call for before each publishing: it reads, like a reader that keeps up."""

    def arguments():
        subscriber.read()
        return (argument,), {}

    return arguments


def test_publish_by_socket(timed):
    """Time a datagram of that size by the system's call."""
    data = a_frame().data.tobytes()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as writer,
    ):
        reader.bind(("127.0.0.1", 0))
        writer.connect(reader.getsockname())
        writer.send(data)
        assert reader.recv(len(data) + 1) == data

        def arguments():
            reader.recv(len(data))
            return (data,), {}

        writer.send(data)
        group = f"publish, udp, {FINGERS} fingers, {len(data)} bytes"
        timed("socket.send", group, writer.send, arguments=arguments)


def a_frame():
    """Return a frame with some heights and normals."""
    message = proximity.Message(proximity.FRAME, FINGERS)
    message.records["signed_distance"] = HEIGHTS
    message.records["normal"] = (0.0, 0.0, 1.0)
    return message


def check_arrival(publisher, subscriber, message):
    """Publish until a frame arrives, and compare its contents."""
    ends = time.monotonic() + ARRIVES_WITHIN
    while time.monotonic() < ends:
        stamp(message)
        publisher.publish(message)
        reading = subscriber.wait(0.01)
        if reading.is_new and reading.is_valid:  # the first may have waited for its reader
            assert np.array_equal(reading.contacts["signed_distance"], HEIGHTS)
            return
    raise AssertionError(f"no frame arrived at {publisher.address} within {ARRIVES_WITHIN:g} s")
