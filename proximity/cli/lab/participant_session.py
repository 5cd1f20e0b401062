"""Session of an experiment with a person: the drums in a thread, and who asks in front of them.

A person is asked line by line at the terminal, or at a guided page, beside which the experimenter has a
second one with state, limits and stop.
"""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from proximity.cli.device.drum_loop import DrumsBeside
from proximity.cli.device.motors import armable_motors
from proximity.cli.output import report
from proximity.cli.tables import Console
from proximity.decaff.glove.calibrated_glove import read_any_glove
from proximity.decaff.motors.motor_drum import home_all
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design import CHOICES, Kind, Question
from proximity.lab.experiment.display import Presentation, Trial
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.experiment.plan import Text
from proximity.lab.experiment.session import (
    EMERGENCY,
    Monitor,
    RefusedError,
    Respondent,
    StoppedError,
    run_visit,
)
from proximity.lab.simulation.simulated_press import Wall
from proximity.transport import open_subscriber
from proximity.web import guided
from proximity.web.guided import Answer, Button, Field, GuidedPages, PageLeftError, Step
from proximity.web.server.access import open_in_browser

GO_ON = Button("go", "Go on", "Enter", look="main")
SEND = Button("go", "Go on", "Enter", look="main", takes_fields=True)
CONSENT_BUTTONS = (Button("agree", "I agree", look="main"), Button("refuse", "I do not agree"))
CHOICE_BUTTONS = (Button("1", "The first", "ArrowLeft"), Button("2", "The second", "ArrowRight"))
TITLES = {"consent": "Consent", "instructions": "What to do", "break": "After the break"}


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
    """Do what is left of a session; why it ended early, or nothing."""
    gloves, monitor = [read_any_glove(path, drums.max_age) for path in drums.gloves], Monitor()
    try:
        with ExitStack() as stack:
            motors = stack.enter_context(armable_motors(drums.motors, gloves))
            subscriber = stack.enter_context(open_subscriber(drums.address))
            display = DrumDisplay(drums.rate, drums.finger, gloves, motors)
            display.check(dataset.design)
            display.warm_up()
            home_all(motors, monitor.stop.wait, report)
            stack.callback(display.stop, "the session is over")
            stack.enter_context(DrumsBeside(display, subscriber, drums.rate))
            respondent: Respondent = TerminalRespondent()
            if not at_terminal:
                respondent = _open_pages(stack, dataset.design.title, display, monitor, opens_browser)
            run_visit(dataset, participant, display, respondent, monitor)
    except RefusedError:
        return f"{participant} does not agree: nothing was kept"
    except StoppedError:
        return "stopped; the same command goes on there"
    return ""


def _open_pages(
    stack: ExitStack, title: str, display: DrumDisplay, monitor: Monitor, opens_browser: bool
) -> "PageRespondent":
    def stop_everything() -> None:
        monitor.stop.set()
        display.stop(EMERGENCY)

    pages = stack.enter_context(GuidedPages(title, has_stop=True, on_stop=stop_everything))
    typer.echo(f"participant:  {pages.url}\nexperimenter: {pages.watch_url}")
    if opens_browser:
        open_in_browser(pages.url)
    return PageRespondent(pages, monitor, title)


class PageRespondent:
    """Asks a person at a page; both pages stop everything."""

    def __init__(self, pages: GuidedPages, monitor: Monitor, title: str) -> None:
        self._pages, self._monitor, self._title = pages, monitor, title
        self._surface = ""
        monitor.changed = self._show

    def read(self, text: Text) -> bool:
        """Show a text; whether the participant goes on."""
        paragraphs = "\n\n".join(" ".join(lines.split()) for lines in text.text.split("\n\n"))
        if text.seconds:
            self._answer_to(Step("Break", paragraphs, seconds=text.seconds))
        buttons = CONSENT_BUTTONS if text.name == "consent" else (GO_ON,)
        title = TITLES.get(text.name, self._title)
        return self._answer_to(Step(title, paragraphs, buttons=buttons)).button != "refuse"

    def choose(self, question: Question) -> Any:
        """Ask a question."""
        least, most = question.range
        field = Field("answer", question.text, least=least, most=most)
        if question.choices:
            field = Field("answer", question.text, choices=question.choices)
        return self._answer_to(Step("Question", fields=(field,), buttons=(SEND,))).values["answer"]

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready, then show that it is time to press."""
        name = ("First surface", "Second surface")[interval] if len(trial.intervals) > 1 else "Surface"
        is_real = trial.intervals[interval].wall is Wall.REAL
        self._surface = "put the real surface in place" if is_real else "by the drum"
        self._show()
        progress = self._progress()
        self._answer_to(Step(name, "Take the finger back, then go on.", buttons=(GO_ON,), progress=progress))
        self._pages.present(Step(name, "Press now.", progress=progress))

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial."""
        task = trial.task
        if task.kind in CHOICES:
            shown = Step(task.question or "Which?", buttons=CHOICE_BUTTONS, progress=self._progress())
            return int(self._answer_to(shown).button)
        if task.kind is not Kind.RATING:
            return None
        field = Field("answer", task.question or "How stiff?", least=0.001)
        return self._answer_to(Step("Rating", fields=(field,), buttons=(SEND,))).values["answer"]

    def explain(self, why: str) -> None:
        """Show why a trial ended early, until the participant goes on."""
        if not self._monitor.stop.is_set():
            sentence = f"{why[0].upper()}{why[1:]}."
            self._answer_to(Step("This trial ended early", sentence, buttons=(GO_ON,)))

    def _answer_to(self, step: Step) -> Answer:
        try:
            return self._pages.ask(step)
        except (guided.StoppedError, PageLeftError):
            self._monitor.stop.set()
            raise StoppedError from None

    def _progress(self) -> tuple[int, int]:
        return self._monitor.trial, self._monitor.trials

    def _show(self) -> None:
        """Show the experimenter where the session is; a participant is not shown the condition."""
        monitor = self._monitor
        watched = {
            "step": monitor.doing,
            "surface": self._surface,
            "trial": f"{monitor.trial} of {monitor.trials}",
            "left": f"{monitor.minutes_left:.0f} min",
            "largest force": f"{monitor.force:.2f} N",
            "force limit": f"{monitor.force_limit:g} N",
        }
        self._pages.show({}, watched=watched)


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

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready."""
        if interval == 0:
            typer.echo(f"\n[{trial.planned.number + 1}]")
        which = f"surface {interval + 1}" if len(trial.intervals) > 1 else "the surface"
        _line(f"  Enter, then press on {which} ")

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial."""
        kind, question = trial.task.kind, trial.task.question
        if kind in CHOICES:
            return int(_chosen(f"  {question or '1 or 2?'} ", ("1", "2")))
        if kind is not Kind.RATING:
            return None
        while not (number := _number(_line(f"  {question or 'How stiff?'} (a number above 0): "))) > 0.0:
            typer.echo("  expected a number above 0", err=True)
        return number

    def explain(self, why: str) -> None:
        """Show why a trial ended early."""
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
