"""Clients in C++, JavaScript and C#: for the same events their readers equal a `Subscriber`."""

import hashlib
import re
import socket
import subprocess
import threading
import time
from itertools import product

import numpy as np
import pytest
from client_programs import LANGUAGES, PATIENCE, Events, ask, build_driver
from ports import free_port
from wire import KNOWN, MS, SESSION, Clock, Wire, frame, sealed

from proximity.message import (
    ADDITIONS,
    CHANGES,
    DESCRIPTION,
    MOVES,
    POSES,
    Message,
    PartAction,
    State,
    parts_of,
)
from proximity.transport import MessageReader, Subscriber, open_inlet, open_publisher
from proximity.transport.message_key import write_key


@pytest.fixture(scope="module", params=LANGUAGES)
def driver(request, tmp_path_factory):
    """A program for each language."""
    return build_driver(request.param, tmp_path_factory.mktemp(request.param))


class Beside:
    """A `Subscriber`, and its events for a client."""

    def __init__(self, shares_clock=True, is_keyed=False):
        self.clock, self.wire = Clock(), Wire(shares_clock)
        self.wire.is_keyed = is_keyed
        self.subscriber = Subscriber(self.wire, "wire:", clock=self.clock)
        self.events, self.expected = Events(shares_clock, is_keyed), []

    def offer(self, data):
        before = self.subscriber.counts.flawed.copy()
        self.wire.put(data)
        list(self.subscriber.frames())
        defects = self.subscriber.counts.flawed - before
        self.events.offer(bytes(data), self.clock.now)
        self.expected.append(next(iter(defects), None))

    def look(self, later=0):
        self.clock.now += later
        reading = self.subscriber.read()
        self.events.look(self.clock.now)
        told = reading.state, reading.is_new, reading.now_ns, reading.age_ns, reading.contacts.copy()
        valid = [self.subscriber.last_valid(finger) for finger in range(len(reading.contacts))]
        self.expected.append((*told, [each and each.copy() for each in valid]))

    def check(self, program, folder):
        answers, counts, (*names, refusal) = self.events.answers(program, folder)
        for number, (found, expected) in enumerate(zip(answers, self.expected, strict=True)):
            if not isinstance(expected, tuple):
                assert found is expected, number
                continue
            assert found[:2] == expected[:2], number
            # Within 2 ns: the rate of the clocks is rounded.
            assert np.abs(np.subtract(found[2:4], expected[2:4])).max() <= 2, number
            same(found[4], expected[4])
            assert found[5]["is_known"].tolist() == [each is not None for each in expected[5]]
            for contact, known in zip(found[5]["contact"], expected[5], strict=True):
                assert known is None or contact.tobytes() == known.tobytes()
        seen = self.subscriber.counts
        assert counts == (seen.received, seen.lost, seen.sessions)
        newest = self.subscriber.description
        assert refusal == (f"{newest.refused} {newest.refusal}" if newest else "0 ")
        assert names == ["", *self.subscriber.part_names[:4]] + [""] * (4 - len(self.subscriber.part_names))


def same(found, expected):
    for name in expected.dtype.names:
        # Bounds change by at most 3 nm per µs: 2 ns are negligible.
        close = {"rtol": 1e-9, "atol": 1e-7 if found.dtype[name].base.kind == "f" else 2}
        np.testing.assert_allclose(found[name], expected[name], err_msg=name, **close)


def any_frame(rng, now):
    """Return a valid frame with random numbers."""
    message = frame(now, 4, valid_for=int(rng.choice([5, 20, 5000])) * MS, state=rng.choice(list(State)))
    contacts = message.records
    for name in contacts.dtype.names:
        if (
            contacts.dtype[name].base.kind == "f"
            and "distance" not in name
            and name not in ("lower", "upper")
        ):
            contacts[name] = rng.normal(size=contacts[name].shape)
    contacts["normal"] /= np.linalg.norm(contacts["normal"], axis=1)[:, None]
    contacts["lower"], contacts["signed_distance"], contacts["upper"] = np.sort(
        rng.normal(size=(3, 4)), axis=0
    )
    low, contacts["predicted_distance"], high = np.sort(rng.normal(size=(3, 4)), axis=0)
    contacts["predicted_lower"], contacts["predicted_upper"] = (
        low,
        high * rng.choice([1, np.inf], p=[0.8, 0.2]),
    )
    contacts["time_to_contact"] = contacts["time_to_contact_lower"] + rng.random(4)
    contacts["predicted_ns"] += rng.integers(-2, 4, 4) * MS
    contacts["flags"] = rng.choice([KNOWN, KNOWN, 1, 0, 0xFFF], 4)
    contacts["source"], contacts["force_is_valid"] = rng.integers(0, 3, 4), rng.integers(0, 2, 4)
    if rng.random() < 0.3:
        contacts["part_velocity"][1] = contacts["velocity"][2] = np.nan
    return message


