"""``proximity controller``: what it writes, and how it refuses."""

import sys

import pytest

from proximity import cli
from proximity.decaff.controller.chip_sources import controller_sources
from proximity.decaff.controller.settings import CableRule, ControllerSettings
from proximity.decaff.glove.glove import DRUMS, Glove


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command in this process; returns exit code, stdout and stderr."""

    def run_with(*arguments):
        monkeypatch.setattr(sys, "argv", ["proximity", "controller", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        written = capsys.readouterr()
        return end.value.code or 0, written.out, written.err

    return run_with


def test_sources_are_written(run, tmp_path):
    folder = tmp_path / "a" / "b"
    code, out, err = run("--out", folder, "--drum", "gear14", "--rate", 2000)

    files = {path.name: path.read_text(encoding="ascii") for path in folder.iterdir()}
    assert (code, err) == (0, "")
    assert files == controller_sources([Glove()], ControllerSettings(2000.0, DRUMS["gear14"]))
    assert out.splitlines() == [f"{folder / name}: written" for name in controller_sources([Glove()])]


def test_cable_is_in_the_sources(run, tmp_path):
    code, _, err = run("--out", tmp_path, "--cable", 1212)

    assert (code, err) == (0, "")
    text = (tmp_path / "decaff_glove.c").read_text(encoding="ascii")
    settings = ControllerSettings(cable=CableRule(1212.0))
    assert text == controller_sources([Glove()], settings)["decaff_glove.c"]
    assert ".cable_stiffness = 1212.0,\n" in text


def test_cable_that_is_none_is_told(run, tmp_path):
    code, _, err = run("--out", tmp_path, "--cable", "stiff")

    assert code == 2 and "'stiff': expected a stiffness in N/m" in err


def test_folder_that_cannot_be_made_is_told(run, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = run("--out", tmp_path / "file")

    assert code == 2
    assert err == f"proximity: {tmp_path}/file: is not a folder and cannot be created (File exists)\n"


def test_rate_that_a_watchdog_would_stop_is_told(run, tmp_path):
    code, _, err = run("--out", tmp_path, "--rate", 100)

    assert code == 2 and "--rate" in err


def test_calibration_that_is_not_there_is_told(run, tmp_path):
    code, _, err = run("--out", tmp_path, "--calibration", tmp_path / "none.json")

    assert code == 2 and f"{tmp_path}/none.json" in err
