"""The bridge between pages and a service: access, accepted messages, rejected messages."""

import asyncio
import contextlib
import http.client
import json
import threading
import time

import numpy as np
import pytest
import shapes
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from proximity.message import (
    CHANGES,
    FRAME,
    MEASURED,
    MOVES,
    PATH_POSES,
    POSES,
    Message,
    PartAction,
    State,
    parts_of,
    validate,
)
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.transport import open_inlet, open_publisher
from proximity.web.bridge import MAX_IN_FLIGHT, Bridge
from proximity.web.page_content import scene_page_files, shown_contents
from proximity.web.page_inbox import PageInbox
from proximity.web.server.access import HELD_UP, MAX_BYTES, TOO_MUCH, UNFIT, WRONG_TOKEN, Access
from proximity.web.server.page_server import document
from proximity.web.sources import LiveFrames, OtherPrograms, Shown

TOKEN = "the token of this test"
PATIENCE = 10.0  # s
COUNT = 5
SETTLED = 0.06  # s for which a clock is observed before it is used


class Running:
    """A bridge in a thread, with a mailbox as its service."""

    def __init__(self, name):
        self.scene = Scene(
            [Solid(*shapes.cube(0.1), name="cube"), Solid(*shapes.cube(0.1, (1, 0, 0)), name="b")]
        )
        addresses = [f"mailbox:{name}-{end}" for end in ("frames", "poses", "moves", "changes")]
        self.frames = open_publisher(addresses[0])
        self.poses, self.moves, self.changes = map(open_inlet, addresses[1:])
        self.feed = PageInbox(*addresses[1:], self.scene, COUNT)
        content = shown_contents(self.scene)
        self.shown = Shown("test", self.scene, LiveFrames(addresses[0]), self.feed, content)
        self.stop = threading.Event()
        self.opened = contextlib.ExitStack()
        self.begun = threading.Event()
        self.thread = threading.Thread(target=lambda: asyncio.run(self.run()), daemon=True)
        self.thread.start()
        assert self.begun.wait(PATIENCE)

    async def run(self):
        access = Access((TOKEN,), frozenset())
        self.bridge = Bridge(self.shown, access, scene_page_files())
        server = await self.bridge.server.listen("127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self.bridge.server.access = Access.of(
            (TOKEN,), ("127.0.0.1", "localhost"), self.port, is_secure=False
        )
        publishing = asyncio.create_task(self.bridge.publish_frames())
        self.begun.set()
        while not self.stop.is_set():
            await asyncio.sleep(0.01)
        publishing.cancel()
        server.close()

    def close(self):
        self.opened.close()
        self.stop.set()
        self.thread.join(PATIENCE)
        for each in (self.frames, self.poses, self.moves, self.changes, self.feed, self.shown.frames):
            each.close()

    def page(self, *, token=TOKEN, origin=None, feeds=True):
        """Return an admitted page, after its welcome."""
        page = self.raw(origin=origin)
        page.send(json.dumps({"hello": token}))
        welcome = json.loads(page.recv(PATIENCE))["welcome"]
        assert welcome["feeds"] is feeds and welcome["has_geometry"]
        return page

    def raw(self, *, origin=None, host=None):
        origin = f"http://127.0.0.1:{self.port}" if origin is None else origin
        return self.opened.enter_context(
            connect(f"ws://{host or '127.0.0.1'}:{self.port}/live", origin=origin or None, max_size=None)
        )

    def get(self, path="/", host=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{self.port}", **headers})
        answer = connection.getresponse()
        answer.content = answer.read()
        return answer

    def shown_to(self, token, name):
        """Return the response to a page with a token, or None if refused."""
        answer = self.get(f"/shown/{name}", Authorization=f"Bearer {token}")
        return answer.content if answer.status == 200 else None


@pytest.fixture
def bridge(request):
    running = Running(request.node.name.replace("[", "-"))
    yield running
    running.close()


def received(inlet, kind, patience=PATIENCE):
    """Return the records of the next message at an address."""
    buffer, ends = np.zeros(70_000, np.uint8), time.monotonic() + patience
    while time.monotonic() < ends:
        size = inlet.receive(buffer)
        if size > 0:
            assert validate(buffer[:size], kind) is None
            return parts_of(buffer[:size].copy(), kind)[1]
        time.sleep(0.002)
    return None


def now():
    """Return the time of a page's clock, whose origin is arbitrary."""
    return time.monotonic_ns() - 7_000_000_000


def poses(kind=POSES, **changes):
    message = Message(kind, 2)
    message.header["send_ns"] = message.records["pose_ns"] = now()
    message.records["finger"] = [0, 3]
    message.records["position"] = [(0.1, 0.2, 0.3), (1, 2, 3)]
    for name, value in changes.items():
        message.records[name] = value
    return message.seal(1, 2).tobytes()


def move(name=b"cube", translation=(0.1, 0, 0), rotation=None):
    message = Message(MOVES, 1)
    message.header["send_ns"] = message.records["pose_ns"] = now()
    message.records["name"] = name
    message.records["rotation"] = np.eye(3) if rotation is None else rotation
    message.records["translation"] = translation
    return message.seal(1, 2).tobytes()


def settle(page):
    """Send messages until the bridge has observed the page's clock."""
    page.send(poses())
    time.sleep(SETTLED)
    page.send(poses())


def closed(page):
    """Return the closing code and reason of a page's connection; messages before are skipped."""
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            page.recv(PATIENCE)
    return caught.value.rcvd.code, caught.value.rcvd.reason


# Access


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1", "https://127.0.0.1:{port}"]
)
def test_a_foreign_origin_is_refused(bridge, origin):
    with pytest.raises(InvalidStatus) as caught:
        bridge.raw(origin=origin.format(port=bridge.port))
    assert caught.value.response.status_code == 403


