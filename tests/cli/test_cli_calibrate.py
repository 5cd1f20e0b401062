"""``proximity calibrate``: prompts, interruption and correction of a measurement, and the calibration."""

import json
import os
import re
import signal
import threading

import numpy as np
import pytest
from simulated_motors import ODriveMotor

from proximity.cli.device.guide import guide, result_rows
from proximity.decaff.calibration.readings import Readings
from proximity.decaff.calibration.results import Estimate, Session
from proximity.decaff.calibration.simulated_glove import SimulatedGlove
from proximity.decaff.calibration.tasks import FREE, POSES, Bench
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.calibration import check_age, read_calibration
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.message import GLOVE_POSES, Message
from proximity.transport import open_publisher

COMMAND = ("calibrate",)
GLOVE = Glove()
SHORT = ("--simulate", "--skip", "held drum")


def test_simulated_glove_is_calibrated(run, tmp_path):
    ended = run(tmp_path / "glove.json", *SHORT, "--yes", "--name", "right index")

    assert ended.code == 0
    assert ended.out.endswith(f"{tmp_path}/glove.json: written\n")
    assert re.search(r"drum mass \[g\] +1\d\d\.\d+ +0\.\d+ +201\.\d+ +1\d\d\.\d+", ended.out)
    made = read_calibration(tmp_path / "glove.json")
    check_age(made)
    CalibratedGlove(GLOVE, made)
    assert made.name == "right index" and made.is_simulated
    assert '"simulated": true' in (tmp_path / "glove.json").read_text()


@pytest.mark.parametrize(
    ("value", "half_width", "cells"),
    [
        (3.926991e-6, 4e-12, ("3.9270", "<0.0001")),  # a simulated encoder's step
        (59.34e-6, 2.5e-6, ("59.3", "2.5")),
        (0.956e-6, 0.017e-6, ("0.956", "0.017")),
        (0.0, 2e-6, ("0.0", "2.0")),
    ],
)
def test_number_has_no_more_digits_than_it_is_good_for(value, half_width, cells):
    one = Estimate("step", "encoder step", "µm", 1e6, value, half_width, 7.853982e-6, 5)
    assert result_rows([one], None)[1][1:3] == cells


def test_input_that_ends_keeps_readings_and_the_next_run_goes_on(run, tmp_path):
    path = tmp_path / "glove.json"
    first = run(path, *SHORT, stdin="\n" * 5)

    assert first.code == 1
    assert "5 readings are kept in" in first.err and "the same command continues from there" in first.err
    assert not path.exists()
    second = run(path, *SHORT, stdin="\n" * 40)
    assert second.code == 0
    assert "glove.readings.json: 5 readings since" in second.err
    assert "[6 of 44] pose 6, 1 of 3" in second.out and "pose 5, 1 of 3" not in second.out


def test_interrupt_keeps_readings(run, tmp_path, monkeypatch):
    answers = iter(["", "", ""])

    def typed(question):
        try:
            return next(answers)
        except StopIteration:
            raise KeyboardInterrupt from None

    monkeypatch.setattr("builtins.input", typed)
    ended = run(tmp_path / "glove.json", *SHORT)

    assert ended.code == 130
    assert "3 readings are kept in" in ended.err
    assert "pose 3 [counts]" in ended.out
    assert len(json.loads((tmp_path / "glove.readings.json").read_text())["readings"]) == 3


def test_numbers_are_typed_and_what_is_none_or_cannot_be_is_asked_again(run, tmp_path):
    """Without a motor the chirps are skipped."""
    counts = GLOVE.counts(np.array(POSES)).tolist()
    lines = ["flat", *map(str, counts * 3)]
    lines += ["35100", "35000", *["35000", "35060"] * 3]  # opening below closing is impossible
    lines += ["35000", "34954"] * 3
    for i in range(9):
        bend = (1 / 6, 1 / 2, 5 / 6)[i % 3]
        lines += [str(GLOVE.counts(bend)), f"{float(GLOVE.drum_angle(bend)) + 0.031:.5f}"]
    lines += ["4.2", "1"] * 3
    ended = run(tmp_path / "glove.json", stdin="\n".join(lines) + "\n")

    assert ended.code == 0
    assert "'flat' is not a number, expected one such as 31072 or 1.178" in ended.err
    assert (
        "rejected: counts are 35100 closing and 35000 opening, expected at least as many opening. Meas"
        in ended.err
    )
    made = read_calibration(tmp_path / "glove.json")
    assert not made.is_simulated
    np.testing.assert_array_equal(made.counts, counts)
    assert made.touch_offset == pytest.approx(0.031, abs=1e-4)
    assert made.latency == pytest.approx(4.2e-3)
    assert "drum mass" not in ended.out


