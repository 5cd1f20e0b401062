"""Session of an experiment with a person, with drums in a thread and questions in the terminal."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import typer

from proximity.cli.device.drum_loop import DrumThread
from proximity.cli.device.motors import armable_motors
from proximity.cli.output import report
from proximity.cli.tables import Console
from proximity.decaff.glove.calibrated_glove import read_any_glove
from proximity.decaff.motors.motor_drum import home_all
from proximity.lab.experiment.design import Design
from proximity.lab.experiment.display import Presentation, intervals_of
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.experiment.plan import Text, Trial
from proximity.lab.experiment.visit import RefusedError, run_visit
from proximity.lab.simulation.simulated_press import Wall
from proximity.transport import open_subscriber


@dataclass(frozen=True, slots=True)
class Drums:
    """Options of the drums in a session."""

    address: str  # address of the service
    rate: float  # Hz
    finger: int
    gloves: list[Path]
    max_age: float | None  # maximum age of calibrations, days
    motors: list[str]  # addresses of motors, which are armed


def run_session(design: Design, folder: Path, participant: str, drums: Drums) -> str:
    """Run the remaining trials of a session. Return the reason for an early end, or ""."""
    gloves = [read_any_glove(path, drums.max_age) for path in drums.gloves]
    try:
        with ExitStack() as stack:
            motors = stack.enter_context(armable_motors(drums.motors, gloves))
            subscriber = stack.enter_context(open_subscriber(drums.address))
            display = DrumDisplay(drums.rate, drums.finger, gloves, motors)
            display.check(design)
            display.warm_up()
            home_all(motors, Event().wait, report)
            stack.callback(display.stop, "the session is over")
            stack.enter_context(DrumThread(display, subscriber, drums.rate))
            run_visit(design, folder, participant, display, Terminal())
    except RefusedError:
        return f"{participant} does not agree: no data were kept"
    except (EOFError, KeyboardInterrupt):
        return "stopped; the same command continues from there"
    return ""


class Terminal:
    """Asks a participant in the terminal.

    Ctrl-C or the end of input stops the session and retracts the drum.
    """

    def consents(self, text: str) -> bool:
        """Show the consent text. Return whether the participant agrees."""
        _print(text)
        return _chosen("  Do you agree? yes or no: ", ("yes", "no")) == "yes"

    def read(self, text: Text) -> None:
        """Show a text until Enter is pressed."""
        _print(text.text)
        if text.seconds:
            typer.echo(f"  Break of {text.seconds / 60.0:g} minutes.")
            time.sleep(text.seconds)
        input("  Enter to continue ")

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Wait until Enter is pressed before an interval.

        If the interval has a real surface, the prompt asks the experimenter to put it in place.
        """
        if interval == 0:
            typer.echo(f"\n[{trial.number + 1}]")
        is_real = intervals_of(trial)[interval].wall is Wall.REAL
        placed = "put the real surface in place, " if is_real else ""
        input(f"  {placed}Enter, then press on surface {interval + 1} ")

    def answer(self, trial: Trial, felt: Sequence[Presentation]) -> int:
        """Return the participant's answer to a trial."""
        return int(_chosen(f"  {trial.task.question or '1 or 2?'} ", ("1", "2")))

    def explain(self, why: str) -> None:
        """Show the reason why a trial ended early."""
        typer.echo(f"  This trial ended early: {why}.")


def _print(text: str) -> None:
    typer.echo("")
    Console().print(text.strip(), markup=False, highlight=False)


def _chosen(prompt: str, choices: tuple[str, ...]) -> str:
    while (text := input(prompt).strip()) not in choices:
        typer.echo(f"  expected {' or '.join(choices)}", err=True)
    return text
