"""Visits: rows of a CSV file, data after a crash, limits, and pseudonyms."""

import csv
import getpass
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from experiments import SMALL, simulate, write_design

from proximity.errors import RecordingError
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import FRAME, Interval, Presentation
from proximity.lab.experiment.observers import Observer, cut_at_limits
from proximity.lab.experiment.visit import COLUMNS, RefusedError, place, read_visit, read_visits
from proximity.lab.simulation.simulated_press import Wall


@pytest.fixture
def design(tmp_path):
    return read_design(write_design(tmp_path))


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "data"


def without_times(rows):
    return [{key: value for key, value in row.items() if key not in ("at_s", "response_s")} for row in rows]


def test_whole_visit_is_one_tidy_table(design, folder):
    rows = simulate(design, folder, "p01")

    assert [path.name for path in folder.iterdir()] == ["p01.csv"]
    with (folder / "p01.csv").open() as stream:
        listed = list(csv.DictReader(stream))
    assert tuple(listed[0]) == COLUMNS and len(listed) == len(rows) == 23
    assert [row["number"] for row in rows] == list(range(23))
    for row in rows:
        assert row["is_right"] == (None if row["stage"] == "catch" else int(row["answer"] == row["odd"]))
        assert row["peak_force_1_N"] > 0.0 and row["peak_force_2_N"] > 0.0 and row["slot"] == 0
    assert {row["odd"] for row in rows if row["stage"] == "catch"} == {None}


@pytest.mark.slow
@pytest.mark.processes
def test_killed_visit_continues_and_no_trial_is_lost_or_repeated(tmp_path, design, folder):
    reference = simulate(design, tmp_path / "reference", "p01")
    command = [sys.executable, "-m", "proximity", "experiment", "simulate", str(tmp_path / "design.toml"),
               "--data", str(folder), "--participant", "p01"]  # fmt: skip
    path, kills = folder / "p01.csv", 0
    for least in (3, 9, 17):
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while running.poll() is None and lines_of(path) < least:
            time.sleep(0.001)
        kills += running.poll() is None
        running.send_signal(signal.SIGKILL)
        running.wait()
    assert kills == 3
    subprocess.run(command, check=True, capture_output=True)

    assert without_times(read_visit(design, path)) == without_times(reference)


def lines_of(path):
    try:
        return path.read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0


def test_row_that_a_crash_left_unfinished_is_cut_off(design, folder):
    whole, path = simulate(design, folder, "p01"), folder / "p01.csv"
    path.write_bytes(path.read_bytes()[:-20])
    assert len(read_visit(design, path)) == 22
    assert without_times(simulate(design, folder, "p01")) == without_times(whole)


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda lines: [lines[0], *lines[2:]], r"p01.csv:2: trial 0 is missing, expected all rows in order"),
        (lambda lines: ["a,b", *lines[1:]], "its first line is not that of a visit"),
        (lambda lines: [*lines[:2], lines[2].replace(",stiffness,", ",stiffness,x,", 1)], r"p01.csv:3: "),
    ],
    ids=["removed", "no visit", "shifted"],
)
def test_table_that_is_not_a_visit_is_refused_by_line(design, folder, edit, sentence):
    simulate(design, folder, "p01")
    path = folder / "p01.csv"
    path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")

    with pytest.raises(RecordingError, match=sentence):
        read_visit(design, path)


def test_visit_of_another_design_is_refused(tmp_path, design, folder):
    simulate(design, folder, "p01")
    other = read_design(write_design(tmp_path, SMALL.replace("seed = 7", "seed = 8")))

    with pytest.raises(RecordingError, match=r"p01.csv:2: belongs to another design"):
        read_visits(other, folder)


def test_one_participant_is_run_by_one_program(design, folder):
    class Twice(Observer):
        def read(self, text):
            with pytest.raises(RecordingError, match="another program runs this participant"):
                simulate(design, folder, "p01")

    simulate(design, folder, "p01", Twice)


def test_force_beyond_the_limit_ends_the_trial_whatever_the_design_says(tmp_path, folder):
    """A wall of 1000 N/m with 10 ms of delay is unstable, with increasing force."""
    text = SMALL.replace("stiffness = 200.0", "stiffness = 1000.0").replace(
        "latency = 0.003", "latency = 0.01"
    )
    rows = simulate(read_design(write_design(tmp_path, text)), folder, "p01")
    late = [row for row in rows if row["task"] == "stiffness" and row["condition"] == "late"]

    assert late and all(row["stopped"].endswith("are beyond the limit of 4 N") for row in late)
    assert all(row["answer"] is None and row["is_right"] is None for row in late)
    assert max(max(row["peak_force_1_N"], row["peak_force_2_N"] or 0.0) for row in rows) <= 4.0


