"""``proximity drum``: controllers and simulated drums follow a service and report their results."""

import csv
import io
import json
import re
import sys
import time

import glove_files
import numpy as np
import pytest
from publishing import publishing
from rich.console import Console
from sealed_frames import frame
from simulated_motors import ODriveMotor

from proximity import cli
from proximity.cli import tables
from proximity.cli.device import drum_loop
from proximity.cli.device.drum_loop import DrumLog
from proximity.decaff.controller.controller import DrumState
from proximity.decaff.controller.settings import CableRule
from proximity.decaff.drum.drum_model import Motor
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.calibrated_glove import read_glove
from proximity.decaff.glove.glove import Glove
from proximity.decaff.simulated_drums import DrumBench, FingerBench
from proximity.errors import ArgumentError
from proximity.message import CONTACT, ContactFlag, Mode, State, Surface
from proximity.transport import Counts, Reading, open_publisher

COMMAND = ("drum",)
ADDRESS = "mailbox:drum"
GLOVE = Glove()
WALL = 0.5
MS = 1_000_000


def fill(contacts, bend):
    """Set the fields of fingers at a bend in front of a wall."""
    contacts["mode"], contacts["bend"], contacts["contact_bend"] = Mode.POSITION, bend, WALL
    distance = float(GLOVE.finger.path_length(bend, WALL))
    for name in ("signed_distance", "lower", "upper"):
        contacts[name] = distance


def reading(now_ns, bend, count=1, state=State.OK):
    message = frame(count, now_ns)
    fill(message.records, bend)
    message.header["sequence"] = now_ns // MS
    return Reading(state, True, now_ns, 0, message.header[()], message.records)


def step(bench, told):
    """Step at the instant of the reading, with one clock for all."""
    bench.step(told, told.now_ns)


@pytest.fixture
def service():
    """Publish two fingers at rest in front of a wall, until the end of the test."""

    def message():
        made = frame(2, time.monotonic_ns())
        fill(made.records, 0.45)
        return made

    with publishing(ADDRESS, message, 0.002):
        yield


def test_drum_meets_the_finger_and_goes_when_nothing_is_known():
    """A finger bends into a wall at 0.2 m/s, presses, and its frames stop."""
    bench = DrumBench(1000.0)
    bends = [*np.linspace(0.3, 0.52, 220), *[0.52] * 200]
    for sample, bend in enumerate(bends):
        step(bench, reading(sample * MS, bend))
    finger = bench.fingers[0]
    assert finger.action.state.value == "position"
    assert finger.plant.position == pytest.approx(float(GLOVE.finger.path_length(0.0, WALL)), abs=2e-4)
    depth = finger.path.position(0.52) - finger.plant.position
    assert finger.plant.force == pytest.approx(200.0 * depth, rel=0.02)
    assert (finger.touches, finger.faults) == (1, 0)

    empty = np.zeros(0, CONTACT)
    for sample in range(len(bends), len(bends) + 1000):
        step(bench, Reading(State.STALE, False, sample * MS, 0, None, empty))
    assert finger.action.state.value == "retracted"
    assert finger.plant.position == pytest.approx(finger.path.retracted, abs=1e-3)


def test_drum_makes_up_for_the_stretch_of_a_cable():
    """Pad and cable are springs in series; with its nearer target the drum presses as without a cable."""
    forces = []
    for rule in (CableRule(), CableRule(1200.0)):
        bench = DrumBench(1000.0, cable=rule)
        for sample, bend in enumerate([*np.linspace(0.3, 0.52, 220), *[0.52] * 1000]):
            step(bench, reading(sample * MS, bend))
        assert bench.fingers[0].action.state.value == "position"
        forces.append(bench.fingers[0].plant.force)
    assert forces[0] == pytest.approx(forces[1], rel=0.03)


