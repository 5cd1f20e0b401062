"""Calibration tasks: a simulated glove is recovered within its uncertainties, also after disturbances."""

import json
import math

import numpy as np
import pytest

from proximity.decaff.calibration.drum_chirp import (
    answer,
    encoder_step,
    free_chirp,
    held_chirp,
    identify_free,
    identify_held,
    inertia,
)
from proximity.decaff.calibration.instruments import DrumRecord
from proximity.decaff.calibration.readings import Readings
from proximity.decaff.calibration.results import Session, as_document, contradiction
from proximity.decaff.calibration.simulated_glove import SimulatedGlove
from proximity.decaff.calibration.tasks import FREE, PULL, TOUCH, Bench
from proximity.decaff.drum.drum_kernels import SWING
from proximity.decaff.glove.glove import Glove, with_gear
from proximity.errors import DecaffError

DESIGN = Glove()
DRUM = DESIGN.tip_drum()
INERTIA, FRICTION = inertia(DRUM), 0.04  # kg m² and N m of the drum


def begin(path, seed, drum="gear51", skipped=()):
    design = with_gear(DESIGN, drum)
    glove = SimulatedGlove(seed, design)
    bench = Bench(glove.instruments, design)
    return Session(bench, Readings(path, glove.instruments.name), skipped), glove


def measure(session, glove, most=500):
    """Perform all requested readings; return their number."""
    taken = 0
    while taken < most and (asked := session.next()) is not None:
        session.take(asked, lambda part, asked=asked: glove.prepare(asked, part))
        taken += 1
    return taken


def test_simulated_gloves_are_recovered_within_their_uncertainties(tmp_path):
    """Of 10 gloves with 16 numbers each about 95 % of the intervals contain the truth; none is far wider."""
    shares = []
    for seed in range(10):
        session, glove = begin(tmp_path / f"{seed}.json", seed, ("gear14", "gear51")[seed % 2])
        measure(session, glove)
        estimates = session.estimates()
        assert {one.key for one in estimates} == set(glove.truth)
        shares += [(one.value - glove.truth[one.key]) / one.half_width for one in estimates]
        session.calibration("")
    shares = np.abs(shares)

    # 152 of 160 are expected; by chance fewer than 144 happen once in 400 runs.
    assert np.count_nonzero(shares <= 1.0) >= 144
    # Half of the errors are below a fifth to a quarter of the interval, by Student's t with 2 to 8 degrees.
    assert 0.12 < np.median(shares) < 0.35
    assert shares.max() < 6.0


def test_uncertainties_are_small_enough_to_be_of_use(tmp_path):
    session, glove = begin(tmp_path / "r.json", 3)
    measure(session, glove)
    share = {one.key: one.half_width / one.value for one in session.estimates()}

    assert share["drum_mass"] < 0.01
    assert share["drum_friction"] < 0.05
    assert share["drum_latency"] < 0.1
    assert share["drum_resolution"] < 1e-5
    assert share["cable_stiffness"] < 0.01
    assert share["cable_compliance"] < 0.2
    assert contradiction(session) == ""


def test_interrupted_anywhere_it_goes_on_to_the_same_numbers(tmp_path):
    whole, glove = begin(tmp_path / "whole.json", 5, skipped=("held drum",))
    count = measure(whole, glove)
    for stop in (1, 17, count - 1):
        measure(*begin(tmp_path / f"{stop}.json", 5, skipped=("held drum",)), stop)
        again, glove = begin(tmp_path / f"{stop}.json", 5, skipped=("held drum",))
        assert measure(again, glove) == count - stop

        assert as_document(again.estimates()) == as_document(whole.estimates())


def test_hand_that_slips_is_asked_again_and_the_slip_left_out(tmp_path):
    session, glove = begin(tmp_path / "r.json", 0)
    slipped = next(task for task in session.tasks if task.key == "pose 4")
    for _ in range(3):  # poses 1 to 4, first round
        session.take(session.next(), lambda part: glove.prepare(session.next(), part))
    session.readings.add(slipped, {"counts": 38000.0})

    assert session.next().task.key == "pose 5"  # a single reading cannot disagree
    measure(session, glove, 10)
    measure(session, glove)

    values = [reading["counts"] for reading in session.of(slipped)]
    assert 38000.0 not in values and len(values) == 3
    assert len(session.readings.of(slipped)) == 4