def test_bounds_and_states_are_those_of_a_subscriber(driver, tmp_path):
    rng, beside = np.random.default_rng(7), Beside()
    for number in range(60):
        beside.offer(sealed(any_frame(rng, beside.clock.now), number))
        for later in (0, 4 * MS, 3 * MS, 20 * MS, 40 * MS, 70 * MS, 900 * MS)[: rng.integers(2, 8)]:
            beside.look(later)

    looks = [told for told in beside.expected if isinstance(told, tuple)]
    assert {told[0] for told in looks} == set(State)
    assert {(told[0] is State.LATE, known is None) for told in looks for known in told[5]} == set(
        product(*2 * [(True, False)])
    )
    beside.check(driver, tmp_path)


@pytest.mark.parametrize("state", [State.OK, State.LATE])
def test_late_contact_keeps_the_distance_of_its_pose(driver, state, tmp_path):
    """Regression: a display showed a lower bound of -32 mm between two pictures of 50 mm."""
    beside = Beside()
    beside.offer(sealed(frame(beside.clock.now, valid_for=20 * MS, state=state)))
    beside.look(40 * MS)
    beside.check(driver, tmp_path)

    (late,) = (told for told in beside.expected if isinstance(told, tuple))
    contacts = late[4]
    assert late[0] is State.LATE and (contacts["lower"] < 0.0).all() and (contacts["upper"] > 0.1).all()
    for name in ("signed_distance", "predicted_distance"):
        assert (contacts[name] == 0.05).all()
    assert all((known is None) == (state is State.LATE) for known in late[5])


@pytest.mark.parametrize("shares_clock", [True, False])
@pytest.mark.parametrize("is_keyed", [True, False])
def test_what_cannot_be_used_is_what_a_subscriber_does_not_use(driver, shares_clock, is_keyed, tmp_path):
    rng, beside = np.random.default_rng(11), Beside(shares_clock, is_keyed)
    sequence, session = 0, SESSION
    for _ in range(400):
        beside.look(int(rng.choice([1, 1, 1, 11, 60])) * MS)
        message = any_frame(rng, beside.clock.now)
        row = message.records[rng.integers(4)]
        what = rng.integers(16)
        if what == 0:
            row[rng.choice(["lower", "upper", "predicted_distance", "time_to_contact"])] = np.nan
        elif what == 1:
            row["position"][1] = rng.choice([np.nan, np.inf])
        elif what == 2:
            row["normal"] = rng.choice([0.0, np.nan, 1.0])
        elif what == 3:
            row[rng.choice(["surface", "mode", "source", "force_is_valid"])] = 9
        elif what == 4:
            message.header[rng.choice(["state", "source"])] = 7
        elif what == 5:
            message.header[rng.choice(["pose_ns", "publish_ns"])] += int(rng.choice([4, 7, 2**62]))
        elif what == 6:
            session += int(rng.integers(-2, 3))
        sequence = max(sequence + int(rng.choice([1, 1, 1, 3, 0, -2])), 0)
        data = bytearray(sealed(message, sequence, session))
        if what == 7:
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        elif what == 8:
            data = data[: rng.integers(len(data))]
        elif what == 9:
            data += bytes(int(rng.integers(1, 400)))
        beside.offer(data)

    assert len({told for told in beside.expected if not isinstance(told, tuple)}) >= 7
    beside.check(driver, tmp_path)


