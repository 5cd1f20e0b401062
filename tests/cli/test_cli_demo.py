"""``proximity demo``: what its drums show, and that all of it starts, ends and tells."""

import math
import os
import re
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest
import queued_transport
from sealed_frames import frame

import proximity
from proximity.cli.device import demo
from proximity.cli.device.drum_loop import DrumsBeside
from proximity.cli.service import watch_view
from proximity.decaff.simulated_drums import DrumBench
from proximity.errors import PublishError, ServiceError
from proximity.message import Mode
from proximity.service import hosting
from proximity.transport import open_publisher, open_subscriber


def test_drums_that_cannot_receive_say_so(monkeypatch):
    queued_transport.register(monkeypatch)

    def fail(self):
        raise PublishError("queue:a: cannot receive (gone)")

    with open_subscriber("queue:a") as subscriber:
        monkeypatch.setattr(type(subscriber), "read", fail)
        with (
            pytest.raises(PublishError, match="gone"),
            DrumsBeside(DrumBench(250.0), subscriber, 250.0) as drums,
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
    """Publishes frames from a thread of this process."""

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
            message.header["valid_until_ns"] += 10**10  # so that a slow machine is not shown as LATE
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
    """``proximity demo`` with a service that is none, which the result has."""
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


def test_demo_shows_lines_and_ends_with_what_was_done(run):
    result = run("--limit", 0.5)

    lines = result.out.splitlines()
    assert (result.code, result.err) == (0, "")
    assert re.search(r" OK: \d+ Hz, .*; 0: 10.00 mm, position; 1: 20.00 mm, retract$", lines[0])
    assert lines[-4:-2] == [
        "service     4711 frames (4700 ok, 11 late), 2 ticks missed",
        "computing   p50 81 µs, p99 140 µs; woken late p50 60 µs, p99 90 µs",
    ]
    assert re.fullmatch(r"watch       \d+ frames seen, 0 lost, 0 refused", lines[-2])
    assert re.fullmatch(
        r"drums       [1-9]\d* frames seen, 0 touches held with 0\.00 N at most, 0 faults", lines[-1]
    )
    assert result.service.is_stopped


def test_terminal_shows_the_drums_beside_until_ctrl_c(run, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    shown = watch_view.picture
    count = []

    def picture(*arguments, **options):
        count.append(1)
        if len(count) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return shown(*arguments, **options)

    monkeypatch.setattr("proximity.cli.service.watch_view.picture", picture)
    result = run()

    plain = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", result.out)
    assert result.code == 0
    assert re.search(r"10\.00 ◆█.* position +approach, 10\.0 mm", plain)
    assert "drums       " in plain
    assert result.service.is_stopped


def test_service_that_fails_ends_the_demo(run):
    run.service = {"failure": ServiceError("demo.toml: the service has failed with exit code 1: oh")}

    result = run("--limit", 30)

    assert result.code == 2
    assert result.err == "proximity: demo.toml: the service has failed with exit code 1: oh\n"


def test_ctrl_c_while_the_service_starts_is_quiet(run, monkeypatch):
    """In a terminal the service hears of it as well, and ends before it has begun."""

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
    assert "drums       0 frames seen" in result.out


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
    """What demo.toml names, and itself, are in the list of what a wheel holds besides the package."""
    import tomllib

    settings = tomllib.loads((demo.sample("demo.toml").parent.parent / "pyproject.toml").read_text())
    brought = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    scene = tomllib.loads(demo.sample("demo.toml").read_text(encoding="utf-8"))

    needed = ["demo.toml", scene["input"]["recording"], *(part["file"] for part in scene["parts"])]
    assert brought == {f"meshes/{name}": f"proximity/samples/{name}" for name in needed}


def test_demo_runs_in_one_command_and_leaves_nothing_behind():
    environment = {
        key: value for key, value in os.environ.items() if key not in ("FORCE_COLOR", "GITHUB_ACTIONS")
    }
    command = [sys.executable, "-m", "proximity", "demo", "--limit", "300"]
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    children = []
    try:
        first = program.stdout.readline()
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
    assert re.match(r"[\d:]{8} [A-Z]+: \d+ Hz, ", first)
    assert re.search(r"^service     \d+ frames \(.*\), \d+ ticks missed$", rest, re.MULTILINE)
    assert re.search(r"^drums       [1-9]\d* frames seen, ", rest, re.MULTILINE)
    assert gone and not alive
