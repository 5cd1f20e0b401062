"""Guide through a calibration, whose steps a `Face` shows in their order."""

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

MAX_FAILURES = 10  # successive invalid readings of a task
MAX_DIGITS = 5  # digits of a number: the step of a simulated encoder repeats to eight
SHOWN = {  # factor and unit of the quantity that is compared between repeats
    "counts": (1.0, "counts"),
    "backlash": (1e6, "µm of backlash"),
    "compliance": (1e6, "µm/N of stretch"),
    "offset": (1e3, "mrad off the model's touch"),
    "latency": (1e3, "ms"),
    "inertia": (1e6, "kg mm²"),
    "stiffness": (1.0, "N m/rad"),
}


class UnfinishedError(Exception):
    """Raised when the user stops or the input ends. The message may state the reason."""


class RepeatError(Exception):
    """Raised to repeat the last reading."""


class SkipError(Exception):
    """Raised to skip the current task."""


@dataclass(frozen=True, slots=True, eq=False)
class Prompt:
    """Prompt that instructs the user to take one reading."""

    glove: Glove
    title: str
    parts: tuple[str, ...]  # instruction before each number
    advice: str  # "" unless the readings differ
    bend: float | None  # bend of the finger
    done: int
    total: int
    is_automatic: bool  # whether the reading repeats without instructions
    waits: bool  # whether to wait for Enter before a reading

    def joint_angles(self) -> str:
        """Return the angles of the three joints at the bend of the prompt, in words."""
        flexions = self.glove.finger.flexions
        knuckle, middle, last = (round(math.degrees((self.bend or 0.0) * each)) for each in flexions)
        return f"knuckle {knuckle}°, middle joint {middle}°, last joint {last}°"


class Face(Protocol):
    """User interface of the guide.

    Methods that wait for input raise `UnfinishedError`, `RepeatError` and `SkipError`.
    """

    def begin(self, prompt: Prompt) -> None:
        """Show the next prompt."""

    def ready(self, part: int) -> None:
        """Show the instruction with number *part*. If the prompt waits, return when the user is ready."""

    def numbers(self, questions: Sequence[str]) -> list[float]:
        """Return the user's answers to the questions, one number each."""

    def read(self, sentence: str) -> None:
        """Show a reading."""

    def refuse(self, sentence: str) -> None:
        """Show the reason for a rejected reading or action."""


def guide(session: Session, face: Face, simulated: SimulatedGlove | None, *, waits: bool) -> None:
    """Prompt for readings until all are complete.

    *session*: saved after each reading. *simulated*: glove that follows the instructions instead of a person;
    None if there is a person. *waits*: whether to wait for Enter before readings. The guide always waits
    before a motor moves.
    """
    failures, last = 0, ""
    while (asked := session.next()) is not None:
        is_automatic = asked.task.is_automatic and asked.task.key == last
        is_moving = asked.task in (FREE, HELD) and simulated is None
        prompt = _prompt(session, asked, is_automatic=is_automatic, waits=waits or is_moving)

        def ready(part: int, asked: Asked = asked, prompt: Prompt = prompt) -> None:
            if simulated is not None:
                simulated.prepare(asked, part)
            if not prompt.is_automatic:
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
        except (ArgumentError, DecaffError) as invalid:
            failures += 1
            if failures >= MAX_FAILURES:
                raise DecaffError(f"{asked.task.key}: {invalid}; {asked.task.advice}") from invalid
            face.refuse(f"This reading was rejected: {invalid}. Measure it again.")
        else:
            failures, last = 0, asked.task.key
            face.read(_what_was_read(session, asked))


def result_rows(estimates: Sequence[Estimate], truth: dict[str, float] | None) -> list[tuple[str, ...]]:
    """Return the results as rows below a heading.

    They include the values of the model, and the true values if known.
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


def _prompt(session: Session, asked: Asked, *, is_automatic: bool, waits: bool) -> Prompt:
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
        is_automatic,
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
    """Return the number of decimal places that shows two digits of an uncertainty.

    The number itself has at most `MAX_DIGITS` digits.
    """
    if not (math.isfinite(half_width) and half_width > 0.0):
        return 3
    places = MAX_DIGITS - 1 - (math.floor(math.log10(abs(value))) if value else 0)
    return min(6, max(0, min(1 - math.floor(math.log10(half_width)), places)))
