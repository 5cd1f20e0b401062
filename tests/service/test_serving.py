"""Serving a scene file: published frames, shutdown, edits, and the service as a process."""

import logging
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import glove_files
import numpy as np
import pytest
from ports import free_port
from project import MESHES
from served_scene import served_scene

from proximity.errors import ArgumentError, PublishError, ServiceError
from proximity.message import (
    ADDITIONS,
    CHANGES,
    GLOVE_POSES,
    MEASURED,
    MOVES,
    POSES,
    ContactFlag,
    Message,
    PartAction,
    Source,
    State,
)
from proximity.recording import FrameReader
from proximity.service.config import PartFiles
from proximity.service.hosting import RunningService, scene_changes, scene_service, serve, start_service
from proximity.transport import open_publisher, open_subscriber
from proximity.transport.link import TRANSPORTS, Transport

PATIENCE_S = 60.0
SCENE = """\
[service]
rate_hz = 200
publish = "mailbox:{name}"
real_time = false
[fingers]
count = 2
[[parts]]
file = "box.stl"
[input]
poses = "mailbox:{name}/poses"
"""


def wait_until(is_so, what):
    """Poll, so that a loaded machine only slows the test."""
    ends = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < ends, f"waited in vain until {what}"
        time.sleep(0.01)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with parts, with a short interval between checks for edits."""
    for name in ("box.stl", "sphere.stl", "hand.csv"):
        shutil.copy(MESHES / name, tmp_path)
    monkeypatch.setattr(scene_service, "LOOK_S", 0.02)
    return tmp_path


@pytest.fixture
def scene_path(folder):
    """A scene with addresses unique to the test."""
    path = folder / "cell.toml"
    path.write_text(SCENE.format(name=folder.name))
    return path


@pytest.fixture
def served(scene_path):
    """Serve the scene in a thread, with its frames and messages; stop it at the end."""
    said = []
    (address,) = scene_service.read_scene_file(scene_path).service.publish
    with (
        open_subscriber(address) as subscriber,
        open_publisher(f"{address}/poses") as poses,
        served_scene(scene_path, say=said.append) as scene,
    ):
        yield SimpleNamespace(
            path=scene_path, address=address, subscriber=subscriber, said=said, poses=poses,
            hold=lambda *tips: hold(poses, tips), **vars(scene),
        )  # fmt: skip


def hold(publisher, tips):
    """Publish fingertip positions."""
    message = Message(POSES, len(tips))
    message.records["finger"] = np.arange(len(tips))
    message.records["pose_ns"] = time.monotonic_ns()
    message.records["position"] = tips
    message.records["velocity"] = np.nan
    message.records["bend"] = np.nan
    publisher.publish(message)


ABOVE = [[0.01, 0.01, 0.2], [0.02, 0.02, 0.2]]


def reading_where(served, is_so, what):
    """Return the first new reading that meets the condition, while poses are published."""
    readings = []

    def is_met():
        served.hold(*ABOVE)
        readings.append(served.subscriber.read())
        return readings[-1].is_new and readings[-1].state == State.OK and is_so(readings[-1])

    wait_until(is_met, what)
    found = readings[-1]
    return replace(found, header=found.header.copy(), contacts=found.contacts.copy())


def recorded(scene_path, more=""):
    """Make the scene play the sample recording."""
    text = scene_path.read_text().replace("count = 2\n", "").split("[input]")[0]
    scene_path.write_text(f'{text}[input]\nrecording = "hand.csv"\n{more}')


def edit(path, before, after):
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def test_poses_come_in_and_contacts_go_out(served):
    reading = reading_where(served, lambda reading: True, "poses were answered")

    assert reading.header["period_ns"] == 5_000_000
    np.testing.assert_allclose(reading.contacts["lower"], reading.contacts["signed_distance"], atol=1e-9)
    height = 0.2 - 0.007 - reading.contacts["point_on_part"][0, 2]
    assert reading.contacts["signed_distance"][0] == pytest.approx(height, abs=1e-9)
    report = served.finish()
    assert report.ticks > 0
    assert report.states[State.OK] > 0
    assert served.subscriber.read().header["state"] == State.STOPPING


def test_gloved_fingers_are_served_with_their_contact(scene_path, folder, request):
    """The calibration is a file next to the scene; the finger bends down onto the box."""
    glove_files.write(folder / "glove.json")
    scene_path.write_text(scene_path.read_text() + '[glove]\ncalibration = "glove.json"\n')
    served = request.getfixturevalue("served")
    top = 0.2  # m above the floor, with the box somewhere below
    message = Message(GLOVE_POSES, 2)
    message.records["finger"] = [0, 1]
    turned = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]  # the back of the hand faces up

    def is_told():
        message.records["pose_ns"] = time.monotonic_ns()
        message.records["rotation"], message.records["translation"] = turned, [0.0, 0.01, top]
        message.records["bend"], message.records["counts"] = [0.2, np.nan], counts
        served.poses.publish(message)
        reading = served.subscriber.read()
        contacts.append(reading.contacts.copy())
        return reading.is_new and reading.state == State.OK

    contacts, counts = [], glove_files.HAND.counts(0.3)
    wait_until(is_told, "poses of gloves were answered")
    told = contacts[-1]

    assert told["bend"] == pytest.approx([0.2, 0.3], abs=1e-3)
    tip = glove_files.HAND.finger.point(0.2)
    assert told["position"][0] == pytest.approx([tip[0], 0.01, top + tip[1]], abs=5e-5)
    assert ((told["flags"] & ContactFlag.ON_PATH) != 0).all()


def test_moves_reach_the_parts_before_and_after_an_edit(scene_path, folder, request):
    edit(scene_path, "[input]\n", f'[input]\nmoves = "mailbox:{folder.name}/moves"\n')
    served = request.getfixturevalue("served")
    before = reading_where(served, lambda reading: True, "poses were answered")

    def is_moved(reading):
        return reading.contacts["signed_distance"][0] < before.contacts["signed_distance"][0] - 0.01

    message = Message(MOVES, 1)
    message.records["name"] = b"box"
    message.records["rotation"] = np.eye(3)
    message.records["translation"] = [0.0, 0.0, 0.05]
    message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
    with open_publisher(f"mailbox:{folder.name}/moves") as moves:
        moves.publish(message)
        reading_where(served, is_moved, "the part was moved")
        edit(served.path, "[fingers]\n", "[fingers]\nbudget = 400\n")
        after = reading_where(
            served, lambda reading: reading.header["epoch"] > before.header["epoch"], "taken"
        )

    assert is_moved(after)


def test_measured_distances_are_published_without_geometry(scene_path, folder, request):
    text = scene_path.read_text().split("[[parts]]")[0]
    scene_path.write_text(f'{text}[input]\nsensor = "mailbox:{folder.name}/sensor"\n')
    served = request.getfixturevalue("served")
    message = Message(MEASURED, 2)
    message.records["finger"] = [0, 1]
    for name in ("position", "velocity", "normal", "approach_speed", "bend", "bend_rate"):
        message.records[name] = np.nan
    message.records["signed_distance"] = [0.01, 0.02]
    message.records["error"] = 1e-4

    with open_publisher(f"mailbox:{folder.name}/sensor") as sensor:

        def is_answered():
            message.records["measured_ns"] = time.monotonic_ns()
            sensor.publish(message)
            reading = served.subscriber.read()
            return reading.state == State.OK and reading.contacts["signed_distance"].tolist() == [0.01, 0.02]

        wait_until(is_answered, "measurements were published")
        assert served.subscriber.read().header["source"] == Source.TELEOPERATION
        edit(scene_path, "count = 2", "count = 2 # of a glove")
        wait_until(lambda: served.said, "the edit was noticed")

    assert served.said == [f"{scene_path} was edited without effect"]
    assert (served.beginnings[0].part_names, served.beginnings[0].finger_count) == ((), 2)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("rate_hz = 200", "rate_hz = 100", "2: service.rate_hz was changed"),
        ("/poses", "/other", "10: input.poses was changed"),
        ("[input]\n", '[input]\nmoves = "mailbox:m"\n', "10: input.moves was changed"),
        ('/poses"\n', '/poses"\n[glove]\ncalibration = "box.stl"\n', "11: glove was changed"),
    ],
)
def test_edit_that_needs_a_restart_is_refused_with_its_line(scene_path, before, after, message):
    settings = scene_service.read_scene_file(scene_path)
    edit(scene_path, before, after)

    with pytest.raises(ServiceError) as refused:
        scene_changes.refuse_what_needs_a_restart(settings, scene_service.read_scene_file(scene_path))

    assert str(refused.value).startswith(f"{scene_path}:{message}: restart the service to apply")


class FakeService:
    """Record replacements of contacts."""

    def __init__(self):
        self.replaced = []

    def replace(self, answering):
        self.replaced.append(answering)


@pytest.fixture
def looking(scene_path):
    """The check for edits without a loop, run by the test."""
    settings = scene_service.read_scene_file(scene_path)
    files = PartFiles()
    service, said = FakeService(), []
    made = SimpleNamespace(
        service=service, files=files, scene=files.scene(settings), moves=None, changes=None, count=2
    )
    reloader = scene_changes.SceneReloader(made, settings, {}, said.append)

    def look(times):
        for _ in range(times):
            reloader.look()

    return SimpleNamespace(path=scene_path, look=look, replaced=service.replaced, said=said)


def test_edit_is_taken_when_two_looks_have_seen_the_same(looking):
    looking.look(1)
    edit(looking.path, "count = 2", "count = 2\nbudget = 40")
    looking.look(1)
    assert looking.replaced == []

    edit(looking.path, "budget = 40", "budget = 400")  # another edit in between
    looking.look(1)
    assert looking.replaced == []

    looking.look(2)
    assert len(looking.replaced) == len(looking.said) == 1
    assert looking.replaced[0].count == 2


def test_edit_that_needs_a_restart_changes_nothing(looking):
    edit(looking.path, "rate_hz = 200", "rate_hz = 100")
    edit(looking.path, "box.stl", "sphere.stl")
    looking.look(3)

    assert looking.replaced == []
    assert "2: service.rate_hz was changed" in looking.said[0]


def test_part_that_is_replaced_by_one_of_the_same_date_and_size_is_taken(looking, folder):
    """Both files have the date of an archive; the new one replaces the old by renaming."""
    old, new = folder / "box.stl", folder / "box.new"
    data = bytearray(old.read_bytes())
    data[-14:-2] = np.float32([1.0, 2.0, 3.0]).tobytes()  # the last corner
    new.write_bytes(data)
    os.utime(new, ns=(old.stat().st_atime_ns, old.stat().st_mtime_ns))
    new.replace(old)
    looking.look(3)

    assert len(looking.replaced) == 1
    vertices = looking.replaced[0].tracker.scene.parts[0].solid.mesh.vertices
    assert np.isclose(vertices, [0.001, 0.002, 0.003]).all(axis=1).any()


def test_refused_edit_is_said_once(looking):
    looking.path.write_text("nonsense")
    looking.look(4)

    assert len(looking.said) == 1
    assert looking.said[0].startswith("the edit is refused, the previous scene stays in use: ")
    assert looking.replaced == []


def test_scene_file_that_is_gone_is_said_and_may_come_back(looking):
    text = looking.path.read_text()
    looking.path.unlink()
    looking.look(3)
    looking.path.write_text(text)
    looking.look(3)

    assert looking.said[0].endswith(f"{looking.path}: cannot be read (No such file or directory)")
    assert len(looking.replaced) == 1


def test_file_that_a_refused_edit_names_is_watched(looking, folder):
    (folder / "new.stl").write_text("not written yet")
    edit(looking.path, "box.stl", "new.stl")
    looking.look(3)
    assert looking.replaced == []

    shutil.copy(MESHES / "sphere.stl", folder / "new.stl")
    looking.look(3)
    assert len(looking.replaced) == 1
    assert looking.replaced[0].tracker.scene.parts[0].name == "new"


def test_mistake_of_ours_in_an_edit_is_said(looking, monkeypatch):
    monkeypatch.setattr(scene_changes, "make_tracker", None)
    edit(looking.path, "count = 2", "count = 2\nbudget = 40")
    looking.look(2)

    assert looking.said == [
        "the edit is refused, the previous scene stays in use: TypeError: 'NoneType' object is not callable"
    ]


def test_signal_ends_it_with_a_word(scene_path, folder):
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    with open_subscriber(f"mailbox:{folder.name}") as subscriber:
        report = serve(scene_path, begun=lambda beginning: os.kill(os.getpid(), signal.SIGTERM))
        assert subscriber.read().header["state"] == State.STOPPING
    assert report.ticks > 0
    assert {each: signal.getsignal(each) for each in before} == before


def test_signal_that_is_ignored_stays_ignored(scene_path, monkeypatch):
    """As in a program started by nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        report = serve(scene_path, tick_count=40, begun=lambda beginning: os.kill(os.getpid(), signal.SIGHUP))
        assert report.ticks == 40
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("name", "value"), [("seconds", float("nan")), ("seconds", "1"), ("tick_count", -1), ("tick_count", 1.5)]
)
def test_limits_that_cannot_be_reached_are_refused(scene_path, name, value):
    """A thread once died with a traceback, and the service never stopped."""
    expected = {"seconds": "a number of seconds", "tick_count": "a whole number"}[name]
    with pytest.raises(ArgumentError, match=rf"^{name} is .*, expected {expected} of 0 or more$"):
        serve(scene_path, **{name: value})


