"""Wording of figures and conditions in the documentation."""

import math
import re
from collections.abc import Iterable
from typing import Any

Document = dict[str, Any]
UNITS = (
    {"µs": 1.0, "ms": 1e3, "s": 1e6},
    {"bytes": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9},
)


def figure(value: float | None) -> str:
    """Return three significant digits at most, without an exponent; thousands in groups."""
    if value is None or math.isnan(value):
        return "–"
    if value == 0.0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    text = f"{value:,.{digits}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace(",", " ")


def whole(value: float) -> str:
    """Return a whole number, in groups of three: 87 204."""
    return f"{value:,.0f}".replace(",", " ")


def share(part: float, total: float) -> str:
    """Return a percentage with at most two significant digits."""
    percent = 100.0 * part / total
    return "<0.1" if percent < 0.1 else figure(float(f"{percent:.2g}"))


def count_words(value: float) -> str:
    """Return a large number, rounded: 87 k, 1.3 M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if value >= 0.9995 * size:
            return f"{value / size:.2g} {letter}" if value < 99.5 * size else f"{value / size:.0f} {letter}"
    return f"{value:.3g}"


def amount(value: float, unit: str) -> str:
    """Return a value in the largest unit of its kind that leaves one or more: 111 ms, 1.76 GB."""
    steps = next((steps for steps in UNITS if unit in steps), {unit: 1.0})
    least = value * steps[unit]
    name = next((name for name, size in reversed(steps.items()) if least >= size), next(iter(steps)))
    return f"{figure(least / steps[name])} {name.replace('bytes', 'B')}"


def power(value: float) -> str:
    """Return a size on a logarithmic axis: 1, 10, 10⁷, 3·10⁶."""
    exponent = math.floor(math.log10(value) + 0.02)
    if -2 <= exponent <= 3:
        return f"{value:,.2g}" if value < 100 else f"{float(f'{value:.2g}'):.0f}"
    head = value / 10.0**exponent
    raised = f"10{str(exponent).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
    return raised if abs(head - 1.0) < 0.05 else f"{head:.2g}·{raised}"


def table(headings: Iterable[str], rows: Iterable[Iterable[str]], right: int = 1) -> list[str]:
    """Return lines of a Markdown table; columns from number *right* on are right-aligned."""
    names = list(headings)
    rule = "".join("---|" if k < right else "---:|" for k in range(len(names)))
    return [_line(names), f"|{rule}", *(_line(row) for row in rows)]


def _line(cells):
    return "| " + " | ".join(cells) + " |"


def short_name(machine: Document) -> str:
    """Return the name of a processor, without trade marks and brackets."""
    bare = re.sub(r"\((R|TM)\)", "", machine["processor"]).partition(" (")[0]
    return " ".join(bare.replace(" Processor", "").split())


def instructions(machine: Document) -> str:
    """Return the instructions of the kernels of a run, to append to the name of its machine."""
    names = {"kernels v3": ", kernels for AVX2", "kernels v4": ", kernels for AVX-512"}
    return next((words for name, words in names.items() if name in machine["python"]), "")


def full_name(machine: Document) -> str:
    """Processor, system and versions of a machine."""
    processor = re.sub(r"\((R|TM)\)", "", machine["processor"])
    return f"{processor}, {machine['system']}; {machine['python']}"


def when(machine: Document) -> str:
    """Date, commit and load of a run."""
    parts = [machine["date"]]
    if machine["commit"] != "none":
        parts.append(f"commit {machine['commit']}")
    if machine["load"] != "unknown":
        parts.append(f"load {machine['load'].partition(',')[0]} when it began")
    return ", ".join(parts)


def verdict_lines(what: str, verdicts: list[Document]) -> list[str]:
    """Return the number of met requirements, and the names of the others."""
    missed = [each for each in verdicts if not each["is_met"]]
    if not verdicts:
        return []
    if not missed:
        return [f"Requirements {what}: all {len(verdicts)} are met."]
    lines = [f"Requirements {what}: {len(verdicts) - len(missed)} of {len(verdicts)} are met. Not met:", ""]
    return [*lines, *(f"- {each['requirement']}: {each['measured']}" for each in missed)]