def test_clock_of_a_publisher_elsewhere_is_believed_as_by_a_subscriber(driver, tmp_path):
    rng, beside, ahead = np.random.default_rng(3), Beside(shares_clock=False), 3600 * 1000 * MS
    for number in range(600):
        beside.look(MS)
        if number in (200, 400):
            ahead += int(rng.choice([-1, 1])) * 700 * MS
        late = int(rng.exponential(0.3) * MS)
        beside.offer(sealed(frame(beside.clock.now + ahead - late), number, SESSION + (number > 500)))

    states = [told[0] for told in beside.expected if isinstance(told, tuple)]
    assert {State.OK, State.STALE} <= set(states)
    beside.check(driver, tmp_path)


def description(names, part_count=2, **numbers):
    message = Message(DESCRIPTION, len(names))
    for name, value in {"part_count": part_count, "finger_count": 1, **numbers}.items():
        message.header[name] = value
    message.records["name"] = [name.encode() for name in names]
    return message


REFUSAL = "additions: there is no file 'lid ä.stl'".encode()
LONG = "64 bytes, the most that a name has in messages, and not one more"


@pytest.mark.parametrize(
    ("parts", "known"),
    [
        ([(["bracket", LONG, "thumb"], {})], ["bracket", LONG]),
        ([(["bracket", "lid", "thumb"], {"refused": 2, "refusal": REFUSAL})], ["bracket", "lid"]),
        ([(["bracket"], {}), (["lid ä", "thumb"], {"first": 1})], ["bracket", "lid ä"]),
        ([(["bracket"], {})], []),
        ([(["lid ä", "thumb"], {"first": 1})], []),
        ([(["bracket", "lid", "thumb"], {"epoch": 1})], []),
        ([(["bracket", "lid", "thumb", "more"], {})], []),
        ([(["a", "b", "thumb"], {}), (["c", "d", "thumb"], {"epoch": 1})], []),
    ],
)
def test_names_of_parts_are_those_of_a_subscriber_and_no_damage(driver, parts, known, tmp_path):
    """Regression: a description counted as a defective frame, once a second."""
    beside = Beside()
    beside.offer(sealed(frame(beside.clock.now)))
    for number, (names, numbers) in enumerate(parts):
        beside.offer(sealed(description(names, **numbers), number))
    beside.offer(sealed(description(["x", "y", "z"]), len(parts))[:-1])
    beside.look(MS)

    assert list(beside.subscriber.part_names) == known
    beside.check(driver, tmp_path)


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "some.key"
    write_key(str(path))
    return path


def test_tags_are_those_of_hashlib(driver, key, tmp_path):
    data = np.random.default_rng(7).bytes(2000)
    (tmp_path / "data").write_bytes(data)
    sizes = [0, 1, 63, 64, 65, 127, 128, 129, 408, 1736]

    tags = ask(driver, "tag", key, tmp_path / "data", *sizes).split()

    secret = bytes.fromhex(key.read_text())
    assert tags == [hashlib.blake2s(data[:n], key=secret, digest_size=16).hexdigest() for n in sizes]


@pytest.mark.parametrize("has_key", [False, True])
def test_poses_moves_and_changes_arrive(driver, has_key, key):
    port = free_port()
    inlet = open_inlet(f"udp://127.0.0.1:{port}" + (f"?key={key}" if has_key else ""))
    reader = MessageReader(inlet, [POSES, MOVES, CHANGES, ADDITIONS])
    before = time.monotonic_ns()
    ask(driver, "send", "127.0.0.1", port, "-", key if has_key else "-")
    arrived = [(kind, *parts_of(data.copy(), kind)) for kind, data, _ in reader.messages()]
    inlet.close()

    assert [kind.name for kind, *_ in arrived] == ["poses", "moves", "changes", "additions", "poses"]
    assert [int(header["sequence"]) for _, header, _ in arrived] == [0, 0, 0, 0, 1]
    assert (reader.counts.unused, reader.counts.lost) == (0, 0)
    _, header, poses = arrived[0]
    assert before < header["send_ns"] < time.monotonic_ns() and before < poses["pose_ns"][0]
    assert poses["position"].tolist() == [[1, 2, 3], [4, 5, 6]] and poses["finger"].tolist() == [0, 1]
    assert np.isnan(poses["velocity"]).all() and np.isnan(poses["bend"]).all()
    move = arrived[1][2][0]
    assert move["name"].decode() == "lid ä" and move["translation"].tolist() == [7, 8, 9]
    assert move["rotation"].tolist() == np.eye(3).tolist() and not move["velocity"].any()
    change = arrived[2][2][0]
    assert (change["name"].decode(), change["action"]) == ("lid ä", PartAction.HIDE)
    added = arrived[3][2][0]
    assert (added["name"].decode(), added["file"], added["units"]) == ("lid ä", b"inner/lid.stl", b"")
    assert added["rotation"].tolist() == np.eye(3).tolist() and added["translation"].tolist() == [7, 8, 9]