def test_it_ends_after_some_seconds_also_while_an_edit_is_being_made(scene_path, monkeypatch):
    """Reading a large part may take minutes."""
    monkeypatch.setattr(scene_service, "LOOK_S", 0.01)
    monkeypatch.setattr(scene_service, "ANNOUNCE_AFTER_S", 0.01)
    is_over = threading.Event()
    monkeypatch.setattr(scene_changes.SceneReloader, "look", lambda self: is_over.wait(PATIENCE_S))
    began = time.monotonic()
    try:
        serve(scene_path, seconds=0.1)
        assert time.monotonic() - began < PATIENCE_S
    finally:
        is_over.set()


def test_recording_is_served_as_fast_as_it_goes_and_logged(scene_path, folder):
    recorded(scene_path, "fast = true\nfit = true\n")

    report = serve(scene_path, log=folder / "run.frames")

    (run,) = FrameReader(folder / "run.frames")
    states = run["header"]["state"].tolist()
    assert report.ticks == report.log_written - 3 == len(states) - 3
    assert 1036 <= report.ticks + report.missed <= 1042  # 5.194 s at 200 Hz
    assert states[-3:] == [State.STOPPING] * 3
    assert State.OK in states
    assert run["header"]["sequence"].tolist() == list(range(len(states)))
    assert (run["contacts"]["signed_distance"] < 0.0).any()


