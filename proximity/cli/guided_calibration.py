"""Guide through a calibration in the terminal: what to do, pictures of poses, what was read, the results."""

import math
import sys
import time
from collections.abc import Sequence

import numpy as np
import typer
from rich.text import Text

from proximity.cli.console import Console, print_fitting, table
from proximity.cli.views.pose_picture import joint_angles, pose_picture
from proximity.decaff.calibrating.instruments import DrumRecord
from proximity.decaff.calibrating.readings import Asked
from proximity.decaff.calibrating.results import Estimate, Session
from proximity.decaff.calibrating.simulated_glove import SimulatedGlove
from proximity.decaff.glove.glove import Glove
from proximity.errors import DecaffError
from proximity.message import GLOVE_POSES
from proximity.service.inputs.reception import Reception

MOST_FAILURES = 10  # readings of one task in a row that cannot be right
LISTENING_S, SILENCE_S, LOOK_S = 0.2, 5.0, 0.005
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
    """There is no more input to answer with."""


class TypedGlove:
    """Instruments that a person reads: each number is typed.

    Parameters
    ----------
    finger : int
        Of the service's, whose counts an address is listened to for.
    address : str
        Where `GLOVE_POSES` messages bring the counts; None: they are typed, too.
    """

    rate = 0.0  # Hz: nobody types a chirp

    def __init__(self, address: str | None, finger: int) -> None:
        self._finger = finger
        self._reception = None if address is None else Reception(address, [GLOVE_POSES], is_timed=False)

    def counts(self) -> np.ndarray:
        """Return counts that were typed, or those that come for a moment from now on."""
        if self._reception is None:
            return np.array([asked_number("  counts of the potentiometer: ")])
        for _ in self._reception.messages():
            pass  # what came before the hand was still
        found: list[float] = []
        started = time.monotonic()
        ends = started + LISTENING_S
        while time.monotonic() < ends or not found:
            if time.monotonic() > started + SILENCE_S:
                raise DecaffError(
                    f"{self._reception.address}: no counts of finger {self._finger} for {SILENCE_S:g} s: "
                    "does the glove send glove_poses there?"
                )
            for _, records, _ in self._reception.messages():
                counts = records["counts"][records["finger"] == self._finger]
                found += counts[np.isfinite(counts)].tolist()
            time.sleep(LOOK_S)
        return np.array(found)

    def latency(self) -> tuple[float, float]:
        """Return the latency that a person measured."""
        return (
            1e-3 * asked_number("  latency of the glove that a step test finds, in ms: "),
            1e-3 * asked_number("  time between its samples, in ms: "),
        )

    def angle(self) -> float:
        """Return the drum's angle that a person reads."""
        return asked_number("  angle of the drum's encoder, in radians: ")

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Refuse: only a motor swings a drum."""
        raise DecaffError("nobody types a chirp, expected a motor")


def asked_number(question: str) -> float:
    """Return a number that is typed; what is none is asked again."""
    while True:
        text = _answer(question)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        typer.echo(f"  {text!r} is no number, expected one as 31072 or 1.178", err=True)


def guide(session: Session, glove: SimulatedGlove | None, *, waits: bool) -> None:
    """Ask for one reading after the other, until all are there.

    Parameters
    ----------
    session : Session
        Which readings are there is kept in its file after each.
    glove : SimulatedGlove
        The simulated person, who does what is asked; None: a person does.
    waits : bool
        Whether Enter is waited for before a reading.

    Raises
    ------
    UnfinishedError
        If the input ends.
    """
    bend_shown: float | None = None
    failures, last = 0, ""
    while (asked := session.next()) is not None:
        goes_on = asked.task.is_automatic and asked.task.key == last
        if not goes_on:
            _print_heading(session, asked)
        if asked.bend is not None and asked.bend != bend_shown:
            _print_pose(session.bench.glove, asked.bend)
        bend_shown, last = asked.bend, asked.task.key

        def ready(part: int, asked: Asked = asked, goes_on: bool = goes_on) -> None:
            if not goes_on:
                typer.echo(f"  {asked.task.parts[part]}")
                if waits:
                    _answer("  Enter when you are there ")
            if glove is not None:
                glove.prepare(asked, part)

        try:
            session.take(asked, ready)
            failures = 0
        except DecaffError as unfit:
            failures += 1
            if failures >= MOST_FAILURES:
                raise DecaffError(f"{asked.task.key}: {unfit}; {asked.task.advice}") from unfit
            typer.echo(f"  not kept: {unfit}. Once more.", err=True)
            last = ""
            continue
        _print_reading(session, asked)


def print_results(estimates: Sequence[Estimate], truth: dict[str, float] | None) -> None:
    """Print what the readings say beside the model, and what is true where that is known.

    Parameters
    ----------
    estimates : sequence of Estimate
        So far.
    truth : dict
        By their keys; None: nobody knows.
    """
    shown = table(("",), ("measured", "± 95 %", "model", *(("true",) if truth else ()), "n"))
    shown.add_column("")
    for one in estimates:
        digits = _digits(one.half_width * one.shown)
        numbers = [one.value, one.half_width, one.model, *([truth[one.key]] if truth else [])]
        cells = [f"{number * one.shown:.{digits}f}" if math.isfinite(number) else "" for number in numbers]
        differs = math.isfinite(one.half_width) and not one.is_as_modelled
        note = Text("not the model's", "yellow") if differs else Text("")
        shown.add_row(f"{one.label} [{one.unit}]".replace("[", "\\["), *cells, str(one.readings), note)
    print_fitting(Console(), [lambda: shown])


def _print_heading(session: Session, asked: Asked) -> None:
    done = sum(min(len(session.of(task)), task.repeats) for task in session.tasks)
    total = sum(task.repeats for task in session.tasks)
    task = asked.task
    again = ": readings differ, once more" if asked.is_again else ""
    typer.echo("")
    typer.secho(
        f"[{done + 1} of {total}] {task.key}, {asked.agreeing + 1} of {task.repeats}{again}", bold=True
    )
    if asked.is_again:
        typer.echo(f"  If that goes on: {task.advice}.")


def _print_pose(glove: Glove, bend: float) -> None:
    typer.echo(f"  bend {bend:.3f}: {joint_angles(glove, bend)}")
    try:
        "\u28ff".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return  # letters that this terminal does not have
    for line in pose_picture(glove, bend):
        typer.echo(f"    {line}")


def _print_reading(session: Session, asked: Asked) -> None:
    task = asked.task
    factor, unit = SHOWN[task.judged]
    verdict = ""
    if len(session.readings.of(task)) > 1:
        verdict = ": agrees" if len(session.of(task)) > asked.agreeing else ": differs from the others"
    typer.echo(f"  read: {factor * session.readings.all[-1][task.judged]:.6g} {unit}{verdict}")


def _answer(question: str) -> str:
    try:
        return input(question).strip()
    except EOFError:
        typer.echo("")
        raise UnfinishedError from None


def _digits(half_width: float) -> int:
    """Decimal places that show two digits of an uncertainty."""
    if not (math.isfinite(half_width) and half_width > 0.0):
        return 3
    return min(6, max(0, 1 - math.floor(math.log10(half_width))))
