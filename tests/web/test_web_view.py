"""`proximity view`, `serve --web` and `proximity.view`: their processes, and that all of them end."""

import json
import re
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit
from urllib.request import Request, url2pathname, urlopen

import numpy as np
import psutil
import pytest
import shapes
from browsing import Viewing
from far_end import until
from project import MESHES
from websockets.sync.client import connect

import proximity
from proximity import cli
from proximity.errors import MissingLibraryError, RecordingError, ServiceError
from proximity.message import FRAME, Message, State
from proximity.recording import FrameLog
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service.config import read_scene_file
from proximity.web import running_page
from proximity.web.page_process import PageSettings, _open_parts, page_settings, run_page
from proximity.web.sources import LoggedFrames

PATIENCE = 120.0
BRACKET = MESHES / "bracket.stl"


def shown_at(url, name):
    """Return a resource of a page, read over HTTP."""
    address, _, token = url.partition("#token=")
    asked = Request(f"{address}shown/{name}", headers={"Authorization": f"Bearer {token}"})
    with urlopen(asked, timeout=PATIENCE) as answer:
        return answer.read()


def welcomed(url):
    """Return a live page's welcome, and the kinds of the following messages."""
    assert shown_at(url, "welcome") == b"null"
    address, _, token = url.partition("/#token=")
    with connect(address.replace("http", "ws") + "/live", origin=address, max_size=None) as page:
        page.send(json.dumps({"hello": token}))
        welcome = json.loads(page.recv(PATIENCE))["welcome"]
        frame = page.recv(PATIENCE)[:4]
    return welcome, shown_at(url, "geometry")[:4], frame


def is_over(process):
    """Test whether a process has ended; a child is a zombie then."""
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def test_view_is_one_process_and_its_page_computes_by_itself():
    with Viewing(BRACKET) as running:
        welcome = json.loads(shown_at(running.url, "welcome"))
        geometry = shown_at(running.url, "geometry")[:4]
        children = psutil.Process(running.process.pid).children()

    assert (geometry, children) == (b"glTF", [])
    assert (welcome["finger_count"], welcome["may_pose"], welcome["may_move"]) == (10, True, True)
    assert welcome["recording"]["name"] == "hand.csv"


def test_points_are_given_to_the_page_in_metres(tmp_path):
    (tmp_path / "scan.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")

    with Viewing(BRACKET, "--points", tmp_path / "scan.csv", "--units", "cm") as running:
        welcome = json.loads(shown_at(running.url, "welcome"))
        points = np.frombuffer(shown_at(running.url, "points"))

    assert (welcome["points"], welcome["unit"]) == ({"name": "scan.csv"}, 0.01)
    assert points.tolist() == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05, 0.06])


def test_a_scene_in_python_is_shown_as_it_is():
    scene = Scene([Solid(*shapes.cube(0.1), name="cube"), Solid(*shapes.cube(0.1, (1, 0, 0)), name="other")])
    scene.hide("other")

    page = proximity.view(scene, open_browser=False)
    try:
        welcome = json.loads(shown_at(page.url, "welcome"))
        html = page._repr_html_()
    finally:
        page.stop()

    assert welcome["title"] == "scene.prox"
    assert f'src="{page.url}"' in html
    assert repr(page) == "RunningPage(ended)"


def test_what_cannot_be_shown_is_refused(tmp_path):
    with pytest.raises(ServiceError, match=r"^a page shows a Scene or a file, not int$"):
        proximity.view(3)
    with pytest.raises(ServiceError, match=r"nothing\.stl"):
        proximity.view(tmp_path / "nothing.stl", open_browser=False)
    for name in ("nothing.stl", "nothing.toml", "nothing.frames"):
        with pytest.raises(ServiceError, match=rf"^{name}: there is no such file$"):
            shown(files=(str(BRACKET), name))


def test_a_page_that_ends_at_once_says_why(monkeypatch):
    monkeypatch.setattr(running_page, "BEGIN_TIMEOUT", PATIENCE)
    with pytest.raises(ServiceError, match="needs a certificate and its key"):
        running_page.RunningPage([str(BRACKET), "--bind", "0.0.0.0"], "bracket", print)


def shown(**settings):
    return run_page(
        PageSettings(**{"files": (str(BRACKET),), **settings}),
        stop=threading.Event(),
        say=lambda sentence: None,
        begun=lambda beginning: None,
    )


def test_another_address_needs_a_certificate(tmp_path):
    with pytest.raises(ServiceError, match=r"^a page at 192\.168\.1\.20 needs a certificate and its key"):
        shown(bind="192.168.1.20")
    (tmp_path / "cert.pem").write_text("no certificate")
    with pytest.raises(ServiceError, match=r"cert\.pem: cannot be used as a certificate"):
        shown(bind="192.168.1.20", certificate=str(tmp_path / "cert.pem"), key=str(tmp_path / "cert.pem"))


