"""Keys of udp://: what a file must be, and that nothing is believed that the key does not verify."""

import os
import socket
import stat
import sys
import time
from hashlib import blake2s
from types import SimpleNamespace

import numpy as np
import pytest
from ports import free_port
from wire import Clock, Wire, frame, sealed

from proximity.errors import PublishError
from proximity.message import FRAME, POSES, Flaw, Message
from proximity.service.inputs.message_input import MessageInput
from proximity.transport import MessageReader, open_inlet, open_outlet, open_publisher, open_subscriber, udp
from proximity.transport.address import parse
from proximity.transport.link import NOTHING
from proximity.transport.message_key import TAG_BYTES, key_of, write_key

PATIENCE = 20.0  # s
LONG = 10**10  # ns that frames of these tests are valid for

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
    """A subscriber with a key, a publisher with the same, and the frames that the publisher sends."""
    address = f"udp://127.0.0.1:{port}?key={key}"
    with open_subscriber(address) as subscriber, open_publisher(address) as publisher:
        yield SimpleNamespace(address=address, port=port, subscriber=subscriber, publisher=publisher)


def secret_of(path):
    return bytes.fromhex(path.read_text())


def tagged(data, secret):
    """A message and its tag, made without the code under test."""
    return data + blake2s(data, key=secret, digest_size=16).digest()


