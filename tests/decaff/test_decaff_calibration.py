"""Calibrations: computation, files, use by a glove, and rejection of those that do not fit."""

import json
import math
import os
import textwrap
from datetime import UTC, datetime

import numpy as np
import pytest

from proximity.decaff.calibration import fit
from proximity.decaff.calibration.fit import backlash, cable_compliance, step_latency, touch_offset
from proximity.decaff.glove.calibrated_glove import TOUCH_TOLERANCE, CalibratedGlove, read_glove
from proximity.decaff.glove.calibration import (
    MAX_FILE,
    Calibration,
    check_age,
    read_calibration,
    write_calibration,
)
from proximity.decaff.glove.glove import Glove
from proximity.decaff.glove.transmission import Cable, Potentiometer
from proximity.errors import ArgumentError, DecaffError, FileError

DESIGN = Glove()
HAND = Glove(cable=Cable(hand_pulley=0.0205, backlash=0.15e-3))
"""The real glove, whose pulley and cable differ from the design."""
TABLE_BENDS = np.linspace(0.0, 1.0, 7)
MOUNTED = 0.031
"""rad of the drum encoder's zero from the geometry."""
MADE = datetime(2026, 11, 21, 19, 30, 5, tzinfo=UTC)


def calibrated(**changes):
    """Return the values that an exact measurement of HAND gives."""
    values = {
        "made": MADE,
        "counts": HAND.counts(TABLE_BENDS),
        "bends": TABLE_BENDS,
        "touch_offset": MOUNTED,
        "cable_compliance": 1.0 / 20e3,
        "backlash": 0.15e-3,
        "latency": 0.9e-3,
        "phalanges": (0.045, 0.026, 0.020),
        "name": "right index",
    }
    return Calibration(**(values | changes))


GLOVE = CalibratedGlove(DESIGN, calibrated())
BENDS = np.linspace(0.0, 1.0, 401)


def touches(bends):
    """Return potentiometer counts and encoder angles at which the drum touches."""
    return HAND.counts(bends), HAND.drum_angle(bends) + MOUNTED


def test_table_gives_the_bend_of_a_hand_that_is_not_as_designed():
    """Seven points are within 0.16 mm of the fingertip's path in between; the design alone is 3 mm off."""
    off = GLOVE.bend_of_counts(HAND.counts(BENDS)) - BENDS
    way = off * HAND.finger.speed(BENDS)
    design = (DESIGN.bend_of_counts(HAND.counts(BENDS)) - BENDS) * HAND.finger.speed(BENDS)

    assert 0.1e-3 < np.abs(way).max() < 0.2e-3
    assert np.abs(design).max() > 3e-3
    np.testing.assert_allclose(
        GLOVE.bend_of_counts(GLOVE.calibration.counts), TABLE_BENDS, rtol=0, atol=1e-15
    )


def test_table_is_monotone_and_so_is_its_inverse():
    """PCHIP does not overshoot, however uneven the points."""
    table = [22000, 23000, 31000, 32000, 33000, 45000, 45600]
    uneven = CalibratedGlove(DESIGN, calibrated(counts=table))
    counts = np.linspace(22000, 45600, 5001)

    assert (np.diff(uneven.bend_of_counts(counts)) >= 0.0).all()
    assert (np.diff(GLOVE.counts(np.linspace(-1.0, 2.0, 3001))) > 0.0).all()
    np.testing.assert_allclose(GLOVE.bend_of_counts(GLOVE.counts(BENDS)), BENDS, rtol=0, atol=1e-6)
    assert (
        np.abs(GLOVE.counts(GLOVE.bend_of_counts(GLOVE.calibration.counts)) - GLOVE.calibration.counts).max()
        < 0.01
    )


def test_counts_far_off_the_table_give_no_bend():
    first, last = GLOVE.calibration.counts[[0, -1]]
    margin = 0.05 * (last - first)

    near = GLOVE.bend_of_counts([first - 0.99 * margin, last + 0.99 * margin])
    assert near == pytest.approx([-0.0495, 1.0495])
    assert np.isnan(GLOVE.bend_of_counts([first - 1.01 * margin, last + 1.01 * margin, np.nan])).all()


