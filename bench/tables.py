"""Results for people: Rich tables for the terminal, Markdown for the README."""

from results import Row, Verdict
from rich.console import Console
from rich.table import Table

HEADINGS = ("median", "min", "p99", "max", "times ours", "off", "wrong sign", "checked", "bytes a face")


def print_rows(console: Console, title: str, rows: list[Row]) -> None:
    """Print the contenders of one section and case, the fastest first."""
    unit = rows[0].unit
    table = Table(title=f"{title}  [{unit}]", title_justify="left", header_style="bold")
    table.add_column("contender")
    for heading in HEADINGS:
        table.add_column(heading, justify="right")
    for row in sorted(rows, key=lambda each: each.median):
        times = [_figure(value) for value in (row.median, row.minimum, row.p99, row.maximum, row.times_ours)]
        table.add_row(f"{row.contender} {row.version}", *times, *_agreement(row), _figure(row.bytes_per_face))
    console.print(table)


def print_verdicts(console: Console, verdicts: list[Verdict]) -> None:
    """Print each requirement with what was measured."""
    table = Table(title="Requirements", title_justify="left", header_style="bold")
    for heading in ("requirement", "measured", "met"):
        table.add_column(heading)
    for verdict in verdicts:
        table.add_row(verdict.requirement, verdict.measured, "[green]yes" if verdict.is_met else "[red]no")
    console.print(table)


def markdown(machine: dict[str, str], rows: list[Row]) -> str:
    """Medians, one line a section and case, one column a contender; wrong signs in brackets."""
    names = list(dict.fromkeys(row.contender for row in rows))
    lines = [
        ", ".join(machine[key] for key in ("processor", "python", "date"))
        + f", commit {machine['commit']}; medians.",
        "",
        "| work | case | unit | " + " | ".join(names) + " |",
        "|---|---|---|" + "---:|" * len(names),
    ]
    for section, case in dict.fromkeys((row.section, row.case) for row in rows):
        here = {row.contender: row for row in rows if (row.section, row.case) == (section, case)}
        unit = next(iter(here.values())).unit
        cells = [_cell(here[name]) if name in here else "" for name in names]
        lines.append(f"| {section} | {case} | {unit} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(row):
    found = row.agreement
    if found is None or not found.wrong_sign_count:
        return _figure(row.median)
    return f"{_figure(row.median)} ({found.wrong_sign_count} of {found.checked_count} wrong)"


def _agreement(row):
    if row.agreement is None:
        return "", "", ""
    found = row.agreement
    return str(found.off_count), str(found.wrong_sign_count), f"{found.checked_count} by {found.judge}"


def _figure(value):
    """Three significant digits, without an exponent."""
    if value is None:
        return ""
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 0.1 else 3
    return f"{value:.{digits}f}"
