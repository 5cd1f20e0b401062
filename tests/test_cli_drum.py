"""``proximity drum``: controllers and simulated drums follow a service, and tell what became of them."""

import io
import json
import re
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from sealed_frames import frame

from proximity import cli
from proximity.cli import drum_run
from proximity.decaff.drum_bench import DrumBench
from proximity.decaff.glove import Glove
from proximity.message import CONTACT, ContactFlag, Mode, State
from proximity.transport import Counts, Reading, open_publisher

ADDRESS = "mailbox:drum"
GLOVE = Glove()
WALL = 0.5
MS = 1_000_000


def fill(contacts, bend):
    """Fingers at a bend before a wall."""
    contacts["mode"], contacts["bend"], contacts["contact_bend"] = Mode.POSITION, bend, WALL
    distance = float(GLOVE.finger.path_length(bend, WALL))
    for name in ("signed_distance", "lower", "upper"):
        contacts[name] = distance


def reading(now_ns, bend, count=1, state=State.OK):
    message = frame(count, now_ns)
    fill(message.records, bend)
    return Reading(state, True, now_ns, 0, message.header[()], message.records)


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command line in this process; returns exit code, stdout and stderr."""
    for name in ("FORCE_COLOR", "NO_COLOR", "GITHUB_ACTIONS", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)

    def run_with(*arguments):
        monkeypatch.setattr(sys, "argv", ["proximity", "drum", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        written = capsys.readouterr()
        return SimpleNamespace(code=end.value.code, out=written.out, err=written.err)

    return run_with


@pytest.fixture
def service():
    """Two fingers that wait before a wall, until the test is over."""
    over = threading.Event()

    def publish():
        with open_publisher(ADDRESS) as publisher:
            while not over.wait(0.002):
                message = frame(2, time.monotonic_ns())
                fill(message.records, 0.45)
                publisher.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    over.set()
    thread.join()


def test_drum_meets_the_finger_and_goes_when_nothing_is_known():
    """A finger bends into a wall at 0.2 m/s, presses, and its frames stop."""
    bench = DrumBench(1000.0, GLOVE)
    bends = [*np.linspace(0.3, 0.52, 220), *[0.52] * 200]
    for sample, bend in enumerate(bends):
        bench.step(reading(sample * MS, bend))
    finger = bench.fingers[0]
    assert finger.action.state.value == "position"
    assert finger.plant.place == pytest.approx(float(GLOVE.finger.path_length(0.0, WALL)), abs=2e-4)
    depth = finger.path.place(0.52) - finger.plant.place
    assert finger.plant.force == pytest.approx(200.0 * depth, rel=0.02)
    assert (finger.touches, finger.faults) == (1, 0)

    empty = np.zeros(0, CONTACT)
    for sample in range(len(bends), len(bends) + 1000):
        bench.step(Reading(State.STALE, False, sample * MS, 0, None, empty))
    assert finger.action.state.value == "retracted"
    assert finger.plant.place == pytest.approx(finger.path.retracted, abs=1e-3)


def test_line_tells_state_places_and_force():
    bench = DrumBench(1000.0, GLOVE)
    assert drum_run.line(reading(0, 0.3), bench).endswith("OK: no frame yet")
    for sample in range(5):
        bench.step(reading(sample * MS, 0.3, 10))
    told = drum_run.line(reading(0, 0.3), bench).split("; ")

    finger = 1e3 * float(GLOVE.finger.path_length(0.0, 0.3))
    assert re.fullmatch(
        rf"\d\d:\d\d:\d\d OK: 0: approach, drum at \d+\.\d mm, finger at {finger:.1f} mm", told[0]
    )
    assert len(told) == 9 and told[-1] == "and 2 more"
    bench.fingers[0].has_bend = False
    assert "; 1: " in drum_run.line(reading(0, 0.3), bench)
    assert "no bend is told" in drum_run.line(reading(0, 0.3), bench).split("; ")[0]


def test_table_has_a_row_for_each_finger():
    bench = DrumBench(1000.0, GLOVE)
    for sample in range(3):
        bench.step(reading(sample * MS, 0.3, 3))
    stream = io.StringIO()
    Console(file=stream, width=100).print(drum_run.table(reading(0, 0.3, 3), bench, 2))
    rows = stream.getvalue().splitlines()

    assert rows[0].strip() == "OK, 3 fingers"
    assert [row.split()[:2] for row in rows[2:]] == [["0", "approach"], ["1", "approach"]]


def test_late_sample_is_a_fault_that_is_counted_and_begun_anew():
    bench = DrumBench(1000.0, GLOVE)
    for now_ms in (0, 1, 2, 3, 40, 41, 42, 43):
        bench.step(reading(now_ms * MS, 0.3))
    told = drum_run.summary(bench, ADDRESS, Counts(received=8), 0.043)["fingers"][0]

    assert told["faults"] == 1
    assert told["samples"] == {"retracted": 1 + 1, "approach": 3 + 2, "fault": 1}
    assert told["state"] == "approach"


def test_untracked_finger_stays_where_it_was():
    bench = DrumBench(1000.0, GLOVE)
    bench.step(reading(0, 0.3))
    lost = reading(MS, 0.4)
    lost.contacts["flags"] &= ~np.uint32(ContactFlag.TRACKED)
    bench.step(lost)

    assert bench.fingers[0].bend == pytest.approx(0.3)


def test_pipe_gets_plain_lines(run, service, monkeypatch):
    monkeypatch.setattr(drum_run, "LINE_EVERY_S", 0.2)
    result = run(ADDRESS, "--limit", 0.8, "--rate", 200)

    lines = result.out.splitlines()
    assert (result.code, result.err) == (0, "")
    assert len(lines) >= 2
    assert "\x1b" not in result.out
    assert all(re.match(r"[\d:]{8} [A-Z]+: 0: [a-z]+, drum at ", text) for text in lines[1:])


def test_json_is_a_summary(run, service):
    result = run(ADDRESS, "--limit", 0.5, "--json")
    told = json.loads(result.out)

    assert result.code == 0
    assert told["address"] == ADDRESS
    assert told["frames"] > 0 and told["seconds"] >= 0.5
    assert [finger["finger"] for finger in told["fingers"]] == [0, 1]
    assert all(finger["has_bend"] for finger in told["fingers"])


def test_silence_is_exit_code_1(run):
    result = run("mailbox:nobody", "--limit", 0.2)

    assert result.code == 1
    assert all(text.endswith("STALE: no frame yet") for text in result.out.splitlines())


@pytest.mark.parametrize("rate", ["100", "6000", "nan"])
def test_rate_that_cannot_be_is_refused(run, rate):
    result = run(ADDRESS, "--rate", rate)

    assert result.code == 2
    assert "expected 150 to 5000" in " ".join(result.err.split())
