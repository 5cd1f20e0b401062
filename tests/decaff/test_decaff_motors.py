"""Drums with motors: each driver against a simulated motor of its protocol, with and without errors."""

import io
import itertools
import math
import time
from dataclasses import replace
from runpy import run_path

import glove_files
import numpy as np
import pytest
from sealed_frames import frame
from simulated_motors import DRIVERS, Cia402Motor, ODriveMotor, SimpleFocMotor

from proximity.decaff.controller.controller import DrumAction, DrumState
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.calibrated_glove import read_glove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.motors.motor_driver import MotorCommand, MotorScale, MotorSettings, open_motor
from proximity.decaff.motors.motor_drum import MotorDrum, home_all, opened_motors
from proximity.decaff.simulated_drums import DrumBench
from proximity.errors import MotorError
from proximity.message import CONTACT, Mode, State
from proximity.transport import Reading

PATH = FingerPath(Glove())
KINDS = {"odrive-can": ODriveMotor, "canopen": Cia402Motor, "simplefoc": SimpleFocMotor}
CHANNELS = itertools.count()
PERIOD = 0.004
PATIENT = "&watchdog=500"  # ms: a loaded machine may delay a simulated motor


def simulated(kind, **shaft):
    """Return a motor with a bus, 0.1 turns before its stop."""
    return KINDS[kind](**shaft) if kind == "simplefoc" else KINDS[kind](f"motors{next(CHANNELS)}", **shaft)


@pytest.fixture(params=KINDS)
def motor(request):
    with simulated(request.param) as shaft:
        yield shaft


@pytest.fixture
def drum(motor):
    """The drum of a motor that is off, before and after the test."""
    with opened_motors([f"{motor.url}{PATIENT}&ratio=4"], [PATH], lambda sentence: None) as (drum,):
        yield drum
    deadline = time.monotonic() + 1.0
    while motor.mode != "off" and not motor.is_silent and time.monotonic() < deadline:
        time.sleep(0.01)
    assert motor.mode == "off"


def action(mode=DriveMode.POSITION, state=DrumState.APPROACH, **fields):
    given = {"position": 0.0, "angle": 0.0, "force": 0.0, "speed_cap": math.inf, "force_cap": 5.0} | fields
    return DrumAction(state, mode, **given)


def serve(drum, wanted, seconds=0.5):
    last = started = time.monotonic()
    while last - started < seconds:
        time.sleep(PERIOD)
        now = time.monotonic()
        drum.advance(wanted, 0.0, now - last)
        last = now


def test_drum_is_homed_goes_where_it_is_sent_and_presses(motor, drum):
    """Position and torque, in metres and newtons, within the resolution of encoder and current."""
    drum.home()
    assert drum.angle == pytest.approx(PATH.drum_angles[1], abs=0.03)

    wanted = 0.5 * (PATH.drum_angles[0] + PATH.drum_angles[1])
    serve(drum, action(angle=wanted, speed_cap=0.2), 0.8)
    assert drum.angle == pytest.approx(wanted, abs=0.02)
    assert drum.position == pytest.approx(PATH.drum_position(wanted), abs=1e-3)

    motor.is_stalled = True  # an unyielding finger
    serve(drum, action(DriveMode.FORCE, DrumState.CONTACT_FORCE, force=2.0), 0.15)
    assert drum.force == pytest.approx(2.0, rel=0.02)
    assert motor.torque < 0.0
    assert getattr(motor, "dropped", 0) == 0


def test_lost_frames_are_borne(motor, drum):
    """One answer of five is lost; no gap is long enough to count as silence."""
    motor.loss = 0.2
    drum.home()
    serve(drum, action(angle=PATH.drum_angles[1] - 0.2), 0.3)


@pytest.mark.parametrize(
    ("trouble", "sentence"),
    [
        ("is_silent", "the motor has not answered for "),
        ("is_wrong", "the motor has not answered for "),
        ("is_stalled", "the shaft does not turn"),
    ],
)
def test_uncertainty_switches_the_motor_off_and_says_why(motor, drum, trouble, sentence):
    drum.home()
    drum.settings = replace(drum.settings, watchdog=0.15)  # s: a stall is told after 0.3
    setattr(motor, trouble, True)
    with pytest.raises(MotorError, match=sentence) as raised:
        serve(drum, action(angle=PATH.drum_angles[0] + 0.3), 2.0)
    assert motor.url in str(raised.value)
    assert "the motor was switched off" in str(raised.value)
    time.sleep(0.05)
    assert motor.mode == "off"


