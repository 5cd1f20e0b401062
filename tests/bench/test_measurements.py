"""Growth, hunting drums and VR applications: measurements and drawings, without checks of times."""

import csv
import json
from dataclasses import asdict, replace

import growth
import numpy as np
import pytest
from hunting import CURES, cell, rest_of
from pages import PAGES
from paper_drums import PAPER_DRUMS
from project import MESHES

from benchmarks.growth import axes, fit, inputs, plots, samples, work
from benchmarks.service import vr_application
from benchmarks.service.vr_application import HEADINGS, PATHS, VrCase, VrRow, measure
from benchmarks.ticks import scenes
from proximity.decaff.drum.drum_model import with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, servo_for
from proximity.decaff.glove.glove import DRUMS
from proximity.lab.simulation.closed_loop import decaff
from proximity.lab.simulation.devices import Decaff, Hand
from proximity.lab.simulation.metrics import FELT_SWING, deviation
from proximity.recording import read_recording


def rows_of(x, y, series="all"):
    return [
        samples.GrowthRow("faces", series, "time", "µs", *pair, None, 1) for pair in zip(x, y, strict=True)
    ]


def test_slope_of_a_power_law_is_its_exponent():
    x = np.logspace(0, 6, 13)
    rows = rows_of(x, 3.0 * x**0.75)

    (found,) = fit.fit_rows(rows)

    assert found.slope == pytest.approx(0.75, abs=1e-12)
    assert found.factor == pytest.approx(3.0, rel=1e-9)
    assert found.error < 1e-9
    assert (found.first, found.last, found.count) == (pytest.approx(1e4), pytest.approx(1e6), 5)


def test_work_of_a_point_grows_in_the_centre_of_a_ball():
    balls = [scenes.scene_of(inputs.ball(n)) for n in (2, 3)]

    small, large = (int(work.work_of_points(scene, np.zeros((1, 3)))[0]) for scene in balls)

    assert 3.0 < large / small < 5.0  # four times the faces, nearly all of them visited


@pytest.mark.internals
def test_rays_that_are_counted_hit_where_rays_hit():
    mesh = inputs.ring(600)
    scene = scenes.scene_of(mesh)
    origins, directions = inputs.rays(mesh, 20)
    directions[0] = -directions[0]  # away from the part

    steps, lengths = work.work_of_rays(scene, origins, directions)

    np.testing.assert_allclose(lengths, scene.cast(origins, directions).distance, rtol=1e-12)
    assert (steps >= 1).all() and steps.max() < len(mesh[1])


def test_size_that_does_not_fit_the_memory_is_left_out_with_a_sentence(monkeypatch):
    free = type("Memory", (), {"available": 500_000})
    monkeypatch.setattr(samples.psutil, "virtual_memory", lambda: free)
    curve = samples.Curve("faces")

    assert list(samples.sizes_that_fit(curve, (300, 10**7))) == [300]
    assert curve.left_out == [
        "10,000,000 faces are left out: making them takes about 9.0 GB, and 0.0 GB are free."
    ]


