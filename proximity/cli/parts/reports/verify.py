"""Verdicts on requirements as text, CSV, JSON, JUnit XML and a page. `FIELDS` defines all fields."""

import csv
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import typer

import proximity
from proximity.cli.output import counted, in_unit, length, printable, text_output
from proximity.cli.parts.reports.scan import TEMPLATE
from proximity.cli.tables import Column, print_fitting, results_console
from proximity.formats import metres_per_unit
from proximity.requirements.measurements import KINDS
from proximity.requirements.records import Verdict, Verification, VerifiedPair, VerifiedRequirement
from proximity.system.extras import needed
from proximity.system.table_text import table_text
from proximity.system.whole_file import whole_file

DIGITS = 6
DISPENSABLE = ("to", "from", "pairs", "position", "second", "first")
"""Columns that are omitted in this order until the table fits the terminal."""
STYLES = {Verdict.HOLDS: "green", Verdict.VIOLATED: "red", Verdict.UNDECIDED: "yellow"}
OUTCOMES = {Verdict.HOLDS: "Passed", Verdict.VIOLATED: "Failed", Verdict.UNDECIDED: "Undecided"}
MANY = {Verdict.HOLDS: "hold", Verdict.VIOLATED: "are violated", Verdict.UNDECIDED: "cannot be decided"}
Pair = tuple[VerifiedRequirement, VerifiedPair]


class Field(NamedTuple):
    """Field of a pair in CSV and JSON; in tables if it has a title."""

    value: Callable[[VerifiedRequirement, VerifiedPair], Any]
    title: str = ""
    is_length: bool = False  # m; in the user's unit in all outputs


FIELDS = {
    "requirement": Field(lambda whole, _: whole.name, "requirement"),
    "verdict": Field(lambda _, pair: str(pair.verdict), "verdict"),
    "kind": Field(lambda whole, _: whole.kind, "kind"),
    "least": Field(lambda whole, _: _finite(whole.limits.least), "least", is_length=True),
    "lower": Field(lambda _, pair: pair.lower, "lower", is_length=True),
    "upper": Field(lambda _, pair: pair.upper, "upper", is_length=True),
    "greatest": Field(lambda whole, _: _finite(whole.limits.greatest), "greatest", is_length=True),
    "deviation": Field(lambda _, pair: pair.deviation, is_length=True),
    "first": Field(lambda _, pair: pair.first, "first"),
    "second": Field(lambda _, pair: pair.second, "second"),
    "position": Field(lambda _, pair: pair.position, "at"),
    "position_unit": Field(lambda whole, _: whole.unit),
    "pairs": Field(lambda whole, _: len(whole.pairs), "pairs"),
    "seconds": Field(lambda whole, _: round(whole.seconds, 6), "time [s]"),
    "from": Field(lambda _, pair: pair.point_on_first.tolist(), "from", is_length=True),
    "to": Field(lambda _, pair: pair.point_on_second.tolist(), "to", is_length=True),
    "reason": Field(lambda _, pair: pair.reason, "reason"),
    "step_tolerance": Field(lambda _, pair: pair.tolerance, is_length=True),
}
"""Fields of a pair, in the order of the columns."""


def _finite(limit: float) -> float | None:
    return limit if math.isfinite(limit) else None


def _row(pair: Pair, units: str) -> dict[str, Any]:
    """Return the fields of a pair in the user's unit."""
    metres, row = metres_per_unit(units), {}
    for name, field in FIELDS.items():
        value = field.value(*pair)
        if field.is_length and value is not None:
            is_point = isinstance(value, list)
            value = [in_unit(each, metres) for each in value] if is_point else in_unit(value, metres)
        row[name] = value
    return row


def _deciding(found: Verification) -> list[Pair]:
    return [(each, each.pairs[0]) for each in found.requirements]


def _all_pairs(found: Verification) -> list[Pair]:
    return [(each, pair) for each in found.requirements for pair in each.pairs]


def document(found: Verification, differences: tuple[str, ...] | None) -> dict[str, Any]:
    """Return the document for JSON."""
    checked = None if differences is None else {"is_confirmed": not differences, "differences": differences}
    return {
        "file": found.path,
        "verdict": str(found.verdict),
        "units": found.units,
        "settings": dict(found.settings),
        "files": dict(found.files),
        "geometry": found.geometry,
        "notes": found.notes,
        "seconds": found.seconds,
        "receipt": checked,
        "requirements": [
            {"name": each.name, "verdict": str(each.verdict), "allowed_pairs": each.allowed_count}
            for each in found.requirements
        ],
        "pairs": [_row(pair, found.units) for pair in _all_pairs(found)],
    }