def test_port_in_use_is_told_in_one_sentence():
    """Regression: a traceback."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(
            ServiceError, match=rf"^port {port} of 127\.0\.0\.1 is in use by another program$"
        ):
            shown(port=port)


def test_without_websockets_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    monkeypatch.delitem(sys.modules, "proximity.web.bridge", raising=False)
    with pytest.raises(MissingLibraryError, match=r'^the page needs websockets.*"cad-proximity\[web\]"'):
        shown()


@pytest.fixture
def view(monkeypatch, tmp_path):
    """Run ``view --save`` without writing; return the arguments of `write_page`."""

    def run(*words):
        read = []
        monkeypatch.setattr("proximity.web.page_process.write_page", lambda *given: read.append(given) or 1e6)
        words = ["proximity", "view", *words, "--save", tmp_path / "page.html"]
        monkeypatch.setattr(sys, "argv", list(map(str, words)))
        with pytest.raises(SystemExit):
            cli.main()
        ((settings, _),) = read
        return settings

    return run


def test_files_are_read_with_the_options_of_the_command(view):
    settings = view(BRACKET, "--scale", 2, "--step-tolerance", 0.002, "--no-cache")

    expected = {"scale": 2.0, "step_tolerance": 2e-6, "unpacked_limit": 2e9, "cache": False}
    assert dict(settings.reading) == expected
    assert _open_parts(settings).scene.part_sizes == pytest.approx(2 * proximity.load(BRACKET).part_sizes)


def test_clashes_are_listed_on_request(view, tmp_path):
    scene = Scene([Solid(*shapes.cube(0.1, (x, 0, 0)), name=name) for name, x in (("a", 0), ("b", 0.08))])
    scene.save(tmp_path / "cubes.prox")
    (tmp_path / "allow.csv").write_text("first,second\nb,*\n")
    options = ((), ("--contact", 15), ("--contact", 30), ("--allow", tmp_path / "allow.csv"))
    read = [view(tmp_path / "cubes.prox", "--clashes", *more) for more in options]

    listed = [json.loads(_open_parts(settings).content["welcome"])["clashes"] for settings in read]
    (clash,) = listed[0]
    assert clash["names"] == ["a", "b"] and listed[1:] == [[clash], [], []]
    assert (clash["deepest"], clash["depth"]) == pytest.approx((0.02, 0.02), rel=0.02)
    assert clash["volume"] == pytest.approx(0.02 * 0.1 * 0.1)
    assert len(clash["point"]) == 3


def test_parts_are_shown_as_was_asked_for():
    files = ("part.stl", str(BRACKET))
    settings = page_settings(files, PageSettings(files, units="in", radius=0.005))

    assert [part.file for part in settings.parts] == [str(Path("part.stl").absolute()), str(BRACKET)]
    assert {part.units for part in settings.parts} == {"in"}
    assert (settings.fingers.count, settings.fingers.radius) == (10, 0.005)


def test_parts_and_fingers_of_a_scene_file_are_taken(tmp_path):
    scene = tmp_path / "cell.toml"
    scene.write_text(
        "[fingers]\ncount = 3\nradius = [0.005, 0.006, 0.007]\nhorizon = 0.3\n"
        f'[[parts]]\nfile = "{BRACKET.as_posix()}"\n'
        'name = "spring"\nposition = [0.1, 0, 0]\nkind = "deformable"\nstiffness = 800.0\ndamping = 2.0\n'
        '[input]\nposes = "mailbox:x"\n'
    )

    with Viewing(scene) as running:
        welcome = json.loads(shown_at(running.url, "welcome"))

    assert (welcome["finger_count"], welcome["radii"]) == (3, [0.005, 0.006, 0.007])
    assert welcome["tracker"] == {"horizon": 0.3}
    assert page_settings((str(scene),), PageSettings(())).parts == read_scene_file(scene).parts


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("part.stl", "solid nothing", "part.stl"),
        ("cell.toml", "[input]\nposes = 'mailbox:x'\n[[parts]]\nfile = 'none.stl'\n", "cell.toml:4"),
    ],
)
def test_parts_that_cannot_be_loaded_are_refused(name, text, words, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(ServiceError, match=re.escape(words)):
        shown(files=(str(tmp_path / name),))


def logged(path, count=50, sessions=1):
    """Write a log in which finger 0's distance is the number of the frame, in millimetres."""
    message = Message(FRAME, 2)
    header = message.header
    header["period_ns"], header["state"] = 1_000_000, State.DEGRADED
    with FrameLog(path) as log:
        for session in range(sessions):
            for number in range(count):
                for name in ("start_ns", "pose_ns", "publish_ns", "valid_until_ns"):
                    header[name] = (session + 5) * 10**9 + number * 10**6
                message.records["signed_distance"] = number / 1e3
                log.append(message.seal(session + 1, number))
    return path


def test_frames_of_a_log_are_found_by_time_and_place(tmp_path):
    frames = LoggedFrames(logged(tmp_path / "run.frames"))

    assert (frames.count, frames.finger_count, frames.duration_ms) == (50, 2, 49.0)
    assert [frames.place_at(ms) for ms in (-1.0, 0.0, 0.9, 1.0, 30.5, 1e9)] == [0, 0, 0, 1, 30, 49]
    assert frames.ms_at(7) == 7.0
    assert np.frombuffer(frames.at(7), FRAME.header, 1)["sequence"][0] == 7
    assert frames.at(-3) == frames.at(0)
    assert frames.at(99) == frames.at(49)