def test_what_begun_raises_ends_it(scene_path):
    def fail(beginning):
        raise RuntimeError("as told")

    with pytest.raises(RuntimeError, match="as told"):
        serve(scene_path, begun=fail)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"rate_hz": 0}, "service.rate_hz is 0, expected a number from 1 to 100000 (Hz)"),
        ({"publish": "decaff"}, "service.publish cannot be used: decaff: expected an address such as"),
        ({"rate": 5}, "[service] has no key 'rate': did you mean rate_hz?"),
        ({"publish": "mailbox:x/poses"},
         "{path}:10: input.poses is mailbox:x/poses, which is also in service.publish"),
    ],
)  # fmt: skip
def test_override_that_cannot_be_used_is_refused(scene_path, overrides, message):
    scene_path.write_text(SCENE.format(name="x"))
    with pytest.raises(ServiceError) as refused:
        serve(scene_path, **overrides)
    assert str(refused.value).startswith(message.format(path=scene_path))


def test_overrides_hold_and_go_on_to_hold_after_an_edit(scene_path, folder):
    said, stop = [], threading.Event()

    def then(sentence):
        said.append(sentence)
        stop.set()

    def begun(beginning):
        edit(scene_path, "[fingers]", "[fingers]\nbudget = 40")

    report = serve(scene_path, rate_hz=100, publish=["mailbox:elsewhere"], stop=stop, say=then, begun=begun)
    assert report.period_ns == 10_000_000
    assert list(report.publish_failures) == ["mailbox:elsewhere"]
    assert "was edited" in said[0]