def write_csv(path: Path, found: Verification) -> None:
    """Write a line for each pair. Columns of lengths end in the unit."""
    with text_output(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        for number, pair in enumerate(_all_pairs(found)):
            cells = {}
            for name, value in _row(pair, found.units).items():
                ending = f"_{found.units}" if FIELDS[name].is_length else ""
                for axis, each in (
                    zip("xyz", value, strict=True) if isinstance(value, list) else [("", value)]
                ):
                    cells["_".join(filter(None, (name, axis))) + ending] = "" if each is None else each
            if not number:
                writer.writerow(cells)
            writer.writerow(map(table_text, cells.values()))


def sentence(found: Verification) -> str:
    """Return the number of requirements with each verdict as a sentence."""
    counts = found.counts().items()
    words = [f"{count} {verdict if count == 1 else MANY[verdict]}" for verdict, count in counts if count]
    return f"{counted(len(found.requirements), 'requirement')}: {', '.join(words)}."


def _cell(value: Any) -> str:
    """Return a value as text of a table."""
    if isinstance(value, float):
        return length(value, DIGITS)
    if isinstance(value, list):
        return "  ".join(map(_cell, value))
    return "" if value is None else printable(str(value))


def _columns(pairs: Iterable[Pair], units: str, left_out: tuple[str, ...]) -> list[Column]:
    """Return the columns of a table of pairs, without empty ones."""
    rows = [_row(pair, units) for pair in pairs]
    columns = []
    for name, field in FIELDS.items():
        cells = [_cell(row[name]) for row in rows]
        if name == "position":
            cells = [
                f"{cell} {row['position_unit']}" if cell else ""
                for cell, row in zip(cells, rows, strict=True)
            ]
        if field.title and name not in left_out and any(cells):
            is_right = field.is_length or name in ("pairs", "seconds")
            title = f"{field.title} [{units}]" if field.is_length else field.title
            columns.append(Column(name, title, is_right, cells))
    return columns


def print_text(found: Verification) -> None:
    """Print a table of the pairs that decide, the reasons of undecided verdicts, and their numbers."""
    from rich.text import Text

    console, pairs = results_console(), _deciding(found)
    columns = _columns(pairs, found.units, ("seconds", "reason", "from", "to"))
    styles = ["" if pair.verdict is Verdict.HOLDS else STYLES[pair.verdict] for _, pair in pairs]
    print_fitting(console, columns, DISPENSABLE, "a wider one, a pipe or --json", styles=styles)
    for requirement, pair in pairs:
        if pair.reason:
            typer.echo(printable(f"{requirement.name}: {pair.reason}."))
    console.print(Text(sentence(found), style=f"bold {STYLES[found.verdict]}"))


def write_junit(path: Path, found: Verification) -> None:
    """Write a test for each requirement. A violated one has a failure, an undecided one an error."""
    counts, name, units = found.counts(), printable(found.path), found.units
    suite = ElementTree.Element(
        "testsuite", name=name, tests=str(len(found.requirements)), failures=str(counts[Verdict.VIOLATED]),
        errors=str(counts[Verdict.UNDECIDED]), time=f"{found.seconds:.3f}",
    )  # fmt: skip
    for each, pair in _deciding(found):
        attributes = {"classname": name, "name": printable(each.name), "time": f"{each.seconds:.3f}"}
        case = ElementTree.SubElement(suite, "testcase", attributes)
        if pair.verdict is Verdict.HOLDS:
            continue
        row = {key: _cell(value) for key, value in _row((each, pair), units).items()}
        parts = " and ".join(filter(None, (row["first"], row["second"])))
        words = [f"{KINDS[each.kind].noun} of {parts}: from {row['lower']} to {row['upper']} {units}"]
        words += [f"{key} {row[key]} {units}" for key in ("least", "greatest") if row[key]]
        tag = "failure" if pair.verdict is Verdict.VIOLATED else "error"
        message = "; ".join(filter(None, (*words, row["reason"])))
        ElementTree.SubElement(case, tag, message=message, type=str(pair.verdict))
    with whole_file(path) as stream:
        ElementTree.ElementTree(suite).write(stream, encoding="utf-8", xml_declaration=True)


def check_libraries() -> None:
    """Import the library for pages, so that a missing one is reported before the models are read."""
    with needed("a report needs", "picture"):
        import jinja2  # noqa: F401


def write_page(path: Path, found: Verification) -> None:
    """Write the report as a page. It replaces an existing file."""
    from proximity.lab.figures import pages

    open_pairs = [pair for pair in _all_pairs(found) if pair[1].verdict is not Verdict.HOLDS]
    page = pages.render_page(TEMPLATE, {
        "title": f"Requirements of {Path(found.path).name}",
        "is_good": found.holds,
        "outcome": OUTCOMES[found.verdict],
        "verdict": sentence(found),
        "summary": found.notes,
        "marks": {Verdict.HOLDS: "held", Verdict.VIOLATED: "over", Verdict.UNDECIDED: "over"},
        "sections": [
            ("Requirements", "", *_table(_columns(_deciding(found), found.units, ("reason",))),
             "Each row has the pair of parts that decides, and the bounds of its length."),
            ("Pairs that do not hold", "", *_table(_columns(open_pairs, found.units, ("pairs", "seconds"))),
             "Points are in the frame of the model." if open_pairs else "All pairs hold."),
            ("Files", "", ("file", "SHA-256"), list(found.files.items()), f"Geometry: {found.geometry}"),
        ],
        "origin": f"proximity {proximity.__version__}; {found.seconds:.2f} s",
    }, dict, ())  # fmt: skip
    with whole_file(path) as stream:
        stream.write(page.encode())


def _table(columns: list[Column]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the titles and the rows of a table of the page."""
    rows = zip(*(map(str, column.cells) for column in columns), strict=True)
    return [str(column.title) for column in columns], list(rows)
