"""``proximity demo``: output of its drums, and start, end and errors of its processes."""

import io
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest
import queued_transport
from rich.console import Console
from sealed_frames import frame

import proximity
from proximity.cli.device import demo, demo_view
from proximity.cli.device.drum_loop import DrumThread
from proximity.cli.service import watch_view
from proximity.decaff.simulated_drums import DrumBench
from proximity.errors import PublishError, ServiceError
from proximity.message import ContactFlag, Mode, State
from proximity.service import hosting
from proximity.transport import Counts, Reading, open_publisher, open_subscriber


def test_drums_that_cannot_receive_say_so(monkeypatch):
    queued_transport.register(monkeypatch)

    def fail(self):
        raise PublishError("queue:a: cannot receive (gone)")

    with open_subscriber("queue:a") as subscriber:
        monkeypatch.setattr(type(subscriber), "read", fail)
        with (
            pytest.raises(PublishError, match="gone"),
            DrumThread(DrumBench(250.0), subscriber, 250.0) as drums,
        ):
            drums._thread.join(60.0)


REPORT = {
    "ticks": 4711,
    "missed": 2,
    "states": {"starting": 0, "ok": 4700, "late": 11},
    "compute": {"p50_ns": 81_400, "p99_ns": 140_000},
    "lateness": {"p50_ns": 60_000, "p99_ns": 90_000},
}


class FakeService:
    """A service that publishes frames from a thread of this process."""

    def __init__(self, publish, *, count=10**9, failure=None):
        self.is_stopped = False
        self._failure = failure
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(publish, count))
        self._thread.start()

    @property
    def is_running(self):
        return self._failure is None

    def _run(self, addresses, count):
        publishers = [open_publisher(address) for address in addresses]
        while count and not self._over.wait(0.002):
            message = frame(2, now_ns=time.monotonic_ns())
            message.header["valid_until_ns"] += 10**10  # a slow machine is not shown as LATE
            message.records["mode"][0], message.records["bend"] = Mode.POSITION, math.nan
            for publisher in publishers:
                publisher.publish(message)
            count -= 1

    def stop(self):
        self.is_stopped = True
        self._over.set()
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return REPORT

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if not self.is_stopped:
            self.stop()


@pytest.fixture
def run(run, monkeypatch):
    """Run ``proximity demo`` with a fake service, which is part of the result."""
    queued_transport.register(monkeypatch)
    services, interval = [], sys.getswitchinterval()

    def start(path, *, publish, say):
        assert path.name == "demo.toml"
        services.append(FakeService(publish, **run_with.service))
        return services[-1]

    monkeypatch.setattr(hosting, "start_service", start)
    monkeypatch.setattr(demo, "_addresses", lambda: ("queue:drums", "queue:watch"))
    monkeypatch.setattr(proximity, "kernels_are_cached", lambda: True, raising=False)

    def run_with(*arguments):
        result = run("demo", *arguments)
        (result.service,) = services or [None]
        return result

    run_with.service = {}
    yield run_with
    sys.setswitchinterval(interval)


def test_pipe_gets_the_summary_only(run):
    result = run("--limit", 0.5)

    assert (result.code, result.err) == (0, "")
    assert result.out.splitlines() == [
        "✓ 99.9 % of 4713 frames in time (limit 99%)",
        "✓ 0 touches as predicted 10 ms before, within 0.00 mm (limit 1 mm)",
        "✓ 0 touches held with 0.0 N at most (limit 20 N)",
        "Next:",
        "  proximity query part.stl 30 10 5  distance of a point from your part",
        "  proximity view part.stl           your part and a hand in the browser",
        "  proximity serve --help            this service, for your own controller",
    ]
    assert result.service.is_stopped