def test_stalled_shaft_is_not_taken_for_the_stop(motor, drum):
    motor.is_stalled = True
    with pytest.raises(MotorError, match="jammed"):
        drum.home()
    assert not drum.is_homed


def test_nothing_moves_before_homing(motor, drum):
    drum.await_answer()
    for _ in range(20):
        drum.look()
        time.sleep(PERIOD)
    with pytest.raises(MotorError, match="before the motor was homed"):
        drum.advance(action(angle=1.0), 0.0, PERIOD)
    assert motor.mode == "off"
    assert not motor.has_moved


def test_missing_stop_is_noticed():
    with (
        simulated("odrive-can", stop=100.0) as shaft,
        opened_motors([shaft.url + "&ratio=0.2" + PATIENT], [PATH], print) as (drum,),
        pytest.raises(MotorError, match="no mechanical stop was found"),
    ):
        drum.home()


def test_drum_beyond_its_limits_is_let_go():
    """The stop yields after homing."""
    with simulated("odrive-can") as shaft, opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,):
        drum.home()
        shaft.stop = shaft.turns = drum._scale.turns(PATH.drum_angles[1] + 0.3)
        with pytest.raises(MotorError, match=r"beyond its limits|jumped"):
            serve(drum, action(angle=PATH.drum_angles[1]))


def test_error_of_an_axis_is_reported_before_anything_moves():
    with simulated("odrive-can") as shaft:
        shaft.error = 0x20
        with (
            opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,),
            pytest.raises(MotorError, match="error 0x20"),
        ):
            drum.home()
        assert not shaft.has_moved


def test_only_an_emergency_is_remembered():
    """A normal end needs no action before the next start; an emergency stop leaves an error to be cleared."""
    with simulated("odrive-can") as shaft:
        for _ in range(2):
            with opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,):
                drum.home()
        assert (shaft.mode, shaft.error) == ("off", 0)
        with pytest.raises(KeyboardInterrupt), opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,):
            drum.home()
            raise KeyboardInterrupt
        assert (shaft.mode, shaft.error) == ("off", 0x2000000)


def test_drive_stops_when_our_heartbeat_ends():
    """After a hang of the program the drive releases the motor."""
    with simulated("canopen") as shaft, opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,):
        drum.home()
        time.sleep(0.3)
        assert shaft.mode == "off"
        with pytest.raises(MotorError, match="FAULT"):
            serve(drum, action(angle=PATH.drum_angles[1]))


def test_motor_over_udp_multicast():
    with (
        ODriveMotor("239.74.163.2", node=9, bus="udp_multicast") as shaft,
        opened_motors([shaft.url + PATIENT], [PATH], print) as (drum,),
    ):
        drum.home()
        assert drum.is_homed


def test_simplefoc_is_not_off_between_position_and_torque():
    """Regressions: each change of mode disabled the motor briefly, and a target had the limit of another."""
    port = io.BytesIO()
    motor = run_path(str(DRIVERS / "simplefoc.py"))["SimpleFoc"](port, "M", 0.05)
    motor.switch_on(MotorCommand(DriveMode.POSITION, 1.0, 0.0, 0.10))
    port.truncate(port.seek(0))
    for command in (
        MotorCommand(DriveMode.FORCE, 0.0, -0.05, 0.10),
        MotorCommand(DriveMode.FORCE, 0.0, 0.08, 0.10),
        MotorCommand(DriveMode.POSITION, 1.0, 0.0, 0.10),
    ):
        motor.send(command)

    assert port.getvalue().decode().split() == [
        "MLC1.0000", "M-3.1416", "M3.1416", "MLC1.6000", "M6.2832", "MLC2.0000",
    ]  # fmt: skip


