"""Output of commands: JSON documents for programs, numbers, words and labelled lines for people.

What a command found is nested values, in people's units: JSON is these, and the text is made of them. nan and
infinity become null in JSON, which has no word for them.
"""

import io
import json
import math
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    import numpy as np

DIGITS = 15
"""Significant decimal digits that every float64 keeps; the two behind them are rounding of the conversion."""
WIDTH, LABEL_WIDTH = 100, 15  # columns where no terminal says how many, and of labels
MM_PER_M = 1e3
MISSING = "-"
STDOUT = Path("-")
FEW_DIGITS = 6  # significant, of numbers that a reader only looks over
NO_LENGTH = 1e-12
"""Of any unit: what is smaller is rounding of lengths that people have."""


def write_document(result: Any, *, indent: int | None = 1) -> None:
    """Write one JSON document to stdout at once: somebody may wait for it."""
    sys.stdout.write(json.dumps(plain(result), allow_nan=False, indent=indent) + "\n")
    sys.stdout.flush()


@contextmanager
def text_output(path: Path) -> Iterator[TextIO]:
    """Give a stream for the text of a file, which is replaced at the end; ``-`` is standard output."""
    if path == STDOUT:
        yield sys.stdout
        return
    from proximity.system.whole_file import whole_file

    with whole_file(path) as stream, io.TextIOWrapper(stream, encoding="utf-8", newline="") as text:
        yield text


def plain(value: Any) -> Any:
    """Return *value* with None for every float that JSON has no word for."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def print_block(rows: Iterable[tuple[str, str]]) -> None:
    """Print labels and values, one pair a line; what is longer than a line goes on below its value."""
    most = shutil.get_terminal_size((WIDTH, 1)).columns - LABEL_WIDTH - 1
    for label, value in rows:
        first, *more = _wrap(printable(value), most)
        lines = "\n".join([first, *(" " * (LABEL_WIDTH + 1) + part for part in more)])
        if sys.stdout.isatty():
            typer.echo(typer.style(f"{label:<{LABEL_WIDTH}} ", bold=True) + lines)
        else:
            sys.stdout.write(f"{label:<{LABEL_WIDTH}} {lines}\n")


def _wrap(text: str, most: int) -> list[str]:
    """Lines of a text; what fits into one is left as it is."""
    if len(text) <= most:
        return [text]
    return textwrap.wrap(text, max(most, 1), break_long_words=False, break_on_hyphens=False) or [""]


def number(value: float, digits: int = 9) -> str:
    """Return *value* with so many significant digits, and zero without a sign.

    *digits*: how many; zeros at the end are left out.
    """
    return f"{value + 0.0:.{digits}g}"


def short(*values: float) -> str:
    """Return numbers with four digits each."""
    return "  ".join(number(value, 4) for value in values)


def length(value: float, digits: int = 9) -> str:
    """Return a length as `number`; one that is rounding is zero."""
    return number(0.0 if abs(value) < NO_LENGTH else value, digits)


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun; *plural*: where an s is not enough."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def printable(text: str) -> str:
    """Return *text* with what could move a terminal's cursor replaced."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def report(sentence: str) -> None:
    """Print a sentence on stderr as one line that names the program."""
    typer.echo(f"proximity: {printable(' '.join(sentence.split()))}", err=True)


def in_units(lengths: "np.ndarray", metres: float, *points: "np.ndarray") -> "np.ndarray":
    """Return *lengths* in the unit, rounded to 15 significant digits; zero has no sign, nan and inf stay.

    *lengths*: (N, ...) m; also areas or volumes, with the power of *metres* that fits them. *points*: (N, 3)
    m, between which the lengths are distances: digits count from the largest coordinate of a row. From -11 to
    -10 the distance is 1, where the difference alone would give 0.999999999999999.
    """
    import numpy as np

    with np.errstate(over="ignore", invalid="ignore"):
        values = np.asarray(lengths, dtype=np.float64) / metres
        sizes = np.abs(values)
        for ends in points:
            sizes = np.fmax(sizes, np.fmax.reduce(np.abs(ends), axis=1) / metres)
        is_plain = (sizes > 1e-7) & (sizes < 1e36)  # so that both powers of ten below are exact
        exponents = np.floor(np.log10(np.where(is_plain, sizes, 1.0))).astype(np.intp)
        shifts = DIGITS - 1 - exponents
        powers = np.array([10.0**exponent for exponent in range(23)])  # float64 holds these exactly
        up, down = powers[np.maximum(shifts, 0)], powers[np.maximum(-shifts, 0)]
        result = np.rint(values * up / down) * down / up + 0.0  # -0.0 + 0.0 is 0.0
    is_extreme = ~is_plain & np.isfinite(values) & (values != 0.0)
    if is_extreme.any():
        result[is_extreme] = [float(f"{value:.{DIGITS}g}") for value in values[is_extreme].tolist()]
    return result


def in_unit(length: float, metres: float) -> float:
    """Return one length in the unit, as `in_units`."""
    return float(in_units([length], metres)[0])  # type: ignore[arg-type]