def test_terminal_shows_the_drums_beside_until_ctrl_c(run, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    shown = demo_view.picture
    count = []

    def picture(reading, seen, last, drums):
        """Interrupt when the first drum is at the end of its path, which takes longer on a busy machine."""
        count.append(1)
        words = drums.reported()
        if len(count) == 400 or (len(count) >= 3 and words and "approach, 10.0 mm" in words[0]):
            os.kill(os.getpid(), signal.SIGINT)
        return shown(reading, seen, last, drums)

    monkeypatch.setattr("proximity.cli.device.demo_view.picture", picture)
    result = run()

    plain = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", result.out)
    assert result.code == 0
    assert result.err.splitlines() == [demo.FIRST_LINE]
    assert re.search(r"IN TIME +\d+ of \d+ frames of the last second were in time", plain)
    assert re.search(r"0 +█+\S? +10\.0 .* approach, 10\.0 mm", plain)
    assert "touches held with" in plain
    assert result.service.is_stopped


def contacts_of(*distances):
    """Return a reading of fingers at the distances; nan: lost."""
    message = frame(len(distances), now_ns=10**9)
    message.header["state"], message.records["time_to_contact"] = State.OK, math.inf
    message.records["signed_distance"] = distances
    message.records["flags"] = np.where(np.isnan(distances), 0, int(ContactFlag.TRACKED))
    return Reading(State.OK, True, 10**9, 0, message.header, message.records)


class Beside:
    """Drums without a reported state."""

    bench = DrumBench(250.0)

    def reported(self):
        return []


def shown(reading, silent_s=0.0, came=998, due=1000):
    seen = watch_view.Seen("", Counts(), 0.0, silent_s, (), ("thumb", "index", "ring"))
    last = demo_view.LastSecond()
    last._samples.extend([(0.0, 0, 0), (1.0, came, due)])
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(demo_view.picture(reading, seen, last, Beside()))
    return console.export_text()


def test_picture_tells_which_finger_touches_which_comes_and_which_the_recording_lost():
    reading = contacts_of(-0.001, 0.005, math.nan)
    reading.contacts["time_to_contact"][1] = 0.042
    lines = shown(reading).splitlines()

    assert lines[0].strip() == "IN TIME   998 of 1000 frames of the last second were in time"
    assert lines[1].strip() == "touching: thumb; next: index in 42 ms; ring lost in the recording"
    assert re.match(r"thumb +touches +-1\.0 +now", lines[3]) and re.match(
        r"index +█+\S* +5\.0 +42 ms", lines[4]
    )
    assert re.match(r"ring +lost in the", lines[5]) and max(map(len, lines)) <= 80


def test_headline_judges_the_last_second_and_says_nothing_of_a_hand_it_does_not_know():
    reading = contacts_of(0.01)
    assert " MOSTLY IN TIME " in shown(reading, came=950) and " LATE " in shown(reading, came=700)
    assert shown(reading, silent_s=0.5).splitlines() == [" no frame for 0.5 s "]
    old = Reading(State.STALE, False, 10**9, 0, reading.header, contacts_of(math.nan).contacts)
    assert "lost" not in shown(old)


def test_touch_is_compared_with_its_prediction():
    watch = demo_view.TouchWatch()
    for ms, distance, left_s in [(0, 0.01, 0.1), (50, 0.005, 0.05), (85, 0.0015, 0.014), (98, -0.0001, 0.0)]:
        reading = contacts_of(distance)
        reading.contacts["pose_ns"], reading.contacts["time_to_contact"] = 10**9 + ms * 10**6, left_s
        reading.contacts["approach_speed"] = 0.1
        watch.add(reading)
    # Predicted for 99 ms, at 0.1 m/s; at 98 ms it is 0.1 mm inside.
    assert watch.touches == 1 and watch.farthest == pytest.approx(2e-4, abs=1e-9)


def test_faults_have_a_reason():
    drums = Beside()
    drums.bench = DrumBench(250.0)
    drums.bench.fingers = [
        drums.bench._finger(drums.bench._paths[0], drums.bench._plant(drums.bench._paths[0]))
    ]
    drums.bench.fingers[0].reasons["no sample for 200 ms"] += 2
    lines = [text.plain for text in demo_view.closing_lines(REPORT, demo_view.TouchWatch(), drums)]

    assert lines[2] == "✗ 0 touches held with 0.0 N at most (limit 20 N): 2 x no sample for 200 ms"


def test_service_that_fails_ends_the_demo(run):
    run.service = {"failure": ServiceError("demo.toml: the service has failed with exit code 1: oh")}

    result = run("--limit", 30)

    assert result.code == 2
    assert result.err == "proximity: demo.toml: the service has failed with exit code 1: oh\n"


def test_ctrl_c_while_the_service_starts_is_quiet(run, monkeypatch):
    """In a terminal the service receives the signal too, and ends before it has started."""

    def start(path, *, publish, say):
        os.kill(os.getpid(), signal.SIGINT)
        raise ServiceError("demo.toml: the service has failed with exit code 130: it printed nothing")

    monkeypatch.setattr(hosting, "start_service", start)

    result = run()

    assert (result.code, result.out, result.err) == (130, "", "")


def test_demo_without_frames_is_exit_code_1(run):
    run.service = {"count": 0}

    result = run("--limit", 0.3)

    assert result.code == 1
    assert "0 touches held" in result.out


def test_samples_are_beside_the_package_or_in_it(tmp_path, monkeypatch):
    assert demo.sample("demo.toml").parent.name == "meshes"

    package = tmp_path / "proximity"
    (package / "samples").mkdir(parents=True)
    monkeypatch.setattr(proximity, "__file__", str(package / "__init__.py"))
    with pytest.raises(ServiceError, match=r"the sample demo\.toml is neither in .*proximity nor in meshes"):
        demo.sample("demo.toml")
    (package / "samples" / "demo.toml").touch()
    assert demo.sample("demo.toml") == package / "samples" / "demo.toml"


def test_wheel_brings_the_samples_along():
    """demo.toml and the files that it names are in the wheel's list of additional files."""
    import tomllib

    settings = tomllib.loads((demo.sample("demo.toml").parent.parent / "pyproject.toml").read_text())
    brought = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    scene = tomllib.loads(demo.sample("demo.toml").read_text(encoding="utf-8"))

    needed = ["demo.toml", scene["input"]["recording"], *(part["file"] for part in scene["parts"])]
    assert brought == {f"meshes/{name}": f"proximity/samples/{name}" for name in needed}


def test_demo_runs_in_one_command_and_leaves_nothing_behind():
    environment = os.environ | {"FORCE_COLOR": "1"}  # it first shows the hand
    command = [sys.executable, "-m", "proximity", "demo", "--limit", "300"]
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    children = []
    try:
        first = program.stdout.read(1)
        children = psutil.Process(program.pid).children(recursive=True)
        program.send_signal(signal.SIGINT)
        rest, said = program.communicate(timeout=60)
    finally:
        program.kill()
        program.wait()
        gone, alive = psutil.wait_procs(children, timeout=30)
        for child in alive:
            child.kill()

    assert program.returncode == 0, said
    plain = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", first + rest)
    assert re.search(r"^[✓✗] \d+\.\d % of \d+ frames in time", plain, re.MULTILINE)
    assert re.search(r"^[✓✗] \d+ touch(es)? held with", plain, re.MULTILINE)
    assert gone and not alive
