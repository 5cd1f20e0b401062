"""Keys of udp://: valid key files, and rejection of datagrams that the key does not verify."""

import os
import socket
import stat
import sys
import time
from hashlib import blake2s
from types import SimpleNamespace

import numpy as np
import pytest
from far_end import until
from ports import free_port
from wire import Clock, Wire, frame, sealed

from proximity.errors import PublishError
from proximity.message import FRAME, POSES, Defect, Message
from proximity.service.inputs.message_input import MessageInput
from proximity.transport import MessageReader, open_inlet, open_outlet, open_publisher, open_subscriber, udp
from proximity.transport.address import parse
from proximity.transport.link import NOTHING
from proximity.transport.message_key import TAG_BYTES, key_of, write_key

PATIENCE = 20.0  # s
LONG = 10**10  # ns that frames of these tests stay valid

knows_permissions = pytest.mark.skipif(sys.platform == "win32", reason="files have no such permissions")


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "frames.key"
    write_key(str(path))
    return path


@pytest.fixture
def port():
    return free_port()


@pytest.fixture
def link(key, port):
    """A subscriber and a publisher with the same key, and their address."""
    address = f"udp://127.0.0.1:{port}?key={key}"
    with open_subscriber(address) as subscriber, open_publisher(address) as publisher:
        yield SimpleNamespace(address=address, port=port, subscriber=subscriber, publisher=publisher)


def secret_of(path):
    return bytes.fromhex(path.read_text())


def tagged(data, secret):
    """Return a message and its tag, computed without the code under test."""
    return data + blake2s(data, key=secret, digest_size=16).digest()


def throw(port, *datagrams):
    """Send datagrams from an ordinary socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in datagrams:
            sender.sendto(data, ("127.0.0.1", port))


def read_until(subscriber, condition):
    until(lambda: (subscriber.wait(0.01), condition(subscriber.counts))[1], PATIENCE)
    return subscriber.counts


def now_frame(**settings):
    return frame(time.monotonic_ns(), valid_for=LONG, **settings)


def test_key_is_random_never_written_over_and_its_owner_alone_may_read_it(tmp_path):
    paths = [tmp_path / "one.key", tmp_path / "two.key"]
    for path in paths:
        write_key(str(path))
    before = [path.read_bytes() for path in paths]

    assert before[0] != before[1] and [len(data) for data in before] == [65, 65]
    assert [len(secret_of(path)) for path in paths] == [32, 32]
    if sys.platform != "win32":
        assert [stat.S_IMODE(path.stat().st_mode) for path in paths] == [0o600] * 2
    with pytest.raises(PublishError, match=r"one.key: exists already, and a key is never overwritten"):
        write_key(str(paths[0]))
    assert paths[0].read_bytes() == before[0]


def test_disk_that_is_full_leaves_no_half_a_key(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(PublishError, match=r"cannot be written \(No space left"):
        write_key(str(tmp_path / "x.key"))
    assert not list(tmp_path.iterdir())


def make(folder, kind):
    """Return the path of a file named by a key's address."""
    path = folder / "x.key"
    if kind == "pipe":
        os.mkfifo(path, 0o600)
    elif isinstance(kind, int):
        write_key(str(path))
        path.chmod(kind)
    elif not kind.startswith(("/", "none")):
        path.write_text(kind.removeprefix("text:"), encoding="utf-8")
        path.chmod(0o600)
    return kind if isinstance(kind, str) and kind.startswith("/") else path


NO_KEY = r"x.key' is not a key \(expected 64 hexadecimal digits, as"
OTHERS = r"x.key' may be used by others: its permissions are {:04o} \(expected 0600: chmod "