def test_a_live_connection_without_an_origin_is_refused(bridge):
    with pytest.raises(InvalidStatus) as caught:
        bridge.raw(origin="")
    assert caught.value.response.status_code == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "evil.example:{port}", "127.0.0.1:{port}.evil.example"]
)
def test_a_foreign_host_is_refused(bridge, host):
    answer = bridge.get(host=host.format(port=bridge.port))
    assert answer.status == 421
    assert bridge.get(path="/live", host=host.format(port=bridge.port)).status == 421


def test_files_have_the_headers_that_shut_others_out(bridge):
    answer = bridge.get()

    assert answer.status == 200
    assert answer.getheader("Cross-Origin-Opener-Policy") == "same-origin"
    assert answer.getheader("Cross-Origin-Embedder-Policy") == "require-corp"
    assert "default-src 'none'" in answer.getheader("Content-Security-Policy")
    assert bridge.get("/nothing").status == 404
    assert bridge.get("/../bridge.py").status == 404
    assert bridge.get(Origin="http://evil.example").status == 403


@pytest.mark.parametrize(
    "hello",
    ['{"hello": "wrong"}', '{"hello": null}', "{}", "[]", "no document", '{"hello": {"a": 1}}', b"bytes"],
)
def test_without_the_token_nobody_comes_in(bridge, hello):
    page = bridge.raw()
    page.send(hello)

    code, reason = closed(page)

    assert code == WRONG_TOKEN
    assert TOKEN not in reason
    assert bridge.bridge._clients == []


def test_page_that_is_busy_for_too_long_is_asked_to_try_again(bridge, monkeypatch):
    """A browser with software rendering may send its hello long after it connects."""
    monkeypatch.setattr("proximity.web.server.page_server.HELLO_S", 0.1)

    code, reason = closed(bridge.raw())

    assert code == HELD_UP
    assert "in time" in reason


def test_localhost_is_the_same_page(bridge):
    page = bridge.raw(origin=f"http://localhost:{bridge.port}", host="localhost")
    page.send(json.dumps({"hello": TOKEN}))
    assert "welcome" in json.loads(page.recv(PATIENCE))


# Accepted messages


def test_poses_reach_the_service_on_its_clock(bridge):
    page = bridge.page()
    page.send(poses())
    time.sleep(SETTLED)
    before = time.monotonic_ns()
    page.send(poses())

    records = received(bridge.poses, POSES)

    assert records["finger"].tolist() == [0, 3]
    np.testing.assert_array_equal(records["position"], [(0.1, 0.2, 0.3), (1, 2, 3)])
    age = time.monotonic_ns() - records["pose_ns"]
    assert (age >= 0).all()  # never from the future
    assert (records["pose_ns"] > before - 50_000_000).all()


