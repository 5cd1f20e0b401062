"""Calibration with a motor: its drum is identified, and the motor is on only during swings."""

import itertools
import math
import time

import numpy as np
import pytest
from simulated_motors import Cia402Motor, ODriveMotor, SimpleFocMotor

from proximity.decaff.calibration import instruments
from proximity.decaff.calibration.drum_chirp import (
    drum_stiffness,
    free_chirp,
    held_chirp,
    identify_free,
    identify_held,
    inertia,
)
from proximity.decaff.calibration.instruments import MotorPort
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.decaff.motors.motor_drum import opened_motors
from proximity.errors import DecaffError, MotorError

GLOVE = Glove()
PATH = FingerPath(GLOVE)
DRUM = PATH.drum
CHANNELS = itertools.count()
PATIENT = "&watchdog=300"  # ms: a loaded machine may delay a simulated motor
TURN = 2.0 * math.pi
INERTIA, FRICTION = 1.25 * inertia(DRUM), 0.8 * DRUM.friction * DRUM.lever  # kg m² and N m of the drum
HALF_WAY = 0.5 * (PATH.drum_angles[1] - PATH.drum_angles[0]) * DRUM.gear.ratio / TURN  # turns of the motor
STEP = 2e-4  # s
STIFFNESS = 0.8 * drum_stiffness(GLOVE, GLOVE.cable.stiffness)  # N m/rad


def like_the_drum(shaft):
    """Set inertia and friction of a simulated motor to those of the drum through its gear."""
    per_turn = TURN / DRUM.gear.ratio**2
    shaft.inertia, shaft.viscous, shaft.friction = (
        INERTIA * per_turn,
        1e-5 * per_turn,
        FRICTION / DRUM.gear.ratio,
    )
    shaft.stiffness = STIFFNESS * per_turn
    return shaft


class LockStep:
    """Time that advances only in sleeps, together with the motor.

    Results of the identification do not depend on the load of the machine.
    """

    def __init__(self, motor, monkeypatch):
        self.motor, self.now = motor, 1000.0
        monkeypatch.setattr(time, "monotonic", lambda *unused: self.now)
        monkeypatch.setattr(time, "sleep", self.sleep)

    def sleep(self, seconds):
        for _ in range(max(1, round(seconds / STEP))):
            self.motor.advance(STEP)
            self.motor.serve()
            self.now += STEP


@pytest.fixture
def motor(monkeypatch):
    """A motor in lock-step, on a bus without threads or terminals."""
    shaft = like_the_drum(ODriveMotor(f"port{next(CHANNELS)}"))
    LockStep(shaft, monkeypatch)
    yield shaft
    shaft.close()


@pytest.fixture
def drum(motor):
    with opened_motors([motor.url], [PATH], lambda sentence: None) as (drum,):
        yield drum


@pytest.fixture
def port(motor, drum):
    """The port of a homed motor whose drum is in the middle of its path."""
    drum.home()
    drum.rest()
    motor.turns -= HALF_WAY
    return MotorPort(drum, DRUM)


def test_free_drum_is_identified_and_the_motor_off_again(motor, port):
    assert port.angle() == pytest.approx(0.5 * sum(PATH.drum_angles), abs=0.05)

    found = identify_free(port.swing(free_chirp(DRUM).torques(port.rate)), DRUM)

    assert motor.mode == "off"
    assert found["inertia"] == pytest.approx(INERTIA, rel=0.02)
    assert found["friction"] == pytest.approx(FRICTION, rel=0.1)
    assert 0.0 < found["latency"] < 0.006


def test_cable_is_identified_while_the_finger_is_held(motor, port):
    motor.held_at = motor.turns

    record = port.swing(held_chirp(GLOVE, DRUM).torques(port.rate))

    assert identify_held(record, DRUM, GLOVE, 0.0)["stiffness"] == pytest.approx(STIFFNESS, rel=0.05)


def test_nothing_moves_before_homing(motor, drum):
    with pytest.raises(MotorError, match="a motion was commanded before the motor was homed"):
        MotorPort(drum, DRUM).swing(np.full(100, 1e-3))
    assert not motor.has_moved and motor.mode == "off"


def test_interrupted_swing_leaves_the_motor_off(motor, port):
    motor.held_at, before = motor.turns, motor.serve

    def interrupted():
        before()
        if motor.mode == "torque" and motor.has_moved:
            motor.serve = before
            raise KeyboardInterrupt

    motor.has_moved, motor.serve = False, interrupted
    with pytest.raises(KeyboardInterrupt):
        port.swing(np.full(100, -0.1))
    time.sleep(0.1)
    assert motor.mode == "off"


@pytest.mark.parametrize("make", [lambda: Cia402Motor(f"port{next(CHANNELS)}"), SimpleFocMotor])
def test_motor_is_read_while_a_person_works_and_a_fault_is_reported(make):
    """With threads, in real time; the first is a drive that needs our heartbeat."""
    with (
        like_the_drum(make()) as motor,
        opened_motors([motor.url + PATIENT], [PATH], lambda sentence: None) as (drum,),
    ):
        drum.home()
        drum.rest()
        with MotorPort(drum, DRUM) as port:
            motor.turns -= HALF_WAY
            wait_until(lambda: abs(port.angle() - 0.5 * sum(PATH.drum_angles)) < 0.1)
            port.swing(np.full(20, 1e-4))
            assert motor.mode == "off"
            motor.is_silent = True
            wait_until(lambda: port._failure is not None)
            with pytest.raises(MotorError, match="the motor has not answered for"):
                port.angle()


def wait_until(done):
    ends = time.monotonic() + 20.0
    while not done():
        assert time.monotonic() < ends
        time.sleep(0.01)


def test_ratio_that_is_not_the_drums_is_refused(drum):
    with pytest.raises(
        DecaffError,
        match=r"^the motor's address has a ratio of 51 and the drum one of 14, expected the same: ",
    ):
        MotorPort(drum, DRUMS["gear14"])


def test_answers_that_come_late_are_left_out_and_a_long_silence_is_refused():
    row = [(0.002 * i, float(i % 2), 0.1 * i, 0.0, i // 2) for i in range(50)]  # every other reading is new
    record = instruments._record(row)
    assert len(record.times) == 25
    np.testing.assert_allclose(record.commanded, 0.5)
    with pytest.raises(DecaffError, match=r"^the motor did not answer for 40 ms of a swing, expected an ans"):
        instruments._record([row[0], (0.04, 0.0, 0.0, 0.0, 1)])