class CountedEnd:
    """Either end of a test transport; opening a third end fails."""

    opened = 0
    shares_clock, is_keyed, refused = True, False, 0

    def __init__(self, address):
        if CountedEnd.opened == 2:
            raise PublishError(f"{address.text}: in use by another")
        CountedEnd.opened += 1

    def close(self):
        CountedEnd.opened -= 1


@pytest.fixture
def counted(monkeypatch):
    monkeypatch.setitem(TRANSPORTS, "counted", Transport("counted_transport", ""))
    module = SimpleNamespace(open_outlet=CountedEnd, open_inlet=CountedEnd)
    monkeypatch.setitem(sys.modules, "counted_transport", module)
    return CountedEnd


def test_address_in_use_is_told_and_the_others_are_given_back(scene_path, counted):
    with pytest.raises(PublishError, match=r"^counted:c: in use by another$"):
        serve(scene_path, publish=("counted:a", "counted:b", "counted:c"))
    assert counted.opened == 0


def test_what_cannot_be_made_gives_all_addresses_back(scene_path, counted):
    edit(scene_path, "[[parts]]", "radius = [0.007, 0.007]\n[[parts]]")
    edit(scene_path, "count = 2\n", "")
    scene_path.write_text(re.sub("poses = .*", 'poses = "counted:poses"', scene_path.read_text()))

    with pytest.raises(ServiceError, match=r"cell\.toml:6: fingers: .* one for each of 5 fingers"):
        serve(scene_path, publish="counted:a")
    assert counted.opened == 0


