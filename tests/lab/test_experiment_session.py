"""Sessions: methods, the log, what a crash costs, limits, and the folder of data."""

import csv
import getpass
import json
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
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import FRAME, TRIAL_FIELDS, Interval, Presentation
from proximity.lab.experiment.observers import Observer, cut_at_limits
from proximity.lab.experiment.plan import QuestPlus, Staircase
from proximity.lab.experiment.session import Monitor, RefusedError, Session, StoppedError
from proximity.lab.experiment.trial_log import TrialLog, read_log
from proximity.lab.simulation.simulated_press import Wall

LEVELS = (0.1, 0.2, 0.4, 0.8)


@pytest.fixture
def design(tmp_path):
    return read_design(write_design(tmp_path))


@pytest.fixture
def dataset(tmp_path, design):
    return Dataset(tmp_path / "data", design)


def without_times(entries):
    ignored = {"at", "response_time", "previous", "sha256"}
    steps = [one for one in entries if one["event"] != "begin"]
    return [{key: value for key, value in one.items() if key not in ignored} for one in steps]


def test_staircase_falls_after_three_right_answers_and_rises_after_one_wrong():
    staircase, seen = Staircase(LEVELS), []
    for is_right in (True, True, True, True, True, True, False, True, False):
        seen.append(staircase.level())
        staircase.update(is_right)

    assert seen == [0.8, 0.8, 0.8, 0.4, 0.4, 0.4, 0.2, 0.4, 0.4]
    assert staircase.level() == 0.8


def test_staircase_settles_where_79_percent_are_right():
    rng, levels = np.random.default_rng(7), np.geomspace(0.01, 1.0, 41)
    staircase, asked = Staircase(levels), []
    for _ in range(4000):
        asked.append(staircase.level())
        staircase.update(bool(rng.random() < 0.5 + 0.5 * asked[-1]))  # 79.4 % at 0.588

    assert np.median(asked[200:]) == pytest.approx(0.588, rel=0.15)


def test_quest_asks_near_the_threshold_and_repeats_itself():
    def asked(count):
        rng, quest = np.random.default_rng(7), QuestPlus(np.geomspace(0.05, 1.0, 12))
        seen = []
        for _ in range(count):
            seen.append(quest.level())
            quest.update(bool(rng.random() < (0.98 if seen[-1] > 0.2 else 0.55)))
        return seen

    seen = asked(30)
    assert seen == asked(30)
    assert 0.1 < np.median(seen[10:]) < 0.4


def test_methods_go_on_from_a_log(tmp_path):
    text = SMALL.replace('kind = "stiffer"\n', 'kind = "stiffer"\nmethod = "staircase"\n')
    design = read_design(write_design(tmp_path, text))
    whole, entries = Session(design, 0), []
    while whole.step is not None:
        is_right = None
        if hasattr(whole.step, "number"):
            is_right = whole.trial().level > 0.15
            entries.append({"event": "trial", "level": whole.trial().level, "is_right": is_right})
        else:
            entries.append({"event": "text"})
        whole.advance(is_right=is_right)
    resumed = Session(design, 0)
    resumed.replay(entries[:9])

    assert len({one.get("level") for one in entries}) > 2
    assert resumed.trial().level == entries[9]["level"]


def test_whole_session_is_in_log_tables_and_frames(dataset):
    simulate(dataset, "p01")
    folder = dataset.folder / "sub-p01"
    entries = dataset.entries("p01")
    trials = [one for one in entries if one["event"] == "trial"]

    assert [one["event"] for one in entries[:3]] == ["begin", "text", "question"]
    assert entries[1]["name"] == "consent" and len(entries[1]["text_sha256"]) == 64
    assert [one["number"] for one in trials] == list(range(len(trials))) and len(trials) == 23
    with np.load(folder / "frames" / "sub-p01_trial-0001.npz") as frames:
        assert frames["interval_1"].dtype == FRAME
        assert frames["interval_2"]["force"].max() == pytest.approx(trials[1]["peak_force"][1], rel=1e-6)
    assert sorted(path.name for path in (folder / "beh").iterdir()) == [
        f"sub-p01_{name}_beh.{ending}"
        for name in ("task-questionnaire", "task-stiffness_run-1", "task-which_run-1")
        for ending in ("json", "tsv")
    ]
    with (folder / "beh" / "sub-p01_task-which_run-1_beh.tsv").open() as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    assert list(rows[0]) == list(TRIAL_FIELDS) and len(rows) == 4
    for row, one in zip(rows, [one for one in trials if one["task"] == "which"], strict=True):
        with np.load(folder / "frames" / f"sub-p01_trial-{one['number']:04d}.npz") as frames:
            felt = [Presentation(frames[name]) for name in ("interval_1", "interval_2")]
        for column, name in (("onset", "onset"), ("depth", "depth"), ("peak_force", "peak")):
            expected = [getattr(each, name) for each in felt]
            assert [float(text) for text in row[column].split()] == pytest.approx(expected, rel=1e-6)
        assert row["odd"] in "12" and row["is_right"] == str(int(row["answer"] == row["odd"]))
    assert "finished" in (dataset.folder / "participants.tsv").read_text()


