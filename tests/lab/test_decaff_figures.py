"""Figures: tables equal the models, and output files are images."""

import csv
import re
import sys
from dataclasses import asdict

import matplotlib
import matplotlib.figure
import numpy as np
import pytest
from sampled_walls import stiffness_limit

from proximity.decaff.drum.sampled_mass import SampledMass, maximum_stiffness
from proximity.errors import ArgumentError, MissingLibraryError
from proximity.lab import part_press
from proximity.lab.figures import catalogue, error_plots, figure_5_plots, motion_plots, stability_plots, style
from proximity.lab.figures.style import Table
from proximity.lab.paper import figure_5
from proximity.lab.simulation import simulated_press
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.simulated_press import Setup, Wall, simulate

STARTS = {"png": b"\x89PNG\r\n\x1a\n", "svg": b"<?xml", "pdf": b"%PDF-"}


def read_columns(path):
    """Return the columns of a CSV by name, as numbers."""
    with open(path, encoding="utf-8", newline="") as stream:
        names, *rows = csv.reader(stream)
    return {
        name: np.array(values, np.float64)
        for name, values in zip(names, zip(*rows, strict=True), strict=True)
    }


def test_table_keeps_every_digit(tmp_path):
    path = tmp_path / "table.csv"
    written = np.array([0.1, 1.0 / 3.0, 1e-300, np.inf])
    style.write_table(path, Table({"a_m": written, "count": [1, 2, 3, 4]}))

    assert path.read_text().splitlines()[:2] == ["a_m,count", "0.1,1"]
    np.testing.assert_array_equal(read_columns(path)["a_m"], written)


def test_table_gives_the_rows_that_are_asked_for():
    table = Table({"name": ["a", "b", "a"], "k": [1, 1, 2]}).where(name="a", k=2)

    assert {name: column.tolist() for name, column in table.columns.items()} == {"name": ["a"], "k": [2]}


@pytest.mark.parametrize("name", figure_5.FIGURES)
def test_numbers_beside_figure_5_are_the_models(name, tmp_path):
    """Including the samples of the reference, which other tests compare with the models."""
    style.write_table(tmp_path / "5.csv", catalogue.PLATES[name].numbers())
    found = read_columns(tmp_path / "5.csv")
    times = figure_5.sample_times(1e-4)

    np.testing.assert_array_equal(found["time_s"], times)
    np.testing.assert_array_equal(found["real_force_N"], figure_5.real_wall(times))
    if name != "5a":
        np.testing.assert_array_equal(found["force_N"], figure_5.FIGURES[name](times))


def test_force_lags_the_position_that_is_drawn():
    """The position is the finger's, the force is 40 ms later; both begin after the touch."""
    times = figure_5.sample_times(1e-4)
    touch, late = 500, 900  # samples, at 50 and 90 ms
    for name in ("5c", "5d", "5g", "5h"):
        table = figure_5_plots.numbers(name)
        assert (table["position_m"] > 1e-12).argmax() == touch + 1
        assert (table["force_N"] > 0.0).argmax() == late + 1
    # Reference: at 100 ms, penetrated, 4.588013 mm.
    assert figure_5_plots.position("5c", times[[1000]])[0] == pytest.approx(4.588013e-3, abs=5e-10)
    assert figure_5_plots.position("5d", times[[1000]])[0] == pytest.approx(3.657227e-3, abs=5e-10)


def test_figure_5e_is_the_force_experienced():
    table = figure_5_plots.numbers("5e")

    np.testing.assert_array_equal(table["force_N"], figure_5_plots.numbers("5b")["force_N"])
    assert figure_5_plots.all_numbers()["5e_force_N"].max() == pytest.approx(1.64876, abs=5e-6)


@pytest.mark.parametrize("delay", stability_plots.DELAYS)
def test_edge_of_the_stability_figure_is_where_the_model_ends(delay):
    device, table = SampledMass(delay_samples=delay), stability_plots.numbers()
    edge = table.where(delay_samples=delay, kind="edge")
    some = slice(1, -1, 57)
    limits = stiffness_limit(device, edge["damping_N_s_per_m"][some])
    assert limits == pytest.approx(edge["stiffness_N_per_m"][some], rel=1e-9)
    top = table.where(delay_samples=delay, kind="stiffest")
    assert top["stiffness_N_per_m"].tolist() == [maximum_stiffness(device).stiffness]