@pytest.mark.parametrize("has_key", [False, True])
def test_frames_are_received(driver, has_key, key):
    port = free_port()
    words = ["listen", "127.0.0.1", port, "-", key if has_key else "-"]
    program = subprocess.Popen([*map(str, (*driver, *words))], stdout=subprocess.PIPE, text=True)
    option = f"?key={key}" if has_key else ""
    timer = threading.Timer(PATIENCE, program.kill)  # ends a wait for a missing line
    timer.start()
    try:
        assert program.stdout.readline() == "listening\n"
        with open_publisher(f"udp://127.0.0.1:{port}{option}") as publisher:
            for distance in (0.5, 0.25, 0.125):
                publisher.publish(frame(time.monotonic_ns(), distance=distance, valid_for=900 * MS))
                assert program.stdout.readline() == f"0 {distance:.6f}\n"
            if has_key:
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                    for size in (0, 10, 16, 1000):
                        other.sendto(bytes(size), ("127.0.0.1", port))
            publisher.publish(frame(time.monotonic_ns(), state=State.STOPPING))
        rest, _ = program.communicate(timeout=PATIENCE)
    finally:
        timer.cancel()
        program.kill()
        program.communicate()

    assert rest == f"received 4 unverified {4 if has_key else 0}\n"


NO_ADDRESS = '"here" is not an IPv4 address, expected one such as 127.0.0.1\n'
REACHED = r"192\.0\.2\.1 can be reached by others, expected `from`, the (one|HOST:PORT) to listen to\n"
FAR = r"192\.0\.2\.1 is not on this machine, expected `bind`, the address to send from\n"
TOO_LARGE = r"a message of 294960 bytes does not fit into a datagram \(expected at most 65507 bytes\)\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["listen", "here", 9100, "-", "-"], re.escape(NO_ADDRESS)),
        (["send", "here", 9100, "-", "-"], re.escape(NO_ADDRESS)),
        (["send", "127.0.0.1", 9100, "here", "-"], re.escape(NO_ADDRESS)),
        (["listen", "127.0.0.1", 0, "-", "-"], "port is 0, expected one from 1 to 65535\n"),
        (["send", "127.0.0.1", 0, "-", "-"], "port is 0, expected one from 1 to 65535\n"),
        (["listen", "192.0.2.1", 9100, "-", "-"], REACHED),
        (["send", "192.0.2.1", 9100, "-", "-"], FAR),
        (["sender", "127.0.0.1", 9100, "-", "-"], TOO_LARGE),
        (["send", "127.0.0.1", 9100, "-", "-", "long"], r".*65 bytes, expected (1 to|at most) 64\n"),
        (["send", "127.0.0.1", 9100, "192.0.2.1", "-"], r"cannot use .*\(.+\)\n"),
        (["listen", "127.0.0.1", 9100, "-", "/none.key"], r"the key /none\.key cannot be read \(.+\)\n"),
    ],
)
def test_what_cannot_be_opened_or_sent_is_told(driver, words, sentence):
    assert re.fullmatch(sentence, ask(driver, *words, code=1))


def test_port_in_use_is_told(driver):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        told = ask(driver, "listen", "127.0.0.1", port, "-", "-", code=1)
    assert re.fullmatch(rf"cannot use 127\.0\.0\.1(, port |:){port} \(.+\)\n", told)


def test_key_that_cannot_be_used_is_told(driver, key):
    words = ["listen", "127.0.0.1", 9100, "-", key]
    key.write_text("ab" * 31)
    assert ask(driver, *words, code=1) == f"the key {key} is not a key (expected 64 hexadecimal digits)\n"
    if "mono" in str(driver[0]):
        return  # .NET of Unity's version cannot request permissions
    key.chmod(0o644)
    told = ask(driver, *words, code=1)
    assert told == f"the key {key} may be used by others (expected permissions 0600)\n"
    assert ask(driver, *words[:4], "/dev/null", code=1) == "the key /dev/null is not a regular file\n"
