"""Identified backlash and latency, and their use by simulation, service and controller."""

import math
from dataclasses import replace

import glove_files
import numpy as np
import pytest

from proximity.decaff.calibration.drum_chirp import free_chirp, identify_free
from proximity.decaff.calibration.instruments import DrumRecord
from proximity.decaff.calibration.readings import Readings
from proximity.decaff.calibration.results import Session
from proximity.decaff.calibration.simulated_glove import SimulatedGlove
from proximity.decaff.calibration.tasks import Bench
from proximity.decaff.controller.chip_sources import controller_sources
from proximity.decaff.controller.controller import SurfaceLaw, required_damping
from proximity.decaff.controller.served_drum import ServedDrum, move, settling_time
from proximity.decaff.controller.settings import ControllerSettings
from proximity.decaff.drum.drum_model import MAX_LATENCY, Motor
from proximity.decaff.drum.servo import SERVO_RATE, DriveMode, DrumCommand, servo_for
from proximity.decaff.glove.calibrated_glove import CalibratedGlove, read_any_glove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.decaff.simulated_drums import DrumPlant
from proximity.errors import ArgumentError, DecaffError
from proximity.lab.simulation.closed_loop import decaff
from proximity.lab.simulation.devices import Decaff, Hand, TipCable
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.simulated_press import Setup, simulate
from proximity.lab.simulation.sweeps import with_transmission

GEAR51 = DRUMS["gear51"]
NOWHERE = -1e9  # m, position of a finger without contact


def late(drum, latency):
    return replace(drum, motor=replace(drum.motor, latency=latency))


def pressed(play, speed=0.1):
    glove = with_transmission(Decaff(GEAR51), TipCable(1200.0, play=play))
    return decaff(Hand(), Hand().press(speed), glove)


@pytest.mark.parametrize("speed", [0.1, 0.5])
@pytest.mark.parametrize("play", [0.5e-3, 1e-3, 2e-3])
def test_finger_that_goes_back_leaves_the_link_behind_by_the_backlash(play, speed):
    """Closing has no backlash: the press is the same. On return the link stays until it is taken up."""
    tight, loose = pressed(0.0, speed), pressed(play, speed)
    pressing = tight.times < tight.press.release_time
    left = [int(np.flatnonzero(one.drum - one.link < 0.5e-3)[-1]) for one in (tight, loose)]
    behind = loose.link - loose.thimble

    np.testing.assert_allclose(loose.force[pressing], tight.force[pressing], atol=1e-6)
    assert play < behind.max() < play + 0.6e-3  # and the stretch by the tension that then pulls the link
    assert play - 0.05e-3 < tight.thimble[left[0]] - loose.thimble[left[1]] < play + 0.35e-3
    assert loose.times[left[1]] > tight.times[left[0]]


def test_service_loses_the_backlash_where_a_finger_turns():
    glove = Glove(cable=replace(Glove().cable, backlash=1e-3))
    plant = DrumPlant(FingerPath(glove))
    play = float(glove.tip_per_radian(0.5)) * 1e-3 / glove.cable.replica_pulley

    assert play == pytest.approx(4.06e-3, rel=1e-2)
    found = [plant.follow(finger) for finger in (0.05, 0.06, 0.06 - 0.5 * play, 0.06 - 3.0 * play, 0.055)]
    assert found == pytest.approx([0.05, 0.06, 0.06, 0.06 - 2.0 * play, 0.055])
    assert plant.follow(1.0) == plant.position  # the drum stops it


def swung(drum, torques, rate=SERVO_RATE):
    """Return the simulated drum's angles, by its encoder, for torques commanded in force mode."""
    servo = replace(servo_for(drum, rate), force_gain=0.0, force_damping=0.0, force_slew=math.inf)
    served, angles = ServedDrum(drum, servo, 0.0), np.zeros(len(torques))
    for i, torque in enumerate(torques):
        served.serve(DrumCommand(DriveMode.FORCE, -torque / drum.lever), math.nan)
        served.push(NOWHERE, 1.0, np.zeros(served.steps))
        angles[i] = served.reported / drum.lever
    return angles


@pytest.mark.parametrize("samples", [1, 3, 15])
def test_torque_acts_later_by_the_latency_and_not_otherwise(samples):
    torques = free_chirp(GEAR51).torques(SERVO_RATE)[:600]
    soon, later = swung(GEAR51, torques), swung(late(GEAR51, samples / SERVO_RATE), torques)

    assert np.array_equal(later[samples:], soon[:-samples])
    assert np.ptp(soon) > 0.1 and not np.array_equal(later, soon)


@pytest.mark.parametrize("latency", [0.5e-3, 1.23e-3, 5e-3])
def test_chirp_of_the_simulated_drum_gives_its_latency_back(latency):
    """In addition to one sample of the servo and the current loop, which any drum has."""
    torques = free_chirp(GEAR51).torques(SERVO_RATE)
    times, found = np.arange(len(torques)) / SERVO_RATE, []
    for drum in (GEAR51, late(GEAR51, latency)):
        found.append(identify_free(DrumRecord(times, torques, swung(drum, torques), torques), GEAR51))

    assert found[0]["latency"] == pytest.approx(1.0 / SERVO_RATE, abs=0.3e-3)
    assert found[1]["latency"] - found[0]["latency"] == pytest.approx(latency, abs=0.02e-3)
    assert found[1]["inertia"] == pytest.approx(found[0]["inertia"], rel=1e-3)


