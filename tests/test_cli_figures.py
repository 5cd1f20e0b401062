"""``proximity figures`` and ``proximity simulate``."""

import json
import re
import sys
from types import SimpleNamespace

import pytest

from proximity import cli
from proximity.decaff.simulation import Setup, Wall, document, simulate


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in a folder of its own; returns exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("FORCE_COLOR", "NO_COLOR", "GITHUB_ACTIONS"):
        monkeypatch.delenv(name, raising=False)

    def run_with(*arguments):
        monkeypatch.setattr(sys, "argv", ["proximity", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        written = capsys.readouterr()
        return SimpleNamespace(code=end.value.code, out=written.out, err=written.err)

    return run_with


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


def test_unknown_figure_is_refused_with_the_list(run, tmp_path):
    result = run("figures", "5d", "5z")

    assert (result.code, result.out) == (2, "")
    assert result.err.startswith("proximity: no figure '5z', expected some of 5a, 5b, 5c, 5d, 5e, 5f, 5g, 5h")
    assert not list(tmp_path.iterdir())


def test_unknown_format_is_refused(run):
    result = run("figures", "5d", "--format", "gif")

    assert result.code == 2
    assert result.err == "proximity: no figures of format 'gif', expected one of png, svg, pdf\n"


@pytest.mark.parametrize("wall", ["real", "coupled", "decaff"])
def test_press_on_every_wall_is_told_and_drawn(run, tmp_path, wall):
    tuned = ("--stiffness", 734, "--damping", 4.4) if wall == "coupled" else ()
    result = run("simulate", "--wall", wall, "--speed", 0.5, *tuned, "--out", "press.png")

    assert result.code == 0
    assert result.err == "proximity: wrote press.png\n"
    assert (tmp_path / "press.png").read_bytes().startswith(b"\x89PNG")
    steady = re.search(r"force at rest \[N\] +(\S+) +(\S+)", result.out)
    setup = Setup(Wall(wall), 0.5, **({"stiffness": 734.0, "damping": 4.4} if tuned else {}))
    assert steady.groups() == (f"{simulate(setup).felt.steady:.3f}", "0.800")
    assert ("drum past the wall" in result.out) == (wall == "decaff")


def test_json_of_a_press_is_the_models(run):
    options = ("--latency-ms", 10, "--rate-hz", 500, "--drum", "gear10", "--policy", "latched")
    result = run("simulate", *options, "--speed", 1, "--json")

    expected = document(simulate(Setup(Wall.DECAFF, 1.0, 0.010, 500.0, "gear10", "latched")))
    assert (result.code, result.err) == (0, "")
    assert json.loads(result.out) == expected


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--wall", "soft"), "'soft': expected one of real, coupled, decaff"),
        (("--wall", "coupled", "--drum", "gear4"), "a coupled wall has none"),
        (("--stiffness", 5), "a decaff wall has none"),
        (("--out", "press.gif"), "press.gif does not end in .png, .svg, .pdf, .csv"),
        (("--policy", "TS"), "policy is 'TS', expected one of naive, latched, feed-forward, time-stamped"),
        (("--wall", "coupled", "--stiffness", 5), "expected both of them, or none"),
        (("--wall", "coupled", "--stiffness", -5, "--damping", 1), "stiffness is -5.0, expected"),
        (("--speed", "nan"), "speed is nan"),
    ],
)
def test_press_that_makes_no_sense_is_refused(run, options, sentence):
    result = run("simulate", *options)

    assert (result.code, result.out) == (2, "")
    assert sentence in " ".join(result.err.split())


def test_csv_of_a_press_needs_no_matplotlib(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)

    assert run("simulate", "--speed", 1, "--out", "press.csv").code == 0
    assert (tmp_path / "press.csv").read_text().startswith("time_s,intent_m,finger_m,link_m,force_N")
    assert "figures need matplotlib" in run("simulate", "--speed", 1, "--out", "press.png").err