def test_frames_end_at_either_limit_and_where_a_force_is_not_known():
    frames = np.zeros(5, FRAME)
    frames["time"], frames["force"] = np.arange(5), (0.0, 1.0, 2.0, 3.0, 0.0)

    assert len(cut_at_limits(frames, 2.5, 10.0).frames) == 3
    assert cut_at_limits(frames, 2.5, 10.0).stopped == "3.0 N are beyond the limit of 2.5 N"
    assert len(cut_at_limits(frames, 5.0, 2.0).frames) == 3
    frames["force"][1] = np.nan
    assert cut_at_limits(frames, 5.0, 10.0).stopped


def test_first_contact_is_measured_from_the_surface():
    frames = np.zeros(4, FRAME)
    frames["time"] = (0.0, 0.001, 0.002, 0.003)
    frames["finger"], frames["wall"] = (-0.001, 0.0, 0.001, 0.002), (0.0, 0.0, 0.0005, 0.001)
    frames["force"] = (0.0, 0.0, 0.05, 0.2)
    felt = Presentation(frames)

    assert felt.onset == pytest.approx(0.002) and felt.depth == pytest.approx(0.001)
    assert np.isnan(Presentation(frames[:2]).onset)


def test_interrupted_visit_continues_with_the_same_trial(design, folder):
    class Stopping(Observer):
        def answer(self, trial, felt):
            if trial.number == 6:
                raise KeyboardInterrupt
            return super().answer(trial, felt)

    with pytest.raises(KeyboardInterrupt):
        simulate(design, folder, "p01", Stopping)
    assert len(read_visit(design, folder / "p01.csv")) == 6
    assert [row["number"] for row in simulate(design, folder, "p01")] == list(range(23))


class Refusing(Observer):
    def consents(self, text):
        return False


def test_refused_consent_leaves_no_file(design, folder):
    with pytest.raises(RefusedError):
        simulate(design, folder, "p01", Refusing)
    assert not folder.exists()


def test_consent_is_asked_once(design, folder):
    class Stopping(Observer):
        def read(self, text):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(design, folder, "p01", Stopping)
    assert len(simulate(design, folder, "p01", Refusing)) == 23


@pytest.mark.parametrize("wall", list(Wall))
@pytest.mark.parametrize("stiffness", [None, 300.0])
def test_hand_feels_every_wall(design, wall, stiffness):
    felt = Observer(design, 0).present(Interval(wall, stiffness, 2.0, 0.001, 1500.0, 0.2), 4.0, 8.0)

    assert not felt.stopped
    assert 0.5 < felt.peak < 1.1
    assert abs(felt.onset) < 0.02


def test_nothing_personal_is_in_the_data(design, folder):
    simulate(design, folder, "p01")
    content = (folder / "p01.csv").read_text()

    assert not re.search(r"20[2-9]\d-\d\d-\d\d", content)
    for word in (getpass.getuser(), socket.gethostname(), str(Path.home()), str(folder.parent)):
        assert not re.search(r"\b" + re.escape(word) + r"\b", content), word


@pytest.mark.parametrize("name", ["Anna", "anna", "p1 ", "../p1", "p12345", ""])
def test_only_pseudonyms_take_part(design, folder, name):
    with pytest.raises(RecordingError, match="expected a pseudonym such as p07"):
        simulate(design, folder, name)


def test_place_of_a_deleted_participant_is_free(design, folder):
    for name in ("p01", "p02", "p03", "p04"):
        simulate(design, folder, name)
    with pytest.raises(RecordingError, match="all 4 places of the design are taken, expected one of: p01"):
        simulate(design, folder, "p05")
    (folder / "p02.csv").unlink()

    assert simulate(design, folder, "p05")[0]["slot"] == 1


@pytest.mark.parametrize(
    ("first", "second", "there", "new"),
    [
        (Observer.name, "simulated drum", "simulated observers", "people"),
        ("drum with a motor", Observer.name, "people", "simulated observers"),
    ],
)
def test_people_and_simulated_observers_are_not_mixed(design, folder, first, second, there, new):
    rows = [{"participant": "p01", "apparatus": first, "slot": 0}]

    for name in ("p01", "p02"):
        with pytest.raises(RecordingError, match=f"has data of {there}, expected another folder for {new}"):
            place(design, rows, name, second, folder)
