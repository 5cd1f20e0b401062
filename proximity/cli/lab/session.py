"""Session of an experiment with a person, on a page or at the terminal: drums in a thread, and who asks."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from proximity.cli.device.drum_loop import DrumsBeside
from proximity.cli.device.motors import armable_motors
from proximity.cli.lab.participant_page import PageRespondent, stop_everything
from proximity.cli.output import report
from proximity.cli.tables import Console
from proximity.decaff.glove.glove_set import read_any_glove
from proximity.decaff.motors.motor_set import home_all
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design import CHOICES, Kind, Question
from proximity.lab.experiment.display import Presentation
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.experiment.plan import Text
from proximity.lab.experiment.session import Trial
from proximity.lab.experiment.visit import Monitor, RefusedError, StoppedError, run_visit
from proximity.transport import open_subscriber
from proximity.web.guided import GuidedPages
from proximity.web.server.browser import open_in_browser


@dataclass(frozen=True, slots=True)
class Drums:
    """The drums that a session needs."""

    address: str  # of the service
    rate: float  # Hz
    finger: int
    gloves: list[Path]
    max_age: float | None  # days
    motors: list[str]  # addresses; they are armed


def run_session(
    dataset: Dataset, participant: str, drums: Drums, *, at_terminal: bool, opens_browser: bool = False
) -> str:
    """Do what is left of a session.

    *opens_browser*: whether the page is opened in a browser of this machine.
    """
    gloves, monitor = [read_any_glove(path, drums.max_age) for path in drums.gloves], Monitor()
    with armable_motors(drums.motors, gloves) as motors, open_subscriber(drums.address) as subscriber:
        display = DrumDisplay(drums.rate, drums.finger, gloves, motors)
        display.check(dataset.design)
        display.warm_up()
        home_all(motors, monitor.stop.wait, report)
        try:
            with DrumsBeside(display, subscriber, drums.rate):
                if at_terminal:
                    run_visit(dataset, participant, display, TerminalRespondent(), monitor)
                else:
                    _sit_at_page(dataset, participant, display, monitor, opens_browser)
        except RefusedError:
            return f"{participant} does not agree: nothing was kept"
        except StoppedError:
            return "stopped; the same command goes on there"
        finally:
            display.stop("the session is over")
    return ""


def _sit_at_page(
    dataset: Dataset, participant: str, display: DrumDisplay, monitor: Monitor, opens_browser: bool
) -> None:
    title = dataset.design.title
    with GuidedPages(title, has_stop=True, on_stop=lambda: stop_everything(monitor, display)) as pages:
        typer.echo(f"participant:  {pages.url}")
        typer.echo(f"experimenter: {pages.watch_url}")
        if opens_browser:
            open_in_browser(pages.url)
        run_visit(dataset, participant, display, PageRespondent(pages, monitor, title), monitor)


class TerminalRespondent:
    """Asks a person at the terminal; Ctrl-C and the end of input stop the visit."""

    def read(self, text: Text) -> bool:
        """Show a text; whether the participant goes on."""
        typer.echo("")
        Console().print(text.text.strip(), markup=False, highlight=False)
        if text.seconds:
            typer.echo(f"  Break of {text.seconds / 60.0:g} minutes.")
            time.sleep(text.seconds)
        if text.name != "consent":
            _line("  Enter to go on ")
            return True
        return _chosen("  Do you agree? yes or no: ", ("yes", "no")) == "yes"

    def choose(self, question: Question) -> Any:
        """Ask a question until the answer fits."""
        while True:
            text = _line(f"{question.text} ({question.expected}): ")
            answer: Any = text if question.choices else _number(text)
            if question.fits(answer):
                return answer
            typer.echo(f"  expected {question.expected}", err=True)

    def begin(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready."""
        if interval == 0:
            typer.echo(f"\n[{trial.planned.number + 1}]")
        which = f"surface {interval + 1}" if len(trial.intervals) > 1 else "the surface"
        _line(f"  Enter, then press on {which} ")

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial."""
        kind, question = trial.kind, trial.question
        if kind in CHOICES:
            return int(_chosen(f"  {question or '1 or 2?'} ", ("1", "2")))
        if kind is not Kind.RATING:
            return None
        while not (number := _number(_line(f"  {question or 'How stiff?'} (a number above 0): "))) > 0.0:
            typer.echo("  expected a number above 0", err=True)
        return number

    def explain(self, why: str) -> None:
        """Say that a trial ended early."""
        typer.echo(f"  This trial ended early: {why}.")


def _chosen(prompt: str, choices: tuple[str, ...]) -> str:
    while (text := _line(prompt)) not in choices:
        typer.echo(f"  expected {' or '.join(choices)}", err=True)
    return text


def _number(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return float("nan")


def _line(prompt: str) -> str:
    try:
        return input(prompt).strip()
    except (EOFError, KeyboardInterrupt):
        typer.echo("")
        raise StoppedError from None
