"""Tables of the comparison, for the terminal."""

from rich.console import Console

from benchmarks.queries.results import Row
from benchmarks.support.output import table_of

HEADINGS = (
    "contender",
    "median",
    "min",
    "p99",
    "max",
    "times ours",
    "off",
    "wrong sign",
    "checked",
    "bytes a face",
)


def print_rows(console: Console, title: str, rows: list[Row]) -> None:
    """Print the contenders of one section and case, the fastest first."""
    unit = rows[0].unit
    table = table_of(f"{title}  [{unit}]", HEADINGS)
    for row in sorted(rows, key=lambda each: each.median):
        times = [_figure(value) for value in (row.median, row.minimum, row.p99, row.maximum, row.times_ours)]
        table.add_row(f"{row.contender} {row.version}", *times, *_agreement(row), _figure(row.bytes_per_face))
    console.print(table)


def _agreement(row):
    if row.agreement is None:
        return "", "", ""
    found = row.agreement
    return str(found.off_count), str(found.wrong_sign_count), f"{found.checked_count} by {found.judge}"


def _figure(value):
    """Return three significant digits, without an exponent."""
    if value is None:
        return ""
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 0.1 else 3
    return f"{value:.{digits}f}"