@pytest.mark.parametrize("name", DRUMS)
@pytest.mark.parametrize("latency", [1e-3, 5e-3, MAX_LATENCY])
def test_drum_with_a_latency_has_a_servo_that_settles_and_is_softer_for_it(name, latency):
    """Stiffness falls with the square of the total delay: latency, a sample, and half a sample of hold."""
    drum = late(DRUMS[name], latency)
    servo, slowest = servo_for(drum, SERVO_RATE), servo_for(late(DRUMS[name], MAX_LATENCY), SERVO_RATE)
    later = (latency + 1.5 * servo.period) / (MAX_LATENCY + 1.5 * servo.period)

    assert servo.stiffness * later**2 == pytest.approx(slowest.stiffness, rel=0.2)
    assert settling_time(drum, servo, 0.03, longest=4.0) < 100.0 * latency + 0.2
    assert move(drum, servo, 0.03, 1.0)[1].max() < 0.03 + 8e-3


def test_wall_is_softer_the_later_the_drum_acts():
    """At 0.5 m/s a drum with 5 ms yields to the finger and returns by its integral."""
    press, errors = Hand().press(0.5), []
    for latency in (0.0, 1e-3, 2e-3, 5e-3):
        errors.append(deviation(decaff(Hand(), press, Decaff(late(GEAR51, latency)))).error)

    assert errors == sorted(errors)
    assert errors[0] < 0.09 and errors[1] < 0.11 and errors[3] > 2.0 * errors[0]


@pytest.mark.parametrize("damping", [0.0, 0.5, 1.0, 5.0])
@pytest.mark.parametrize("samples", [1, 2, 7, 60])
def test_surface_before_a_late_drum_is_displayed_as_stiff_as_is_passive(damping, samples):
    settings = ControllerSettings(SERVO_RATE, late(GEAR51, samples / SERVO_RATE))
    law = SurfaceLaw(settings)
    stiffness, displayed = law.displayed(1e6, damping)

    assert required_damping(stiffness, displayed, 1.0 / SERVO_RATE, 1 + samples) <= 2.0 + 1e-9
    assert stiffness < SurfaceLaw(ControllerSettings(SERVO_RATE, GEAR51)).displayed(1e6, damping)[0]
    assert law.lacking(1e6, damping) == pytest.approx(
        required_damping(stiffness, displayed, 1.0 / SERVO_RATE, 1 + samples)
    )


def test_latency_that_no_servo_bears_is_refused(tmp_path):
    with pytest.raises(ArgumentError, match=r"^latency is 0\.021 seconds, expected 0\.02 at most$"):
        Motor(latency=0.021)
    with pytest.raises(DecaffError, match=r"drum_latency is 0\.021 seconds, expected 0\.02 at most"):
        glove_files.write(tmp_path / "glove.json", drum_latency=0.021)


def test_calibrated_drum_is_the_one_that_simulation_service_and_firmware_have(tmp_path):
    """A simulated glove with 1 mm and 5 ms more than its design: both are identified, and then used."""
    hidden = Glove(cable=replace(Glove().cable, backlash=1e-3), motor=Motor(latency=5e-3))
    simulated = SimulatedGlove(3, hidden)
    bench = Bench(simulated.instruments, Glove())
    session = Session(bench, Readings(tmp_path / "r.json", bench.instruments.name))
    while (asked := session.next()) is not None:
        session.take(asked, lambda part, asked=asked: simulated.prepare(asked, part))
    made = session.calibration("")
    worn, truth = CalibratedGlove(made.design, made), simulated.truth
    path, setup = FingerPath(worn), Setup(glove=worn.glove, cable=1200.0)

    assert truth["backlash"] > 1e-3 and truth["drum_latency"] > 5e-3
    assert worn.glove.cable.backlash == pytest.approx(truth["backlash"], abs=0.05e-3)
    assert worn.glove.motor.latency == pytest.approx(truth["drum_latency"], abs=0.1e-3)
    assert setup.drum.motor.latency == path.drum.motor.latency == worn.glove.motor.latency
    assert setup.tip_cable.play == path.play == float(worn.glove.tip_play(0.5))
    assert f".drum_latency = {made.drum_latency!r}" in controller_sources([worn])["decaff_glove.c"]
    at_once = replace(worn.glove, motor=replace(worn.glove.motor, latency=0.0))
    errors = [simulate(Setup(glove=glove, speed=0.5)).force_error for glove in (at_once, worn.glove)]
    assert errors[1] > 2.0 * errors[0]


def test_calibration_file_keeps_the_latency_of_the_drum(tmp_path):
    worn = read_any_glove(glove_files.write(tmp_path / "glove.json", drum_latency=1.2e-3))
    older = read_any_glove(glove_files.write(tmp_path / "older.json"))

    assert (worn.glove.motor.latency, older.glove.motor.latency) == (1.2e-3, 0.0)