@knows_permissions
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (0o640, OTHERS.format(0o640)),
        (0o604, OTHERS.format(0o604)),
        ("text:", NO_KEY),
        ("text:" + "ab" * 31, NO_KEY),
        ("text:" + "xy" * 32, NO_KEY),
        ("text:" + "ab" * 32 + "\nab", NO_KEY),
        ("text:" + "ab" * 5000, NO_KEY),
        ("none", r"cannot be read \(No such file .*`proximity client key --out FILE`"),
        ("pipe", "is not a regular file"),
        ("/dev/zero", "is not a regular file"),
        ("/tmp", "is not a regular file"),
    ],
    ids=str,
)
def test_file_that_is_no_key_is_refused_and_not_printed(tmp_path, kind, message):
    path = make(tmp_path, kind)
    for opener in (open_publisher, open_subscriber):
        with pytest.raises(PublishError, match=message) as refusal:
            opener(f"udp://127.0.0.1:9100?key={path}")
        assert "abab" not in str(refusal.value)


@knows_permissions
def test_key_that_its_owner_may_only_read_is_taken_and_one_without_a_name_not(key):
    key.chmod(0o400)
    assert key_of(parse(f"udp://127.0.0.1:9100?key={key}")) is not None
    with pytest.raises(PublishError, match=r"cannot be read \(No such file"):
        open_subscriber("udp://127.0.0.1:9100?key=")


def test_tag_is_keyed_blake2s_over_the_whole_message(key, port):
    data = np.arange(1000).astype(np.uint8)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", port))
        outlet = open_outlet(f"udp://127.0.0.1:{port}?key={key}")
        outlet.send(data)
        outlet.close()
        listener.settimeout(PATIENCE)
        assert listener.recv(2000) == tagged(data.tobytes(), secret_of(key))


def test_largest_message_leaves_room_for_the_tag(key, port):
    address = f"udp://127.0.0.1:{port}?key={key}"
    inlet, outlet = open_inlet(address), open_outlet(address)
    data, room = np.full(udp.MAX_DATAGRAM_BYTES - TAG_BYTES, 7, np.uint8), np.zeros(100, np.uint8)
    try:
        outlet.send(data)
        assert inlet.wait(PATIENCE)
        assert inlet.receive(room) == len(data) and (room == 7).all()
        with pytest.raises(PublishError, match=r"of 65492 bytes .* \(expected at most 65491 bytes\)"):
            outlet.send(np.zeros(len(data) + 1, np.uint8))
    finally:
        inlet.close()
        outlet.close()


def test_frames_with_the_key_are_believed_and_50_of_50_forged_ones_are_not(link):
    link.publisher.publish(now_frame())
    assert link.subscriber.wait(PATIENCE).is_new
    forged = now_frame(distance=5.0)
    throw(link.port, *(sealed(forged, number, 2**63) for number in range(50)))
    read_until(link.subscriber, lambda counts: counts.unverified == 50)
    link.publisher.publish(now_frame(distance=0.02))
    reading = link.subscriber.wait(PATIENCE)

    counts = link.subscriber.counts
    assert (counts.unverified, counts.received, counts.lost, counts.unused) == (50, 2, 0, 50)
    assert reading.contacts["signed_distance"].tolist() == [0.02] * 5
    assert str(counts) == "2 received, 0 lost, 50 not verified by the key"


def test_tampered_cut_repeated_and_earlier_frames_and_those_of_another_key_are_counted(link, key):
    message, secret = now_frame(), secret_of(key)
    data = sealed(message, 0, 2**62)
    good = tagged(data, secret)
    bad = [good[:at] + bytes([good[at] ^ 1]) + good[at + 1 :] for at in range(0, len(good), 97)]
    bad += [good[:-1], good[:-16], good[:16], good[:15], b"", good + b"\0", good[:-16] + bytes(16)]
    bad += [tagged(data, bytes(32)), data + blake2s(data, digest_size=16).digest(), good[1:], data[-16:]]
    throw(link.port, *bad)
    counts = read_until(link.subscriber, lambda counts: counts.unverified == len(bad))
    assert (counts.unverified, counts.received, counts.flawed) == (len(bad), 0, {})

    sent = [tagged(sealed(message, number, 2**62), secret) for number in range(5)]
    throw(link.port, *sent, *sent, tagged(sealed(message, 100, 2**62 - 1), secret))
    counts = read_until(link.subscriber, lambda counts: counts.flawed[Defect.OLD] == 6)
    assert (counts.received, counts.flawed, counts.unverified) == (5, {Defect.OLD: 6}, len(bad))


