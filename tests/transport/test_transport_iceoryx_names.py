"""Names in shared memory: taken, left, given back by the dead, made by others."""

import ctypes
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from far_end import PATIENCE, FarEnd, frame, new_name, touch

from proximity.errors import PublishError
from proximity.transport import open_inlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

iceoryx2 = pytest.importorskip("iceoryx2", reason="there is no iceoryx2 for this machine")
iceoryx_names = pytest.importorskip("proximity.transport.iceoryx_names")


@pytest.fixture
def address():
    return f"iox2://{new_name()}"


def place_of(address):
    return address.removeprefix("iox2://")


def text_of(path):
    """What is in a file; nothing where it has just been removed, as other programs remove theirs."""
    try:
        return path.read_text()
    except OSError:
        return ""


def test_one_subscriber_too_many_is_refused_until_another_leaves(address):
    inlets = [open_inlet(address) for _ in range(iceoryx_names.SUBSCRIBERS)]

    with pytest.raises(PublishError, match=r"iox2://.*: has 16 subscribers already, the maximum"):
        open_inlet(address)
    inlets.pop().close()
    inlets.append(open_inlet(address))
    for inlet in inlets:
        inlet.close()


def test_second_publisher_is_refused_and_told_who_publishes(address):
    with (
        open_publisher(address),
        pytest.raises(PublishError, match=rf"is in use: process {os.getpid()} \(.*\) publishes there"),
    ):
        open_publisher(address)
    with (
        FarEnd("publish", address) as other,
        pytest.raises(PublishError, match=rf"iox2://.*: is in use: process {other.pid} "),
    ):
        open_publisher(address)


def test_other_process_is_refused_without_a_word_of_the_library(address):
    with open_publisher(address), FarEnd("refused", address, 2) as other:
        assert f"is in use: process {os.getpid()} " in other.said
        assert other.ended() == (0, "", "")


def test_name_is_free_after_close_and_closing_twice_is_once(address):
    for _ in range(40):
        publisher, subscriber = open_publisher(address), open_subscriber(address)
        publisher.publish(touch(frame()))
        assert subscriber.read().is_new
        for end in (publisher, subscriber, publisher, subscriber):
            end.close()


def test_killed_subscribers_keep_neither_the_publisher_nor_their_places(address):
    with open_publisher(address) as publisher:
        for role in ("hold", "subscribe", "hold", "subscribe", "hold"):
            with FarEnd(role, address, 9) as reader:
                assert reader.said == "ready"  # though nine dead ones have most of the places
                for _ in range(100):
                    publisher.publish(touch(frame()))
                reader.kill()
                publisher.publish(touch(frame()))
        with open_subscriber(address) as subscriber:
            publisher.publish(touch(frame()))
            assert subscriber.read().is_valid


def test_process_that_ends_without_closing_leaves_nothing(address):
    with FarEnd("hold", address, 16) as reader:
        assert reader.ended(let_go=True) == (0, "", "")
    inlets = [open_inlet(address) for _ in range(16)]
    for inlet in inlets:
        inlet.close()


@pytest.mark.skipif(sys.platform != "linux", reason="how unfinished names look elsewhere is not known")
def test_name_whose_maker_was_killed_while_making_it_comes_free(address):
    """iceoryx2 leaves a file that is still writable, and then refuses the name for ever."""
    folder = Path(iceoryx2.config.global_config().global_cfg.service_dir.to_string())
    inlet = open_inlet(address)
    file = next(path for path in folder.iterdir() if f'"proximity/{place_of(address)}"' in text_of(path))
    text = text_of(file)
    inlet.close()
    assert not file.exists()
    file.write_text(text)
    file.chmod(0o600)

    publisher = open_publisher(address)
    publisher.close()
    assert not file.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="shared memory has no files elsewhere")
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


def test_other_settings_are_refused(address):
    node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
    name = iceoryx2.ServiceName.new(f"proximity/{place_of(address)}")
    builder = node.service_builder(name).publish_subscribe(iceoryx2.Slice[ctypes.c_uint8])
    service = builder.open_or_create()

    with pytest.raises(
        PublishError,
        match=r"another program made it with other settings \(.*DoesNotSupport.*\); expected slices",
    ):
        open_publisher(address)
    del service, builder, node
    open_publisher(address).close()


def test_place_that_another_program_gave_no_name_is_refused_too(address):
    """A publisher that is not ours cannot be told from the other programs that have the name open."""
    node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
    inlet = open_inlet(address)
    name = iceoryx2.ServiceName.new(f"proximity/{place_of(address)}")
    service = node.service_builder(name).publish_subscribe(iceoryx2.Slice[ctypes.c_uint8]).open()
    theirs = service.publisher_builder().initial_max_slice_len(64).create()

    with pytest.raises(PublishError, match="is in use: another process publishes there"):
        open_publisher(address)
    theirs.delete()
    inlet.close()


@pytest.mark.parametrize("place", ["x" * 300, "bär"])
def test_name_that_cannot_be_one_is_refused(place):
    with pytest.raises(PublishError, match="expected a name of at most 245 ASCII characters"):
        open_subscriber(f"iox2://{place}")
