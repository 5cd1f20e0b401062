"""``proximity controller``: what it writes, and how it refuses."""

import sys

import pytest

from proximity import cli
from proximity.decaff.chip.sources import controller_sources
from proximity.decaff.controller.cable_stretch import CableRule
from proximity.decaff.controller.settings import ControllerSettings
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