def test_table_has_a_row_for_each_finger():
    bench = DrumBench(1000.0)
    for sample in range(3):
        step(bench, reading(sample * MS, 0.3, 3))
    stream = io.StringIO()
    Console(file=stream, width=100).print(drum_loop.table(reading(0, 0.3, 3), bench, 2))
    rows = stream.getvalue().splitlines()

    assert rows[0].strip() == "OK, 3 fingers"
    assert [row.split()[:2] for row in rows[2:]] == [["0", "approach"], ["1", "approach"]]


def test_line_tells_state_places_and_force():
    bench = DrumBench(1000.0)
    assert drum_loop.line(reading(0, 0.3), bench).endswith("OK: no frame yet")
    for sample in range(5):
        step(bench, reading(sample * MS, 0.3, 10))
    told = drum_loop.line(reading(0, 0.3), bench).split("; ")

    finger = 1e3 * float(GLOVE.finger.path_length(0.0, 0.3))
    assert re.fullmatch(
        rf"\d\d:\d\d:\d\d OK: 0: approach, drum at \d+\.\d mm \(\d+\.\d°\), finger at {finger:.1f} mm",
        told[0],
    )
    assert len(told) == 9 and told[-1] == "and 2 more"
    bench.fingers[0].plant.force = 0.5
    assert re.search(r" mm, 0\.50 N by -?\d+\.\d mNm; 1: ", drum_loop.line(reading(0, 0.3), bench))


def test_late_sample_is_a_fault_that_is_counted_and_begun_anew():
    bench = DrumBench(1000.0)
    for now_ms in (0, 1, 2, 3, 40, 41, 42, 43):
        step(bench, reading(now_ms * MS, 0.3))
    told = drum_loop.summary(bench, ADDRESS, Counts(received=8), 0.043)["fingers"][0]

    assert told["faults"] == 1
    assert told["samples"] == {"retracted": 1 + 1, "approach": 3 + 2, "fault": 1}
    assert told["state"] == "approach"


def test_clock_of_another_machine_that_is_learnt_anew_is_no_fault():
    """Sampled each millisecond; the estimate of the other clock jumps by an hour, then by 23 ms."""
    bench, now_ns = DrumBench(1000.0), 0
    for sample in range(90):
        now_ns += MS + {20: 3_600_000 * MS, 40: 23 * MS}.get(sample, 0)
        bench.step(reading(now_ns, 0.3), sample * MS)

    (finger,) = bench.fingers
    assert finger.faults == 0
    assert abs(finger.plant.position - finger.path.position(WALL)) < 1e-3


def test_untracked_finger_stays_where_it_was():
    bench = DrumBench(1000.0)
    step(bench, reading(0, 0.3))
    lost = reading(MS, 0.4)
    lost.contacts["flags"] &= ~np.uint32(ContactFlag.TRACKED)
    step(bench, lost)

    assert bench.fingers[0].bend == pytest.approx(0.3)


def test_pipe_gets_plain_lines(run, service, monkeypatch):
    monkeypatch.setattr(tables, "LINE_EVERY_S", 0.2)
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


def test_contact_becomes_a_drum_angle_by_the_calibrated_glove(tmp_path):
    """This hand's potentiometer reads differently from the design, and its drum's zero is off."""
    glove = read_glove(glove_files.write(tmp_path / "glove.json"))
    worn, designed = DrumBench(1000.0, [glove]), DrumBench(1000.0)
    for sample in range(5):
        step(worn, reading(sample * MS, 0.3))
        step(designed, reading(sample * MS, 0.3))

    angle = worn.fingers[0].action.angle
    assert angle == pytest.approx(float(glove.drum_angle(WALL)), abs=1e-5)
    assert angle == pytest.approx(float(glove_files.HAND.drum_angle(WALL)) + glove_files.MOUNTED, abs=3e-3)
    assert angle - designed.fingers[0].action.angle > 0.04


