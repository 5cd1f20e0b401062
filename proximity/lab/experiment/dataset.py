"""Folder of an experiment's data, as BIDS lays out behaviour: nothing in it names a person.

::

    dataset_description.json  design.toml  participants.tsv  participants.json
    sub-p01/sub-p01_log.jsonl                 every step, in the order it was done
    sub-p01/frames/sub-p01_trial-0001.npz     what was felt, an array of `display.FRAME` an interval
    sub-p01/beh/sub-p01_task-NAME_run-1_beh.tsv and .json

The log is what counts; tables are written from it. Times count from the begin of a visit: no dates.
"""

import csv
import hashlib
import io
import json
import re
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import RecordingError
from proximity.lab.experiment.design import SIMULATED, Design
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import TRIAL_FIELDS
from proximity.lab.experiment.trial_log import Entry, TrialLog, read_log
from proximity.system.whole_file import whole_file

PSEUDONYM = re.compile(r"[a-z]{0,3}[0-9]{1,4}")
DERIVED = "derivatives"  # folder of reports: made from the data, and removed with any participant
PARTICIPANT_COLUMNS = {
    "participant_id": "Pseudonym.",
    "slot": "Place in the plan, from 0.",
    "state": "begun or finished.",
    "apparatus": "What displayed the surfaces first; simulated observer: the participant is no person.",
    "log_sha256": "Last hash of a log that is finished.",
}


