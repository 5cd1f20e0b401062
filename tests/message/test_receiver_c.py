"""The receiver in C: compiled with all warnings, run with publishers, transmission errors, and silence."""

import contextlib
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from hashlib import blake2s

import numpy as np
import pytest
from compiling_c import WARNINGS, c_compiler, run
from ports import free_port
from publishing import publishing
from wire import MS, frame, sealed

from proximity.clients import write_client
from proximity.message import FRAME, Message
from proximity.transport import open_publisher, widen
from proximity.transport.message_key import write_key

PATIENCE = 30.0  # s
FINGER = r"finger (\d): at least (\S+) mm"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the receiver is for POSIX")


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("receiver")
    write_client("c", folder)
    target = folder / "receiver"
    run(c_compiler(), "-std=c99", *WARNINGS, "-O2", folder / "receiver.c", "-lm", "-o", target)
    return target


class Receiver:
    """The running program."""

    def __init__(self, program, *words):
        self.process = subprocess.Popen(
            [program, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.lines = []

    def read_until(self, pattern):
        """Read lines up to the first match of the pattern; return the match."""
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))
            if found := re.search(pattern, line):
                return found
        raise AssertionError(f"{pattern} never came: {self.lines[-20:]}")

    def stop(self):
        """Stop the program; return its counts."""
        self.process.send_signal(signal.SIGTERM)
        rest, errors = self.process.communicate(timeout=PATIENCE)
        self.lines += rest.splitlines()
        assert (self.process.returncode, errors) == (0, "")
        words = self.lines[-1].replace(",", "").split()
        return {name: int(number) for name, number in zip(words[::2], words[1::2], strict=True)}


@pytest.fixture
def port():
    return free_port()


@contextlib.contextmanager
def listening(program, port, here="127.0.0.1", sender="127.0.0.1", *rest):
    receiver = Receiver(program, here, port, sender, *rest)
    # End a wait for a missing line.
    timer = threading.Timer(PATIENCE, receiver.process.kill)
    timer.start()
    try:
        receiver.read_until("^listening")
        yield receiver
    finally:
        timer.cancel()
        timer.join()
        receiver.process.kill()
        receiver.process.wait()
        receiver.process.stdout.close()
        receiver.process.stderr.close()


def throw(port, *datagrams, source="127.0.0.1"):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        for data in datagrams:
            sender.sendto(data, ("127.0.0.1", port))


def complaint(program, *words, code):
    """Return the error message of a failed start."""
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (code, "")
    return done.stderr.removeprefix("receiver: ").rstrip()


def test_frames_are_told_while_they_are_valid(program, port):
    with listening(program, port) as receiver, open_publisher(f"udp://127.0.0.1:{port}") as publisher:
        for number in range(5):
            message = frame(time.monotonic_ns(), 2, distance=0.0164, valid_for=900 * MS)
            message.records["time_to_contact"], message.records["time_to_contact_lower"] = 0.041, 0.0405
            message.records["flags"][1] = 0  # not tracked: not reported
            publisher.publish(message)
            found = receiver.read_until(rf"^{number} OK age (\S+) ms(.*)$")
            assert 1.0 <= float(found[1]) <= 900.0
            assert found[2] == "; finger 0: 16.400 mm, contact in 41.0 ms, not before 40.5"
        counts = receiver.stop()

    assert counts.pop("received") == 5
    assert not any(counts.values())


