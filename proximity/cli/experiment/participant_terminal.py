"""A participant at a terminal: texts, questions and answers of an experiment, line by line."""

import time
from typing import Any

import typer

from proximity.cli.console import Console
from proximity.lab.experiment.conduct import StoppedError
from proximity.lab.experiment.design import CHOICES, Kind, Question
from proximity.lab.experiment.display import Presentation
from proximity.lab.experiment.plan import Text
from proximity.lab.experiment.session import Trial


class TerminalRespondent:
    """Asks a person at the terminal; Ctrl-C and the end of input stop the sitting."""

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
