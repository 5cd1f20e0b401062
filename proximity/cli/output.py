"""Output of commands: JSON documents for programs, numbers, words and labelled lines for people.

What a command found is nested values, in people's units: JSON is these, and a table of labels and templates
makes the text of them. nan and infinity become null in JSON, which has no word for them.
"""

import json
import math
import string
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import typer

MISSING = "-"
FEW_DIGITS = 6  # significant, of numbers that a reader only looks over
NO_LENGTH = 1e-12
"""Of any unit: what is smaller is rounding of lengths that people have."""
Lines = list[tuple[str, str]]
SHORT_DIGITS = 4


def write_document(result: Any, *, indent: int | None = 1) -> None:
    """Write one JSON document to stdout at once: somebody may wait for it."""
    sys.stdout.write(json.dumps(plain(result), allow_nan=False, indent=indent) + "\n")
    sys.stdout.flush()


def plain(value: Any) -> Any:
    """Return *value* with None for every float that JSON has no word for."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def print_block(lines: Iterable[tuple[str, str]]) -> None:
    """Print labels and values, one pair a line."""
    for label, value in lines:
        if sys.stdout.isatty():
            typer.echo(typer.style(f"{label:<15} ", bold=True) + printable(value))
        else:
            sys.stdout.write(f"{label:<15} {printable(value)}\n")


def block(templates: Iterable[tuple[str, str]], values: dict[str, Any]) -> Lines:
    """Return labels with their templates filled in."""
    return [(label, filled(template, values)) for label, template in templates]


def filled(template: str, values: dict[str, Any]) -> str:
    """Return *template* with what stands in braces taken from nested *values*, as ``{ticks.count:n}``.

    Formats of our own: ``n`` nine significant digits, ``s`` four, also of several numbers; ``us`` nanoseconds
    in microseconds; ``1/part`` a count with the word for it. Others are Python's.
    """
    return _Words().vformat(template, (), values)


class _Words(string.Formatter):
    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Any) -> Any:
        """Return the value that dots lead to."""
        value = kwargs
        for key in field_name.split("."):
            value = value[int(key) if isinstance(value, list | tuple) else key]
        return value, field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return a value as `filled` says."""
        if format_spec == "n":
            return number(value)
        if format_spec == "s":
            several = value if isinstance(value, list | tuple) else [value]
            return "  ".join(number(each, SHORT_DIGITS) for each in several)
        if format_spec.startswith("1/"):
            return counted(value, format_spec[2:])
        if format_spec == "us":
            return f"{value / 1e3:.1f}"
        return super().format_field(value, format_spec)


def number(value: float, digits: int = 9) -> str:
    """Return *value* with so many significant digits, and zero without a sign.

    *digits*: how many; zeros at the end are left out.
    """
    return f"{value + 0.0:.{digits}g}"


def length(value: float, digits: int = 9) -> str:
    """Return a length as `number`; one that is rounding is zero."""
    return number(0.0 if abs(value) < NO_LENGTH else value, digits)


def counted(count: int, what: str) -> str:
    """Return a number with what it counts."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def printable(text: str) -> str:
    """Return *text* with what could move a terminal's cursor replaced."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def side(signed_distance: float, is_signed: bool) -> str | None:
    """Return on which side of the surface a point is, in a word; None where there is no answer."""
    if math.isnan(signed_distance):
        return None
    if signed_distance == 0.0:
        return "surface"
    if not is_signed:
        return "unknown"
    return "inside" if signed_distance < 0.0 else "outside"


def report(sentence: str) -> None:
    """Print a sentence on stderr as one line that names the program."""
    typer.echo(f"proximity: {printable(' '.join(sentence.split()))}", err=True)