def test_paths_reach_the_service(bridge):
    page = bridge.page()
    settle(page)
    assert received(bridge.poses, POSES) is not None
    corners = np.arange(2 * 65 * 3, dtype=float).reshape(2, 65, 3) / 100
    page.send(poses(PATH_POSES, corners=corners))

    np.testing.assert_array_equal(received(bridge.poses, PATH_POSES)["corners"], corners)


def test_a_page_that_goes_leaves_no_finger_tracked(bridge):
    page = bridge.page()
    settle(page)
    assert received(bridge.poses, POSES) is not None
    left = time.monotonic()
    page.socket.close()  # as when its process ends

    records = received(bridge.poses, POSES)

    assert time.monotonic() - left < 0.1
    assert records["finger"].tolist() == list(range(COUNT))
    assert np.isnan(records["position"]).all()


def test_moves_reach_service_and_all_pages(bridge):
    page, other = bridge.page(), bridge.page(feeds=False)
    settle(page)
    page.send(move())

    (record,) = received(bridge.moves, MOVES)

    assert record["translation"].tolist() == [0.1, 0, 0]
    for each in (page, other):
        data = np.frombuffer(each.recv(PATIENCE), np.uint8)
        assert parts_of(data, MOVES)[1]["name"].tolist() == [b"cube"]
    assert bridge.scene.part("cube").pose.translation.tolist() == [0.1, 0, 0]
    # A later page is informed immediately.
    later = bridge.page(feeds=False)
    data = np.frombuffer(later.recv(PATIENCE), np.uint8)
    assert parts_of(data, MOVES)[1]["translation"].tolist() == [[0.1, 0, 0]]


def test_the_first_move_is_taken_where_only_the_clock_was_asked_for(bridge):
    """Regression: it was lost, as a page without a hand had sent no message with its clock."""
    page = bridge.page()
    for _ in range(2):
        page.send(json.dumps({"clock": now() / 1e6}))
        time.sleep(SETTLED)
    page.send(move())

    assert received(bridge.moves, MOVES)["translation"].tolist() == [[0.1, 0, 0]]


def change(name, action):
    message = Message(CHANGES, 1)
    message.records["name"], message.records["action"] = name, action
    return bytes(message.seal(0, 0))


def test_what_a_page_hides_no_distance_knows_and_all_pages_hear_of_it(bridge):
    page, other = bridge.page(), bridge.page(feeds=False)
    page.send(change(b"b", PartAction.HIDE))

    (record,) = received(bridge.changes, CHANGES)

    assert (record["name"], record["action"]) == (b"b", PartAction.HIDE)
    for each in (page, other):
        assert parts_of(np.frombuffer(each.recv(PATIENCE), np.uint8), CHANGES)[1]["name"].tolist() == [b"b"]
    assert bridge.scene.part("b").is_hidden
    later = bridge.page(feeds=False)
    told = parts_of(np.frombuffer(later.recv(PATIENCE), np.uint8), CHANGES)[1]
    assert (told["name"].tolist(), told["action"].tolist()) == ([b"b"], [PartAction.HIDE])
    page.send(change(b"b", PartAction.SHOW))
    assert received(bridge.changes, CHANGES)["action"].tolist() == [PartAction.SHOW]
    assert bridge.feed.state() == []


@pytest.mark.parametrize("action", [PartAction.REMOVE, PartAction.DESCRIBE, 99])
def test_a_page_may_hide_and_show_and_change_nothing_else(bridge, action):
    page = bridge.page()
    page.send(change(b"b", action))

    assert closed(page)[0] == UNFIT
    assert received(bridge.changes, CHANGES, 0.1) is None


