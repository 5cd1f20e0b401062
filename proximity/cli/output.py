"""Output of commands, as JSON documents for programs or as numbers and labelled lines for people.

The result of a command is a tree of values in the user's units, which is written as JSON or formatted as
text. nan and infinity become null in JSON.
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
"""Number of significant decimal digits that every float64 keeps. The next two are rounding errors of the
conversion."""
WIDTH, LABEL_WIDTH = 100, 15  # width in columns without a terminal, and width of labels
MM_PER_M = 1e3
NEGLIGIBLE = 2e-7  # m
"""Deviation from CAD surfaces that is not reported: the rounding of positions in STEP files."""
MISSING = "-"
STDOUT = Path("-")
FEW_DIGITS = 6  # number of significant digits in summaries
NO_LENGTH = 1e-12
"""Maximum rounding error of a length in any unit."""


def at_most(value: float, digits: int = 2) -> str:
    """Return a positive number rounded up to *digits* significant digits."""
    if not 0.0 < value < math.inf:
        return length(value)
    step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
    return length(math.ceil(value / step) * step, digits + 1)


def write_document(result: Any, *, indent: int | None = 1) -> None:
    """Write a JSON document to stdout and flush it."""
    sys.stdout.write(json.dumps(plain(result), allow_nan=False, indent=indent) + "\n")
    sys.stdout.flush()


@contextmanager
def text_output(path: Path) -> Iterator[TextIO]:
    """Open a text stream that replaces a file at the end of the block. ``-`` is standard output."""
    if path == STDOUT:
        yield sys.stdout
        return
    from proximity.system.whole_file import whole_file

    with whole_file(path) as stream, io.TextIOWrapper(stream, encoding="utf-8", newline="") as text:
        yield text


def plain(value: Any) -> Any:
    """Return *value* in which nan and infinity are replaced by None, since JSON lacks them."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def print_block(rows: Iterable[tuple[str, str]]) -> None:
    """Print labels and values, one pair per line. Long values are wrapped and aligned."""
    width = shutil.get_terminal_size((WIDTH, 1)).columns - LABEL_WIDTH - 1
    for label, value in rows:
        first, *more = _wrap(printable(value), width)
        lines = "\n".join([first, *(" " * (LABEL_WIDTH + 1) + part for part in more)])
        if sys.stdout.isatty():
            typer.echo(typer.style(f"{label:<{LABEL_WIDTH}} ", bold=True) + lines)
        else:
            sys.stdout.write(f"{label:<{LABEL_WIDTH}} {lines}\n")


def _wrap(text: str, width: int) -> list[str]:
    """Return the lines of a text. A text that fits one line is unchanged."""
    if len(text) <= width:
        return [text]
    return textwrap.wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]


def number(value: float, digits: int = 9) -> str:
    """Return *value* with *digits* significant digits as text.

    It has no trailing zeros, and zero has no sign.
    """
    return f"{value + 0.0:.{digits}g}"


def short(*values: float) -> str:
    """Return numbers as text with four significant digits."""
    return "  ".join(number(value, 4) for value in values)


def length(value: float, digits: int = 9) -> str:
    """Return a length as text like `number`, with rounding errors as zero."""
    return number(0.0 if abs(value) < NO_LENGTH else value, digits)


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return a count and its noun, such as "2 parts". *plural*: irregular plural of the noun."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def printable(text: str) -> str:
    """Return *text* in which unprintable characters are replaced.

    They could move the cursor of a terminal.
    """
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def report(sentence: str) -> None:
    """Print a sentence on stderr as one line that names the program."""
    typer.echo(f"proximity: {printable(' '.join(sentence.split()))}", err=True)


def in_units(lengths: "np.ndarray", metres: float, *points: "np.ndarray") -> "np.ndarray":
    """Convert lengths to a unit and round them to 15 significant digits.

    Zero has no sign; nan and infinities are unchanged. *lengths*: (N, ...) m, or areas or volumes with the
    corresponding power of *metres*. *points*: (N, 3) m, ends of the distances *lengths*. Digits then count
    from the largest coordinate of a row. For example, the distance from -11 to -10 is 1, while the difference
    alone would give 0.999999999999999.
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
    """Convert one length to a unit, like `in_units`."""
    return float(in_units([length], metres)[0])  # type: ignore[arg-type]