def test_old_frame_becomes_a_falling_bound_and_then_nothing(program, port):
    message = frame(count=3, distance=0.2)
    message.records["velocity"][1], message.records["part_velocity"][2] = (0.5, 0, 0), (0, 0, 1)
    late = []
    with listening(program, port) as receiver, open_publisher(f"udp://127.0.0.1:{port}") as publisher:
        while not late and publisher.sequence < 20:  # a loaded machine may miss this phase
            now, number = time.monotonic_ns(), publisher.sequence
            message.header["pose_ns"] = message.header["publish_ns"] = message.records["pose_ns"] = now
            message.header["valid_until_ns"], message.records["predicted_ns"] = now + 50 * MS, now + MS
            publisher.publish(message)
            receiver.read_until(f"^{number} STALE")
            late = [line for line in receiver.lines if line.startswith(f"{number} LATE")]
        receiver.stop()

    assert "finger" not in receiver.lines[-2]
    bounds = []
    for line in late:
        age = float(re.search(r"age (\S+) ms", line)[1])
        contacts = message.records.copy()
        widen(contacts, now + round(age * MS), 3.0, 120.0)
        told = [float(bound) for _, bound in re.findall(FINGER, line)]
        # The age has a precision of 1 µs, the bound of 1 µm.
        assert told == pytest.approx((1e3 * contacts["lower"]).tolist(), abs=0.02)
        bounds.append(told)
    assert late, receiver.lines
    assert (np.diff(bounds, axis=0) < 0.0).all()
    assert "OK" not in " ".join(receiver.lines[receiver.lines.index(late[0]) :])


def test_faults_are_counted_and_the_stream_goes_on(program, port):
    with listening(program, port) as receiver:
        now = time.monotonic_ns()
        message = frame(now, valid_for=900 * MS)
        good = [sealed(message, number) for number in range(4)]
        nonsense = frame(now)
        nonsense.records["upper"][2] = np.nan
        future = frame(now + 60_000 * MS)
        faults = [
            good[0],  # received
            good[1][:700] + bytes([good[1][700] ^ 8]) + good[1][701:],
            good[1][:-1],
            good[1] + bytes(65000 - len(good[1])),
            good[1][:8] + b"\1" + good[1][9:],
            b"garbage",
            b"",
            b"garbage " * 100,
            good[2],  # received, one was lost
            good[0],
            good[1],
            sealed(message, 9, session=5),  # of an earlier run
            sealed(nonsense, 10),
            sealed(future, 11),
            good[3],  # received
        ]
        throw(port, *faults)
        receiver.read_until("^3 ")
        counts = receiver.stop()

    assert counts == {
        "received": 3, "lost": 1, "checksum": 1, "size": 2, "version": 1, "short": 2, "magic": 1, "old": 3,
        "content": 1, "future": 1, "stranger": 0, "unverified": 0,
    }  # fmt: skip


def test_strangers_are_counted(program, port):
    with listening(program, port) as receiver:
        for source, number in (("127.0.0.2", 1), ("127.0.0.1", 2)):
            throw(port, sealed(frame(time.monotonic_ns()), number), source=source)
        receiver.read_until("^2 ")
        counts = receiver.stop()

    assert (counts["stranger"], counts["received"]) == (1, 1)


def test_publisher_that_starts_anew_is_followed(program, port):
    with listening(program, port) as receiver:
        for _ in range(2):
            with open_publisher(f"udp://127.0.0.1:{port}") as publisher:
                for number in range(3):
                    publisher.publish(frame(time.monotonic_ns(), valid_for=900 * MS))
                    receiver.read_until(f"^{number} OK")
        counts = receiver.stop()

    assert (counts["received"], counts["lost"], counts["old"]) == (6, 0, 0)


def test_publisher_elsewhere_is_believed_when_its_clock_has_been_seen_to_run(program, port):
    """The address of another machine, used from here; its clock is an hour ahead."""
    ahead, here = 3600 * 1000 * MS, own_address()
    with listening(program, port, here, here) as receiver:
        with publishing(
            f"udp://{here}:{port}?bind={here}",
            lambda: frame(time.monotonic_ns() + ahead, valid_for=900 * MS),
        ):
            receiver.read_until(" OK age")
        receiver.stop()

    states = [line.split()[1] for line in receiver.lines if " age " in line]
    assert states[0] == "STALE"
    ages = [float(re.search(r"OK age (\S+)", line)[1]) for line in receiver.lines if " OK " in line]
    assert min(ages) < 1000.0