def test_stretch_and_backlash_are_taken_out():
    tension = 3.0
    pressed = HAND.potentiometer.read(HAND.replica_angle(BENDS, tension))
    opening = HAND.potentiometer.read(HAND.replica_angle(BENDS, is_closing=False))
    free = GLOVE.bend_of_counts(HAND.counts(BENDS))

    np.testing.assert_allclose(GLOVE.bend_of_counts(pressed, tension), free, rtol=0, atol=1e-4)
    np.testing.assert_allclose(GLOVE.bend_of_counts(opening, is_closing=False), free, rtol=0, atol=1e-4)
    assert GLOVE.glove.cable.stiffness == pytest.approx(20e3)
    assert math.isinf(CalibratedGlove(DESIGN, calibrated(cable_compliance=0.0)).glove.cable.stiffness)


def test_drum_stands_where_the_replica_will_be():
    """Within a count at the points of the table; between them finger and drum are off together."""
    told = GLOVE.drum_angle(TABLE_BENDS) - MOUNTED
    np.testing.assert_allclose(told, HAND.drum_angle(TABLE_BENDS), rtol=0, atol=1e-4)

    for counts in HAND.counts(BENDS)[::40]:
        replica = DESIGN.potentiometer.angle(counts)
        stands = GLOVE.drum_angle(GLOVE.bend_of_counts(counts)) - MOUNTED - DESIGN.drum.alpha
        assert float(stands) == pytest.approx(float(replica), abs=1e-6)


def test_finger_is_the_measured_one():
    longer = CalibratedGlove(DESIGN, calibrated(phalanges=(0.050, 0.028, 0.021)))

    assert longer.finger.phalanges == (0.050, 0.028, 0.021)
    assert float(longer.finger.point(0.0)[0]) == pytest.approx(0.099)
    assert longer.finger.pad_radius == DESIGN.finger.pad_radius


@pytest.mark.parametrize("counts", [12.0, 65000.0, math.nan])
def test_reading_that_no_hand_gave_has_no_bend(counts):
    assert np.isnan(GLOVE.bend_of_counts(counts))


def test_table_for_another_potentiometer_is_refused():
    coarse = Glove(potentiometer=Potentiometer(bits=12))

    with pytest.raises(
        DecaffError,
        match=r"^the table has counts from 21\d+ to 44\d+, expected 0 to 4095 of this potentiometer$",
    ):
        CalibratedGlove(coarse, calibrated())


FLAT, FIST = (float(counts) for counts in HAND.counts([0.0, 1.0]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"counts": range(7)}, r"the table has 6 counts at bend 1, expected 43\d+, within 10\d+"),
        ({"counts": HAND.counts(TABLE_BENDS) / 16},
         r"the table has 27\d+(\.\d+)? counts at bend 1, expected 43\d+, within 10\d+"),
        ({"counts": [FLAT, 26000, 26000.001, 35000, 38000, 41000, FIST]},
         r"counts go up by 0\.001 from bend 0\.166667 to 0\.333333, expected about 43\d+"),
    ],
)  # fmt: skip
def test_table_that_cannot_be_of_this_glove_is_refused(changes, message):
    with pytest.raises(DecaffError, match=f"^{message}, from the design of this glove$"):
        CalibratedGlove(DESIGN, calibrated(**changes))


@pytest.mark.parametrize("pulley", [0.8, 1.2])
@pytest.mark.parametrize("mounted", [-0.3, 0.3])
def test_table_of_a_glove_that_is_not_quite_as_designed_is_taken(pulley, mounted):
    """The pulley's radius is off by a fifth, the potentiometer's mounting by 17 degrees."""
    hand = Glove(cable=Cable(hand_pulley=0.02 * pulley))
    counts = DESIGN.potentiometer.counts(hand.replica_angle(TABLE_BENDS) + mounted)
    glove = CalibratedGlove(DESIGN, calibrated(counts=counts))

    assert glove.bend_of_counts(counts) == pytest.approx(TABLE_BENDS)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"made": "2026"}, "the date is 2026, expected a date with a time zone"),
        ({"counts": [1, 2, 3]}, "counts have shape (3,), expected 7 increasing numbers"),
        ({"counts": [1, 2, 3, 3, 5, 6, 7]},
         "the table is not monotone: counts go from 3 to 3 at its point 3, expected 7 increasing numbers"),
        ({"counts": [1, 2, 3, math.nan, 5, 6, 7]},
         "counts are [1.0, 2.0, 3.0, nan, 5.0, 6.0, 7.0], expected 7 increasing numbers"),
        ({"bends": np.linspace(0, 0.9, 7)}, "bends go from 0 to 0.9, expected 0 to 1"),
        ({"touch_offset": math.nan}, "touch_offset is nan, expected a number of radians"),
        ({"cable_compliance": -1},
         "cable_compliance is -1, expected a number of metres a newton of 0 or more"),
        ({"touch_offset": 40}, "touch_offset is 40 radians, expected 0.5 at most, either way"),
        ({"cable_compliance": 1.0}, "cable_compliance is 1 metres a newton, expected 0.002 at most"),
        ({"phalanges": (0.1, 0.1)}, "phalanges are (0.1, 0.1), expected three numbers of metres"),
        ({"phalanges": (0.1, 0, 0.1)}, "one of phalanges is 0, expected a positive number of metres"),
    ],
)  # fmt: skip
def test_numbers_that_contradict_themselves_are_refused(changes, message):
    with pytest.raises((ArgumentError, DecaffError)) as refused:
        calibrated(**changes)

    assert str(refused.value) == message


