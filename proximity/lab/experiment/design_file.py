"""Reader of designs: from TOML to a `Design`; every mistake is named by its line."""

import hashlib
import os
import re
from enum import StrEnum
from typing import Any

from proximity.lab.experiment.design import (
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
from proximity.lab.simulation.simulated_press import (
    LONGEST_LATENCY,
    MOST_DAMPED,
    SPEEDS_ALLOWED,
    STIFFEST,
    Wall,
)
from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, read_document

TABLES = (
    "title", "seed", "participants", "consent", "welcome", "pause", "goodbye", "limits", "schedule",
    "exclusions", "observers", "conditions", "tasks", "questions",
)  # fmt: skip
CONDITION_KEYS = ("name", "wall", "latency", "stiffness", "damping", "threshold", "correct")
TASK_KEYS = (
    "name", "kind", "method", "trials", "levels", "varied", "stiffness", "damping", "speed", "practice",
    "catch",
    "catch_level", "blocks", "question", "instructions",
)  # fmt: skip
QUESTION_KEYS = ("key", "text", "range", "choices", "when")
NAME = re.compile(r"[a-zA-Z][a-zA-Z0-9]*")
"""A label as file names of BIDS have it."""

MIN_ADAPTIVE = 3  # levels
COUNT = Range("", 1, 1000)
NONE_OR_MORE = Range("", 0, 1000)
SECONDS = Range("s", 0.0, LONGEST_LATENCY)
STIFFNESS = Range("N/m", 0.0, STIFFEST, is_above=True)
DAMPING = Range("N s/m", 0.0, MOST_DAMPED)
SPEED = Range("m/s", *SPEEDS_ALLOWED)
LEVEL = Range("", 0.0, 1e3, is_above=True)
SHARE = Range("", 0.0, 1.0)
FORCE = Range("N", 0.0, 20.0, is_above=True)  # no drum gives more, whatever a design says
ANY = Range("", -1e9, 1e9)
NUMBERS = {  # of tables with a default each
    "limits": (Limits, {"force": FORCE, "seconds": Range("s", 0.1, 600.0)}),
    "schedule": (Schedule, {
        "trial_seconds": Range("s", 0.1, 600.0), "question_seconds": Range("s", 0.1, 600.0),
        "break_minutes": Range("min", 0.0, 60.0), "break_every": COUNT,
    }),
    "exclusions": (Exclusions, {
        "catch_correct": SHARE, "longest_response": Range("s", 0.0, 1e9, is_above=True),
        "stopped_trials": SHARE,
    }),
    "observers": (Observers, {
        "spread": Range("", 0.0, 2.0), "interaction": Range("", 0.0, 2.0),
        "felt_noise": Range("", 0.0, 2.0), "width": Range("", 0.01, 5.0),
        "lapse": Range("", 0.0, 0.2), "rating_noise": Range("", 0.0, 2.0), "speed_noise": SHARE,
    }),
}  # fmt: skip


def read_design(path: str | os.PathLike[str]) -> Design:
    """Return the design in a file."""
    document = read_document(path, "a design")
    top = Table(document, (), document.data, TABLES)
    design = Design(
        title=top.text("title", REQUIRED, meaning="what the experiment is called"),
        seed=top.whole("seed", REQUIRED, Range("", 0, 2**31 - 1)),
        participants=top.whole("participants", REQUIRED, Range("", 1, 10_000)),
        consent=top.text("consent", REQUIRED, meaning="what a participant agrees to"),
        conditions=tuple(_condition(table) for table in _tables(document, "conditions", CONDITION_KEYS)),
        tasks=tuple(_task(table) for table in _tables(document, "tasks", TASK_KEYS)),
        questions=tuple(_question(table) for table in _tables(document, "questions", QUESTION_KEYS)),
        **{key: top.text(key, "", meaning="what is shown") for key in ("welcome", "pause", "goodbye")},
        **{name: _numbers(document, name) for name in NUMBERS},
        text=document.text,
        sha256=sha256_of(document.text),
    )
    document.raise_complaints()
    _check_together(document, design)
    document.raise_complaints()
    return design


def sha256_of(text: str) -> str:
    """Return the SHA-256 of a text, in hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def _numbers(document: Document, name: str) -> Any:
    """One of the tables that consist of numbers."""
    make, ranges = NUMBERS[name]
    table, default = Table(document, (name,), document.data.get(name, {}), tuple(ranges)), make()
    return make(
        **{
            key: (table.whole if accepted is COUNT else table.number)(key, getattr(default, key), accepted)
            for key, accepted in ranges.items()
        }
    )


def _tables(document: Document, name: str, known: tuple[str, ...]) -> list[Table]:
    listed = document.data.get(name, [])
    if not isinstance(listed, list):
        document.complain((name,), f"{name} are not a list of tables, expected [[{name}]] above each")
        return []
    if not listed and name != "questions":
        document.complain((), f"[[{name}]] is missing, expected at least one")
    return [Table(document, (name, index), content, known) for index, content in enumerate(listed)]


def _named(table: Table, key: str = "name") -> str:
    name = table.text(key, REQUIRED, meaning="a name")
    if isinstance(name, str) and not NAME.fullmatch(name):
        table.complain(key, f"is {name!r}, expected letters and digits: it becomes part of file names")
    return str(name)


def _chosen(table: Table, key: str, words: type[StrEnum], default: Any = REQUIRED) -> Any:
    word = table.one_of(key, default, tuple(words))
    return next(iter(words)) if word is REQUIRED else words(word)


def _condition(table: Table) -> Condition:
    wall = _chosen(table, "wall", Wall)
    is_coupled = wall is Wall.COUPLED
    if table.has("stiffness") and not is_coupled:
        table.complain(
            "stiffness", f"is a gain of a coupled wall, and this one is {wall}: expected it in a task"
        )
    return Condition(
        name=_named(table),
        wall=wall,
        latency=table.number("latency", 0.001, SECONDS),
        stiffness=table.number("stiffness", REQUIRED if is_coupled else 1500.0, STIFFNESS),
        damping=table.number("damping", REQUIRED if is_coupled else 2.0, DAMPING),
        threshold=table.number("threshold", 0.2, LEVEL),
        correct=table.number("correct", 0.5, SHARE),
    )


def _task(table: Table) -> Task:
    kind = _chosen(table, "kind", Kind)
    varied = _chosen(table, "varied", Varied, Varied.STIFFNESS)
    procedure = _chosen(table, "method", Procedure, Procedure.CONSTANT)
    levels = table.number_or_numbers("levels", 0.0, None, LEVEL)
    listed = tuple(sorted(levels)) if isinstance(levels, tuple) else (levels,)
    if procedure is not Procedure.CONSTANT and (kind is not Kind.STIFFER or len(listed) < MIN_ADAPTIVE):
        table.complain(
            "method",
            f'is "{procedure}", expected a task of kind "stiffer" with {MIN_ADAPTIVE} levels or more for it',
        )
    if kind is Kind.STIFFER and not table.has("levels"):
        table.complain("levels", f"are missing, expected shares by which the {varied} differs")
    stiffness = table.number("stiffness", None, STIFFNESS)
    if stiffness is None and varied is Varied.STIFFNESS and table.has("levels"):
        table.complain("levels", "are shares of the stiffness, expected tasks.stiffness beside them")
    damping = table.number("damping", None, DAMPING)
    if damping is not None and stiffness is None:
        table.complain("damping", "is of a surface, expected tasks.stiffness beside it")
    catch = table.whole("catch", 0, NONE_OR_MORE)
    if catch and kind is not Kind.STIFFER:
        table.complain("catch", f'is of tasks of kind "stiffer", and this one is "{kind}"')
    return Task(
        name=_named(table),
        kind=kind,
        procedure=procedure,
        trials=table.whole("trials", REQUIRED, COUNT),
        levels=listed,
        varied=varied,
        stiffness=stiffness,
        damping=damping,
        speed=table.number("speed", 0.2, SPEED),
        practice=table.whole("practice", 0, NONE_OR_MORE),
        catch=catch,
        catch_level=table.number("catch_level", max(listed), LEVEL),
        blocks=table.whole("blocks", 1, COUNT),
        question=table.text("question", "", meaning="what is asked"),
        instructions=table.text("instructions", "", meaning="what is to be done"),
    )


def _question(table: Table) -> Question:
    lowest, highest = table.numbers("range", (0.0, 100.0), 2, ANY)
    choices = table.texts("choices", (), meaning="an answer to choose")
    return Question(
        key=_named(table, "key"),
        text=table.text("text", REQUIRED, meaning="what is asked"),
        lowest=lowest,
        highest=highest,
        choices=choices,
        is_after=table.one_of("when", "before", ("before", "after")) == "after",
    )


def _check_together(document: Document, design: Design) -> None:
    """Complain of what does not fit together, though each of it could be."""
    for name, labels in (
        ("conditions", [one.name for one in design.conditions]),
        ("tasks", [one.name for one in design.tasks]),
        ("questions", [one.key for one in design.questions]),
    ):
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
            if task.trials % count and (what == "blocks" or task.procedure is Procedure.CONSTANT):
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
