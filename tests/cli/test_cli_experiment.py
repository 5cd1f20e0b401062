"""``proximity experiment``: commands from the design to the figure."""

import builtins
import csv
import re
import time

import numpy as np
import pytest
from experiments import SMALL, write_design
from publishing import publishing
from sealed_frames import frame

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.message import Mode


@pytest.fixture
def experiment(run):
    """Run a command; return its exit code, stdout and stderr."""

    def run_with(*arguments):
        result = run("experiment", *arguments)
        return result.code, result.out, result.err

    return run_with


def test_new_design_is_written_once_and_can_be_planned(experiment, tmp_path):
    path = tmp_path / "walls.toml"

    assert experiment("new", "--out", path)[:2] == (0, f"{path}: written\n")
    code, _, err = experiment("new", "--out", path)
    assert code == 2 and "cannot be written (File exists): choose another name" in err.replace("\n", " ")
    path.write_text(path.read_text().replace("stiffness = 100.0", "stiffness = 200.0"))
    code, out, err = experiment("plan", path, "--slot", 1)
    assert code == 0 and err.startswith("proximity: 256 trials, 43 minutes as planned, design ")
    assert "proximity: coupled10ms in stiffness is unstable at 320 N/m with 1 N s/m, 10 ms late" in err
    lines = out.splitlines()
    assert lines[:3] == ["step\trun\tstage\ttask\tcondition\tlevel\todd", "welcome", "instructions"]
    assert len(lines) == 264 and "catch\tstiffness\tdecaff1ms\t0\t0" in out


def test_commands_in_the_shipped_design_exist(experiment, tmp_path):
    path = tmp_path / "comparison.toml"
    experiment("new", "--out", path)
    named = re.findall(r"# proximity experiment (\w+) \S+((?: p\d+)?(?: --\w+ \S+)*)", path.read_text())

    assert [name for name, _ in named] == ["plan", "simulate", "report", "run"]
    for name, rest in named:
        help_of = experiment(name, "--help")[1]
        assert all(option in help_of for option in re.findall(r"--\w+", rest)), name


def test_whole_experiment_from_design_to_figure(experiment, tmp_path):
    design, data = write_design(tmp_path), tmp_path / "data"

    code, out, _ = experiment("simulate", design, "--data", data)
    assert code == 0 and out.endswith(f"{data}: 4 participants\n")
    assert out.startswith("participants") and "late against real" in out  # power, before participants
    assert "late against real" not in experiment("simulate", design, "--data", data)[1]
    figure, scores = tmp_path / "f.png", tmp_path / "scores.csv"
    code, out, err = experiment("report", design, data, "--out", figure, "--csv", scores)
    assert code == 0 and out.endswith(f"{figure}: written\n") and "late against real" in out
    assert err == "proximity: All 4 participants are simulated observers.\n"
    assert figure.read_bytes().startswith(b"\x89PNG")
    lines = scores.read_text().splitlines()
    assert lines[0] == "task,condition,participant,score,lower,upper" and len(lines) == 13


def test_power_is_a_table(experiment, tmp_path):
    code, out, _ = experiment("power", write_design(tmp_path), "--participants", 8, "--participants", 12)

    assert code == 0
    assert [line.split()[:2] for line in out.splitlines()[1:]] == [["8", "stiffness"], ["12", "stiffness"]]
    assert out.splitlines()[0].split("  ")[-1].strip() == "80 % find"


ADDRESS = "mailbox:experiment"
PATH = FingerPath(Glove())
WALL = PATH.position(0.5)
PERIOD_S = 1.2  # s, period of a finger that presses repeatedly
PERSON = (
    SMALL.replace("trials = 8\nlevels = [0.1, 0.2, 0.4, 0.8]", "trials = 2\nlevels = [0.4, 0.8]")
    .replace("catch = 1\npractice = 1\n", "")
    .replace("trials = 4", "trials = 1")
    .replace("force = 4.0", "force = 4.0\nseconds = 2.0")
)


@pytest.fixture
def pressing():
    """Publish a finger that touches a wall every 1.2 s, until the end of the test."""
    began = time.monotonic()

    def message():
        phase = (time.monotonic() - began) % PERIOD_S / PERIOD_S
        depth = float(np.interp(phase, [0.0, 0.15, 0.3, 0.45], [-0.03, 0.003, 0.003, -0.03]))
        made = frame(1, time.monotonic_ns())
        contact = made.records
        contact["mode"], contact["contact_bend"] = Mode.POSITION, 0.5
        contact["bend"] = PATH.bend(WALL + depth)
        for name in ("signed_distance", "lower", "upper"):
            contact[name] = -depth
        return made

    with publishing(ADDRESS, message, 0.002):
        yield


def typing(monkeypatch, answers):
    """Simulate typing: answer prompts with the first answer whose key is in the prompt, others with Enter."""
    asked = []

    def typed(prompt=""):
        asked.append(prompt)
        answer = next((answer for words, answer in answers.items() if words in prompt), "")
        if answer is KeyboardInterrupt:
            raise KeyboardInterrupt
        return answer.pop(0) if isinstance(answer, list) else answer

    monkeypatch.setattr(builtins, "input", typed)
    return asked


@pytest.mark.slow
def test_session_at_the_terminal_stops_continues_and_ends(experiment, tmp_path, monkeypatch, pressing):
    design, data = write_design(tmp_path, PERSON), tmp_path / "data"
    command = ("run", design, "p01", "--address", ADDRESS, "--data", data)
    typing(monkeypatch, {"agree": ["perhaps", "yes"], "1 or 2": KeyboardInterrupt})
    code, out, err = experiment(*command)
    assert code == 130 and "expected yes or no" in err and "80 % find" in out
    assert err.endswith("proximity: stopped; the same command continues from there\n")

    asked = typing(monkeypatch, {"1 or 2": ["three", "1", *"1" * 20]})
    code, out, err = experiment(*command)
    with (data / "p01.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert code == 0 and "expected 1 or 2" in err
    assert out.splitlines()[-1] == f"{data / 'p01.csv'}: p01 is done"
    assert [int(row["number"]) for row in rows] == list(range(5))
    assert not [row["stopped"] for row in rows if row["stopped"]] and {row["answer"] for row in rows} == {"1"}
    pressed = [float(row[f"peak_force_{i}_N"]) for row in rows for i in (1, 2)]
    assert max(pressed) > 0.3 and min(pressed) == 0.0  # the real wall is independent of the drum
    assert rows[0]["apparatus"] == "simulated drum"
    assert any("put the real surface in place" in prompt for prompt in asked)


def test_refused_consent_keeps_no_data(experiment, tmp_path, monkeypatch, pressing):
    data = tmp_path / "data"
    typing(monkeypatch, {"agree": "no"})
    code, _, err = experiment(
        "run", write_design(tmp_path, PERSON), "p01", "--address", ADDRESS, "--data", data
    )

    assert code == 130 and err.endswith("p01 does not agree: no data were kept\n")
    assert not data.exists()