@pytest.mark.slow
def test_killed_session_goes_on_and_nothing_is_lost_or_done_twice(tmp_path, design):
    """The process is killed as often as it takes, wherever it happens to be."""
    reference = Dataset(tmp_path / "reference", design)
    simulate(reference, "p01")
    data, path = tmp_path / "killed", tmp_path / "design.toml"
    command = [sys.executable, "-m", "proximity", "experiment", "simulate", str(path), "--data", str(data),
               "--participant", "p01"]  # fmt: skip
    log, kills = data / "sub-p01" / "sub-p01_log.jsonl", 0
    for least in (2, 9, 17):
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while running.poll() is None and lines_of(log) < least:
            time.sleep(0.001)
        kills += running.poll() is None
        running.send_signal(signal.SIGKILL)
        running.wait()
    assert kills == 3
    subprocess.run(command, check=True, capture_output=True)

    assert without_times(read_log(log)) == without_times(reference.entries("p01"))
    assert sum(one["event"] == "begin" for one in read_log(log)) >= 3


def lines_of(path):
    try:
        return path.read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0


def test_line_that_a_crash_left_unfinished_is_cut_off(tmp_path):
    path = tmp_path / "log.jsonl"
    with TrialLog(path) as log:
        log.append("text", name="consent")
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"event": "tri')

    with TrialLog(path) as log:
        assert [one["event"] for one in log.entries] == ["text"]
        log.append("trial", number=0)
    assert [one["event"] for one in read_log(path)] == ["text", "trial"]
    assert path.read_bytes().startswith(whole)


@pytest.mark.parametrize(
    "edit",
    [
        lambda lines: [lines[0], lines[1].replace('"answer": 1', '"answer": 2'), *lines[2:]],
        lambda lines: [lines[0], *lines[2:]],
        lambda lines: [lines[1], lines[0], *lines[2:]],
        lambda lines: [*lines[:2], "{}", *lines[2:]],
        lambda lines: [*lines[:2], "nonsense", *lines[2:]],
    ],
    ids=["changed", "removed", "swapped", "added", "no JSON"],
)
def test_edited_log_is_refused_in_one_sentence(tmp_path, edit):
    path = tmp_path / "log.jsonl"
    with TrialLog(path) as log:
        for number in range(4):
            log.append("trial", number=number, answer=1)
    path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")

    with pytest.raises(RecordingError, match=r"log.jsonl:\d: this line, or one before it, was edited after"):
        read_log(path)
    with pytest.raises(RecordingError, match="was edited after it was written"):
        TrialLog(path)


def test_finished_log_that_was_shortened_is_refused(dataset):
    simulate(dataset, "p01")
    path = dataset.log_path("p01")
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-1]))

    with pytest.raises(RecordingError, match="does not end as it did when the session was over"):
        dataset.trials()


def test_one_participant_is_run_by_one_program(tmp_path):
    with (
        TrialLog(tmp_path / "log.jsonl"),
        pytest.raises(RecordingError, match="another program runs this participant"),
    ):
        TrialLog(tmp_path / "log.jsonl")


def test_force_beyond_the_limit_ends_the_trial_whatever_the_design_says(tmp_path):
    """A wall of 1000 N/m that is 10 ms late pushes back with more and more force."""
    text = SMALL.replace("stiffness = 200.0", "stiffness = 1000.0").replace(
        "latency = 0.003", "latency = 0.01"
    )
    dataset = Dataset(tmp_path / "data", read_design(write_design(tmp_path, text)))
    simulate(dataset, "p01")
    trials = [one for one in dataset.trials() if one["task"] == "stiffness" and one["condition"] == "late"]

    assert trials and all(one["stopped"].endswith("are beyond the limit of 4 N") for one in trials)
    assert all(one["answer"] is None and one["is_right"] is None for one in trials)
    assert max(max(one["peak_force"]) for one in dataset.trials()) <= 4.0


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


def test_emergency_stop_ends_the_visit_and_the_session_goes_on_later(dataset):
    monitor = Monitor()

    class Stopping(Observer):
        def present(self, interval, limit_force, limit_seconds):
            if len(dataset.log_path("p01").read_bytes().splitlines()) == 6:
                monitor.stop.set()
            return super().present(interval, limit_force, limit_seconds)

    with pytest.raises(StoppedError):
        simulate(dataset, "p01", Stopping, monitor)
    last = dataset.entries("p01")[-1]
    assert last["stopped"] == "emergency stop" and last["answer"] is None
    simulate(dataset, "p01")
    assert sorted(one["number"] for one in dataset.trials()) == list(range(23))