def test_file_gives_back_what_was_written(tmp_path):
    path = tmp_path / "right-index.json"
    for round_ in range(2):  # the second replaces the first
        made = calibrated(touch_offset=0.1 + 0.2 - 0.5 * round_, name="rechter Zeigefinger ☝")
        write_calibration(path, made)
        read = read_calibration(path)

        np.testing.assert_array_equal(read.counts, made.counts)
        np.testing.assert_array_equal(read.bends, made.bends)
        for name in ("made", "touch_offset", "cable_compliance", "backlash", "latency", "phalanges", "name"):
            assert getattr(read, name) == getattr(made, name), name
    assert os.listdir(tmp_path) == ["right-index.json"]


def test_simulated_glove_is_marked_in_its_file_and_warned_of_once(tmp_path, caplog):
    simulated, own = tmp_path / "simulated.json", tmp_path / "own.json"
    write_calibration(simulated, calibrated(made=datetime.now(UTC), is_simulated=True))
    write_calibration(own, calibrated(made=datetime.now(UTC)))
    own.write_text(own.read_text().replace(',\n  "simulated": false', ""))  # as in older files
    assert "simulated" not in own.read_text()
    for path in (simulated, own, simulated):
        assert read_glove(path).calibration.is_simulated == (path == simulated)

    assert caplog.messages == [f"{simulated}: this is the calibration of a simulated glove, not of a hand"]


def test_file_that_cannot_be_replaced_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "c.json"
    write_calibration(path, calibrated())

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError, match=r"c\.json: cannot be written \(No space left on device\)$"):
        write_calibration(path, calibrated(latency=0.5))

    assert read_calibration(path).latency == 0.9e-3
    assert os.listdir(tmp_path) == ["c.json"]


def test_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(FileError, match=r"c\.json: cannot be written \(No such file or directory\)$"):
        write_calibration(tmp_path / "none" / "c.json", calibrated())
    with pytest.raises(DecaffError, match=r"c\.json: cannot be read \(No such file or directory\)$"):
        read_calibration(tmp_path / "c.json")


