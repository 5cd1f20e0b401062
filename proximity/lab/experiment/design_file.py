"""Reader of designs: from TOML to a `Design`; every mistake is named by its line."""

import hashlib
import os
from dataclasses import fields, replace
from typing import Any

from proximity.lab.experiment.design import (
    DAMPING,
    STIFFNESS,
    Condition,
    Design,
    Exclusions,
    Kind,
    Limits,
    Observers,
    Procedure,
    Question,
    Schedule,
    Task,
    Varied,
)
from proximity.lab.experiment.plan import latin_square
from proximity.lab.simulation.simulated_press import Wall
from proximity.service.config.table_fields import REQUIRED, Table
from proximity.service.config.toml_document import Document, Path, read_document

MIN_ADAPTIVE = 3  # levels
TABLES = {"limits": Limits, "schedule": Schedule, "exclusions": Exclusions, "observers": Observers}
LISTS = {"conditions": Condition, "tasks": Task, "questions": Question}
OF_FILE = ("sha256", "file_text")  # fields of a design that are no keys


def read_design(path: str | os.PathLike[str]) -> Design:
    """Return the design in a file."""
    document = read_document(path, "a design")
    values = _read(Design, document, (), document.data)[1]
    for name, record in TABLES.items():
        values[name] = record(**_read(record, document, (name,), document.data.get(name, {}))[1])
    for name, record in LISTS.items():
        values[name] = tuple(_listed(document, name, record))
    document.raise_complaints()
    design = Design(**values, sha256=sha256_of(document.text), file_text=document.text)
    _check_together(document, design)
    document.raise_complaints()
    return design


def sha256_of(text: str) -> str:
    """Return the SHA-256 of a text, in hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def _read(record: Any, document: Document, path: Path, content: Any) -> tuple[Table, dict[str, Any]]:
    """The table of a record, and the fields that it has, by name."""
    keys = [one for one in fields(record) if one.name not in OF_FILE]
    table = Table(document, path, content, [one.name for one in keys])
    return table, {one.name: one.metadata["read"](table, one.name) for one in keys if one.metadata}


def _listed(document: Document, name: str, record: Any) -> list[Any]:
    """The records in a list of tables."""
    listed, found = document.data.get(name, []), []
    if not isinstance(listed, list):
        document.complain((name,), f"{name} are not a list of tables, expected [[{name}]] above each")
        return []
    if not listed and name != "questions":
        document.complain((), f"[[{name}]] is missing, expected at least one")
    for index, content in enumerate(listed):
        table, values = _read(record, document, (name, index), content)
        one = record(**values)
        if isinstance(one, Condition):
            _check_condition(table, one)
        elif isinstance(one, Task):
            _check_task(table, one)
            one = one if table.has("catch_level") else replace(one, catch_level=max(one.levels))
        found.append(one)
    return found


def _check_condition(table: Table, one: Condition) -> None:
    for key, accepted in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        if one.wall is Wall.COUPLED and not table.has(key):
            table.number(key, REQUIRED, accepted)  # complains
    if table.has("stiffness") and one.wall is not Wall.COUPLED:
        table.complain(
            "stiffness", f"is a gain of a coupled wall, and this one is {one.wall}: expected it in a task"
        )


def _check_task(table: Table, one: Task) -> None:
    is_stiffer = one.kind is Kind.STIFFER
    if one.method is not Procedure.CONSTANT and (not is_stiffer or len(one.levels) < MIN_ADAPTIVE):
        table.complain(
            "method",
            f'is "{one.method}", expected a task of kind "stiffer" with {MIN_ADAPTIVE} levels or more for it',
        )
    if is_stiffer and not table.has("levels"):
        table.complain("levels", f"are missing, expected shares by which the {one.varied} differs")
    if one.stiffness is None and one.varied is Varied.STIFFNESS and table.has("levels"):
        table.complain("levels", "are shares of the stiffness, expected tasks.stiffness beside them")
    if one.damping is not None and one.stiffness is None:
        table.complain("damping", "is of a surface, expected tasks.stiffness beside it")
    if one.catch and not is_stiffer:
        table.complain("catch", f'is of tasks of kind "stiffer", and this one is "{one.kind}"')


def _check_together(document: Document, design: Design) -> None:
    """Complain of what does not fit together, though each of it could be."""
    for name in LISTS:
        labels = [one.key if isinstance(one, Question) else one.name for one in getattr(design, name)]
        for index, label in enumerate(labels):
            if label in labels[:index]:
                document.complain((name, index), f"{name}[{index}] is called {label!r}, as an earlier one is")
    rows = len(latin_square(len(design.conditions)))
    if design.participants % rows:
        document.complain(
            ("participants",),
            f"participants is {design.participants}, which cannot be balanced: the Latin square of "
            f"{len(design.conditions)} conditions has {rows} rows, expected a multiple of {rows}",
        )
    for index, task in enumerate(design.tasks):
        for what, count in (("levels", len(task.levels)), ("blocks", task.blocks)):
            if task.trials % count and (what == "blocks" or task.method is Procedure.CONSTANT):
                document.complain(
                    ("tasks", index, "trials"),
                    f"tasks[{index}].trials is {task.trials}, which cannot be balanced over {count} {what}, "
                    f"expected a multiple of {count}",
                )
        if task.kind is Kind.REAL and all(one.wall is Wall.REAL for one in design.conditions):
            document.complain(
                ("tasks", index, "kind"),
                f'tasks[{index}].kind is "real", expected a condition whose wall is not',
            )