def test_drums_of_the_figure_are_in_place_after_their_settling_time():
    table = motion_plots.numbers()
    for name in ("gear14", "gear51", "gear111"):
        late = table["time_s"] > table[f"{name}_settled_s"][0] + 1e-4
        assert table[f"{name}_left_m"][0] == motion_plots.TRAVEL
        assert np.abs(table[f"{name}_left_m"][late]).max() <= 1e-4


@pytest.mark.parametrize("form", style.FORMATS)
def test_figure_is_written_with_its_numbers(form, tmp_path):
    paths = catalogue.write_figure("5h", tmp_path / "new" / "folder", form)

    assert [path.name for path in paths] == [f"figure-5h.{form}", "figure-5h.csv"]
    assert paths[0].read_bytes().startswith(STARTS[form])
    assert sorted(path.name for path in paths[0].parent.iterdir()) == sorted(path.name for path in paths)


def test_figure_has_the_width_that_is_asked_for_and_no_caption(tmp_path):
    def texts(sheet):
        image, _ = catalogue.write_figure("5h", tmp_path, "svg", sheet=sheet)
        return image.read_text()

    designed, plain = texts(style.AS_DESIGNED), texts(style.Sheet(0.120, has_caption=False))

    assert 'width="244.8pt"' in designed and 'width="340.15' in plain
    assert "N/m" in designed and "N/m" not in plain


@pytest.mark.parametrize("name", ["5", "5a", "stability"])
def test_every_kind_of_figure_is_drawn(name, tmp_path):
    image, _ = catalogue.write_figure(name, tmp_path, "svg")

    text = image.read_text()
    assert "[ms]" in text or "[N·s/m]" in text  # text is not converted to paths, and axes have units


@pytest.mark.parametrize(
    ("draw", "numbers"),
    [
        (stability_plots.draw, stability_plots.numbers),
        (motion_plots.draw, motion_plots.numbers),
        (error_plots.draw_against_speed, lambda: error_plots.numbers(error_plots.SPEED_PANELS, [1.0])),
        (error_plots.draw_against_latency, lambda: error_plots.numbers([0.010], error_plots.LATENCY_PANELS)),
    ],
)
def test_sweeps_are_drawn_with_their_parameters_and_whose_they_are(draw, numbers):
    drawn = style.render(draw, numbers(), (7.0, 3.0), "svg")

    assert drawn.startswith(STARTS["svg"])
    text = drawn.decode()
    assert "(ours)" in text and re.search(r"\d (kg|g|kHz|Hz)\b", text)


def test_error_against_latency_is_the_staircase_that_it_is(monkeypatch):
    """A drum's servo reads a distance at its next sample: between two samples latency has no effect."""
    monkeypatch.setattr(error_plots, "LATENCIES", (0.001,))
    table = error_plots.numbers_against_latency().where(speed_m_per_s=0.1)
    naive = table["naive_error"][np.isnan(table["coupled_error"])]

    assert len(naive) == 2 * error_plots.STAIRS
    np.testing.assert_array_equal(naive[1:-1:2], naive[2::2])
    assert (naive[1::2] > naive[0::2]).all() and naive[1] > 10.0 * naive[0]


def test_same_figure_is_the_same_file_and_leaves_no_trace_in_matplotlib(tmp_path, monkeypatch):
    """With pyplot, a figure would open windows and be kept."""
    before = {name: matplotlib.rcParams[name] for name in style.LOOK}
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    first, _ = catalogue.write_figure("drum-motion", tmp_path, "svg")
    content = first.read_bytes()
    again, _ = catalogue.write_figure("drum-motion", tmp_path, "svg")

    assert again.read_bytes() == content
    assert {name: matplotlib.rcParams[name] for name in style.LOOK} == before


def test_unknown_figure_and_format_are_refused_with_the_list(tmp_path):
    with pytest.raises(ArgumentError, match=r"no figure '6', expected some of 5a, 5b, 5c, .* drum-motion"):
        catalogue.write_figure("6", tmp_path)
    with pytest.raises(ArgumentError, match="no figures of format 'gif', expected one of png, svg, pdf"):
        catalogue.write_figure("5a", tmp_path / "folder", "gif")
    assert not list(tmp_path.iterdir())


