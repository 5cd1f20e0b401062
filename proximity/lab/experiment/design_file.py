"""Reader of designs, from TOML to a `Design`. Every mistake is reported with its line."""

import hashlib
import os
from typing import Any

from proximity.lab.experiment.design import (
    AGAINST,
    DAMPING,
    STIFFNESS,
    Condition,
    Design,
    Exclusions,
    Kind,
    Limits,
    Observers,
    Schedule,
    Task,
    Varied,
)
from proximity.lab.experiment.plan import latin_square
from proximity.lab.simulation.simulated_press import Wall
from proximity.service.config.record_fields import keys_of, read_fields, read_table, read_tables
from proximity.service.config.table_fields import REQUIRED, Table
from proximity.service.config.toml_document import Document, read_document

TABLES = {"limits": Limits, "schedule": Schedule, "exclusions": Exclusions, "observers": Observers}
MIN_LEVELS = 2


def _check_condition(table: Table, one: Condition) -> None:
    for key, accepted in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        if one.wall is Wall.COUPLED and not table.has(key):
            table.number(key, REQUIRED, accepted)  # complains
    if table.has("stiffness") and one.wall is not Wall.COUPLED:
        table.complain(
            "stiffness", f"is a gain of a coupled wall, and this one is {one.wall}: expected it in a task"
        )


def _check_task(table: Table, one: Task) -> None:
    if one.kind is Kind.STIFFER and len(one.levels) < MIN_LEVELS:
        few = "has 1 level" if table.has("levels") else "is missing"
        table.complain("levels", f"{few}, expected {MIN_LEVELS} or more, by which the {one.varied} differs")
    if one.stiffness is None and one.varied is Varied.STIFFNESS and table.has("levels"):
        table.complain("levels", "are shares of the stiffness, expected tasks.stiffness beside them")
    if one.damping is not None and one.stiffness is None:
        table.complain("damping", "is of a surface, expected tasks.stiffness beside it")


LISTS: dict[str, tuple[Any, Any]] = {
    "conditions": (Condition, _check_condition),
    "tasks": (Task, _check_task),
}


def read_design(path: str | os.PathLike[str]) -> Design:
    """Read the design in a file."""
    document = read_document(path, "a design")
    # Every table and list of tables is a key as well.
    known = (*keys_of(Design), *TABLES, *LISTS)
    values = read_fields(Design, Table(document, (), document.data, known))
    for name, record in TABLES.items():
        values[name] = read_table(record, document, name)
    for name, (record, check) in LISTS.items():
        values[name] = ()
        for table, one in read_tables(record, document, name, is_needed=True):
            check(table, one)
            values[name] += (one,)
    document.raise_complaints()
    design = Design(**values, digest=hashlib.sha256(document.text.encode()).hexdigest()[:16])
    _check_together(document, design)
    document.raise_complaints()
    return design


def _check_together(document: Document, design: Design) -> None:
    """Report the values of a design that contradict each other."""
    for name in LISTS:
        labels = [one.name for one in getattr(design, name)]
        for index, label in enumerate(labels):
            if label in labels[:index]:
                document.complain((name, index), f"{name}[{index}] is called {label!r}, as an earlier one is")
    rows = len(latin_square(len(design.conditions))) * len(latin_square(len(design.tasks)))
    if design.participants % rows:
        document.complain(
            ("participants",),
            f"participants is {design.participants}, which cannot be balanced: {len(design.conditions)} "
            f"conditions and {len(design.tasks)} tasks have {rows} orders, expected a multiple of {rows}",
        )
    for index, task in enumerate(design.tasks):
        for what, count in (("levels", len(task.levels)), ("blocks", task.blocks)):
            if task.trials % count:
                document.complain(
                    ("tasks", index, "trials"),
                    f"tasks[{index}].trials is {task.trials}, which cannot be balanced over {count} {what}, "
                    f"expected a multiple of {count}",
                )
        names = [one.name for one in design.compared(task)]
        for text in task.comparisons:
            first, _, second = text.partition(AGAINST)
            if first == second or not {first, second} <= set(names):
                document.complain(
                    ("tasks", index, "comparisons"),
                    f'tasks[{index}].comparisons has {text!r}, expected "A{AGAINST}B" of {", ".join(names)}',
                )
        if not names:
            document.complain(
                ("tasks", index, "kind"),
                f'tasks[{index}].kind is "real", expected a condition whose wall is not',
            )