def test_listener_that_fails_ends_nothing(scene_path, caplog):
    """Neither the loop nor the check for edits fails, as with a closed terminal."""

    def fail(sentence):
        said.append(sentence)
        raise BrokenPipeError(32, "Broken pipe")

    def begun(beginning):
        logging.getLogger("proximity.service").warning("%d frames", 3)
        edit(scene_path, "[fingers]", "[fingers]\nbudget = 40")

    said, stop = [], threading.Event()
    ended = threading.Thread(
        target=lambda: wait_until(lambda: len(said) == 2, "both were said") or stop.set()
    )
    ended.start()
    report = serve(scene_path, stop=stop, say=fail, begun=begun)
    ended.join(PATIENCE_S)

    assert report.ticks > 0
    assert said[0] == "3 frames" and "was edited" in said[1]
    assert [record.message for record in caplog.records if record.name == "proximity.hosting"] == [
        f"this could not be announced: {sentence}" for sentence in said
    ]


def test_listener_that_takes_its_time_delays_no_tick(scene_path):
    may_go_on, seen = threading.Event(), []
    poses_failed = logging.getLogger("proximity.service")

    def say(sentence):
        assert may_go_on.wait(PATIENCE_S)
        seen.append(sentence)

    with scene_service.warnings_of_loop_to(say):
        poses_failed.warning("first")  # would block here
        poses_failed.warning("second")
        assert seen == []
        may_go_on.set()

    assert seen == ["first", "second"]


BEGUN = """
import json, sys, time
print(json.dumps({"event": "begun", "rate_hz": 500.0}), flush=True)
"""
ENDED = """
sys.stdin.readline()
print(json.dumps({"event": "ended", "ticks": 7}), flush=True)
"""