class Dataset:
    """The folder of an experiment; *design*: that of the experiment, or None for the one that lies there."""

    folder: Path
    design: Design

    def __init__(self, folder: Path, design: Design | None = None) -> None:
        self.folder, kept = folder, folder / "design.toml"
        if kept.is_file():
            self.design = read_design(kept)
            if design is not None and design.sha256 != self.design.sha256:
                raise RecordingError(
                    f"{folder}: was begun with another design, kept there as design.toml; expected that one, "
                    "or a new folder"
                )
        elif design is None:
            raise RecordingError(f"{folder}: no experiment is here, expected a folder that `run` wrote")
        else:
            self.design = design
            self._write_json("participants.json", _described(PARTICIPANT_COLUMNS))
            self._write_participants([])
            self._write("design.toml", design.file_text)  # last: with it the folder counts

    def participants(self) -> list[dict[str, str]]:
        """Return the rows of ``participants.tsv``."""
        text = (self.folder / "participants.tsv").read_text(encoding="utf-8")
        rows = list(csv.DictReader(io.StringIO(text), delimiter="\t"))
        for row in rows:
            row["participant_id"] = row["participant_id"].removeprefix("sub-")
            if "apparatus" not in row:  # folders of earlier versions have it in the logs only
                log = read_log(self.log_path(row["participant_id"]))
                begun = (str(entry["apparatus"]) for entry in log if entry["event"] == "begin")
                row["apparatus"] = next(begun, "n/a")
        return rows

    def register(self, pseudonym: str, apparatus: str) -> int:
        """Return the slot of a participant; a new one gets the first that is free.

        *apparatus*: what displays the surfaces; `design.SIMULATED` where the participant is no person.
        """
        check_pseudonym(pseudonym)
        rows, is_simulated = self.participants(), apparatus == SIMULATED
        if any((row["apparatus"] == SIMULATED) != is_simulated for row in rows):
            there, new = ("people", "simulated observers")[:: 1 if is_simulated else -1]
            raise RecordingError(f"{self.folder}: has data of {there}, expected another folder for {new}")
        for row in rows:
            if row["participant_id"] == pseudonym:
                return int(row["slot"])
        free = sorted(set(range(self.design.participants)) - {int(row["slot"]) for row in rows})
        if not free:
            raise RecordingError(
                f"{self.folder}: all {self.design.participants} places of the design are taken, expected a "
                "participant who has begun"
            )
        values = (pseudonym, str(free[0]), "begun", apparatus, "n/a")
        self._write_participants([*rows, dict(zip(PARTICIPANT_COLUMNS, values, strict=True))])
        return free[0]

    def log_path(self, pseudonym: str) -> Path:
        """Return where the log of a participant is; its folder is made."""
        folder = self._folder_of(pseudonym)
        folder.mkdir(parents=True, exist_ok=True)
        return folder / f"sub-{pseudonym}_log.jsonl"

    def write_frames(self, pseudonym: str, number: int, frames: dict[str, np.ndarray]) -> str:
        """Write the frames of a trial, and return the hash of the file."""
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **frames)
        self._write(f"sub-{pseudonym}/frames/sub-{pseudonym}_trial-{number:04d}.npz", content.getvalue())
        return hashlib.sha256(content.getvalue()).hexdigest()

    def finish(self, pseudonym: str, log: TrialLog) -> None:
        """Note that a session is over, with the last hash of its log."""
        rows = self.participants()
        for row in rows:
            if row["participant_id"] == pseudonym:
                row |= {"state": "finished", "log_sha256": log.head}
        self._write_participants(rows)

    def entries(self, pseudonym: str) -> list[Entry]:
        """Return the log of a participant."""
        path = self.log_path(pseudonym)
        entries = read_log(path)
        row = next(row for row in self.participants() if row["participant_id"] == pseudonym)
        if row["log_sha256"] not in ("n/a", entries[-1]["sha256"] if entries else ""):
            raise RecordingError(
                f"{path}: does not end as it did when the session was over, expected the log as the "
                "experiment left it"
            )
        return entries

    def write_tables(self, pseudonym: str) -> None:
        """Write the tables of a participant from the log."""
        entries = self.entries(pseudonym)
        runs: dict[tuple[str, int], list[Entry]] = defaultdict(list)
        for entry in entries:
            if entry["event"] == "trial":
                runs[entry["task"], entry["run"]].append(entry)
        for (task, run), rows in runs.items():
            about = {"TaskName": task, "Instructions": self.design.task(task).question}
            name = f"sub-{pseudonym}/beh/sub-{pseudonym}_task-{task}_run-{run}_beh"
            self._write(f"{name}.tsv", _as_tsv(TRIAL_FIELDS, rows))
            self._write_json(f"{name}.json", about | _described(TRIAL_FIELDS))
        answers = [entry for entry in entries if entry["event"] == "question"]
        if answers:
            texts = {question.key: question.text for question in self.design.questions}
            name = f"sub-{pseudonym}/beh/sub-{pseudonym}_task-questionnaire_beh"
            self._write(f"{name}.tsv", _as_tsv(("key", "answer"), answers))
            self._write_json(f"{name}.json", {"TaskName": "questionnaire", "key": {"Levels": texts}})

    def trials(self) -> list[Entry]:
        """Return the trials of all participants, with ``participant`` and ``is_simulated`` in each."""
        return [
            {"participant": row["participant_id"], "is_simulated": row["apparatus"] == SIMULATED} | entry
            for row in self.participants()
            for entry in self.entries(row["participant_id"])
            if entry["event"] == "trial"
        ]

    def remove(self, pseudonym: str, *, leaves_reports: bool = False) -> None:
        """Delete all of a participant; *leaves_reports*: none in the folder has data of the participant."""
        rows = self.participants()
        left = [row for row in rows if row["participant_id"] != pseudonym]
        if len(left) == len(rows):
            known = ", ".join(row["participant_id"] for row in rows) or "nobody"
            raise RecordingError(f"{self.folder}: no participant {pseudonym!r}, expected one of: {known}")
        for folder in (self._folder_of(pseudonym), *(() if leaves_reports else (self.folder / DERIVED,))):
            if folder.exists():
                shutil.rmtree(folder)
        self._write_participants(left)

    def _folder_of(self, pseudonym: str) -> Path:
        check_pseudonym(pseudonym)
        return self.folder / f"sub-{pseudonym}"

    def _write_participants(self, rows: list[dict[str, str]]) -> None:
        listed = [row | {"participant_id": f"sub-{row['participant_id']}"} for row in rows]
        self._write("participants.tsv", _as_tsv(PARTICIPANT_COLUMNS, listed))
        made = {"Name": "proximity experiment", "CodeURL": "n/a"}
        if any(row["apparatus"] == SIMULATED for row in rows):
            made["Description"] = "All participants are simulated observers."
        about = {"Name": self.design.title, "BIDSVersion": "1.9.0", "DatasetType": "raw"}
        self._write_json("dataset_description.json", about | {"GeneratedBy": [made]})

    def _write_json(self, name: str, value: Any) -> None:
        self._write(name, json.dumps(value, indent=1, ensure_ascii=False) + "\n")

    def _write(self, name: str, content: str | bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as failed:
            raise RecordingError(f"{path.parent}: cannot be made ({failed.strerror})") from failed
        with whole_file(path) as stream:
            stream.write(content if isinstance(content, bytes) else content.encode())


def check_pseudonym(pseudonym: str) -> None:
    """Refuse what may be a name."""
    if not PSEUDONYM.fullmatch(pseudonym):
        raise RecordingError(
            f"participant is {pseudonym!r}, expected a pseudonym such as p07: up to three small letters and "
            "up to four digits, no name"
        )


def _described(columns: Mapping[str, str]) -> dict[str, Any]:
    return {name: {"Description": text} for name, text in columns.items()}


def _as_tsv(columns: Iterable[str], rows: Iterable[dict[str, Any]]) -> str:
    names, text = tuple(columns), io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_cell(row.get(name)) for name in names] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(map(_cell, value))
    if value is None or value == "":
        return "n/a"
    return str(int(value)) if isinstance(value, bool) else str(value)
