"""Publishing a frame of five fingers, with pytest-benchmark: ``python -m pytest bench/bench_publish.py``.

A subscriber in this process proves that frames arrive, and what they say, before anything is timed. Beside
the whole publishing stand the transport's bytes alone, and where there is one the system's own call with the
same bytes. What a reader in another process sees is timed by `service.py`, and from pose to frame by
`bench_end_to_end.py`.
"""

import os
import socket
import time
import uuid
from contextlib import closing, contextmanager

import numpy as np
import pytest
from service_publishing import FINGERS, VALID_NS

import proximity
from proximity.errors import PublishError
from proximity.transport import open_outlet

SCHEMES = ("mailbox", "iox2", "udp", "zenoh")
ARRIVES_WITHIN = 10.0  # s: until routers and readers have found each other
HEIGHTS = np.array([0.05, 0.04, 0.03, 0.02, 0.01])  # m, what the frame says
pytestmark = pytest.mark.benchmark(timer=time.perf_counter)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("what", ["publish", "bytes alone"])
def test_publish(timed, leave_out, scheme, what):
    message = a_frame()
    group = f"publish, {scheme}, {FINGERS} fingers, {len(message.data)} bytes"
    with an_address(scheme) as (read_at, publish_at):
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
    """What is called before each publishing: nothing piles up, as with a reader that keeps up."""

    def arguments():
        subscriber.read()
        return (argument,), {}

    return arguments


def test_publish_by_socket(timed):
    """What the system takes for a datagram of that size."""
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
    """A message that says something."""
    message = proximity.Message(proximity.FRAME, FINGERS)
    message.records["signed_distance"] = HEIGHTS
    message.records["normal"] = (0.0, 0.0, 1.0)
    return message


def check_arrival(publisher, subscriber, message):
    """Publish until a frame arrives, and look at what it says."""
    ends = time.monotonic() + ARRIVES_WITHIN
    while time.monotonic() < ends:
        now = time.monotonic_ns()
        header = message.header
        header["pose_ns"] = header["start_ns"] = header["publish_ns"] = now
        header["valid_until_ns"], header["state"] = now + VALID_NS, proximity.State.OK
        publisher.publish(message)
        reading = subscriber.wait(0.01)
        if reading.is_new and reading.is_valid:  # the first may have waited for its reader
            assert np.array_equal(reading.contacts["signed_distance"], HEIGHTS)
            return
    raise AssertionError(f"no frame arrived at {publisher.address} within {ARRIVES_WITHIN:g} s")


@contextmanager
def an_address(scheme):
    """Where to read and where to publish; nobody else is there."""
    name = f"bench-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    if scheme in ("mailbox", "iox2"):
        address = f"{scheme}:{name}" if scheme == "mailbox" else f"{scheme}://{name}"
        yield address, address
        return
    kind = socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{probe.getsockname()[1]}"
    if scheme == "udp":
        yield f"udp://{place}", f"udp://{place}"
    else:
        yield f"zenoh://{name}?listen=tcp/{place}", f"zenoh://{name}?connect=tcp/{place}"