@pytest.fixture
def child():
    """Start a process that prints like a service."""
    held = []

    def start(code, timeout=PATIENCE_S, say=lambda sentence: None):
        held.append(RunningService([sys.executable, "-c", code], "cell.toml", say, timeout))
        return held[-1]

    yield start
    for service in held:
        service._process.kill()
        service._clean_up()


def test_child_s_report_is_what_stop_returns(child):
    said = []
    service = child(BEGUN + "print('proximity: edited', file=sys.stderr)" + ENDED, say=said.append)

    assert service.beginning == {"rate_hz": 500.0}
    assert service.is_running and "running" in repr(service)
    assert service.stop() == service.stop() == {"ticks": 7}
    assert not service.is_running and "ended" in repr(service)
    assert said == ["edited"]


def test_listener_that_fails_does_not_stop_the_service(child):
    """Unread output would fill the pipe and block the service."""
    code = BEGUN + "for _ in range(5000): print('proximity:', 60 * 'edited', file=sys.stderr)\n" + ENDED
    service = child(code, say=lambda sentence: 1 / 0)
    assert service.stop(timeout=PATIENCE_S) == {"ticks": 7}


def test_child_is_waited_for_as_long_as_wished(child):
    service = child(BEGUN + ENDED, timeout=threading.TIMEOUT_MAX)
    with pytest.raises(ArgumentError, match=r"^timeout is nan, expected a number of seconds of 0 or more$"):
        service.stop(timeout=float("nan"))
    assert service.stop(timeout=float("inf")) == {"ticks": 7}


def test_child_that_ends_by_itself_has_a_report(child):
    with child(BEGUN + 'print(json.dumps({"event": "ended", "ticks": 9}), flush=True)') as service:
        wait_until(lambda: not service.is_running, "it ended")

        assert service.stop() == {"ticks": 9}


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import sys; sys.exit('proximity: a.toml:3: wrong')",
         "cell.toml: the service has failed with exit code 1"),
        ("import sys; print('proximity: a.toml:3: wrong', file=sys.stderr); sys.exit(2)", "a.toml:3: wrong"),
        ("1 / 0", "cell.toml: the service has failed with exit code 1: ZeroDivisionError: division by zero"),
        ("pass", "cell.toml: the service has failed with exit code 0: it printed nothing"),
    ],
)  # fmt: skip
def test_child_that_does_not_begin_is_told_by_its_own_words(child, code, message):
    with pytest.raises(ServiceError) as failed:
        child(code)
    assert str(failed.value).startswith(message)


def test_child_that_does_not_begin_or_stop_in_time_is_killed(child):
    with pytest.raises(ServiceError, match=r"^cell\.toml: .* published no frame within 0\.1 s: killed$"):
        child("import time; time.sleep(600)", timeout=0.1)
    service = child(BEGUN + "time.sleep(600)")
    with pytest.raises(ServiceError, match=r"^cell\.toml: the service did not stop within 0\.1 s: killed$"):
        service.stop(timeout=0.1)
    assert not service.is_running


def test_mistake_within_the_block_is_the_one_that_is_raised(child):
    with pytest.raises(ZeroDivisionError), child(BEGUN + ENDED) as service:
        service._process.kill()
        raise ZeroDivisionError


def test_override_that_no_option_has_is_refused(scene_path):
    expected = "core can only be set in the scene file, expected rate_hz, publish, log, real_time"
    with pytest.raises(ServiceError, match=f"^{expected}$"):
        start_service(scene_path, core=1)


def test_override_of_none_is_what_the_file_says(scene_path, folder):
    report = serve(scene_path, rate_hz=100, log=None, publish=None, tick_count=1)
    assert list(report.publish_failures) == [f"mailbox:{folder.name}"]


