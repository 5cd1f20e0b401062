"""``proximity figures`` and ``proximity simulate``."""

import json
import re
import sys

import glove_files
import pytest
from project import MESHES

from proximity.cli.output import plain
from proximity.decaff.drum.drum_model import with_random_phases
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.lab.engine.engine_loop import EngineSetup
from proximity.lab.figures.catalogue import PLATES
from proximity.lab.part_press import document as part_document
from proximity.lab.part_press import simulate_on_part
from proximity.lab.simulation.simulated_press import Setup, Wall, document, simulate
from proximity.scene.loader import load


@pytest.fixture
def run(run, monkeypatch, tmp_path):
    """Run the command line in an empty folder, 200 columns wide."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return run


def test_figures_are_written_and_progress_is_told(run, tmp_path):
    (tmp_path / "paper").mkdir()
    (tmp_path / "paper" / "notes.txt").write_text("kept")

    result = run("figures", "stability", "5d", "5d", "--out", "paper", "--format", "svg")

    assert result.code == 0
    assert re.fullmatch(r"paper: 2 figures, 4 files, \d+\.\d s\n", result.out)
    first, second = result.err.splitlines()
    assert re.fullmatch(r"proximity: stability.svg, stability.csv \(\d+\.\d s\)", first)
    assert re.fullmatch(r"proximity: figure-5d.svg, figure-5d.csv \(\d+\.\d s\)", second)
    assert sorted(path.name for path in (tmp_path / "paper").iterdir()) == [
        "figure-5d.csv", "figure-5d.svg", "notes.txt", "stability.csv", "stability.svg",
    ]  # fmt: skip


def test_json_is_the_summary_of_figures_as_a_document(run, tmp_path):
    result = run("figures", "5d", "--out", "paper", "--format", "svg", "--json")

    told = json.loads(result.out)
    assert result.code == 0
    assert told["out"] == "paper" and told["seconds"] >= told["figures"][0].pop("seconds") > 0.0
    files = ["paper/figure-5d.svg", "paper/figure-5d.csv"]
    assert told["figures"] == [{"name": "5d", "title": PLATES["5d"].title, "files": files}]


@pytest.mark.parametrize("wall", ["real", "coupled", "decaff"])
def test_press_on_every_wall_is_told(run, tmp_path, wall):
    tuned = ("--stiffness", 734, "--damping", 4.4) if wall == "coupled" else ()
    result = run("simulate", "--wall", wall, "--speed", 0.5, *tuned, "--csv", "press.csv")

    assert result.code == 0
    assert result.err == "proximity: wrote press.csv\n"
    steady = re.search(r"force at rest \[N\] +(\S+) +(\S+)", result.out)
    setup = Setup(Wall(wall), 0.5, **({"stiffness": 734.0, "damping": 4.4} if tuned else {}))
    assert steady.groups() == (f"{simulate(setup).felt.steady:.3f}", "0.800")
    assert ("drum past the wall" in result.out) == (wall == "decaff")
    assert ("20 g that the finger carries" in result.out) == (wall == "coupled")
    assert "does not come to rest" not in result.out


def test_wall_that_shakes_is_called_unstable(run):
    gains = ("--stiffness", 3900, "--damping", 60, "--rate", 200, "--latency", 0)
    result = run("simulate", "--wall", "coupled", *gains)

    assert result.code == 0
    assert "with these gains a wall is unstable, or nearly so" in result.out


def test_json_of_a_press_is_the_models(run):
    options = ("--latency", 10, "--rate", 500, "--drum", "gear111", "--policy", "latched")
    result = run("simulate", *options, "--speed", 1, "--json")

    expected = document(simulate(Setup(Wall.DECAFF, 1.0, 0.010, 500.0, gear="gear111", policy="latched")))
    assert (result.code, result.err) == (0, "")
    assert json.loads(result.out) == expected


def test_wall_out_of_control_is_told_in_short_numbers(run):
    result = run("simulate", "--wall", "coupled", "--stiffness", 1e6, "--damping", 1e4, "--speed", 1)

    assert result.code == 0
    assert re.search(r"peak force \[N\] +\d\.\d+e\+\d+ +6\.000", result.out)
    assert max(map(len, result.out.splitlines())) < 80


@pytest.mark.parametrize("is_measured", [False, True])
def test_cable_is_in_the_press_by_its_stiffness_or_by_the_calibration_of_a_glove(run, tmp_path, is_measured):
    stiffness = float(Glove().tip_stiffness(0.5))
    cable = glove_files.write(tmp_path / "glove.json") if is_measured else stiffness
    result = run("simulate", "--speed", 1, "--cable", cable, "--stretch", "sensor", "--json")

    expected = document(simulate(Setup(speed=1.0, cable=stiffness, stretch="sensor")))
    assert (result.code, result.err) == (0, "")
    assert json.loads(result.out) == expected
    assert expected["cable"] == stiffness
    words = run("simulate", "--speed", 1, "--cable", 1212).out
    assert "cable of 1212 N/m at the fingertip, its stretch left" in " ".join(words.split())


def test_csv_of_a_press_needs_no_matplotlib(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert run("simulate", "--speed", 1, "--csv", "press.csv").code == 0
    assert (tmp_path / "press.csv").read_text().startswith("time_s,intent_m,finger_m,link_m,force_N")


BOX = MESHES / "box.stl"
FAST = ("--scene", BOX, "--at", 20, 15, 25, "--speed", 1)


def test_press_on_a_part_is_told_beside_the_ideal_and_the_real(run, tmp_path):
    result = run("simulate", *FAST, "--latency", 3, "--csv", "press.csv")

    assert (result.code, result.err) == (0, "proximity: wrote press.csv\n")
    assert "part            box, rigid, touched at (20.00, 15.00, 20.00) mm, incidence 1.000" in result.out
    assert "reported by     the tracker at 1000 Hz, 3 ms late" in result.out
    assert "this engine" in result.out and "ideal distance" in result.out and "real surface" in result.out
    names = (tmp_path / "press.csv").read_text().splitlines()[0].split(",")
    assert {"time_s", "force_N", "ideal_force_N", "real_force_N", "drum_m"} <= set(names)


def test_json_of_a_press_on_a_part_is_the_models(run):
    result = run("simulate", *FAST, "--drum", "gear14", "--stiffness", 800, "--damping", 2, "--json")

    scene = load(BOX)
    scene.set_surface("box", stiffness=800.0, damping=2.0)
    setup = EngineSetup(drum=with_random_phases(DRUMS["gear14"], 1)[0])
    expected = simulate_on_part(scene, setup, at=(0.020, 0.015, 0.025), speed=1.0)
    assert (result.code, result.err) == (0, "")
    assert json.loads(result.out) == plain(part_document(expected))


def test_cable_of_a_press_on_a_part_is_told_and_made_up_for(run):
    left, made_up = (run("simulate", *FAST, "--cable", 1212, *how) for how in ((), ("--stretch", "sensor")))

    assert "cable           1212 N/m at the fingertip, its stretch left" in left.out
    assert (
        "cable           1212 N/m at the fingertip, its stretch made up for by a force sensor" in made_up.out
    )
    rests = [float(re.search(r"force at rest \[N\] +(\S+)", one.out).group(1)) for one in (left, made_up)]
    assert rests[0] < 0.76 and rests[1] == pytest.approx(0.8, abs=0.02)


def test_far_end_is_simulated(run):
    result = run("simulate", *FAST, "--sensor")
    assert "reported by     a sensor at the far end" in result.out
    assert "force           served from" in result.out


@pytest.mark.parametrize(("stiffness", "is_limited"), [(800, False), (8000, True)])
def test_part_that_is_too_stiff_to_be_displayed_is_said_to_be(run, stiffness, is_limited):
    result = run("simulate", *FAST, "--stiffness", stiffness)
    said = "4000 N/m, the stiffest that is passive at 3000 Hz"
    assert (said in " ".join(result.out.split())) == is_limited


def test_part_of_a_scene_file_is_pressed_with_a_plain_reading(run, tmp_path):
    (tmp_path / "cell.toml").write_text(
        f"""
        [service]
        publish = "mailbox:x"
        [[parts]]
        file = "{BOX}"
        name = "low"
        [[parts]]
        file = "{BOX}"
        name = "high"
        position = [0.0, 0.0, 0.1]
        [input]
        poses = "mailbox:y"
        """
    )
    result = run("simulate", "--scene", "cell.toml", "--part", "high", "--speed", 1, "--policy", "latched")

    assert result.code == 0
    assert "high, rigid, touched at (20.00, 15.00, 120.00) mm" in result.out
    assert "drum            latched distances, servo at 3000 Hz" in result.out
