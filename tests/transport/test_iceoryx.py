"""Names and memory of iceoryx2: taken, left, given back by the dead, made by others."""

import ctypes
import errno
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from far_end import PATIENCE, FarEnd, frame, new_name, touch

from proximity.errors import PublishError
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

iceoryx2 = pytest.importorskip("iceoryx2", reason="there is no iceoryx2 for this machine")
iceoryx_names = pytest.importorskip("proximity.transport.iceoryx_names")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="where shared memory is elsewhere is not known")


@pytest.fixture
def name():
    return new_name()


@pytest.fixture
def address(name):
    return f"iox2://{name}"


def text_of(path):
    """What is in a file; nothing where it has just been removed, as other programs remove theirs."""
    try:
        return path.read_text()
    except OSError:
        return ""


def test_messages_arrive_at_every_subscriber(address):
    with open_publisher(address) as publisher:
        subscribers = [open_subscriber(address) for _ in range(2)]
        for _ in range(50):
            publisher.publish(touch(frame()))
        for subscriber in subscribers:
            assert [int(data[24:32].view("<u8")[0]) for data in subscriber.frames()] == list(range(50))
            subscriber.close()


def test_memory_is_enough_for_all_subscribers_at_their_own_pace(address):
    outlet, room = open_outlet(address), np.zeros(200, np.uint8)
    inlets = [open_inlet(address) for _ in range(iceoryx_names.SUBSCRIBERS)]
    for number in range(1500):
        outlet.send(np.full(100, number % 256, np.uint8))
        for pace, inlet in enumerate(inlets[:-1], start=1):
            if number % pace == 0:
                inlet.receive(room)
    numbers = []
    while inlets[-1].receive(room) != NOTHING:
        numbers.append(int(room[0]))

    assert numbers == [k % 256 for k in range(1500 - 64, 1500)]
    for end in (outlet, *inlets):
        end.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_signals_are_left_to_python(address):
    with FarEnd("interrupted", address, 1) as program:
        program.signal(signal.SIGINT)
        assert program.ended() == (0, "interrupted\n", "")
    with FarEnd("publish", address) as program:
        program.signal(signal.SIGTERM)
        assert program.ended() == (-signal.SIGTERM, "", "")


@on_linux
def test_memory_of_messages_is_there_before_the_first_one(address):
    """A publisher that finds none left when it writes is killed by the system."""
    with open_publisher(address) as publisher:
        (file,) = Path("/dev/shm").glob(f"*_{publisher._outlet._publisher.id.value}__0.data")

        assert file.stat().st_blocks * 512 >= file.stat().st_size > 1_000_000


@on_linux
def test_shared_memory_that_is_full_is_told_and_the_name_stays_free(address, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "posix_fallocate", refuse)
        with pytest.raises(PublishError, match=r"no room .* in /dev/shm \(No space .*expected 1\.1 MB"):
            open_publisher(address)
    open_publisher(address).close()


def test_one_subscriber_too_many_is_refused_until_another_leaves(address):
    inlets = [open_inlet(address) for _ in range(iceoryx_names.SUBSCRIBERS)]
    with pytest.raises(PublishError, match=r"iox2://.*: has 16 subscribers already, the maximum"):
        open_inlet(address)
    inlets.pop().close()
    inlets.append(open_inlet(address))
    for inlet in inlets:
        inlet.close()


def test_second_publisher_is_refused_and_told_who_publishes(address):
    """Without a word of the library."""
    ours = rf"is in use: process {os.getpid()} \(.*\) publishes there"
    with open_publisher(address), pytest.raises(PublishError, match=ours):
        open_publisher(address)
    with FarEnd("publish", address) as other:
        with pytest.raises(PublishError, match=rf"iox2://.*: is in use: process {other.pid} "):
            open_publisher(address)
        other.kill()
    with open_publisher(address), FarEnd("refused", address, 2) as other:
        assert f"is in use: process {os.getpid()} " in other.said
        assert other.ended() == (0, "", "")


@on_linux
def test_name_whose_maker_was_killed_while_making_it_comes_free(address, name):
    """iceoryx2 leaves a file that is still writable, and then refuses the name for ever."""
    folder = Path(iceoryx2.config.global_config().global_cfg.service_dir.to_string())
    inlet = open_inlet(address)
    file = next(path for path in folder.iterdir() if f'"proximity/{name}"' in text_of(path))
    text = text_of(file)
    inlet.close()
    assert not file.exists()
    file.write_text(text)
    file.chmod(0o600)

    open_publisher(address).close()
    assert not file.exists()


@on_linux
@pytest.mark.parametrize("kept", ["old", "just made"])
def test_memory_whose_maker_was_killed_while_making_it_hangs_nobody(address, kept):
    """Whoever joins iceoryx2 looks after the dead, and would wait for their half-made memory for ever."""
    inlet = open_inlet(address)
    with FarEnd("publish", address) as publisher:
        assert inlet.wait(PATIENCE)
        (connection,) = Path("/dev/shm").glob(f"*{inlet._subscriber.id.value}*.connection")
        publisher.kill()
    room = np.zeros(2000, np.uint8)
    while inlet.receive(room) != NOTHING:
        pass
    try:
        # Whatever joins meanwhile, in another test, may have cleared it away.
        connection.unlink(missing_ok=True)
        os.close(os.open(connection, os.O_CREAT | os.O_WRONLY, 0o200))
        if kept == "old":
            os.utime(connection, (1.0, 1.0))
        with FarEnd("publish", address) as publisher:
            assert publisher.said == "ready"
            assert inlet.wait(PATIENCE)
    finally:
        connection.unlink(missing_ok=True)  # or every program of this machine hangs
    inlet.close()


def service_of(name):
    """The builder of the service as another program would open it; the node is to be kept."""
    node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
    builder = node.service_builder(iceoryx2.ServiceName.new(f"proximity/{name}"))
    return node, builder.publish_subscribe(iceoryx2.Slice[ctypes.c_uint8])


def test_other_settings_are_refused(address, name):
    node, builder = service_of(name)
    service = builder.open_or_create()
    with pytest.raises(PublishError, match=r"other settings \(.*DoesNotSupport.*\); expected slices"):
        open_publisher(address)
    del service, builder, node
    open_publisher(address).close()


def test_place_that_another_program_gave_no_name_is_refused_too(address, name):
    """A publisher that is not ours cannot be told from the other programs that have the name open."""
    inlet = open_inlet(address)
    node, builder = service_of(name)
    theirs = builder.open().publisher_builder().initial_max_slice_len(64).create()
    with pytest.raises(PublishError, match="is in use: another process publishes there"):
        open_publisher(address)
    theirs.delete()
    inlet.close()
    del node


@pytest.mark.parametrize("place", ["x" * 300, "bär"])
def test_name_that_cannot_be_one_is_refused(place):
    with pytest.raises(PublishError, match="expected a name of at most 245 ASCII characters"):
        open_subscriber(f"iox2://{place}")
