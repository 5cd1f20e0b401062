"""Mailboxes in shared memory: access, rejected files, writers that die, and readers in C."""

import mmap
import os
import signal
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from compiling_c import WARNINGS, c_compiler, run
from far_end import FarEnd, frame, new_name, touch, until, until_valid

from proximity.core import CORE, library_in_c
from proximity.errors import PublishError
from proximity.message.c_header import header_text
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="mailboxes in shared memory are for Linux")
HEADER = struct.Struct("<QIIQqq24xQQQI36x")
"""Magic, layout, size of the header, ring, writer, instant, then head, floor, newest and count."""
RING, WRITER, FLOOR = 3, 4, 6


@pytest.fixture
def name():
    return new_name().replace("/", "-")


@pytest.fixture
def path(name):
    at = Path(f"/dev/shm/proximity.{name}")
    yield at
    at.unlink(missing_ok=True)  # left by a killed writer


@pytest.fixture
def address(name, path):
    return f"shm://{name}"


def taken(inlet, most=1000):
    """Return the first byte of each waiting message."""
    found, buffer = [], np.zeros(8192, np.uint8)
    while inlet.receive(buffer) != NOTHING:
        found.append(int(buffer[0]))
        assert len(found) < most
    return found


def test_only_its_owner_may_open_the_file_and_it_is_gone_after_close(address, path):
    outlet = open_outlet(address)
    outlet.send(np.full(100, 1, np.uint8))
    magic, layout, size, ring, writer, written_ns, head, floor, newest, count = HEADER.unpack(
        path.read_bytes()[: HEADER.size]
    )

    assert path.stat().st_mode & 0o777 == 0o600 and path.stat().st_size == size + ring
    assert (magic.to_bytes(8, "little"), layout, size, ring) == (b"DMAILBOX", 1, 128, 1 << 17)
    assert (writer, head, floor, newest, count) == (os.getpid(), 128, 0, 0, 1)
    assert 0 <= time.monotonic_ns() - written_ns < 60e9
    assert struct.unpack_from("<I", path.read_bytes(), 128) == (100,)
    outlet.close()
    assert not path.exists()


def test_one_writer_at_a_time(address):
    outlet = open_outlet(address)
    with pytest.raises(PublishError, match="is in use: another program publishes there"):
        open_outlet(address)
    outlet.close()
    open_outlet(address).close()


@pytest.mark.parametrize("location", ["x" * 201, "é" * 100])
def test_name_that_is_too_long_is_refused(location):
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match="at most 200 characters"):
            opener(f"shm://{location}")


def damaged(path, at, value):
    content = bytearray(path.read_bytes())
    content[at : at + len(value)] = value
    path.write_bytes(content)


DAMAGES = {
    "foreign": (lambda path: damaged(path, 0, b"SOMETHING"), "is not a mailbox of proximity, or damaged"),
    "short": (lambda path: path.write_bytes(path.read_bytes()[:1000]), "is not a mailbox"),
    "half a header": (lambda path: path.write_bytes(path.read_bytes()[:100]), "is not a mailbox"),
    "empty": (lambda path: path.write_bytes(b""), "is not a mailbox"),
    "another ring": (lambda path: damaged(path, 16, struct.pack("<Q", 3 << 16)), "is not a mailbox"),
    "old": (lambda path: damaged(path, 8, struct.pack("<I", 0)), "of another version of proximity"),
    "open to others": (lambda path: path.chmod(0o644), r"others may open it \(expected permissions 0600\)"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_file_that_is_no_mailbox_is_refused_by_both_ends(address, path, damage):
    outlet = open_outlet(address)
    content = path.read_bytes()
    outlet.close()
    path.write_bytes(content)
    path.chmod(0o600)
    change, sentence = DAMAGES[damage]
    change(path)
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match=f"{address}: .*{sentence}"):
            opener(address)


def test_link_to_another_file_is_refused(address, path, tmp_path):
    path.symlink_to(tmp_path / "elsewhere")
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match="is not a mailbox"):
            opener(address)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.skipif(os.name == "nt" or os.geteuid() != 0, reason="only root can give files away")
def test_file_of_another_user_is_refused(address, path):
    outlet = open_outlet(address)
    os.chown(path, 65534, 65534)
    with pytest.raises(PublishError, match="belongs to another user"):
        open_inlet(address)
    outlet.close()