def test_scale_keeps_work_the_same_at_both_ends():
    """Torque times turns is force times metres, for either direction of the motor."""
    for direction in (1.0, -1.0):
        scale = MotorScale(PATH, MotorSettings("motor", ratio=4.0, direction=direction))
        scale.set_home(12.5, PATH.drum_angles[1])
        for angle in np.linspace(PATH.drum_angles[0] + 0.1, PATH.drum_angles[1] - 0.1, 7):
            turn = 1e-3
            travel = scale.position(scale.angle(scale.turns(angle) + turn)) - scale.position(angle)
            work = scale.torque(2.0, angle) * 2.0 * math.pi * turn
            assert work == pytest.approx(-2.0 * travel, rel=2e-3)
            assert scale.force(scale.torque(2.0, angle), angle) == pytest.approx(2.0)


def reading(sample, bend, state=State.OK):
    now = sample * 4_000_000
    if state is not State.OK:
        return Reading(state, False, now, 0, None, np.zeros(0, CONTACT))
    message = frame(1, now)
    contacts = message.records
    contacts["mode"], contacts["bend"], contacts["contact_bend"] = Mode.POSITION, bend, 0.5
    for name in ("signed_distance", "lower", "upper"):
        contacts[name] = float(Glove().finger.path_length(bend, 0.5))
    message.header["sequence"] = sample
    return Reading(state, True, now, 0, message.header[()], contacts)


def test_controller_moves_a_motor_and_draws_back_when_frames_are_stale(motor, drum):
    """From frames to the shaft, and retraction when frames become stale."""
    home_all([drum], lambda seconds: time.sleep(seconds) or False, lambda sentence: None)
    bench = DrumBench(250.0, motors=[drum])

    def step(count, state, start):
        for sample in range(start, start + count):
            told = reading(sample, 0.3, state)
            bench.step(told, told.now_ns)
            time.sleep(PERIOD)

    step(100, State.OK, 0)
    assert drum.position == pytest.approx(float(Glove().finger.path_length(0.0, 0.5)), abs=2e-3)
    step(150, State.STALE, 100)
    assert drum.position == pytest.approx(PATH.retracted, abs=2e-3)
    assert bench.warnings() == ["all frames are too old to be used: the drums release and retract"]
    with pytest.raises(MotorError, match="from its last sample"):
        step(1, State.OK, 400)  # a second late: the controller's own watchdog


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("stepper://x", "unknown kind of motor 'stepper'"),
        ("odrive-can://", "names no bus or port"),
        ("odrive-can://x?bus=virtual&tork=1", "unknown option 'tork'"),
        ("odrive-can://x?bus=virtual&ratio=none", "ratio=none, expected a number from 0.01 to 1000"),
        ("odrive-can://x?bus=virtual&direction=0", "expected 1 or -1"),
        ("odrive-can://x?bus=nothing", "the bus cannot be opened"),
        (f"simplefoc:///dev/none?driver={DRIVERS}/simplefoc.py", "the port cannot be opened"),
        (f"canopen://nobody?driver={DRIVERS}/cia402.py&bus=virtual", "node 1 cannot be set up"),
        ("stepper://x?driver=none.py", "driver=none.py cannot be read"),
        (f"stepper://x?driver={__file__}", "has no open_driver"),
    ],
)
def test_address_that_cannot_be_used_is_refused(url, sentence):
    with pytest.raises(MotorError, match=sentence):
        open_motor(url)


def test_closing_says_that_a_motor_did_not_confirm():
    said = []
    with simulated("odrive-can") as shaft:
        with opened_motors([shaft.url + PATIENT], [PATH], said.append) as (drum,):
            drum.home()
            assert isinstance(drum, MotorDrum)
            shaft.is_silent = True
        assert said == [f"{shaft.url}{PATIENT}: the motor did not confirm that it is off"]
        assert shaft.mode == "off"


def test_drum_of_a_calibrated_glove_counts_from_the_stop_as_when_it_was_calibrated(motor, tmp_path):
    """The offset of its touches counts; the stop does not move with it."""
    path = FingerPath(read_glove(glove_files.write(tmp_path / "glove.json")))
    assert abs(path.drum_angles[1] - PATH.drum_angles[1]) > 0.03
    with opened_motors([motor.url + PATIENT], [path], lambda sentence: None) as (drum,):
        drum.home()
        angle = drum.angle
        turns = motor.turns

    stop = angle + (motor.stop - turns) * 2.0 * math.pi / PATH.drum.gear.ratio
    assert stop == pytest.approx(PATH.drum_angles[1] + 0.1, abs=0.02)
    assert angle == pytest.approx(min(path.drum_angles[1], stop - 0.02), abs=0.03)
