"""Run a calibration in the terminal, with instructions, readings and results."""

import math
from collections.abc import Sequence

import typer
from rich.text import Text

from proximity.cli.device.guide import Prompt, RepeatError, SkipError, UnfinishedError
from proximity.cli.tables import Console, table

HINT = "Type r to repeat the last reading, s to skip the task. Ctrl-C stops and keeps all readings."


class Terminal:
    """Prints the prompts of a calibration and reads the input."""

    def __init__(self) -> None:
        self._bend: float | None = None  # bend that was shown last
        self._prompt: Prompt | None = None

    def begin(self, prompt: Prompt) -> None:
        """Print the heading and the pose of a prompt, unless they were printed before."""
        if self._prompt is None:
            typer.echo(HINT)
        self._prompt = prompt
        if not prompt.is_automatic:
            typer.echo("")
            typer.secho(f"[{prompt.done + 1} of {prompt.total}] {prompt.title}", bold=True)
            if prompt.advice:
                typer.echo(f"  If this happens again: {prompt.advice}.")
        if prompt.bend is not None and prompt.bend != self._bend:
            typer.echo(f"  bend {prompt.bend:.3f}: {prompt.joint_angles()}")
        self._bend = prompt.bend

    def ready(self, part: int) -> None:
        """Print an instruction. If the prompt waits, return when Enter is pressed."""
        assert self._prompt is not None, "a prompt begins first"
        typer.echo(f"  {self._prompt.parts[part]}")
        if self._prompt.waits:
            _answer("  Press Enter when you are ready ")

    def numbers(self, questions: Sequence[str]) -> list[float]:
        """Return typed numbers. A question is repeated until the input is a number."""
        return [_asked_number(f"  {question}: ") for question in questions]

    def read(self, sentence: str) -> None:
        """Print a reading."""
        typer.echo(f"  read: {sentence}")

    def refuse(self, sentence: str) -> None:
        """Print an error."""
        typer.echo(f"  {sentence}", err=True)


def print_results(rows: Sequence[tuple[str, ...]]) -> None:
    """Print a table of results."""
    shown = table(rows[0][:1], rows[0][1:-1])
    shown.add_column("")
    for row in rows[1:]:
        shown.add_row(row[0].replace("[", "\\["), *row[1:-1], Text(row[-1], "yellow"))
    Console().print(shown)


def _asked_number(question: str) -> float:
    while True:
        text = _answer(question)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        typer.echo(f"  {text!r} is not a number, expected one such as 31072 or 1.178", err=True)


def _answer(question: str) -> str:
    try:
        text = input(question).strip()
    except EOFError:
        typer.echo("")
        raise UnfinishedError from None
    if text.lower() == "r":
        raise RepeatError
    if text.lower() == "s":
        raise SkipError
    return text
