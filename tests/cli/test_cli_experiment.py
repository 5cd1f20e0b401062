"""``proximity experiment``: commands from the design to the report."""

import builtins
import re
import sys
import threading
import time

import numpy as np
import pytest
from experiments import SMALL, write_design
from sealed_frames import frame

from proximity import cli
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.lab.experiment.trial_log import read_log
from proximity.message import Mode
from proximity.transport import open_publisher


@pytest.fixture
def experiment(monkeypatch, capsys):
    """Run a command; its exit code, and what it printed on stdout and stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["proximity", "experiment", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code or 0, *capsys.readouterr()

    return run


def test_new_design_is_written_once_and_can_be_planned(experiment, tmp_path):
    path = tmp_path / "walls.toml"

    assert experiment("new", "--out", path)[:2] == (0, f"{path}: written\n")
    code, _, err = experiment("new", "--out", path)
    assert code == 2 and "cannot be written (File exists): choose another name" in err.replace("\n", " ")
    path.write_text(path.read_text().replace("stiffness = 100.0", "stiffness = 200.0"))
    code, out, err = experiment("plan", path, "--slot", 1)
    assert code == 0 and err.startswith("proximity: 248 trials, 42 minutes as planned, design ")
    assert "proximity: coupled10ms in stiffness is unstable at 320 N/m with 1 N s/m, 10 ms late" in err
    lines = out.splitlines()
    assert lines[:3] == ["step\trun\tstage\ttask\tcondition\tlevel\todd", "consent", "question hours"]
    assert len(lines) == 260 and "catch\tstiffness\tdecaff\t1\t" in out


def test_commands_in_the_shipped_design_exist(experiment, tmp_path):
    path = tmp_path / "comparison.toml"
    experiment("new", "--out", path)
    named = re.findall(r"proximity experiment (\w+) \S+((?: p\d+)?(?: --\w+ \S+)*)", path.read_text())

    assert [name for name, _ in named] == ["new", "plan", "simulate", "run"]
    for name, rest in named:
        help_of = experiment(name, "--help")[1]
        assert all(option in help_of for option in re.findall(r"--\w+", rest)), name


def test_whole_experiment_from_design_to_report_and_forgetting(experiment, tmp_path):
    design, data = (
        write_design(tmp_path, SMALL.replace("participants = 2", "participants = 4")),
        tmp_path / "data",
    )

    code, out, _ = experiment("simulate", design, "--data", data)
    assert (code, out) == (0, f"{data}: 4 participants\n")
    code, out, _ = experiment("report", data)
    assert code == 0 and out.startswith("stiffness: F(1, 3) = ")
    assert (data / "derivatives" / "report" / "report.html").is_file()
    code, out, _ = experiment("forget", data, "p02")
    assert (code, out) == (0, f"{data}: all data of p02 are deleted, and reports with them\n")
    assert not (data / "sub-p02").exists() and not (data / "derivatives").exists()


def test_name_of_a_person_is_refused_in_one_sentence(experiment, tmp_path):
    design, data = write_design(tmp_path), tmp_path / "none"
    code, out, err = experiment("simulate", design, "--data", data, "--participant", "Anna Smith")

    assert (code, out) == (2, "") and "expected a pseudonym" in err and err.count("\n") == 1


def test_edited_log_is_one_sentence(experiment, tmp_path):
    design, data = write_design(tmp_path), tmp_path / "data"
    experiment("simulate", design, "--data", data, "--participant", "p01")
    log = data / "sub-p01" / "sub-p01_log.jsonl"
    log.write_text(log.read_text().replace('"level": 0.1', '"level": 0.2', 1))
    code, _, err = experiment("report", data)

    assert code == 2 and "was edited after it was written" in err and err.count("\n") == 1


def test_power_is_a_table_and_check_says_both(experiment, tmp_path, monkeypatch):
    from proximity.lab.experiment.analysis import simulation

    monkeypatch.setattr(
        simulation, "power", lambda *given, watch: [simulation.Power("t", "b against a", 8, 0.5)]
    )
    design = write_design(tmp_path)
    code, out, _ = experiment("power", design, "--participants", 8, "--effect", 1.5)
    assert code == 0 and "8 participants" in out and "50%" in out
    monkeypatch.setattr(simulation, "false_positives", lambda *given: {"t": 0.05})
    monkeypatch.setattr(simulation, "recovery", lambda design: simulation.Recovery(48, 47, -0.02))
    code, out, _ = experiment("check", design)
    assert out.splitlines() == [
        "t: a difference was found in 5% of 100 experiments without one",
        "47 of 48 thresholds lie in their 95 % credible intervals; on average they are found 2.0% too low",
    ]


ADDRESS = "mailbox:experiment"
PATH = FingerPath(Glove())
WALL = PATH.position(0.5)
PERIOD_S = 1.2  # of a finger that presses again and again
PERSON = (
    SMALL.replace("trials = 8\nlevels = [0.1, 0.2, 0.4, 0.8]", "trials = 1\nlevels = [0.8]")
    .replace("trials = 4", "trials = 1")
    .replace("force = 4.0", "force = 4.0\nseconds = 2.0")
)


@pytest.fixture
def pressing():
    """A service whose finger touches a wall every 1.2 s, until the test is over."""
    over, began = threading.Event(), time.monotonic()

    def publish():
        with open_publisher(ADDRESS) as publisher:
            while not over.wait(0.002):
                phase = (time.monotonic() - began) % PERIOD_S / PERIOD_S
                depth = float(np.interp(phase, [0.0, 0.15, 0.3, 0.45], [-0.03, 0.003, 0.003, -0.03]))
                message = frame(1, time.monotonic_ns())
                contact = message.records
                contact["mode"], contact["contact_bend"] = Mode.POSITION, 0.5
                contact["bend"] = PATH.bend(WALL + depth)
                for name in ("signed_distance", "lower", "upper"):
                    contact[name] = -depth
                publisher.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    over.set()
    thread.join()


def typing(monkeypatch, answers):
    """Type at prompts: the first answer whose words are in the prompt; Enter at others."""
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
def test_session_at_the_terminal_stops_goes_on_and_ends(experiment, tmp_path, monkeypatch, pressing):
    design, data = write_design(tmp_path, PERSON), tmp_path / "data"
    command = ("run", design, "p01", "--address", ADDRESS, "--data", data, "--terminal")
    typing(monkeypatch, {"agree": "yes", "How many": ["many", "3"], "1 or 2": KeyboardInterrupt})
    code, _, err = experiment(*command)
    assert code == 130 and "expected a number from 0 to 10" in err
    assert err.endswith("proximity: stopped; the same command goes on there\n")

    typing(monkeypatch, {"1 or 2": ["three", "1", *"1" * 20], "Which hand": "left"})
    code, out, err = experiment(*command)
    entries = read_log(data / "sub-p01" / "sub-p01_log.jsonl")
    trials = [one for one in entries if one["event"] == "trial"]
    assert (code, out.splitlines()[-1]) == (0, f"{data}: p01 is done") and "expected 1 or 2" in err
    assert [one["number"] for one in trials] == list(range(6))
    assert sum(one["event"] == "begin" for one in entries) == 2
    assert {one["answer"] for one in trials} == {1} and not any(one["stopped"] for one in trials)
    pressed = [force for one in trials for force in one["peak_force"]]
    assert max(pressed) > 0.3 and min(pressed) == 0.0  # the real wall is not of the drum
    assert code == 0 and entries[0]["apparatus"] == "simulated drum"


def test_who_refuses_is_not_kept(experiment, tmp_path, monkeypatch, pressing):
    data = tmp_path / "data"
    typing(monkeypatch, {"agree": "no"})
    code, _, err = experiment(
        "run", write_design(tmp_path, PERSON), "p01", "--address", ADDRESS, "--data", data, "--terminal"
    )

    assert code == 130 and err.endswith("p01 does not agree: nothing was kept\n")
    assert not (data / "sub-p01").exists()
