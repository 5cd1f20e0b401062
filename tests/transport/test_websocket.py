"""``ws://``: web pages connect to the program, which sends to all of them and receives their messages."""

import subprocess
import sys

import numpy as np
import pytest
from ports import free_port
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from proximity.errors import PublishError
from proximity.transport import open_inlet, open_outlet, open_subscriber
from proximity.transport.link import NOTHING

HOME = "http://localhost:5173"


@pytest.fixture
def url():
    return f"ws://127.0.0.1:{free_port(kind=1)}"


def received(inlet):
    buffer = np.zeros(100, np.uint8)
    size = inlet.receive(buffer)
    return None if size == NOTHING else buffer[:size].tobytes()


def test_every_page_gets_what_is_sent_and_all_is_taken_that_pages_send(url):
    outlet, inlet = open_outlet(url), open_inlet(url)
    with connect(url, origin=HOME) as first, connect(url) as second:
        first.send(b"pose")
        assert inlet.wait(60) and received(inlet) == b"pose"
        second.send(b"another")
        assert inlet.wait(60) and received(inlet) == b"another"
        assert received(inlet) is None and not inlet.wait(0.0)
        outlet.send(np.arange(3, dtype=np.uint8))
        assert [page.recv(60) for page in (first, second)] == [b"\0\1\2"] * 2
    for end in (outlet, outlet, inlet):
        end.close()
    with pytest.raises(OSError), connect(url):
        pass


def test_paths_of_a_port_are_apart(url):
    frames, moves = open_outlet(url), open_inlet(f"{url}/moves")
    try:
        with connect(url) as page, connect(f"{url}/moves") as mover:
            mover.send(b"move")
            assert moves.wait(60) and received(moves) == b"move"
            page.send(b"nobody takes this")
            frames.send(np.zeros(1, np.uint8))
            assert page.recv(60) == b"\0" and not moves.wait(0.0)
            with pytest.raises(TimeoutError):
                mover.recv(0.05)
    finally:
        frames.close()
        moves.close()


@pytest.mark.parametrize(
    ("option", "origin", "may_connect"),
    [
        ("", HOME, True),
        ("", "https://127.0.0.1:8443", True),
        ("", "https://elsewhere.example", False),
        ("", "http://localhost.elsewhere.example", False),
        ("?origin=https://my.site", "https://my.site", True),
        ("?origin=https://my.site", "https://your.site", False),
    ],
)
def test_pages_of_other_sites_are_turned_away(url, option, origin, may_connect):
    outlet = open_outlet(url + option)
    try:
        if may_connect:
            with connect(url, origin=origin):
                pass
        else:
            with pytest.raises(InvalidStatus, match="403"), connect(url, origin=origin):
                pass
    finally:
        outlet.close()


def test_page_that_does_not_read_misses_messages_and_delays_nobody(url):
    outlet = open_outlet(url)
    with (
        connect(url) as reader,
        connect(url, ping_interval=None, close_timeout=0.1),
    ):  # this one does not read
        for number in range(1000):  # 10 MB: more than the system buffers
            outlet.send(np.full(10_000, number % 256, np.uint8))
            assert reader.recv(60)[0] == number % 256
    outlet.close()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("ws://0.0.0.0:8765", "expected ws://127.0.0.1:PORT or ws://127.0.0.1:PORT/PATH"),
        ("ws://127.0.0.1", "expected ws://127.0.0.1:PORT"),
        ("ws://127.0.0.1:65536", "expected ws://127.0.0.1:PORT"),
        ("ws://127.0.0.1:8765?key=a", "unknown option 'key' \\(expected origin\\)"),
    ],
)
def test_addresses_that_cannot_be_are_refused(text, why):
    with pytest.raises(PublishError, match=why):
        open_outlet(text)


def test_port_has_one_site_and_one_process(url):
    outlet = open_outlet(url)
    with pytest.raises(PublishError, match="the port is open for pages of this machine already"):
        open_inlet(f"{url}?origin=https://my.site")
    code = f"from proximity.transport import open_outlet; open_outlet('{url}')"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert f"{url}: cannot listen there" in other.stderr
    outlet.close()
    open_outlet(url).close()
    with pytest.raises(PublishError, match="is closed"):
        outlet.send(np.zeros(1, np.uint8))


def test_reader_of_frames_is_told_that_pages_connect():
    with pytest.raises(PublishError, match=r"ws://127\.0\.0\.1:8765: is for web pages"):
        open_subscriber("ws://127.0.0.1:8765")