def test_a_page_that_watches_sees_what_other_programs_move_and_hide(tmp_path):
    address = f"shm://web-{tmp_path.name}"
    scene = Scene([Solid(*shapes.cube(0.1), name="cube")])
    moved, hidden = Message(MOVES, 1), Message(CHANGES, 1)
    moved.records["name"] = hidden.records["name"] = b"cube"
    moved.records["rotation"], moved.records["translation"] = np.eye(3), (0.2, 0, 0)
    moved.records["pose_ns"] = time.monotonic_ns()

    addresses = [address, address, None, "udp://127.0.0.1:9"]
    with contextlib.closing(OtherPrograms(addresses, scene)) as others, open_publisher(address) as publisher:
        for message in (moved, hidden):
            message.header["send_ns"] = time.monotonic_ns()
            publisher.publish(message)
        got, ends = [], time.monotonic() + PATIENCE
        while len(got) < 2 and time.monotonic() < ends:
            got += others.messages()

    assert [int.from_bytes(each[:4], "little") for each in got] == [MOVES.magic, CHANGES.magic]
    assert scene.part("cube").pose.translation.tolist() == [0.2, 0, 0]
    assert scene.part("cube").is_hidden


def test_a_second_page_watches_until_it_takes_over(bridge):
    first, second = bridge.page(), bridge.page(feeds=False)
    settle(second)
    assert received(bridge.poses, POSES, 0.1) is None

    second.send(json.dumps({"feed": True}))

    assert json.loads(second.recv(PATIENCE)) == {"feeds": True}
    assert json.loads(first.recv(PATIENCE)) == {"feeds": False}
    assert np.isnan(received(bridge.poses, POSES)["position"]).all()  # of the first page
    settle(second)
    assert received(bridge.poses, POSES)["finger"].tolist() == [0, 3]


def test_when_the_page_that_feeds_goes_another_may(bridge):
    first, second = bridge.page(), bridge.page(feeds=False)
    first.close()
    assert json.loads(second.recv(PATIENCE)) == {"feeds": True}


# Frames


def frame(sequence, pose_ns):
    message = Message(FRAME, COUNT)
    message.header["pose_ns"] = message.header["start_ns"] = message.header["publish_ns"] = pose_ns
    message.header["valid_until_ns"] = pose_ns + 10**8
    message.header["period_ns"] = 10**6
    message.header["state"] = State.DEGRADED
    message.records["finger"] = np.arange(COUNT)
    message.records["normal"] = np.nan
    return message


def test_frames_come_byte_for_byte_and_two_at_max_are_under_way(bridge):
    page = bridge.page()
    for number in range(60):
        bridge.frames.publish(frame(number, time.monotonic_ns()))
        time.sleep(0.006)
    got = []
    with contextlib.suppress(TimeoutError):
        while True:
            got.append(page.recv(0.2))

    assert len(got) == MAX_IN_FLIGHT
    assert all(validate(np.frombuffer(each, np.uint8), FRAME) is None for each in got)
    page.send("ok")
    newest = np.frombuffer(page.recv(PATIENCE), np.uint8)
    assert parts_of(newest, FRAME)[0]["sequence"] == 59  # the ones in between are left out


def test_a_service_that_begins_anew_is_told_where_parts_are(bridge):
    page = bridge.page()
    bridge.frames.publish(frame(0, time.monotonic_ns()))
    settle(page)
    page.send(move())
    assert received(bridge.moves, MOVES) is not None
    bridge.frames.session += 1
    ends = time.monotonic() + PATIENCE
    while (records := received(bridge.moves, MOVES, 0.05)) is None and time.monotonic() < ends:
        bridge.frames.publish(frame(0, time.monotonic_ns()))

    assert records["translation"].tolist() == [[0.1, 0, 0]]


# Shown resources


def test_what_is_shown_is_given_for_the_token(bridge):
    scene = bridge.shown_to(TOKEN, "scene")
    assert bridge.shown_to(TOKEN, "geometry")[:4] == b"glTF"
    assert bridge.shown_to(TOKEN, "welcome") == b"null"  # a service sends the welcome later, by socket
    assert len(scene) > 1000 and bridge.shown_to(TOKEN, "scene/../welcome") is None
    for token in ("", "wrong"):
        assert bridge.shown_to(token, "scene") is None
    assert bridge.bridge.server.refused["wrong token"] == 2


# Rejected messages


def test_an_oversize_message_ends_the_connection(bridge):
    page = bridge.page()
    page.send(b"x" * (MAX_BYTES + 1))

    assert closed(page)[0] == 1009
    assert bridge.page() is not None  # the next one is admitted


