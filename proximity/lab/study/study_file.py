"""Reader of study files: from TOML to the conditions of a study, with the line of every mistake.

A job is a function of keyword arguments: its parameters are the factors, its dictionary the measures.
"""

import glob
import hashlib
import inspect
import itertools
import json
import os
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from proximity.service.config.table_fields import REQUIRED, Table, shown
from proximity.service.config.toml_document import Document, read_document
from proximity.service.config.toml_document import Path as KeyPath

NONE = "none"
"""Word for a factor without a value."""
TABLES = ("study", "factors", "conditions", "plot")
PLOT_KEYS = ("measure", "x", "lines", "columns", "points")
POINTS = ("median", "worst")
KEY_BYTES = 10
"""Size of a key: two of a million conditions share one with a probability of 4e-13."""
Job = Callable[..., dict[str, Any]]
EXPECTED = {
    float: "a number",
    int: "a whole number",
    str: "a text",
    Path: "a file",
    types.NoneType: f'"{NONE}"',
}


@dataclass(frozen=True, slots=True)
class Condition:
    """One row of a study."""

    key: str  # hash of job, factors and content of files
    values: Mapping[str, Any]  # all factors of the job


@dataclass(frozen=True, slots=True)
class Study:
    """A study file."""

    path: Path
    name: str
    job: Job
    conditions: tuple[Condition, ...]
    plot: Mapping[str, str]  # keys of `PLOT_KEYS`

    @property
    def results(self) -> Path:
        """Folder of the results, next to the file."""
        return self.path.with_suffix(".results")


def read_study(path: Path, jobs: Mapping[str, Job]) -> Study:
    """Return a study; *jobs*: by the names that its file may use, in addition to ``module:function``."""
    document = read_document(path, "a study")
    Table(document, (), document.data, TABLES)  # complains of others
    table = Table(document, ("study",), document.data.get("study", {}), ("name", "job"))
    name = table.text("name", path.stem, meaning="a name")
    job_name = table.text("job", REQUIRED, meaning="a job")
    document.raise_complaints()  # the factors follow from the job
    job = jobs.get(job_name) or _imported(table, job_name, jobs)
    document.raise_complaints()
    conditions = tuple(_conditions(document, path.parent, job_name, job))
    plot = Table(document, ("plot",), document.data.get("plot", {}), PLOT_KEYS)
    chosen = {key: plot.text(key, "", meaning="a column") for key in PLOT_KEYS[:-1]}
    chosen["points"] = plot.one_of("points", POINTS[0], POINTS)
    document.raise_complaints()
    return Study(path, name, job, conditions, chosen)


def _imported(table: Table, name: str, jobs: Mapping[str, Job]) -> Job:
    """Return the function that ``module:function`` names."""
    module, _, function = name.partition(":")
    try:
        found: Job = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as failed:
        known = " or ".join(f'"{one}"' for one in jobs)
        table.complain("job", f'is {name!r}, expected {known} or "module:function" ({failed})')
        return dict
    return found


def _conditions(document: Document, folder: Path, job_name: str, job: Job) -> Iterator[Condition]:
    """Return every combination of [factors], with each of [[conditions]]; each condition once."""
    rows = document.data.get("conditions", [{}])
    if not isinstance(rows, list):
        document.complain(("conditions",), "conditions are not tables, expected [[conditions]] above each")
        return
    paths: list[KeyPath] = [("conditions", index) for index in range(len(rows))]
    common = _levels(document, folder, ("factors",), document.data.get("factors", {}), job)
    parameters = inspect.signature(job).parameters
    digests: dict[str, str] = {}
    seen = set[str]()
    for path, row in zip(paths, rows, strict=True):
        levels = common | _levels(document, folder, path, row, job)
        missing = [n for n, one in parameters.items() if one.default is one.empty and n not in levels]
        if missing:
            document.complain(("factors",), f"factors.{missing[0]} is missing: the job {job_name} needs it")
            return
        defaults = {name: one.default for name, one in parameters.items() if name not in levels}
        for chosen in itertools.product(*levels.values()):
            values = defaults | dict(zip(levels, chosen, strict=True))
            files = {str(one): _digest(one, digests) for one in values.values() if isinstance(one, Path)}
            key = _key(job_name, values, files)
            if key not in seen:
                seen.add(key)
                yield Condition(key, {name: values[name] for name in parameters})


def _levels(document: Document, folder: Path, path: KeyPath, content: Any, job: Job) -> dict[str, list[Any]]:
    """Return the values of each factor in a table."""
    parameters = inspect.signature(job).parameters
    Table(document, path, content, list(parameters))
    levels = {}
    for name, value in content.items() if isinstance(content, dict) else ():
        if name in parameters:
            annotation = parameters[name].annotation
            accepted = typing.get_args(annotation) or (annotation,)
            listed = value if isinstance(value, list) else [value]
            levels[name] = [
                one for each in listed for one in _read(document, folder, (*path, name), each, accepted)
            ]
            if not levels[name]:
                document.complain((*path, name), f"{name} has no values, expected one or more")
    return levels


def _read(
    document: Document, folder: Path, path: KeyPath, value: Any, accepted: tuple[type, ...]
) -> list[Any]:
    """Return the values of an item: several for a pattern of files, none for an invalid one."""
    if value == NONE and types.NoneType in accepted:
        return [None]
    if Path in accepted and isinstance(value, str):
        names = sorted(glob.glob(value, root_dir=folder, recursive=True))
        files = [Path(os.path.normpath((folder / name).absolute())) for name in names]
        if not any(one.is_file() for one in files):
            document.complain(path, f"{path[-1]}: {value!r} matches no file in {folder.absolute()}")
        return [one for one in files if one.is_file()]
    if isinstance(value, int) and not isinstance(value, bool) and float in accepted:
        return [float(value)]
    if type(value) in accepted:
        return [value]
    expected = " or ".join(EXPECTED.get(one, str(one)) for one in accepted)
    document.complain(path, f"{path[-1]} is {shown(value)}, expected {expected}")
    return []


def _digest(path: Path, known: dict[str, str]) -> str:
    """Return the SHA-256 of a file, read once."""
    if str(path) not in known:
        with path.open("rb") as stream:
            known[str(path)] = hashlib.file_digest(stream, "sha256").hexdigest()
    return known[str(path)]


def _key(job: str, values: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    """Return the hash of a condition; a file counts by its content."""
    plain = {
        name: digests.get(str(one), str(one)) if isinstance(one, Path) else one
        for name, one in values.items()
    }
    said = json.dumps([job, plain], sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(said.encode(), digest_size=KEY_BYTES).hexdigest()
