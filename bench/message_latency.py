"""How long a frame is on its way, and what it costs to publish it: from a process of its own to this one.

    python bench/message_latency.py iox2
    python bench/message_latency.py zenoh --reader wait

``publish`` is the call of `Publisher.publish`, checksum included; ``seen`` is from before that call to when
the reader has the bytes (``bytes``: a bare inlet, asked all the time), or what they mean (``read``:
`Subscriber.read` all the time; ``wait``: `Subscriber.wait`). Both processes share the clock.
"""

import argparse
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from proximity.message import FRAME, Message, State
from proximity.transport import open_inlet, open_publisher, open_subscriber

PUBLISHED_AT = slice(48, 56)
"""Where ``publish_ns`` is in a frame."""
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
WARM_UP = 200


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scheme", choices=("iox2", "zenoh"))
    parser.add_argument("--reader", choices=READERS, default="bytes")
    parser.add_argument("--fingers", type=int, default=5)
    parser.add_argument("--rate-hz", type=float, default=1000.0)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--publish-at", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish_at:
        publish(options.publish_at, options.fingers, options.count, options.rate_hz)
        return
    publisher_at, reader_at = addresses(options.scheme)
    command = [sys.executable, __file__, options.scheme, "--publish-at", publisher_at]
    command += ["--fingers", str(options.fingers), "--count", str(options.count)]
    read = READERS[options.reader]
    with subprocess.Popen([*command, "--rate-hz", str(options.rate_hz)]) as process:
        used_before, began = time.process_time(), time.monotonic()
        seen = read(reader_at, process)
        share = (time.process_time() - used_before) / (time.monotonic() - began)
    show(f"seen ({options.reader})", np.array(seen[WARM_UP:]))
    print(f"{len(seen)} of {options.count} were seen; the reader took {100.0 * share:.0f} % of a core")


def addresses(scheme: str) -> tuple[str, str]:
    """Of the publisher and of the reader."""
    if scheme == "iox2":
        return (f"iox2://latency-{os.getpid()}",) * 2
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{held.getsockname()[1]}"
    return f"zenoh://latency?listen={endpoint}", f"zenoh://latency?connect={endpoint}"


def publish(address: str, finger_count: int, count: int, rate_hz: float) -> None:
    """Publish frames at a rate, then as fast as possible, and show what that took."""
    message = Message(FRAME, finger_count)
    message.header["state"] = State.OK
    with open_publisher(address) as publisher:
        time.sleep(1.0)  # for the reader to come
        period_ns = round(1e9 / rate_hz)
        show("publish, at the rate", np.array(timed(publisher.publish, message, count, period_ns)[WARM_UP:]))
        time.sleep(0.5)
    with open_publisher(address.replace("latency", "latency-of-nobody")) as publisher:
        show("publish, in a row", np.array(timed(publisher.publish, message, count, 0)[WARM_UP:]))


def timed(publish_one: Callable[[Message], None], message: Message, count: int, period_ns: int) -> list[int]:
    """Publish that often, and say what each took, ns."""
    times, header = [], message.header
    due = time.monotonic_ns()
    for _ in range(count):
        due += period_ns
        left = due - time.monotonic_ns()
        if left > 0:
            time.sleep(1e-9 * left)
        now = time.monotonic_ns()
        header["pose_ns"] = header["publish_ns"] = now
        header["valid_until_ns"] = now + 20_000_000
        began = time.monotonic_ns()
        publish_one(message)
        times.append(time.monotonic_ns() - began)
    return times


def read_bytes(address: str, publisher: "subprocess.Popen[bytes]") -> list[int]:
    """Ask a bare inlet all the time."""
    inlet, room, seen = open_inlet(address), np.empty(2_000_000, np.uint8), []
    while publisher.poll() is None:
        for _ in range(1000):
            if inlet.receive(room) >= 0:
                seen.append(time.monotonic_ns() - int(room[PUBLISHED_AT].view("<i8")[0]))
    inlet.close()
    return seen


def read_frames(address: str, publisher: "subprocess.Popen[bytes]", timeout: float = 0.0) -> list[int]:
    """Read what frames mean, all the time or when there is one."""
    seen = []
    with open_subscriber(address) as subscriber:
        while publisher.poll() is None:
            for _ in range(100):
                reading = subscriber.wait(timeout)
                if reading.is_new:
                    seen.append(time.monotonic_ns() - int(reading.header["publish_ns"]))
    return seen


def show(what: str, nanoseconds: np.ndarray) -> None:
    """Print percentiles in microseconds."""
    figures = np.percentile(nanoseconds, PERCENTILES) / 1e3
    text = "  ".join(f"p{p:g} {value:.1f}" for p, value in zip(PERCENTILES, figures, strict=True))
    print(f"{what:24s} {text.replace('p100', 'max')} us", flush=True)


READERS = {
    "bytes": read_bytes,
    "read": read_frames,
    "wait": lambda address, publisher: read_frames(address, publisher, 0.01),
}

if __name__ == "__main__":
    main()