def test_counts_come_from_the_glove_and_a_hand_that_moves_is_asked_again(run, tmp_path, monkeypatch):
    reported = iter([21845.0, 31000.0])
    with open_publisher("mailbox:calibrate/poses") as sender:

        def sleep(seconds):
            message = Message(GLOVE_POSES, 1)
            message.records["finger"], message.records["counts"] = 1, next(reported, 21850.0)
            sender.publish(message)

        monkeypatch.setattr("proximity.cli.device.typed_instruments.time.sleep", sleep)
        monkeypatch.setattr("proximity.cli.device.typed_instruments.LISTENING_S", 0.01)
        ended = run(tmp_path / "g.json", "--counts", "mailbox:calibrate/poses", "--finger", "1", stdin="\n\n")

    assert ended.code == 1
    assert (
        "rejected: the potentiometer wandered by 9155 counts: hold the hand still. Measure it again"
        in ended.err
    )
    assert "read: 21850 counts" in ended.out


def test_results_are_printed_as_json_and_a_task_is_measured_again(run, tmp_path):
    path = tmp_path / "glove.json"
    ended = run(path, "--simulate", "--skip", "held drum", "--skip", "free drum", "--yes", "--json")
    document = json.loads(ended.out)
    assert document["latency"]["readings"] == 3 and document["latency"]["uncertainty_95"] > 0.0

    again = run(path, *SHORT, "--skip", "free drum", "--yes", "--again", "touch")
    assert "touches, 1 of 9" in again.out and "pose" not in again.out.partition("measured")[0]
    assert again.code == 0
    renewed = read_calibration(path).made
    run(path, *SHORT, "--skip", "free drum", "--yes")
    assert read_calibration(path).made == renewed  # without a measurement the date stays
    assert run(path, *SHORT, "--again", "chirp").words.count("there are no readings of 'chirp'") == 1


def test_motor_is_only_read_until_it_is_armed(run, tmp_path, monkeypatch):
    monkeypatch.setattr("proximity.cli.device.motors.SHOWN_S", 0.1)
    with ODriveMotor("calibrate-unarmed") as motor:
        stop = threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
        stop.start()
        ended = run(tmp_path / "glove.json", "--motor", f"{motor.url}&watchdog=300")
        stop.join()
        assert not motor.has_moved and motor.mode == "off"

    assert ended.code == 0
    assert "motor 0: 0.0000 turns, 0.000 A, off" in ended.out
    assert "No motor driver was ever run on hardware" in ended.err
    assert not (tmp_path / "glove.readings.json").exists()


def test_armed_motor_is_homed_and_off_while_the_person_turns_it(run, tmp_path, monkeypatch):
    """Counts are typed; the angles of touches come from the motor's encoder."""
    counts = GLOVE.counts(np.array(POSES)).tolist()
    lines = [*map(str, counts * 3), *["35000", "35060"] * 3, *["35000", "34954"] * 3]
    touches = [(1 / 6, 1 / 2, 5 / 6)[i % 3] for i in range(9)]
    modes = []
    with ODriveMotor("calibrate-armed") as motor:

        def typed(question):
            modes.append(motor.mode)
            if lines:
                return lines.pop(0)
            if not touches:
                raise EOFError
            bend = touches.pop(0)
            back = FingerPath(GLOVE).drum_angles[1] + 0.1 - float(GLOVE.drum_angle(bend)) - 0.031
            motor.turns = motor.stop - back * GLOVE.gear.ratio / (2.0 * np.pi)  # by hand, from the stop
            return str(GLOVE.counts(bend))

        monkeypatch.setattr("builtins.input", typed)
        ended = run(tmp_path / "glove.json", "--motor", f"{motor.url}&watchdog=300", "--arm")
        assert motor.has_moved and motor.mode == "off"

    assert ended.code == 1, ended.err
    assert "the motor moves now to find its stop" in ended.err
    assert set(modes) == {"off"}
    offset = re.search(r"drum zero \[mrad\] +([\d.]+)", ended.out)
    assert float(offset[1]) == pytest.approx(31.0, abs=0.5)


def test_motor_that_is_jammed_ends_with_a_sentence_and_off(run, tmp_path):
    with ODriveMotor("calibrate-jammed") as motor:
        motor.is_stalled = True
        ended = run(tmp_path / "glove.json", "--motor", f"{motor.url}&watchdog=300", "--arm")
        assert motor.mode == "off"
    assert ended.code == 2 and "the motor was switched off" in ended.err


def test_person_is_waited_for_before_the_motor_swings(tmp_path):
    """Also if all other numbers are typed, without waiting."""

    class Told(Exception):
        pass

    class Asking:
        def begin(self, prompt):
            assert (prompt.title, prompt.waits) == ("free drum, 1 of 5", True)
            raise Told

    glove = SimulatedGlove(0, GLOVE)
    session = Session(Bench(glove.instruments, GLOVE), Readings(tmp_path / "r.json", "test"))
    for task in session.tasks:
        if task is not FREE:
            session.skip(task)
    with pytest.raises(Told):
        guide(session, Asking(), None, waits=False)