def test_who_does_not_consent_leaves_nothing(dataset):
    class Refusing(Observer):
        def read(self, text):
            return False

    report = dataset.folder / "derivatives" / "report.html"
    report.parent.mkdir()
    report.touch()
    with pytest.raises(RefusedError):
        simulate(dataset, "p01", Refusing)
    assert "p01" not in (dataset.folder / "participants.tsv").read_text()
    assert not (dataset.folder / "sub-p01").exists() and report.exists()


@pytest.mark.parametrize("wall", list(Wall))
@pytest.mark.parametrize("stiffness", [None, 300.0])
def test_hand_feels_every_wall(design, wall, stiffness):
    felt = Observer(design, 0).present(Interval(wall, stiffness, 2.0, 0.001, 1500.0, 0.2), 4.0, 8.0)

    assert not felt.stopped
    assert 0.5 < felt.peak < 1.1
    assert abs(felt.onset) < 0.02


def test_nothing_personal_is_in_the_data(dataset):
    simulate(dataset, "p01")
    personal = {getpass.getuser(), socket.gethostname(), str(Path.home()), str(dataset.folder.parent)}
    dates = re.compile(rb"20[2-9]\d-\d\d-\d\d|20[2-9]\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])")
    files = [path for path in dataset.folder.rglob("*") if path.is_file() and path.suffix != ".npz"]

    assert len(files) > 6
    for path in files:
        content = path.read_bytes()
        assert not dates.search(re.sub(rb"[0-9a-f]{64}", b"", content)), path
        for word in personal:
            assert not re.search(rb"\b" + re.escape(word.encode()) + rb"\b", content), (path, word)
    with np.load(dataset.folder / "sub-p01" / "frames" / "sub-p01_trial-0000.npz") as frames:
        assert set(frames) <= {"interval_1", "interval_2"}
        assert set(frames["interval_1"].dtype.names) == {"time", "finger", "wall", "force"}


@pytest.mark.parametrize("name", ["Anna", "anna", "p1 ", "../p1", "p12345", ""])
def test_only_pseudonyms_take_part(dataset, name):
    with pytest.raises(RecordingError, match="expected a pseudonym such as p07"):
        dataset.register(name, Observer.name)


def test_forgotten_participant_is_nowhere_and_the_place_is_free(dataset):
    simulate(dataset, "p01")
    simulate(dataset, "p02")
    report = dataset.folder / "derivatives" / "report" / "scores.csv"
    report.parent.mkdir(parents=True)
    report.write_text("p01,1\n")
    with pytest.raises(RecordingError, match="all 2 places of the design are taken"):
        dataset.register("p03", Observer.name)
    dataset.remove("p01")

    assert not [path for path in dataset.folder.rglob("*") if "p01" in path.name]
    assert not [path for path in dataset.folder.rglob("*") if path.is_file() and b"p01" in path.read_bytes()]
    assert dataset.register("p03", Observer.name) == 0
    with pytest.raises(RecordingError, match="no participant 'p01', expected one of: p02, p03"):
        dataset.remove("p01")


@pytest.mark.parametrize(
    ("first", "second", "there", "new"),
    [
        (Observer.name, "simulated drum", "simulated observers", "people"),
        ("drum with a motor", Observer.name, "people", "simulated"),
    ],
)
def test_people_and_simulated_observers_are_not_mixed(dataset, first, second, there, new):
    dataset.register("p01", first)

    for name in ("p01", "p02"):
        with pytest.raises(RecordingError, match=f"has data of {there}, expected another folder for {new}"):
            dataset.register(name, second)
    assert [row["participant_id"] for row in dataset.participants()] == ["p01"]


def test_data_say_whether_participants_are_simulated(tmp_path, dataset):
    people = Dataset(tmp_path / "people", dataset.design)
    for folder, apparatus in ((dataset, Observer.name), (people, "simulated drum")):
        folder.register("p01", apparatus)
        assert folder.participants()[0]["apparatus"] == apparatus
    said = "All participants are simulated observers."
    assert said in (dataset.folder / "dataset_description.json").read_text()
    assert said not in (people.folder / "dataset_description.json").read_text()


def test_apparatus_that_the_table_lacks_is_that_of_the_log(dataset):
    simulate(dataset, "p01")
    table = dataset.folder / "participants.tsv"
    table.write_text(re.sub(r"\t(apparatus|simulated observer)", "", table.read_text()))

    assert "simulated" not in table.read_text()
    assert dataset.participants()[0]["apparatus"] == Observer.name
    assert all(trial["is_simulated"] for trial in dataset.trials())


def test_folder_belongs_to_one_design(tmp_path, dataset):
    other = read_design(write_design(tmp_path, SMALL.replace("seed = 7", "seed = 8")))

    with pytest.raises(RecordingError, match="was begun with another design"):
        Dataset(dataset.folder, other)
    assert Dataset(dataset.folder).design == dataset.design
    with pytest.raises(RecordingError, match="no experiment is here"):
        Dataset(tmp_path / "elsewhere")


def test_descriptions_are_json(dataset):
    described = json.loads((dataset.folder / "dataset_description.json").read_text())

    assert described["Name"] == "Small" and described["BIDSVersion"]
