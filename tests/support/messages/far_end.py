"""The other end of a transport, in a separate process that a test can kill.

The process is this script: ``far_end.py ROLE ADDRESS COUNT``. It prints a line when ready and ends with its
standard input, so that no process outlives a failed test.
"""

import contextlib
import itertools
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from proximity.errors import PublishError
from proximity.message import FRAME, Message, State
from proximity.transport import open_inlet, open_publisher, open_subscriber

PATIENCE = 30.0
"""s, time limit of a test, generous for a loaded machine with two cores."""
_numbers = itertools.count()


def new_name():
    """A name unique among tests and concurrent test runs."""
    return f"test-{os.getpid()}-{time.time_ns()}/{next(_numbers)}"


def frame(count=5):
    """A valid frame: untracked fingers, posed now, valid for 20 ms."""
    message = Message(FRAME, count)
    message.header["state"] = State.OK
    return touch(message)


def touch(message):
    """Set a frame's times to now."""
    now = time.monotonic_ns()
    message.header["pose_ns"] = message.header["start_ns"] = message.header["publish_ns"] = now
    message.header["valid_until_ns"] = now + 20_000_000
    return message


def until(condition, patience=PATIENCE):
    """Poll until the condition is true and return its value; fail after *patience*."""
    ends = time.monotonic() + patience
    while not (answer := condition()):
        assert time.monotonic() < ends, "it did not happen in time"
        time.sleep(0.001)
    return answer


def until_valid(subscriber):
    """Read until a frame is valid; report the received frames on failure."""
    ends, reading = time.monotonic() + PATIENCE, subscriber.read()
    while not reading.is_valid:
        assert time.monotonic() < ends, f"no frame that may be used, but {reading} after {subscriber.counts}"
        reading = subscriber.wait(1.0)


class FarEnd:
    """A process at the other end; killed at the end of the ``with`` block at the latest."""

    def __init__(self, role, address, count=1):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._process = subprocess.Popen(
            [sys.executable, __file__, role, address, str(count)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=Path(__file__).parent,
        )
        self.pid = self._process.pid
        self.said = self._first_line()
        if not self.said:
            self.kill()
            raise AssertionError(f"far end {role} {address} did not begin: {self._process.stderr.read()}")

    def _first_line(self):
        in_time = threading.Timer(PATIENCE, self._process.kill)  # kills a hung process, which prints no line
        in_time.start()
        try:
            return self._process.stdout.readline().strip()
        finally:
            in_time.cancel()

    def kill(self):
        """Kill the process and wait until it has ended."""
        self._process.kill()
        self._process.wait(PATIENCE)

    def signal(self, number):
        """Send a signal to the process."""
        self._process.send_signal(number)

    def ended(self, let_go=False):
        """Wait until it has ended; return the exit status and the rest of both streams.

        *let_go*: close its standard input, which ends it.
        """
        if let_go:
            self._process.stdin.close()
            self._process.stdin = None
        rest, errors = self._process.communicate(timeout=PATIENCE)
        return self._process.returncode, rest, errors

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with contextlib.suppress(ProcessLookupError):
            self.kill()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()


def ready():
    """Report readiness to the test, and end with the standard input from now on."""
    print("ready", flush=True)
    over = threading.Event()

    def wait_for_the_end():
        os.read(0, 1)  # sys.stdin has a lock that the interpreter needs at exit
        over.set()

    threading.Thread(target=wait_for_the_end, daemon=True).start()
    return over


def publish(address, count):
    """Publish frames of *count* fingers a thousand times a second."""
    message = frame(count)
    with open_publisher(address) as publisher:
        over = ready()
        while not over.is_set():
            publisher.publish(touch(message))
            time.sleep(0.001)


def subscribe(address, count):
    """Read with *count* subscribers as fast as possible."""
    subscribers = [open_subscriber(address) for _ in range(count)]
    over = ready()
    while not over.is_set():
        for subscriber in subscribers:
            subscriber.read()


def hold(address, count):
    """Open *count* receiving ends, read no message, and end without closing them."""
    inlets = [open_inlet(address) for _ in range(count)]
    ready().wait()
    assert len(inlets) == count


def refused(address, count):
    """Try to open a publisher *count* times; print the last error."""
    text = ""
    for _ in range(count):
        try:
            open_publisher(address).close()
        except PublishError as refusal:
            text = str(refusal)
    print(text, flush=True)


def interrupted(address, count):
    """Wait with an open publisher and *count* inlets for KeyboardInterrupt."""
    with open_publisher(address), contextlib.ExitStack() as stack:
        for _ in range(count):
            stack.callback(open_inlet(address).close)
        try:
            ready().wait()
        except KeyboardInterrupt:
            print("interrupted", flush=True)


def grow(address, _):
    """Publish frames of 1 to 4096 fingers in turn."""
    frames = [frame(count) for count in (1, 30, 4096, 300)]
    with open_publisher(address) as publisher:
        over = ready()
        while not over.is_set():
            for message in frames:
                publisher.publish(touch(message))
                time.sleep(0.005)


ROLES = {role.__name__: role for role in (publish, subscribe, hold, refused, interrupted, grow)}

if __name__ == "__main__":
    ROLES[sys.argv[1]](sys.argv[2], int(sys.argv[3]))