def test_reader_sees_whether_its_writer_lives(address):
    inlet = open_inlet(address)
    assert not inlet.is_written
    with FarEnd("publish", address) as writer:
        until(lambda: inlet.wait(0.1))
        assert inlet.is_written
        writer.signal(signal.SIGSTOP)
        assert inlet.is_written
        writer.kill()
        assert not inlet.is_written
    outlet = open_outlet(address)
    outlet.send(np.full(9, 7, np.uint8))
    until(lambda: 7 in taken(inlet))
    assert inlet.is_written
    outlet.close()
    assert not inlet.is_written
    inlet.close()


def test_killed_writer_leaves_no_torn_message_and_its_readers_go_on(address):
    with open_subscriber(address) as subscriber:
        for round_number in range(5):
            with FarEnd("grow", address) as writer:
                until_valid(subscriber)
                time.sleep(0.01 * round_number)
                writer.kill()
        assert subscriber.counts.sessions >= 5 and not subscriber.counts.flawed


def test_file_removed_by_hand_is_followed_by_the_next(address, path):
    first, inlet = open_outlet(address), open_inlet(address)
    path.unlink()
    second = open_outlet(address)
    second.send(np.full(9, 5, np.uint8))
    until(lambda: taken(inlet) == [5])
    first.close()
    assert path.exists()
    for end in (second, inlet):
        end.close()


def test_reader_that_is_overtaken_goes_on_with_the_oldest_whole_message(address):
    outlet, inlet = open_outlet(address), open_inlet(address)
    for number in range(300):
        outlet.send(np.full(1736, number % 256, np.uint8))
    numbers = taken(inlet)

    assert len(numbers) == (1 << 17) // (1736 + 24)
    assert numbers == [k % 256 for k in range(300 - len(numbers), 300)]
    outlet.close()
    inlet.close()


def test_threads_see_whole_messages_while_the_ring_is_overwritten(address):
    outlet, inlet, over = open_outlet(address), open_inlet(address), threading.Event()
    outlet.send(np.zeros(8, np.uint8))

    def write():
        for number in range(60_000):
            outlet.send(np.full(3000 + number % 999, number % 251, np.uint8))
        over.set()

    writer, room, seen = threading.Thread(target=write), np.zeros(8192, np.uint8), 0
    writer.start()
    while not over.is_set():
        time.sleep(0.0005 * (seen % 3))
        while (size := inlet.receive(room)) != NOTHING:
            assert (room[:size] == room[0]).all()
            seen += 1
    writer.join()
    assert seen > 10
    outlet.close()
    inlet.close()


def test_one_thread_may_wait_while_another_follows_to_the_next_mailbox(address, path):
    """The memory was unmapped under the waiting thread, and the process crashed (SIGSEGV)."""
    outlets, inlet, is_over = [open_outlet(address)], open_inlet(address), threading.Event()
    buffer = np.empty(64, np.uint8)

    def wait():
        while not is_over.is_set():
            inlet.wait(0.02)

    waiting = threading.Thread(target=wait)
    waiting.start()
    for number in range(10):
        path.unlink()  # by hand: readers are not woken, and the mailbox is missing for a while
        until(lambda: inlet.receive(buffer) == NOTHING and not inlet.is_written)
        time.sleep(0.03)
        outlets.append(open_outlet(address))
        outlets[-1].send(np.full(8, number, np.uint8))
        until(lambda: inlet.receive(buffer) == 8)
        assert buffer[0] == number
    is_over.set()
    waiting.join()
    inlet.close()


def test_reader_does_not_follow_what_no_writer_has_left(address, path):
    """Invalid lengths and positions are skipped, within the ring."""
    outlet, inlet = open_outlet(address), open_inlet(address)
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
        for length in (2**32 - 1, 1 << 17, 5000):
            outlet.send(np.full(100, 1, np.uint8))
            head = struct.unpack_from("<Q", memory, 64)[0]
            struct.pack_into("<I", memory, 128 + (head - 128) % (1 << 17), length)
            assert taken(inlet) == []
        struct.pack_into("<Q", memory, 64, 2**63 + 8)
        taken(inlet)
    outlet.close()
    inlet.close()