@pytest.mark.parametrize(
    ("content", "message"),  # changes of a valid file, or its whole text
    [
        ({"version": 2}, "has version 2, expected 1: calibrate again with this version"),
        ({"format": "hand"},
         "is not a calibration of a glove, expected the format 'proximity glove calibration'"),
        ({"latency_s": ...}, "lacks 'latency_s'"),
        ({"latency_ms": 1}, "has an unknown field 'latency_ms'"),
        ({"made": "yesterday"}, "the date is 'yesterday', expected a date such as 2026-11-21T19:30:00+00:00"),
        ({"made": "2026-11-21T19:30:00"},
         "the date is 2026-11-21 19:30:00, expected a date with a time zone"),
        ({"name": 7}, "the name is 7, expected text"),
        ({"simulated": "yes"}, "simulated is 'yes', expected true or false"),
        ({"phalanges_m": 7}, "phalanges are 7, expected three numbers of metres"),
        ({"counts": [[1], [2, 3]]}, "counts have rows of different lengths, expected 7 increasing numbers"),
        (b"", "is not JSON (Expecting value…"),
        (b"\xff\xfe{}", "is not JSON ('utf-8' codec…"),
        (b"[1, 2]", "is not a calibration of a glove…"),
        (b"[" * 60000, "is not JSON…"),
        (b'{"latency_s": 0.1, "name": "", "latency_s": 0.9}',
         "has 'latency_s' twice, expected each field once…"),
        (b" " * (MAX_FILE + 1), f"has more than {MAX_FILE} bytes…"),
        (b'{"format": "proximity glove calibration"}', "has version None, expected 1…"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)  # fmt: skip
def test_file_that_was_changed_wrongly_or_is_none_is_refused(tmp_path, content, message):
    path = tmp_path / "c.json"
    if isinstance(content, dict):
        write_calibration(path, calibrated())
        document = json.loads(path.read_text(encoding="utf-8")) | content
        content = json.dumps({key: value for key, value in document.items() if value is not ...}).encode()
    path.write_bytes(content)
    with pytest.raises(DecaffError) as refused:
        read_calibration(path)
    told = str(refused.value).removeprefix(f"{path}: ")
    assert told == message or (message.endswith("…") and told.startswith(message[:-1]))


def test_touch_off_at_three_angles_finds_how_the_drum_is_mounted():
    """Within the rounding of counts: a tenth of a millimetre at the fingertip is 0.8 mrad."""
    assert touch_offset(DESIGN, *touches([0.2, 0.5, 0.8])) == pytest.approx(MOUNTED, abs=1e-4)


def test_touches_that_disagree_are_refused():
    counts, angles = touches([0.2, 0.5, 0.8])

    with pytest.raises(
        DecaffError,
        match=r"^the touches disagree by 0\.4\d mm, expected 0\.3 mm at most: repeat the touches$",
    ):
        touch_offset(DESIGN, counts, angles + np.array([0.0, 5e-3, 0.0]))
    with pytest.raises(
        DecaffError, match=r"^2 counts and 2 drum angles at touches, expected 3 or more of each$"
    ):
        touch_offset(DESIGN, counts[:2], angles[:2])
    with pytest.raises(DecaffError, match=r"^the touches disagree by nan mm"):
        touch_offset(DESIGN, counts, angles * np.nan)
    assert TOUCH_TOLERANCE == 0.3e-3


def test_compliance_and_backlash_are_found_again():
    """Within half a count, 1.4 µm of cable."""
    held = [HAND.potentiometer.read(HAND.replica_angle(0.5, tension)) for tension in (0.0, 2.0)]
    assert cable_compliance(HAND, held) == pytest.approx(1.0 / 20e3, abs=1.1e-6)

    opening = HAND.potentiometer.read(HAND.replica_angle(0.5, is_closing=False))
    assert backlash(HAND, float(HAND.counts(0.5)), float(opening)) == pytest.approx(0.15e-3, abs=2.2e-6)


@pytest.mark.parametrize(
    ("measure", "message"),
    [
        (
            lambda: cable_compliance(HAND, (20000, 20010)),
            "counts went from 20000 to 20010 as the tension went from 0 to 2 N, expected fewer under more "
            "tension",
        ),
        (lambda: cable_compliance(HAND, [1, 2, 3]), "3 counts and 2 tensions, expected two of each"),
        (lambda: backlash(HAND, 20010, 20000),
         "counts are 20010 closing and 20000 opening, expected at least as many opening"),
        (lambda: step_latency([0, 1, 2], [5, 5, 5], 1.0),
         "no response follows the step at 1 s, expected one that begins after it"),
        (
            lambda: step_latency([0, 0], [1, 2], 0.0),
            "times and values of a step test do not match, expected two or more of each, with "
            "increasing times",
        ),
    ],
)  # fmt: skip
def test_measurement_that_cannot_be_is_refused(measure, message):
    with pytest.raises(DecaffError) as refused:
        measure()

    assert str(refused.value) == message


@pytest.mark.parametrize("height", [-300.0])
def test_latency_is_found_from_a_step(height):
    """The response begins 4.2 ms after the step, is reported 0.1 ms later, and has a little noise."""
    times = np.arange(0.0, 0.050, 1e-5)
    answer = 7.0 + height * np.clip((times - 0.0142) / 1e-4, 0.0, 1.0)
    answer += 0.01 * height * np.random.default_rng(7).uniform(-1, 1, len(times))

    assert step_latency(times, answer, 0.010) == pytest.approx(4.2e-3, abs=2e-5)


def test_example_of_the_documentation_makes_a_calibration(tmp_path, monkeypatch):
    """The documentation's example of how to make the file runs as printed."""
    monkeypatch.chdir(tmp_path)
    _, _, example = fit.__doc__.partition("::\n")

    exec(compile(textwrap.dedent(example), "calibration", "exec"), {})

    made = read_calibration("glove.json")
    check_age(made)
    CalibratedGlove(Glove(), made)
    assert made.cable_compliance == pytest.approx(5e-5, rel=0.01)
    assert made.backlash == pytest.approx(0.15e-3, rel=0.01)
    assert made.latency == pytest.approx(1e-3)