def test_calibration_is_given_on_the_command_line(run, service, tmp_path):
    path = glove_files.write(tmp_path / "glove.json")
    result = run(ADDRESS, "--limit", 0.6, "--json", "--glove", path)
    told = json.loads(result.out)["fingers"][0]

    assert (result.code, result.err) == (0, "")
    glove = read_glove(path)
    if told["state"] == "approach":  # if the machine is not too slow
        assert told["drum_rad"] > float(glove.drum_angle(WALL - 0.01))


def test_calibrations_of_another_number_of_fingers_are_refused_with_the_first_frame(run, service, tmp_path):
    path = glove_files.write(tmp_path / "glove.json")
    result = run(ADDRESS, "--limit", 20, *["--glove", path] * 3)

    assert result.code == 2
    assert result.err == ("proximity: 3 calibrations for 2 fingers, expected one for all, or one for each\n")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("old.json",
         r"old\.json: the calibration is of .*, 31 days ago, expected 30 at most: calibrate again"),
        ("far.json", r"far\.json: the table has counts from 60000 to 70000, expected 0 to 65535 of this"),
        ("none.json", r"none\.json: cannot be read \(No such file or directory\)"),
    ],
)  # fmt: skip
def test_calibration_that_does_not_fit_is_refused_with_one_sentence(run, tmp_path, name, message):
    glove_files.write(tmp_path / "old.json", days_ago=31.0)
    glove_files.write(tmp_path / "far.json", counts=np.linspace(60_000, 70_000, 7))
    result = run(ADDRESS, "--limit", 1, "--glove", tmp_path / name)
    assert result.code == 2
    assert len(result.err.splitlines()) == 1 and re.search(message, result.err)


def test_drum_without_bends_is_shown_as_if_fingers_bent_straight_and_that_is_said():
    """A finger comes 20 mm nearer, goes 1 mm inside, and its bend is unknown."""
    bench = DrumBench(1000.0)
    distances = [*np.linspace(0.020, -0.001, 200), *[-0.001] * 200]
    for sample, distance in enumerate(distances):
        told = reading(sample * MS, 0.3)
        for name in ("bend", "bend_rate", "contact_bend", "contact_bend_error"):
            told.contacts[name] = np.nan
        for name in ("signed_distance", "lower", "upper"):
            told.contacts[name] = distance
        step(bench, told)

    (finger,) = bench.fingers
    assert finger.action.state.value == "position" and finger.touches == 1
    assert finger.plant.force == pytest.approx(0.2, rel=0.15)  # a pad of 200 N/m
    assert bench.warnings() == [
        "the service reports no bend for finger 0: shown as if it bent straight towards the nearest surface; "
        "a real drum stays "
        "retracted without a bend, which comes from a path or a glove"
    ]
    assert bench.warnings() == []


def test_all_fingers_without_bends_are_named_though_somebody_asks_in_the_midst_of_a_sample(monkeypatch):
    bench, reported = DrumBench(1000.0), []
    step_of_finger = FingerBench.step

    def ask_after(finger, *given):
        step_of_finger(finger, *given)
        reported.extend(bench.warnings())

    monkeypatch.setattr(FingerBench, "step", ask_after)
    told = reading(0, 0.3, 2)
    told.contacts["bend"] = np.nan
    step(bench, told)

    reported += bench.warnings()
    assert [sentence.partition(":")[0] for sentence in reported] == [
        "the service reports no bend for finger 0, 1"
    ]


@pytest.mark.parametrize(("stiffness", "is_said"), [(100.0, False), (1e5, True)])
def test_stiffness_beyond_what_is_passive_is_said_once(stiffness, is_said):
    bench, told = DrumBench(500.0), []
    for sample in range(5):
        seen = reading(2 * sample * MS, 0.45)
        seen.contacts["surface"], seen.contacts["stiffness"] = Surface.DEFORMABLE, stiffness
        step(bench, seen)
        told += bench.warnings()

    shown, _ = bench.fingers[0].controller.law.displayed(stiffness, 0.0)
    expected = (
        "the part before finger 0 has 100000 N/m, more than this drum can render at 500 Hz without "
        f"adding energy: it is rendered as {shown:.0f} N/m"
    )
    lacking = bench.fingers[0].controller.law.lacking(stiffness, 0.0)
    left = (
        f"at {shown:.0f} N/m the drum itself lacks {lacking:.2g} N s/m of damping to be passive on "
        "its own: it relies on the damping of a fingertip"
    )
    assert told == ([expected, left] if is_said else [left])
    assert shown == pytest.approx(2.0 / (1.5 / 500.0), rel=1e-3) or not is_said  # B over 1.5 periods