def test_repeats_that_never_agree_end_with_advice(tmp_path):
    session, _ = begin(tmp_path / "r.json", 0)
    pose = session.tasks[0]
    for i in range(12):
        session.readings.add(pose, {"counts": 21000.0 + 1000.0 * i})

    with pytest.raises(
        DecaffError,
        match=r"^pose 1: of 12 readings no 3 agree: use the same gauge each time, .*; then measure it again "
        r"with --again 'pose'$",
    ):
        session.next()
    assert session.readings.drop("pose") == 12
    assert session.next().task is pose


def test_pulled_cable_and_chirp_that_contradict_each_other_are_reported(tmp_path):
    """A spring scale that reads twice the force: all pulls agree with each other and are wrong."""
    session, glove = begin(tmp_path / "r.json", 2)
    measure(session, glove)
    for reading in session.readings.of(PULL):
        reading["compliance"] *= 2.0

    assert "which differ by more than their uncertainties: check the clamp" in contradiction(session)


def test_readings_of_another_glove_or_file_are_refused(tmp_path):
    path = tmp_path / "r.json"
    session, glove = begin(path, 1)
    measure(session, glove, 2)

    with pytest.raises(DecaffError, match=r"has readings of a simulated glove, seed 1, not of .* seed 2"):
        begin(path, 2)
    for text in ("[]", '{"format": "x"}', "{"):
        path.write_text(text)
        with pytest.raises(DecaffError, match=r"r\.json: readings cannot be used"):
            begin(path, 1)


def test_touches_that_disagree_are_not_made_a_calibration(tmp_path):
    session, glove = begin(tmp_path / "r.json", 1, skipped=("free drum", "held drum"))
    measure(session, glove)
    session.of(TOUCH)[0]["angle"] += 0.05

    with pytest.raises(DecaffError, match="touches disagree"):
        session.calibration("")


def record_of(chirp, plant, latency=1e-3, step=1e-9, rate=3000.0):
    torques = chirp.torques(rate)
    times = np.arange(len(torques)) / rate
    bare = DrumRecord(times, torques, times, torques)
    angles = np.rint(answer(np.array([tuple(plant)], SWING), bare, latency) / step) * step
    return DrumRecord(times, torques, angles, torques)


def test_friction_and_latency_are_separated_by_coasting():
    """In the chirp alone both delay the response."""
    found = identify_free(record_of(free_chirp(DRUM), [1.2 * INERTIA, FRICTION, 1e-3, 0.0, 0.0]), DRUM)

    assert found["inertia"] == pytest.approx(1.2 * INERTIA, rel=2e-3)
    assert found["friction"] == pytest.approx(FRICTION, rel=0.02)
    assert found["latency"] == pytest.approx(1e-3, rel=0.02)


def test_stiffness_three_times_off_the_model_is_found():
    record = record_of(held_chirp(DESIGN, DRUM), [INERTIA, FRICTION, 0.0, 54.0, 0.065])

    assert identify_held(record, DRUM, DESIGN, 0.0)["stiffness"] == pytest.approx(54.0, rel=0.01)


def test_chirp_that_went_wrong_is_refused():
    chirp = free_chirp(DRUM)
    good = record_of(chirp, [INERTIA, FRICTION, 0.0, 0.0, 0.0], step=1e-3)
    times, torques = good.times, good.commanded

    with pytest.raises(DecaffError, match="hardly moved, expected a swing"):
        identify_free(DrumRecord(times, torques, np.zeros(len(times)), torques), DRUM)
    blocked = np.clip(good.angles, -1.0, good.angles[0] + 0.05)
    with pytest.raises(DecaffError, match="cannot be explained, expected 15 % at most: is the drum blocked"):
        identify_free(DrumRecord(times, torques, blocked, torques), DRUM)
    with pytest.raises(DecaffError, match=r"the motor's torque is .* off its command"):
        identify_free(DrumRecord(times, torques, good.angles, 0.1 * torques), DRUM)


def test_step_of_an_encoder_is_seen_where_there_is_one():
    angles = np.rint(np.cumsum(np.random.default_rng(7).normal(0, 2, 500))) * 1e-3 + 0.3

    step, error = encoder_step(angles)
    assert step == pytest.approx(1e-3, abs=error) and error < 1e-8
    assert math.isnan(encoder_step(np.random.default_rng(7).normal(size=500))[0])


def test_file_keeps_readings_and_results(tmp_path):
    session, glove = begin(tmp_path / "r.json", 4, skipped=("held drum",))
    measure(session, glove)
    session.readings.write(as_document(session.estimates()))

    document = json.loads((tmp_path / "r.json").read_text())
    assert len(document["readings"]) == len(session.readings.all)
    assert document["results"]["drum_mass"]["readings"] == len(session.of(FREE))
    assert document["results"]["drum_mass"]["model"] == pytest.approx(DRUM.mass)