def in_fork(work):
    """Run *work* in a forked child that exits normally; return its process id."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child


def test_forked_child_takes_nothing_from_its_parent(address, path):
    outlet, inlet = open_outlet(address), open_inlet(address)
    said, heard = os.pipe()

    def child():
        with pytest.raises(PublishError, match="is closed"):
            outlet.send(np.full(9, 1, np.uint8))
        outlet.close()
        os.write(heard, b"1")

    os.waitpid(in_fork(child), 0)

    assert os.read(said, 1) == b"1" and path.exists() and inlet.is_written
    outlet.send(np.full(9, 7, np.uint8))
    assert taken(inlet) == [7]
    for end in (outlet, inlet):
        end.close()
    os.close(said)
    os.close(heard)


def test_name_of_a_killed_writer_is_free_while_its_child_lives(address):
    ready, say = os.pipe()
    rest, end = os.pipe()

    def writer():
        outlet = open_outlet(address)
        outlet.send(np.full(9, 3, np.uint8))
        in_fork(lambda: (os.write(say, b"1"), os.close(end), os.read(rest, 1)))
        time.sleep(600)

    parent = in_fork(writer)
    assert os.read(ready, 1) == b"1"
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)
    outlet = open_outlet(address)
    outlet.close()
    for each in (ready, say, rest, end):
        os.close(each)


def test_mailbox_that_is_closed_and_has_its_name_is_none_and_nobody_spins(address, path):
    outlet, inlet = open_outlet(address), open_inlet(address)
    outlet.send(np.full(9, 3, np.uint8))
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
        struct.pack_into("<q", memory, 24, 0)

    assert taken(inlet) == [3]
    assert not inlet.wait(0.3)
    assert not inlet.is_written
    assert not inlet._is_open  # it polls, as without a mailbox
    outlet.close()
    inlet.close()


READER = """
#define _GNU_SOURCE
#include "proximity_mailbox.h"
#include "proximity_message.h"
static union { proximity_frame_header header; char bytes[65536]; } room;
int main(int count, char **words)
{
    proximity_mailbox in, out;
    int whole = 0, outcome;
    while ((outcome = proximity_mailbox_open(&in, words[1])) == PROXIMITY_MAILBOX_NOBODY)
        usleep(1000);
    if (outcome == PROXIMITY_MAILBOX_OK)
        outcome = proximity_mailbox_create(&out, words[2], sizeof room);
    if (count != 3 || outcome != PROXIMITY_MAILBOX_OK)
        return printf("%s\\n", proximity_mailbox_reason(outcome)), 1;
    while (whole < 20) {
        int64_t size;
        proximity_mailbox_wait(&in, proximity_mailbox_now_ns() + 10000000);
        while ((size = proximity_mailbox_read(&in, &room, sizeof room)) != PROXIMITY_MAILBOX_NOTHING)
            if (proximity_check_frame(&room, (size_t)size) == PROXIMITY_FLAW_NONE)
                whole += proximity_mailbox_write(&out, &room, (uint32_t)size);
    }
    printf("%d %d\\n", whole, proximity_mailbox_is_written(&in));
    proximity_mailbox_close(&in);
    proximity_mailbox_close(&out);
    return 0;
}
"""


def test_program_in_c_reads_and_writes(address, name, tmp_path):
    source, program = tmp_path / "reader.c", tmp_path / "reader"
    source.write_text(READER)
    (tmp_path / "proximity_message.h").write_text(header_text())
    run(c_compiler(), "-std=c99", *WARNINGS, f"-I{CORE / 'mailbox'}", source, "-lm", "-o", program)
    said = []
    with open_publisher(address) as publisher, open_subscriber(f"{address}-back") as subscriber:
        reader = threading.Thread(target=lambda: said.append(run(program, name, f"{name}-back")))
        reader.start()
        until(lambda: publisher.publish(touch(frame())) or (subscriber.read() and said))
        reader.join()
        assert subscriber.read() and subscriber.counts.received >= 20 and not subscriber.counts.flawed
    count, is_written = said[0].split()
    assert int(count) >= 20 and is_written == "1"


def test_without_the_compiled_library_the_error_says_what_is_needed(address, monkeypatch):
    library_in_c.libraries.cache_clear()
    monkeypatch.setattr(library_in_c, "LIBRARIES", ())
    try:
        with pytest.raises(PublishError, match=r"needs Linux and the library in C .* udp:// needs neither"):
            open_inlet(address)
    finally:
        library_in_c.libraries.cache_clear()