def test_a_later_session_goes_on_where_the_one_before_ended(tmp_path):
    frames = LoggedFrames(logged(tmp_path / "run.frames", count=10, sessions=2))
    assert (frames.count, frames.duration_ms) == (20, 18.0)


def test_a_log_without_frames_is_refused(tmp_path):
    (tmp_path / "empty.frames").touch()
    with pytest.raises(RecordingError, match="has no frame yet"):
        LoggedFrames(tmp_path / "empty.frames")


def test_a_log_is_shown_frame_by_frame(tmp_path):
    log = logged(tmp_path / "run.frames")
    with Viewing(log, BRACKET) as running:
        address, _, token = running.url.partition("/#token=")
        with connect(address.replace("http", "ws") + "/live", origin=address, max_size=None) as page:
            page.send(json.dumps({"hello": token}))
            welcome = json.loads(page.recv(PATIENCE))["welcome"]
            assert welcome["log"] == {"count": 50, "duration_ms": 49.0, "notes": []}
            page.send(json.dumps({"at_ms": 30.5}))
            assert json.loads(page.recv(PATIENCE)) == {"place": 30, "ms": 30.0}
            assert np.frombuffer(page.recv(PATIENCE), FRAME.header, 1)["sequence"][0] == 30
            page.send(json.dumps({"place": 31}))
            assert json.loads(page.recv(PATIENCE)) == {"place": 31, "ms": 31.0}


def test_part_of_an_unlikely_size_is_told_with_the_likely_unit():
    said, stop = [], threading.Event()
    run_page(
        PageSettings(files=(str(BRACKET),), units="um"),
        stop=stop,
        say=said.append,
        begun=lambda _: stop.set(),
    )

    assert (
        said[0].startswith(f"{BRACKET}: the part is 0.") and "was read in um; the likely unit is" in said[0]
    )


def test_a_page_beside_a_service_watches_unless_the_scene_file_lets_it_feed(tmp_path):
    scene = tmp_path / "cell.toml"
    text = (
        '[service]\nrate_hz = 200\nreal_time = false\npublish = "mailbox:away"\n[fingers]\ncount = 2\n'
        f'[[parts]]\nfile = "{BRACKET.as_posix()}"\n'
        f'[input]\nposes = "shm://web-{tmp_path.name}/poses"\n'
    )
    for feed in (False, True):
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        scene.write_text(text + ("[web]\nfeed = true\n" if feed else ""))
        process = subprocess.Popen(
            [sys.executable, "-m", "proximity", "serve", str(scene), "--web", "--until-stdin",
             "--port", str(port)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            for line in process.stderr:
                if "the page is at" in line:
                    break
            assert f"http://127.0.0.1:{port}/#token=" in line
            welcome, geometry, frame = welcomed(line.split()[-1])
            children = psutil.Process(process.pid).children()
        finally:
            process.stdin.close()
            code = process.wait(60)
            process.stderr.close()
        assert (geometry, frame, code) == (b"glTF", b"DECF", 0)
        assert (welcome["may_pose"], welcome["may_move"], welcome["finger_count"]) == (feed, False, 2)
        for child in children:
            until(lambda child=child: is_over(child), 30.0)


def test_names_of_a_page_for_other_machines():
    from proximity.web.page_process import _names

    names = _names(SimpleNamespace(names=("lab.example",), bind="192.168.1.20"))
    assert names == ("127.0.0.1", "localhost", "[::1]", "lab.example", "192.168.1.20")


@pytest.mark.parametrize("opens", ["python", "command"])
def test_the_token_is_in_no_argument_of_the_browser(opens, tmp_path, monkeypatch):
    """All users of a machine can read the arguments of processes, and could use the page."""
    browser, seen = tmp_path / "browser", tmp_path / "arguments"
    browser.write_text(f'#!/bin/sh\necho "$@" > {seen}.part && mv {seen}.part {seen}\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    if opens == "python":
        program = (
            "import proximity, sys; page = proximity.view(sys.argv[1], open_browser=True); print(page.url)"
        )
        words = ["-c", f"{program}; sys.stdout.flush(); sys.stdin.read(); page.stop()", str(BRACKET)]
    else:
        words = ["-m", "proximity", "view", str(BRACKET), "--until-stdin"]
    with subprocess.Popen([sys.executable, *words], stdin=-1, stdout=-1, text=True) as page:
        url = page.stdout.readline().strip()
        until(seen.exists, PATIENCE)
        address = seen.read_text().strip()
        redirect = Path(url2pathname(urlsplit(address).path))
        modes = [stat.S_IMODE(each.stat().st_mode) for each in (redirect, redirect.parent)]
        content = redirect.read_text()
        page.communicate("")

    token = url.partition("#token=")[2]
    assert address.startswith("file:///") and len(token) > 20 and token not in address
    assert modes == [0o600, 0o700]
    assert f'content="0; url={url}"' in content
    assert not redirect.parent.exists()
