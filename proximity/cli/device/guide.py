"""Guide through a calibration: the steps, in their order, shown by a `Face`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from proximity.decaff.calibration.readings import Asked
from proximity.decaff.calibration.results import Estimate, Session
from proximity.decaff.calibration.simulated_glove import SimulatedGlove
from proximity.decaff.calibration.tasks import FREE, HELD
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError, DecaffError

MOST_FAILURES = 10  # readings of one task in a row that cannot be right
MOST_DIGITS = 5  # of a number: a simulated encoder has a step that repeats to eight
SHOWN = {  # factor and unit of what repeats are judged by
    "counts": (1.0, "counts"),
    "backlash": (1e6, "µm of backlash"),
    "compliance": (1e6, "µm/N of stretch"),
    "offset": (1e3, "mrad off the model's touch"),
    "latency": (1e3, "ms"),
    "inertia": (1e6, "kg mm²"),
    "stiffness": (1.0, "N m/rad"),
}


class UnfinishedError(Exception):
    """The person stopped, or cannot answer any more; the text says why, if there is more to say."""


class RepeatError(Exception):
    """The person wants the last reading again."""


class SkipError(Exception):
    """The person leaves the task out for now."""


@dataclass(frozen=True, slots=True, eq=False)
class Prompt:
    """One reading that a person is asked for."""

    glove: Glove
    title: str
    parts: tuple[str, ...]  # what is to be done before each number
    advice: str  # "" unless readings differ
    bend: float | None  # of the finger
    done: int
    total: int
    goes_on: bool  # by itself: the person has done what is to be done
    waits: bool  # for the person before a reading; else the person is asked for numbers, or need do nothing

    def joint_angles(self) -> str:
        """Return the angles of the three joints at the bend, in words."""
        flexions = self.glove.finger.flexions
        knuckle, middle, last = (round(math.degrees((self.bend or 0.0) * each)) for each in flexions)
        return f"knuckle {knuckle}°, middle joint {middle}°, last joint {last}°"


class Face(Protocol):
    """Way to ask a person.

    Where something is waited for, it raises `UnfinishedError`, `RepeatError` and `SkipError`.
    """

    def begin(self, prompt: Prompt) -> None:
        """Show what is asked next."""

    def ready(self, part: int) -> None:
        """Say what a part of it is; where the prompt waits, return when the person has done it."""

    def numbers(self, questions: Sequence[str]) -> list[float]:
        """Return a number that the person gives for each question."""

    def read(self, sentence: str) -> None:
        """Say what was read."""

    def refuse(self, sentence: str) -> None:
        """Say why something was not kept, or not done."""


def guide(session: Session, face: Face, simulated: SimulatedGlove | None, *, waits: bool) -> None:
    """Ask for one reading after the other, until all are there.

    *session*: which readings are there is kept in its file after each. *simulated*: the simulated person, who
    does what is asked; None: a person does. *waits*: whether a person is waited for before readings; before a
    motor moves, always.
    """
    failures, last = 0, ""
    while (asked := session.next()) is not None:
        goes_on = asked.task.is_automatic and asked.task.key == last
        is_moving = asked.task in (FREE, HELD) and simulated is None
        prompt = _prompt(session, asked, goes_on=goes_on, waits=waits or is_moving)

        def ready(part: int, asked: Asked = asked, prompt: Prompt = prompt) -> None:
            if simulated is not None:
                simulated.prepare(asked, part)
            if not prompt.goes_on:
                face.ready(part)

        last = ""
        try:
            face.begin(prompt)
            session.take(asked, ready)
        except RepeatError:
            if not session.repeat():
                face.refuse("There is no reading yet.")
        except SkipError:
            session.skip(asked.task)
        except (ArgumentError, DecaffError) as unfit:
            failures += 1
            if failures >= MOST_FAILURES:
                raise DecaffError(f"{asked.task.key}: {unfit}; {asked.task.advice}") from unfit
            face.refuse(f"This reading was not kept: {unfit}. Measure it again.")
        else:
            failures, last = 0, asked.task.key
            face.read(_what_was_read(session, asked))


def result_rows(estimates: Sequence[Estimate], truth: dict[str, float] | None) -> list[tuple[str, ...]]:
    """Return a heading, and what the readings say beside the model, and beside the truth where it is
    known.
    """
    rows = [("", "measured", "± 95 %", "model", *(("true",) if truth else ()), "readings", "")]
    for one in estimates:
        digits = _digits(one.value * one.shown, one.half_width * one.shown)
        numbers = [one.value, one.half_width, one.model, *([truth[one.key]] if truth else [])]
        cells = [f"{number * one.shown:.{digits}f}" if math.isfinite(number) else "" for number in numbers]
        if math.isfinite(one.half_width) and float(cells[1]) == 0.0:
            cells[1] = f"<{10.0**-digits:.{digits}f}"
        differs = math.isfinite(one.half_width) and not one.is_as_modelled
        note = "differs from the model" if differs else ""
        rows.append((f"{one.label} [{one.unit}]", *cells, str(one.readings), note))
    return rows


def _prompt(session: Session, asked: Asked, *, goes_on: bool, waits: bool) -> Prompt:
    task = asked.task
    again = ": the readings differ, measure again" if asked.is_again else ""
    return Prompt(
        session.bench.glove,
        f"{task.key}, {asked.agreeing + 1} of {task.repeats}{again}",
        task.parts,
        task.advice if asked.is_again else "",
        asked.bend,
        sum(min(len(session.of(each)), each.repeats) for each in session.tasks),
        sum(each.repeats for each in session.tasks),
        goes_on,
        waits,
    )


def _what_was_read(session: Session, asked: Asked) -> str:
    task = asked.task
    factor, unit = SHOWN[task.judged]
    verdict = ""
    if len(session.readings.of(task)) > 1:
        verdict = ": agrees" if len(session.of(task)) > asked.agreeing else ": differs from the others"
    return f"{factor * session.readings.all[-1][task.judged]:.6g} {unit}{verdict}"


def _digits(value: float, half_width: float) -> int:
    """Decimal places that show two digits of an uncertainty, but no more than `MOST_DIGITS` of the number."""
    if not (math.isfinite(half_width) and half_width > 0.0):
        return 3
    most = MOST_DIGITS - 1 - (math.floor(math.log10(abs(value))) if value else 0)
    return min(6, max(0, min(1 - math.floor(math.log10(half_width)), most)))