def test_a_flood_ends_the_connection(bridge):
    page = bridge.page()
    with contextlib.suppress(ConnectionClosed):
        for _ in range(20_000):
            page.send("ok")

    assert closed(page)[0] == TOO_MUCH
    assert bridge.page() is not None


def damaged(data, at, value=0xFF):
    return data[:at] + bytes([data[at] ^ value]) + data[at + 1 :]


def measured():
    message = Message(MEASURED, 1)
    message.header["send_ns"] = message.records["measured_ns"] = now()
    return message.seal(1, 2).tobytes()


def move_often(count):
    message = Message(MOVES, count)
    message.header["send_ns"] = message.records["pose_ns"] = now()
    message.records["name"], message.records["translation"] = b"a", (0.1, 0, 0)
    return message.seal(1, 2).tobytes()


FORGED = {
    "truncated": lambda: poses()[:-8],
    "shorter than a header": lambda: poses()[:20],
    "four bytes": lambda: poses()[:4],
    "nothing": lambda: b"",
    "damaged": lambda: damaged(poses(), 60),
    "its checksum": lambda: damaged(poses(), 5),
    "another version": lambda: damaged(poses(), 8),
    "a frame": lambda: frame(0, now()).seal(1, 2).tobytes(),
    "a sensor": measured,
    "a finger too many": lambda: poses(finger=[0, COUNT]),
    "an infinite place": lambda: poses(position=[(np.inf, 0, 0), (0, 0, 0)]),
    "a place far away": lambda: poses(position=[(1e7, 0, 0), (0, 0, 0)]),
    "an instant far away": lambda: poses(pose_ns=[0, 0]),
    "a part that is not there": lambda: move(b"nobody"),
    "no rotation": lambda: move(rotation=np.full((3, 3), 2.0)),
    "a mirror": lambda: move(rotation=np.diag([1.0, 1.0, -1.0])),
    "a part to infinity": lambda: move(translation=(np.nan, 0, 0)),
    "a question that there is not": lambda: json.dumps({"run": "rm"}),
    "a deep document": lambda: "[" * 50_000,
    "a part a hundred times": lambda: move_often(300),
    "half a letter": lambda: '{"clearance": ["\\ud83d", "b"]}',
    "half a letter in a name": lambda: '{"\\uDE00": 1}',
    "a number of 400 digits": lambda: '{"clock": ' + "9" * 400 + "}",
    "a number without end": lambda: '{"at_ms": 1e999}',
    "no number": lambda: '{"clock": NaN}',
    "a clock that is off": lambda: '{"clock": 1e308}',
}


@pytest.mark.parametrize("name", FORGED)
def test_what_is_forged_ends_the_connection_and_reaches_nobody(bridge, name):
    page = bridge.page()
    settle(page)
    assert received(bridge.poses, POSES) is not None
    page.send(FORGED[name]())

    assert closed(page)[0] == UNFIT
    gone = received(bridge.poses, POSES)
    assert np.isnan(gone["position"]).all()  # only its fingers are withdrawn
    assert received(bridge.poses, POSES, 0.05) is None
    assert received(bridge.moves, MOVES, 0.05) is None
    assert bridge.page() is not None


def test_messages_that_were_held_up_end_the_connection(bridge):
    page = bridge.page()
    settle(page)
    time.sleep(1.6)  # messages of a connection are in order: a late one follows a silence
    late = Message(POSES, 1)
    late.header["send_ns"] = late.records["pose_ns"] = now() - 1_400_000_000
    page.send(late.seal(1, 2).tobytes())

    code, reason = closed(page)

    assert (code, reason) == (4408, "messages of this page are delayed by more than a second")


def test_why_a_page_was_disconnected_is_logged_once_and_counted(bridge, caplog):
    for _ in range(2):
        page = bridge.page()
        page.send('{"clearance": ["\\ud83d", "b"]}')
        assert closed(page) == (UNFIT, "a text has half of a surrogate pair")
    assert caplog.messages == ["a page is disconnected: a text has half of a surrogate pair"]
    assert bridge.bridge.server.refused["a text has half of a surrogate pair"] == 2


def test_a_letter_beyond_the_first_plane_is_no_half():
    assert document('{"clearance": ["\\ud83d\\ude00", "b"], "clock": -12.5}')["clearance"][0] == "\U0001f600"
