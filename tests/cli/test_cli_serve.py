"""``proximity serve``: output, options and exit."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from project import MESHES

from proximity.cli import output
from proximity.errors import RecordingError
from proximity.message import State
from proximity.recording import FrameLog, FrameReader
from proximity.service import Report, realtime
from proximity.system.stop_signals import stop_at_input

COMMAND = ("serve",)
LIBRARY = {"prctl": lambda *_: 0, "mlockall": lambda _: 0, "munlockall": lambda: 0}
"""Stand-ins of C functions on a machine that allows locked memory."""
SCENE = """\
[service]
rate_hz = 500
publish = ["mailbox:a", "mailbox:b"]
real_time = false
[[parts]]
file = "box.stl"
[input]
recording = "hand.csv"
"""


@pytest.fixture
def scene_path(tmp_path):
    for name in ("box.stl", "hand.csv"):
        shutil.copy(MESHES / name, tmp_path)
    path = tmp_path / "cell.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def calls(monkeypatch):
    """Record calls of `serve` without serving."""
    import proximity.service.hosting

    noted = []

    def serve(path, **given):
        noted.append((path, given))
        return Report(1_000_000)

    monkeypatch.setattr(proximity.service.hosting, "serve", serve)
    return noted


def test_beginning_and_end_are_told_in_words(run, scene_path):
    result = run(scene_path, "--ticks", 100)

    assert result.code == 0
    assert result.err == (
        f"proximity: serving {scene_path}: 5 fingers at 1 part, 12 faces\n"
        "proximity: 500 Hz to mailbox:a, mailbox:b\n"
        "proximity: ordinary priority, memory not locked, any core; --realtime requests more\n"
    )
    lines = [(line[:16].strip(), line[16:]) for line in result.out.splitlines()]
    assert [label for label, _ in lines] == [
        "ticks", "states", "compute", "lateness", "published", "published",
    ]  # fmt: skip
    told = dict(lines)
    assert re.fullmatch(r"100 at 500 Hz, \d+ missed", told["ticks"])
    assert re.fullmatch(r"(\d+ \w+(, )?)+", told["states"])
    assert re.fullmatch(r"p50 [\d.]+, p99 [\d.]+, p99\.9 [\d.]+, max [\d.]+ µs", told["compute"])
    assert re.fullmatch(r"p50 [\d.]+, p99 [\d.]+, p99\.9 [\d.]+, max [\d.]+ µs", told["lateness"])
    assert told["published"] == "mailbox:b: all frames"


def test_json_is_a_document_at_the_beginning_and_one_at_the_end(run, scene_path):
    result = run(scene_path, "--ticks", 100, "--json")

    begun, ended = map(json.loads, result.out.splitlines())
    assert (result.code, result.err) == (0, "")
    assert begun == {
        "event": "begun", "pid": os.getpid(), "scene": str(scene_path), "rate_hz": 500.0, "log": None,
        "publish": ["mailbox:a", "mailbox:b"], "real_time": False, "finger_count": 5, "part_count": 1,
        "part_names": ["box"], "face_count": 12, "notes": [],
    }  # fmt: skip
    assert (ended["event"], ended["ticks"]) == ("ended", 100)
    assert sum(ended["states"].values()) == 100
    assert ended["compute"]["p50_ns"] <= ended["compute"]["p999_ns"] <= ended["compute"]["max_ns"]


def test_recording_that_may_be_cut_is_said_to_be_at_the_beginning_and_in_the_report(
    run, scene_path, monkeypatch
):
    monkeypatch.setattr(output, "WIDTH", 1000)  # no line wraps
    path = scene_path.parent / "hand.csv"
    path.write_text(path.read_text()[:-1])

    result = run(scene_path, "--ticks", 5)

    note = f"{path}: the last line has no line end: the file may be cut off"
    assert f"proximity: {note}\n" in result.err and f"note            {note}\n" in result.out


def test_part_of_an_unlikely_size_is_told_with_the_likely_unit(run, scene_path):
    """Regression: only `query` and `check` reported it, not the service, whose distances are as wrong."""
    scene_path.write_text(SCENE.replace('"box.stl"', '"box.stl"\nunits = "um"'))

    result = run(scene_path, "--ticks", 5)

    note = r"proximity: \S+box\.stl: the part is \S+ mm across: the file declares no unit and was read in um"
    assert re.search(note, result.err), result.err


def test_log_is_told(run, scene_path, tmp_path):
    log = tmp_path / "run.frames"

    result = run(scene_path, "--ticks", 10, "--log", log)

    assert f"proximity: 500 Hz to mailbox:a, mailbox:b, logged in {log}\n" in result.err
    assert "log             13 frames, 0 lost\n" in result.out
    assert sum(len(frames) for frames in FrameReader(log)) == 13


@pytest.mark.parametrize("option", [(), ("--json",)])
def test_log_that_lacks_frames_ends_with_exit_code_2_behind_the_report(run, scene_path, monkeypatch, option):
    def refuse(log, data):
        raise RecordingError("no room")

    monkeypatch.setattr(FrameLog, "append", refuse)

    result = run(scene_path, "--ticks", 10, "--log", scene_path.parent / "run.frames", *option)

    assert result.code == 2
    assert result.err.endswith("proximity: the log lacks 13 of 13 frames\n")
    assert "13 frames were not logged, first: no room" in result.out


def test_options_hold_instead_of_what_the_file_says(run, scene_path, calls):
    options = (
        "--rate", 250, "--publish", "mailbox:x", "--publish", "mailbox:y", "--log", "a", "--no-realtime",
    )  # fmt: skip
    run(scene_path, *options, "--limit", 2.5, "--ticks", 7)

    ((path, given),) = calls
    assert path == scene_path
    assert given["rate_hz"] == 250.0
    assert given["publish"] == ["mailbox:x", "mailbox:y"]
    assert given["log"] == Path("a")
    assert given["real_time"] is False
    assert (given["seconds"], given["tick_count"]) == (2.5, 7)


def test_realtime_is_asked_for_only_where_it_is_wanted_and_what_came_of_it_is_said(
    run, scene_path, monkeypatch
):
    asked = []

    def refuse(*arguments):
        asked.append(arguments)
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0}, raising=False)
    monkeypatch.setattr(realtime, "_libc", lambda: SimpleNamespace(**LIBRARY))
    monkeypatch.setattr(realtime, "_may_lock_all", lambda: True)
    scene_path.write_text(SCENE.replace("real_time = false\n", ""))

    quiet = run(scene_path, "--ticks", 3)
    assert not asked
    wanted = run(scene_path, "--ticks", 3, "--realtime")

    assert (
        "proximity: ordinary priority, memory not locked, any core; --realtime requests more\n" in quiet.err
    )
    assert asked and "ordinary" not in wanted.err
    assert "note            priority: not permitted (Operation not permitted)\n" in wanted.out
    assert wanted.err.splitlines()[2:] == [
        "proximity: memory: locked",
        "proximity: core: the process may use one core only",
        "proximity: priority: not permitted (Operation not permitted)",
    ]


def test_without_options_the_file_holds(run, scene_path, calls):
    run(scene_path)

    ((_, given),) = calls
    assert [given[key] for key in ("rate_hz", "publish", "log", "real_time")] == [None] * 4
    assert given["seconds"] is given["tick_count"] is None


def test_edits_and_failures_are_said_on_stderr(run, scene_path, monkeypatch):
    import proximity.service.hosting

    def serve(path, *, say, **given):
        say(f"{path}:3: not\nlike this")
        return Report(1_000_000)

    monkeypatch.setattr(proximity.service.hosting, "serve", serve)

    assert run(scene_path).err == f"proximity: {scene_path}:3: not like this\n"


def test_end_of_standard_input_ends_it():
    """As when the parent program dies."""
    there, here = os.pipe()
    stop = threading.Event()
    thread = stop_at_input(stop, there)
    assert not stop.wait(0.05)

    os.close(here)

    thread.join(60.0)
    os.close(there)
    assert stop.is_set()


def test_sigterm_ends_the_program_with_a_last_word_and_a_report(scene_path, tmp_path):
    log = tmp_path / "run.frames"
    scene_path.write_text(SCENE + "repeat = true\n")
    command = [sys.executable, "-P", "-m", "proximity", "serve", scene_path, "--log", log, "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}

    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as program:
        assert json.loads(program.stdout.readline())["event"] == "begun"
        program.send_signal(signal.SIGTERM)
        report = json.loads(program.stdout.readline())
        assert program.wait(60.0) == 0

    (frames,) = FrameReader(log)
    assert frames["header"]["state"].tolist()[-3:] == [State.STOPPING] * 3
    assert report["log_written"] == len(frames) == report["ticks"] + 3