def test_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ArgumentError, match="no folder can be made"):
        catalogue.write_figure("5a", tmp_path / "file")


def test_missing_matplotlib_is_told_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(
        MissingLibraryError,
        match=r'^figures need matplotlib, which is not installed: pip .*\[sim\]"',
    ):
        catalogue.write_figure("5a", tmp_path / "folder")
    assert not list(tmp_path.iterdir())


def test_matplotlib_that_refuses_its_settings_is_told_in_a_sentence(tmp_path, monkeypatch):
    """E.g. if MPLBACKEND names a removed backend, though no window is opened."""

    def unfit(name):
        raise ValueError("Key backend: 'qt4agg' is not a valid value")

    monkeypatch.setattr(style, "import_module", unfit)
    with pytest.raises(ArgumentError, match=r"matplotlib, which cannot be used \(Key backend: 'qt4agg' is"):
        catalogue.write_figure("5a", tmp_path / "folder")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "setup",
    [
        Setup(Wall.REAL, speed=0.25),
        Setup(Wall.COUPLED, speed=0.25, latency=0.003, stiffness=734.0, damping=4.4),
        Setup(Wall.DECAFF, speed=0.25, latency=0.003, policy="latched", gear="gear111"),
    ],
    ids=lambda setup: setup.wall,
)
def test_simulated_press_is_told_as_the_metrics_say(setup, tmp_path):
    press = simulate(setup)
    found = deviation(press.response)

    assert press.force_error == found.error
    assert press.felt.onset - simulated_press.felt(press.real).onset == found.onset
    assert press.felt.peak == found.peak
    assert press.felt.steady - simulated_press.felt(press.real).steady == found.steady_error
    assert press.felt.penetration == found.penetration
    assert press.felt.work - simulated_press.felt(press.real).work == found.work_error
    style.write_table(tmp_path / "press.csv", part_press.numbers_on_wall(press))
    columns = read_columns(tmp_path / "press.csv")
    touch = int(np.argmin(np.abs(columns["time_s"])))
    assert columns["time_s"][touch] == 0.0
    assert columns["real_force_N"][touch] == press.real.force[press.response.zero]
    assert ("drum_m" in columns) == (setup.wall == Wall.DECAFF)


def test_document_of_a_press_has_what_concerns_its_wall():
    setup = Setup(Wall.COUPLED, speed=1.0, stiffness=1000.0, damping=2.0)
    press = simulate(setup)
    told = simulated_press.document(press)

    assert told["stiffness"] == 1000.0 and "drum" not in told
    assert told["felt"] == asdict(press.felt)
    assert "latency" not in simulated_press.document(simulate(Setup(Wall.REAL, speed=1.0)))


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({"speed": 0.0}, "speed is 0, expected 0.01 to 10 metres a second"),
        ({"speed": np.nan}, "speed is nan, expected a number of metres a second"),
        ({"latency": 2.0}, "latency is 2, expected 0 to 1 seconds"),
        ({"rate": 1.0}, "rate is 1, expected 5 to 50000 hertz"),
        ({"gear": "gear5"}, "drum is 'gear5', expected one of gear14, gear51, gear111"),
        ({"gear": "gear4"}, "drum is 'gear4', the gear of a drum that no hand can wear: expected 'gear51'"),
        ({"policy": "TS"}, "policy is 'TS', expected one of naive, latched, feed-forward, time-stamped"),
        ({"wall": "soft"}, "wall is 'soft', expected one of real, coupled, decaff"),
        ({"stiffness": 2e6, "damping": 1.0}, r"stiffness is 2e\+06, expected 0 to 1e\+06 newtons a metre"),
        ({"stiffness": 1.0, "damping": 1e5},
         r"damping is 100000, expected 0 to 10000 newton seconds a metre"),
        ({"stiffness": 100.0}, "belong together: expected both or neither"),
        ({"cable": 5.0}, r"cable is 5, expected 10 to 1e\+06 newtons a metre"),
        ({"cable": 500.0, "stretch": "much"}, "stretch is 'much', expected one of left, torque, sensor"),
        ({"stretch": "torque"}, "stretch is 'torque', but the cable is missing: expected its stiffness"),
    ],
)  # fmt: skip
def test_setup_that_makes_no_sense_is_refused(numbers, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        Setup(**numbers)