def test_end_without_the_key_of_the_other_end_gets_nothing_and_counts(key, port):
    plain = f"udp://127.0.0.1:{port}"
    keyed = f"{plain}?key={key}"
    for theirs, ours, count in (
        (keyed, plain, lambda counts: counts.flawed[Defect.SIZE]),
        (plain, keyed, lambda counts: counts.unverified),
    ):
        with open_subscriber(ours) as subscriber, open_publisher(theirs) as publisher:
            for _ in range(3):
                publisher.publish(now_frame())
            counts = read_until(subscriber, lambda counts, count=count: count(counts) == 3)
            assert (count(counts), counts.received) == (3, 0)


def test_strangers_are_counted_as_strangers_and_a_flood_leaves_the_reader_its_time(key, port):
    room = np.zeros(100, np.uint8)
    for option, datagrams, refused, unverified in (
        ("from=127.0.0.1:1&", [b"right key, wrong sender"], 1, 0),
        ("", [bytes(100)] * (udp.MAX_STRANGERS + 1) + [b"friend"], 0, udp.MAX_STRANGERS),
    ):
        inlet = open_inlet(f"udp://127.0.0.1:{port}?{option}key={key}")
        throw(port, *datagrams[:-1], tagged(datagrams[-1], secret_of(key)))
        assert inlet.wait(PATIENCE)
        assert inlet.receive(room) == NOTHING
        assert (inlet.refused, inlet.unverified) == (refused, unverified)
        assert inlet.receive(room) == (6 if unverified else NOTHING)
        inlet.close()


@pytest.mark.parametrize("silence", [0, 10**12])
def test_session_before_the_newest_is_never_believed_again(silence):
    """Also in messages of another kind."""
    wire, clock = Wire(shares_clock=False), Clock()
    wire.is_keyed = True
    reader = MessageReader(wire, (FRAME, POSES), clock)
    taken = []
    for kind, sequence, session in (
        (FRAME, 7, 100), (FRAME, 0, 200), (FRAME, 8, 100), (FRAME, 0, 150), (POSES, 0, 100), (FRAME, 1, 200),
        (POSES, 0, 200), (FRAME, 0, 300),
    ):  # fmt: skip
        clock.now += silence if session < 200 else 0
        wire.put(sealed(frame() if kind is FRAME else Message(POSES, 1), sequence, session))
        taken.append(len(list(reader.messages())))

    assert taken == [1, 1, 0, 0, 0, 1, 1, 1]
    assert reader.counts.flawed == {Defect.OLD: 3}


def test_forged_poses_do_not_reach_a_service(key, port, caplog):
    address = f"udp://127.0.0.1:{port}?key={key}"
    poses, message = MessageInput(address, 2), Message(POSES, 2)
    message.records["finger"] = 0, 1
    now = time.monotonic_ns()
    message.header["send_ns"] = message.records["pose_ns"] = now
    message.records["position"], message.records["velocity"], message.records["bend"] = 0.5, 0.0, np.nan
    throw(port, *(sealed(message, number, 2**63) for number in range(50)))
    try:
        until(lambda: not list(poses.poll(now)) and any("50 not verified" in note for note in poses.notes))
        assert poses.notes == [f"{address}: 0 received, 0 lost, 50 not verified by the key"]
        expected = f"{address}: a message is not verified by the key (expected that of its sender)"
        assert caplog.messages == [expected]
        message.records["position"] = 0.1
        with open_publisher(address) as publisher:
            publisher.publish(message)
        assert (until(lambda: next(poses.poll(now), None)).positions == 0.1).all()
    finally:
        poses.close()