def own_address():
    """Return an address of this machine other than loopback, found without sending."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return probe.getsockname()[0]
        except OSError:
            pytest.skip("this machine has no network")


def test_more_fingers_than_there_is_room_for_are_refused(program, port):
    with listening(program, port) as receiver, open_publisher(f"udp://127.0.0.1:{port}") as publisher:
        publisher.publish(Message(FRAME, 65))
        publisher.publish(frame(time.monotonic_ns(), 64, valid_for=900 * MS))
        receiver.read_until("^1 ")
        counts = receiver.stop()

    assert (counts["size"], counts["received"]) == (1, 1)


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "frames.key"
    write_key(str(path))
    return path


def tagged(data, path):
    return data + blake2s(data, key=bytes.fromhex(path.read_text()), digest_size=16).digest()


def test_with_a_key_only_what_it_verifies_is_believed(program, key, port):
    keyed = listening(program, port, "127.0.0.1", "127.0.0.1", key)
    with keyed as receiver, open_publisher(f"udp://127.0.0.1:{port}?key={key}") as publisher:
        publisher.publish(frame(time.monotonic_ns(), 2, valid_for=900 * MS))
        receiver.read_until("^0 OK")
        forged = frame(time.monotonic_ns(), 2, distance=5.0, valid_for=900 * MS)
        good = tagged(sealed(forged, 1, 2**63), key)
        throw(port, *(sealed(forged, number, 2**63) for number in range(50)))
        throw(port, good[:-1], good[:16], b"", good[:-1] + bytes([good[-1] ^ 1]), b"x" + good[1:])
        publisher.publish(frame(time.monotonic_ns(), 2, valid_for=900 * MS))
        receiver.read_until("^1 OK")
        counts = receiver.stop()

    assert (counts.pop("unverified"), counts.pop("received")) == (55, 2)
    assert not any(counts.values())
    assert "5000" not in " ".join(receiver.lines)


def test_with_a_key_recordings_are_old_however_long_it_was_silent(program, key, port):
    message = frame(time.monotonic_ns(), valid_for=900 * MS)
    recorded = [tagged(sealed(message, number, session=100), key) for number in (10, 11, 12)]
    later = tagged(sealed(message, 20, session=200), key)
    with listening(program, port, "127.0.0.1", "127.0.0.1", key) as receiver:
        throw(port, *recorded, *recorded, later)
        receiver.read_until("^20 ")
        time.sleep(1.1)  # without a key another run would be accepted after a second
        throw(port, *(tagged(sealed(message, *numbers), key) for numbers in ((30, 100), (21, 200))))
        receiver.read_until("^21 ")
        counts = receiver.stop()

    assert (counts["received"], counts["old"], counts["unverified"]) == (5, 4, 0)


def test_max_fingers_fit_with_their_tag(program, key, port):
    keyed = listening(program, port, "127.0.0.1", "127.0.0.1", key)
    with keyed as receiver, open_publisher(f"udp://127.0.0.1:{port}?key={key}") as publisher:
        publisher.publish(frame(time.monotonic_ns(), 65, valid_for=900 * MS))
        publisher.publish(frame(time.monotonic_ns(), 64, valid_for=900 * MS))
        receiver.read_until("^1 ")
        counts = receiver.stop()

    assert (counts["unverified"], counts["received"]) == (1, 1)


def test_what_it_cannot_begin_with_is_told(program, key):
    expected = "expected ADDRESS PORT SENDER [KEY], such as 127.0.0.1 9100 127.0.0.1"
    for words in ((), ("here", 9100, "127.0.0.1")):
        assert complaint(program, *words, code=2) == expected
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        words = ("127.0.0.1", other.getsockname()[1], "127.0.0.1")
        assert complaint(program, *words, code=1) == "Address already in use"
    words = ("127.0.0.1", 9100, "127.0.0.1", key)
    key.chmod(0o644)
    assert complaint(program, *words, code=2) == f"{key} may be used by others (expected permissions 0600)"
    key.chmod(0o600)
    key.write_text("ab" * 31)
    assert complaint(program, *words, code=2) == f"{key} is not a key (expected 64 hexadecimal digits)"
    key.unlink()
    assert complaint(program, *words, code=2) == f"{key} cannot be opened"