def test_doubts_are_said_on_stderr(run):
    with open_publisher(ADDRESS) as publisher:
        message = frame(2, time.monotonic_ns())
        message.records["bend"] = np.nan
        message.header["valid_until_ns"] += 10**10
        publisher.publish(message)
        result = run(ADDRESS, "--limit", 0.4, "--json")

    assert result.code == 0
    assert result.err.startswith(
        "proximity: the service reports no bend for finger 0, 1: shown as if it bent straight"
    )
    assert len(result.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("failure", "ending"),
    [(ZeroDivisionError("of a drum"), ZeroDivisionError), (ArgumentError("of a drum"), SystemExit)],
)
def test_drums_that_fail_end_the_command_with_their_motors_off(service, monkeypatch, failure, ending):
    """Regression: the table continued to show the last state, and the exit code was 0."""
    benches = []

    def fail(log, reading, bench):
        if any(finger.action.state is DrumState.APPROACH for finger in bench.fingers):
            benches.append(bench)
            raise failure

    monkeypatch.setattr(DrumLog, "append", fail)
    monkeypatch.setattr(sys, "argv", ["proximity", "drum", ADDRESS, "--limit", "20", "--json"])
    with pytest.raises(ending) as end:
        cli.main()

    assert end.type is ZeroDivisionError or end.value.code == 2
    (bench,) = benches
    for finger in bench.fingers:
        action = finger.action
        assert (action.state, action.mode) == (DrumState.FAULT, DriveMode.BRAKED)
        assert (action.force_cap, action.torque_cap, action.motor_speed_cap) == (0.0, 0.0, 0.0)
        assert finger.controller.fault == "the controllers ended: of a drum"


def test_log_has_a_line_a_finger_and_sample(run, service, tmp_path):
    path = tmp_path / "drum.csv"
    result = run(ADDRESS, "--limit", 0.5, "--json", "--log", path)
    fingers = json.loads(result.out)["fingers"]
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))

    assert len(rows) == sum(sum(finger["samples"].values()) for finger in fingers) > 0
    assert {row["finger"] for row in rows} == {"0", "1"}
    moving = [row for row in rows if row["mode"] == "position"]
    assert all(0.0 < float(row["torque_cap_Nm"]) <= Motor().torque for row in moving)
    assert all(abs(float(row["motor_torque_Nm"])) <= Motor().torque for row in rows)
    assert all(0.0 <= float(row["motor_speed_cap_rad_s"]) <= Motor().speed * (1 + 1e-9) for row in rows)


def test_motor_is_only_read_until_it_is_armed(run):
    """Works without a service and without motion; warns that no driver was tried on hardware."""
    with ODriveMotor("drum-unarmed") as motor:
        result = run(ADDRESS, "--motor", f"{motor.url}&watchdog=300", "--limit", 0.5)
        assert not motor.has_moved
    assert (result.code, result.out) == (0, "motor 0: 0.0000 turns, 0.000 A, off\n")
    assert "No motor driver was ever run on hardware" in result.err and "not armed" in result.err


def test_armed_motor_that_is_jammed_ends_with_a_sentence(run):
    with ODriveMotor("drum-jammed") as motor:
        motor.is_stalled = True
        result = run(ADDRESS, "--motor", f"{motor.url}&watchdog=300", "--arm")
        assert motor.mode == "off"
    assert result.code == 2 and "motor 0 moves now" in result.err
    assert "the shaft does not turn back from the stop" in result.err