@pytest.mark.internals
def test_growth_of_small_scenes_writes_a_table_and_json(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(growth.proximity, "warm_up", lambda: None)  # it compiles unused kernels
    monkeypatch.setattr(samples, "MAX_BUILD_S", float("inf"))  # the first size compiles
    path = tmp_path / "growth.json"

    exit_code = growth.main(["--small", "--json", str(path)])

    document = json.loads(path.read_text(encoding="utf-8"))
    assert exit_code == 0
    assert {row["axis"] for row in document["rows"]} == set(axes.MEASURES)
    memory = next(fit for fit in document["fits"] if fit["quantity"] == "memory")
    assert memory["slope"] == pytest.approx(1.0, abs=0.15)
    assert "tick of five fingers" in capsys.readouterr().out
    assert any("diagonals on inside are left out" in sentence for sentence in document["left_out"])


def test_growth_is_written_as_csv_and_pictures(tmp_path):
    rows = rows_of([1.0, 10.0, 100.0], [1.0, 2.0, 4.0])
    rows += [samples.GrowthRow("faces", "none", "bracket", "%", 1.0, 0.0, None, 1)]  # without a bar
    machine = {"processor": "Fast (avx2)", "date": "2026-11-21 23:00 UTC"}

    paths = plots.write_plots(tmp_path, machine, rows, fit.fit_rows(rows))

    assert [path.name for path in paths] == ["growth_faces.csv", "growth_faces.png", "growth_faces.svg"]
    table = list(csv.DictReader(paths[0].read_text(encoding="utf-8").splitlines()))
    assert [row["median"] for row in table] == ["1.0", "2.0", "4.0", "0.0"]
    assert paths[1].read_bytes()[:4] == b"\x89PNG"
    assert "slope 0.30 ± 0.00" in paths[2].read_text(encoding="utf-8")


HAND = Hand()
COUNT = 24
HOLD = 0.5  # s: a drum hit at 1 m/s has come to rest


def swings(drum, speed, **settings):
    """Return the peak-to-peak force at rest, N, for many phases of the encoder."""
    drums = with_random_phases(drum, COUNT)
    servo = replace(servo_for(drums[0], SERVO_RATE), **settings)
    press = HAND.press(speed, hold=HOLD)
    return np.array([deviation(decaff(HAND, press, Decaff(drum, servo))).swing for drum in drums])


@pytest.mark.parametrize("name", PAPER_DRUMS)
@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_force_at_rest_swings_less_than_is_felt(name, speed):
    """Without the deadband, most phases swing by up to 44 (gear49), 140 (gear12) and 18 mN (gear122)."""
    assert swings(PAPER_DRUMS[name], speed).max() < FELT_SWING
    assert (swings(PAPER_DRUMS[name], speed, deadband=0.0) > FELT_SWING).mean() > 0.5


@pytest.mark.parametrize("name", DRUMS)
def test_drum_behind_a_gear_that_rubs_is_still_as_well(name):
    assert swings(DRUMS[name], 0.1).max() < 1e-4


@pytest.mark.parametrize("name", PAPER_DRUMS)
def test_deadband_is_the_cure_at_rest_and_a_finer_encoder_makes_the_steps_before_smaller(name):
    found = {cure: rest_of(PAPER_DRUMS[name], CURES[cure], phases=4) for cure in CURES}
    hunting = {cure for cure, one in found.items() if one.swing > FELT_SWING}

    assert {"none", "friction", "small dither", "dither"} <= hunting
    assert not hunting & {"deadband", "smooth", "both"}
    assert found["deadband"].swing == pytest.approx(0.0, abs=1e-4)
    assert found["deadband"].step > FELT_SWING
    assert found["both"].step < 0.15 * found["deadband"].step
    assert found["smooth"].step > 0.7 * found["deadband"].step


def test_page_has_the_comparison_of_the_cures():
    """Run ``python bench/hunting.py`` for the new text; gear51 is checked."""
    page = PAGES["science/drum.md"].splitlines()
    begin = page.index("| cure | gear14 | gear51 | gear111 |")
    rows = page[begin + 2 : begin + 2 + len(CURES)]

    for row, cure in zip(rows, CURES.values(), strict=True):
        words = [part.strip() for part in row.strip("|").split("|")]
        assert (words[0], words[2]) == (cure.words, cell(rest_of(DRUMS["gear51"], cure)))


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(("count", "is_moving"), [(5, False), (10, True)])
def test_an_application_serves_the_fingers_that_are_said(path, count, is_moving, monkeypatch):
    served = set()
    parts_of = vr_application.parts_of
    monkeypatch.setattr(
        vr_application, "parts_of", lambda *given: (served.add(len(parts_of(*given)[1])), parts_of(*given))[1]
    )
    case = VrCase(path, finger_count=count, is_moving=is_moving, seconds=0.5)

    row = measure([str(MESHES / "bracket.stl")], case, read_recording(MESHES / "hand.csv"))

    assert served == {count}
    assert 30 < row.answered_count <= row.pose_count < 60
    assert 0.0 < row.motion_to_distance_p50 <= row.motion_to_distance_p99 <= row.motion_to_distance_p999
    assert 0.0 < row.tick_p50 <= row.tick_p99
    assert (row.bridge_share is None) is (path == "native")
    assert len(row.cells) == len(HEADINGS)
    assert VrRow.of(asdict(row)) == row


def test_ticks_with_a_new_pose_are_told_from_those_without():
    timed = vr_application._Timed(sent=[0, 100_000_000])
    for pose, arrival, took in ((0, 10, 70), (0, 20, 5), (0, 30, 7), (100_000_000, 100_000_040, 90)):
        timed.frames.append((pose + 1, arrival, took))

    row = vr_application._row(VrCase(), timed, 12)

    np.testing.assert_allclose([row.tick_p50, row.idle_tick_p50], [80e-9, 6e-9])
    np.testing.assert_allclose(row.motion_to_distance_p50, 25e-9)
    assert (row.pose_count, row.answered_count) == (2, 2)
