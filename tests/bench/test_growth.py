"""Growth is measured, fitted and drawn. No time is judged here."""

import csv
import json

import growth
import numpy as np
import pytest

from benchmarks.growth import axes, fit, inputs, plots, samples, work
from benchmarks.ticks import scenes


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

    assert 3.0 < large / small < 5.0  # four times the faces, nearly all of which are looked at


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
def test_growth_of_small_scenes_writes_a_table_and_json(capsys, tmp_path):
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
    rows += [samples.GrowthRow("faces", "none", "bracket", "%", 1.0, 0.0, None, 1)]  # nothing to draw
    machine = {"processor": "Fast (avx2)", "date": "2026-11-21 23:00 UTC"}

    paths = plots.write_plots(tmp_path, machine, rows, fit.fit_rows(rows))

    assert [path.name for path in paths] == ["growth_faces.csv", "growth_faces.png", "growth_faces.svg"]
    table = list(csv.DictReader(paths[0].read_text(encoding="utf-8").splitlines()))
    assert [row["median"] for row in table] == ["1.0", "2.0", "4.0", "0.0"]
    assert paths[1].read_bytes()[:4] == b"\x89PNG"
    assert "slope 0.30 ± 0.00" in paths[2].read_text(encoding="utf-8")