def throw(port, *datagrams):
    """Send datagrams as any program of this machine can."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in datagrams:
            sender.sendto(data, ("127.0.0.1", port))


def read_until(subscriber, condition):
    deadline = time.monotonic() + PATIENCE
    while not condition(subscriber.counts) and time.monotonic() < deadline:
        subscriber.wait(0.01)
    return subscriber.counts


def now_frame(**settings):
    return frame(time.monotonic_ns(), valid_for=LONG, **settings)


# --- the file ---


def test_key_is_random_and_its_owner_alone_may_read_it(tmp_path):
    paths = [tmp_path / "one.key", tmp_path / "two.key"]
    for path in paths:
        write_key(str(path))

    assert [len(secret_of(path)) for path in paths] == [32, 32]
    assert secret_of(paths[0]) != secret_of(paths[1])
    assert all(len(path.read_bytes()) == 65 for path in paths)
    if sys.platform != "win32":
        assert [stat.S_IMODE(path.stat().st_mode) for path in paths] == [0o600] * 2


def test_key_is_never_written_over(key):
    before = key.read_bytes()

    with pytest.raises(PublishError, match=r"frames.key: exists already, and a key is never overwritten"):
        write_key(str(key))
    assert key.read_bytes() == before


def test_disk_that_is_full_leaves_no_half_a_key(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(PublishError, match=r"cannot be written \(No space left"):
        write_key(str(tmp_path / "x.key"))
    assert not list(tmp_path.iterdir())


@knows_permissions
@pytest.mark.parametrize("mode", [0o640, 0o604])
def test_key_that_others_may_use_is_refused(key, mode):
    key.chmod(mode)

    with pytest.raises(
        PublishError,
        match=rf"frames.key' may be used by others: its permissions are {mode:04o} \(expected 0600: chmod ",
    ):
        open_subscriber(f"udp://127.0.0.1:9100?key={key}")


@knows_permissions
def test_key_that_its_owner_may_only_read_is_taken(key):
    key.chmod(0o400)

    assert key_of(parse(f"udp://127.0.0.1:9100?key={key}")) is not None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "ab" * 31,
        "xy" * 32,
        "ab" * 32 + "\nab",
        "ab" * 5000,
    ],
)
def test_file_that_is_no_key_is_refused_and_not_printed(tmp_path, text):
    path = tmp_path / "x.key"
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)

    with pytest.raises(
        PublishError, match=r"x.key' is not a key \(expected 64 hexadecimal digits, as"
    ) as refusal:
        open_publisher(f"udp://127.0.0.1:9100?key={path}")
    assert "abab" not in str(refusal.value)


def test_key_that_is_not_there_is_a_sentence_that_says_how_to_make_one(tmp_path):
    for named in (tmp_path / "none.key", ""):
        with pytest.raises(PublishError, match=r"cannot be read \(No such file .*`proximity key --out FILE`"):
            open_subscriber(f"udp://127.0.0.1:9100?key={named}")


@knows_permissions
def test_what_is_no_regular_file_is_no_key(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo, 0o600)
    for path in (fifo, "/dev/zero", tmp_path):
        with pytest.raises(PublishError, match="is not a regular file"):
            open_subscriber(f"udp://127.0.0.1:9100?key={path}")


# --- what is sent ---


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
    data, room = np.full(udp.MOST_DATAGRAM_BYTES - TAG_BYTES, 7, np.uint8), np.zeros(100, np.uint8)
    try:
        outlet.send(data)
        assert inlet.wait(PATIENCE)
        assert inlet.receive(room) == len(data)
        assert (room == 7).all()
        with pytest.raises(PublishError, match=r"of 65492 bytes .* \(expected at most 65491 bytes\)"):
            outlet.send(np.zeros(len(data) + 1, np.uint8))
    finally:
        inlet.close()
        outlet.close()


# --- what is believed ---


def test_frames_with_the_key_are_believed_and_50_of_50_forged_ones_are_not(link):
    link.publisher.publish(now_frame())
    assert link.subscriber.wait(PATIENCE).is_new
    forged = now_frame(distance=5.0)
    throw(link.port, *(sealed(forged, number, 2**63) for number in range(50)))
    counts = read_until(link.subscriber, lambda counts: counts.unverified == 50)
    link.publisher.publish(now_frame(distance=0.02))
    reading = link.subscriber.wait(PATIENCE)

    assert (counts.unverified, counts.received, counts.lost) == (50, 2, 0)
    assert reading.contacts["signed_distance"].tolist() == [0.02] * 5
    assert str(counts) == "2 received, 0 lost, 50 not verified by the key"
    assert counts.unused == 50


def test_tampered_and_cut_frames_and_those_of_another_key_are_counted(link, key):
    data, secret = sealed(now_frame(), 0, 2**63), secret_of(key)
    good = tagged(data, secret)
    bad = [good[:at] + bytes([good[at] ^ 1]) + good[at + 1 :] for at in range(0, len(good), 97)]
    bad += [good[:-1], good[:-16], good[:16], good[:15], b"", good + b"\0", good[:-16] + bytes(16)]
    bad += [tagged(data, bytes(32)), data + blake2s(data, digest_size=16).digest(), good[1:], data[-16:]]
    throw(link.port, *bad)
    counts = read_until(link.subscriber, lambda counts: counts.unverified == len(bad))

    assert (counts.unverified, counts.received, counts.flawed) == (len(bad), 0, {})
    throw(link.port, good)
    assert read_until(link.subscriber, lambda counts: counts.received).received == 1


def test_repeated_and_earlier_frames_are_counted(link, key):
    secret, message = secret_of(key), now_frame()
    sent = [tagged(sealed(message, number, 2**62), secret) for number in range(5)]
    earlier = tagged(sealed(message, 100, 2**62 - 1), secret)
    throw(link.port, *sent, *sent, earlier)
    counts = read_until(link.subscriber, lambda counts: counts.flawed[Flaw.OLD] == 6)

    assert (counts.received, counts.flawed, counts.unverified) == (5, {Flaw.OLD: 6}, 0)


def test_end_without_the_key_of_the_other_end_gets_nothing_and_counts(key, port):
    plain = f"udp://127.0.0.1:{port}"
    keyed = f"{plain}?key={key}"
    for theirs, ours, count in (
        (keyed, plain, lambda counts: counts.flawed[Flaw.SIZE]),
        (plain, keyed, lambda counts: counts.unverified),
    ):
        with open_subscriber(ours) as subscriber, open_publisher(theirs) as publisher:
            for _ in range(3):
                publisher.publish(now_frame())
            counts = read_until(subscriber, lambda counts, count=count: count(counts) == 3)
            assert (count(counts), counts.received) == (3, 0)


def test_strangers_are_counted_as_strangers(key, port):
    inlet = open_inlet(f"udp://127.0.0.1:{port}?from=127.0.0.1:1&key={key}")
    try:
        throw(port, tagged(b"right key, wrong sender", secret_of(key)))
        assert inlet.wait(PATIENCE)
        assert inlet.receive(np.zeros(99, np.uint8)) == NOTHING
        assert (inlet.refused, inlet.unverified) == (1, 0)
    finally:
        inlet.close()


@pytest.mark.parametrize(("size", "count"), [(100, udp.MOST_STRANGERS)])
def test_flood_of_forged_datagrams_leaves_the_reader_its_time(key, port, size, count):
    inlet, room = open_inlet(f"udp://127.0.0.1:{port}?key={key}"), np.zeros(100, np.uint8)
    try:
        throw(port, *[bytes(size)] * (count + 1), tagged(b"friend", secret_of(key)))
        assert inlet.wait(PATIENCE)
        assert inlet.receive(room) == NOTHING
        assert inlet.unverified == count
        assert inlet.receive(room) == 6
    finally:
        inlet.close()


# --- what was recorded and is sent again ---


class Keyed:
    """An reader of what a key has verified."""

    def __init__(self, *kinds):
        self.wire, self.clock = Wire(shares_clock=False), Clock()
        self.wire.is_keyed = True
        self.reader = MessageReader(self.wire, kinds, self.clock)

    def takes(self, data, after=0):
        self.wire.put(data)
        self.clock.now += after
        return len(list(self.reader.messages())) == 1


@pytest.mark.parametrize("silence", [0, 10**12])
def test_session_before_the_newest_is_never_believed_again(silence):
    keyed, message = Keyed(FRAME), frame()
    assert keyed.takes(sealed(message, 7, session=100))
    assert keyed.takes(sealed(message, 0, session=200))

    assert not keyed.takes(sealed(message, 8, session=100), silence)
    assert not keyed.takes(sealed(message, 0, session=150), silence)
    assert keyed.takes(sealed(message, 1, session=200))
    assert keyed.takes(sealed(message, 0, session=300))
    assert keyed.reader.counts.flawed == {Flaw.OLD: 2}


def test_earlier_session_is_not_believed_for_being_of_another_kind():
    keyed = Keyed(FRAME, POSES)
    assert keyed.takes(sealed(frame(), 0, session=200))

    assert not keyed.takes(sealed(Message(POSES, 1), 0, session=100))
    assert keyed.takes(sealed(Message(POSES, 1), 0, session=200))


# --- poses into a service ---


def test_forged_poses_do_not_reach_a_service(key, port, caplog):
    address = f"udp://127.0.0.1:{port}?key={key}"
    poses, message = MessageInput(address, 2), Message(POSES, 2)
    message.records["finger"] = 0, 1
    now = time.monotonic_ns()
    message.header["send_ns"] = message.records["pose_ns"] = now
    message.records["position"], message.records["velocity"], message.records["bend"] = 0.5, 0.0, np.nan
    throw(port, *(sealed(message, number, 2**63) for number in range(50)))
    try:
        deadline = time.monotonic() + PATIENCE
        while not any("50 not verified" in note for note in poses.notes) and time.monotonic() < deadline:
            assert not list(poses.poll(now))
        assert poses.notes == [f"{address}: 0 received, 0 lost, 50 not verified by the key"]
        assert caplog.messages == [
            f"{address}: a message is not verified by the key (expected that of its sender)"
        ]
        message.records["position"] = 0.1
        with open_publisher(address) as publisher:
            publisher.publish(message)
        while (hands := next(poses.poll(now), None)) is None and time.monotonic() < deadline:
            time.sleep(0.001)
        assert (hands.positions == 0.1).all()
    finally:
        poses.close()
