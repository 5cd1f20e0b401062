"""``proximity experiment``: commands from the design to the report."""

import sys

import pytest
from experiments import SMALL, write_design

from proximity import cli


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

    assert experiment("new", path)[:2] == (0, f"{path}: written\n")
    code, _, err = experiment("new", path)
    assert code == 2 and "cannot be written (File exists)" in err.replace("\n", " ")
    code, out, err = experiment("plan", path, "--slot", 1)
    assert code == 0 and err.startswith("proximity: 248 trials, 42 minutes as planned, design ")
    lines = out.splitlines()
    assert lines[:3] == ["step\trun\tstage\ttask\tcondition\tlevel\todd", "consent", "question hours"]
    assert len(lines) == 260 and "catch\tstiffness\tdecaff\t1\t" in out


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


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("report", "DATA"), "no experiment is here, expected a folder that `run` wrote"),
        (("forget", "DATA", "p01"), "no experiment is here"),
        (("plan", "missing.toml"), "missing.toml: cannot be read (No such file or directory)"),
        (("simulate", "DESIGN", "--data", "DATA", "--participant", "Anna Smith"), "expected a pseudonym"),
    ],
)
def test_mistake_is_one_sentence(experiment, tmp_path, arguments, sentence):
    known = {"DESIGN": write_design(tmp_path), "DATA": tmp_path / "none"}
    code, out, err = experiment(*(known.get(word, word) for word in arguments))

    assert (code, out) == (2, "") and sentence in err and err.count("\n") == 1


def test_edited_log_is_one_sentence(experiment, tmp_path):
    design, data = write_design(tmp_path), tmp_path / "data"
    experiment("simulate", design, "--data", data, "--participant", "p01")
    log = data / "sub-p01" / "sub-p01_log.jsonl"
    log.write_text(log.read_text().replace('"level": 0.1', '"level": 0.2', 1))
    code, _, err = experiment("report", data)

    assert code == 2 and "was edited after it was written" in err and err.count("\n") == 1


def test_power_is_a_table_and_check_says_both(experiment, tmp_path, monkeypatch):
    from proximity.studies.experiment.analysis import simulation

    monkeypatch.setattr(simulation, "power", lambda *given: [simulation.Power("t", "b against a", 8, 0.5)])
    design = write_design(tmp_path)
    code, out, _ = experiment("power", design, "--participants", 8, "--effect", 1.5)
    assert code == 0 and "8 participants" in out and "50%" in out
    monkeypatch.setattr(simulation, "false_positives", lambda *given: {"t": 0.05})
    monkeypatch.setattr(simulation, "recovery", lambda design: simulation.Recovery(48, 47, -0.02))
    code, out, _ = experiment("check", design)
    assert out.splitlines() == [
        "t: a difference was found in 5% of 100 experiments without one",
        "47 of 48 thresholds lie in their 95 % credible intervals; on average they are found -2.0% off",
    ]
