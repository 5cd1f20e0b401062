"""Repetition of one condition in this process, beside what its row says."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proximity.errors import ServiceError
from proximity.lab.sweep.design import Condition
from proximity.lab.sweep.node_files import NodeFiles
from proximity.lab.sweep.row_files import read_rows, row_paths
from proximity.lab.sweep.study_file import Study


@dataclass(frozen=True, slots=True)
class Repetition:
    """One condition, done again."""

    condition: Condition
    results: Mapping[str, Any]
    recorded: Mapping[str, Any] | None  # its row; None where it has none


def repeat(study: Study, out: Path, key: str) -> Repetition:
    """Do the job for one condition, and return what comes of it; nothing is recorded."""
    found = [condition for condition in study.conditions if condition.key.startswith(key.lower())]
    if len(found) != 1:
        reason = "no condition has" if not found else f"{len(found)} conditions have"
        raise ServiceError(
            f"{study.path}: {reason} a key that begins with {key!r}, expected the key of a row"
        )
    (condition,) = found
    files = NodeFiles(study.folder, str(out.absolute()), condition.key, condition.digests)
    return Repetition(condition, study.job.run(condition.values, files), _recorded(out, condition.key))


def _recorded(out: Path, key: str) -> dict[str, Any] | None:
    if not row_paths(out):
        return None
    rows = read_rows(out).rows
    keys = rows["key"].to_pylist()
    row: dict[str, Any] | None = rows.slice(keys.index(key), 1).to_pylist()[0] if key in keys else None
    return row