def test_service_in_its_own_process_serves_is_edited_and_stops(scene_path, folder):
    """One test for all of it, since a process takes seconds to start."""
    recorded(scene_path, "repeat = true\nfit = true\n")
    said, log, address = [], folder / "run.frames", f"udp://127.0.0.1:{free_port()}"

    with (
        open_subscriber(address) as subscriber,
        start_service(scene_path, rate_hz=100, publish=address, log=log, say=said.append) as service,
    ):
        assert service.beginning["rate_hz"] == 100.0
        assert service.beginning["publish"] == [address]
        assert (service.beginning["finger_count"], service.beginning["part_names"]) == (5, ["box"])
        wait_until(lambda: subscriber.read().state == State.OK, "a hand was seen")
        edit(scene_path, 'file = "box.stl"', 'file = "bax.stl"')
        wait_until(lambda: said, "the edit was refused")
        report = service.stop()
        assert subscriber.read().header["state"] == State.STOPPING

    assert said[0].startswith(
        f"the edit is refused, the previous scene stays in use: {scene_path}:7: parts[0].file is"
    )
    (run,) = FrameReader(log)
    assert run["header"]["state"].tolist()[-3:] == [State.STOPPING] * 3
    assert report["log_written"] == len(run["header"]) == report["ticks"] + 3
    assert report["publish_failures"] == {address: 0}


def test_service_stops_when_its_parent_is_killed(scene_path, folder):
    recorded(scene_path, "repeat = true\n")
    code = (
        "import sys, time; from proximity.service.hosting import start_service\n"
        "service = start_service(sys.argv[1], log=sys.argv[2]); print('up', flush=True); time.sleep(600)"
    )
    log = folder / "run.frames"
    command = [sys.executable, "-P", "-c", code, str(scene_path), str(log)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}

    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as parent:
        assert parent.stdout.readline() == b"up\n"
        parent.kill()

    def has_stopped():
        *_, latest = FrameReader(log)
        return latest["header"]["state"][-1] == State.STOPPING

    wait_until(has_stopped, "the service has stopped")


@pytest.mark.parametrize("transport", ["udp", "shm"])
def test_parts_are_added_hidden_and_removed_while_they_are_served(scene_path, folder, request, transport):
    """Both ends have the same parts: names carry the epoch of the frames that use them."""
    if transport == "shm" and sys.platform != "linux":
        pytest.skip("shared memory is for Linux")
    if transport == "udp":
        frames, to_changes = (f"udp://127.0.0.1:{free_port()}" for _ in range(2))
    else:
        frames, to_changes = f"shm://{folder.name}", f"shm://{folder.name}/changes"
    (folder / "more").mkdir()
    shutil.copy(MESHES / "sphere.stl", folder / "more")
    text = scene_path.read_text().replace(f'publish = "mailbox:{folder.name}"', f'publish = "{frames}"')
    scene_path.write_text(f'{text}changes = "{to_changes}"\nparts_from = "more"\n')
    with (
        open_subscriber(frames) as subscriber,
        served_scene(scene_path) as scene,
        open_publisher(to_changes) as changes,
    ):

        def until_parts_are(message, *names, hidden=()):
            def is_so():
                changes.publish(message)  # lost messages are repeated
                subscriber.wait(0.05)
                known = subscriber.description
                return subscriber.part_names == names and known.hidden_parts == hidden

            wait_until(is_so, f"parts were {names}")

        action = Message(CHANGES, 1)
        action.records["action"] = PartAction.DESCRIBE
        until_parts_are(action, "box")
        assert subscriber.finger_names == ("0", "1")
        assert subscriber.description.finger_radii == (0.007, 0.007)
        lid = Message(ADDITIONS, 1)
        lid.records["name"], lid.records["file"] = b"lid", b"sphere.stl"
        lid.records["rotation"] = np.eye(3)
        until_parts_are(lid, "box", "lid")
        action.records["name"], action.records["action"] = b"box", PartAction.HIDE
        until_parts_are(action, "box", "lid", hidden=("box",))
        action.records["action"] = PartAction.REMOVE
        until_parts_are(action, "lid")
        report = scene.finish()
    counts = subscriber.counts
    assert counts.unused == 0
    assert not report.publish_failures[frames]
