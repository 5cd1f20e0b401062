"""The page of a study: its factors, effects, plots, worst conditions, and a command that repeats each row."""

import shlex
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.figures.pages import render_page, svg
from proximity.lab.sweep.effects import (
    MOST_X,
    NOT_USED,
    Effect,
    Plot,
    Rows,
    effect,
    effects_plot,
    main_plot,
    without_factor,
    words,
)
from proximity.lab.sweep.row_files import MADE_BY, read_rows
from proximity.lab.sweep.study_file import PlotChoice, Study

WORST = 12
FAILURES = 12
LARGEST_WHOLE = 1e9
"""Whole numbers below this are shown with all their digits."""
ROWS_LISTED = 300
"""Rows in the page; all are in the Parquet files."""


class Report(NamedTuple):
    """The page of a study, and its plots by name."""

    page: str
    plots: dict[str, Plot]


def study_report(study: Study, folder: Path) -> Report:
    """Return the report of what a folder holds."""
    recorded = read_rows(folder)
    if not recorded.rows.num_rows:
        raise ServiceError(f"{folder}: no condition is finished yet, run the study first")
    rows = Rows(study.job, recorded.rows)
    count, failed = recorded.rows.num_rows, recorded.rows.filter(recorded.rows["failure"].is_valid())
    varied = rows.varied()
    main = study.plot.measure or study.measures[0]
    effects = {measure: _effects(rows, varied, measure) for measure in dict.fromkeys([*study.measures, main])}
    choice = _choice(study.plot, rows, main, effects[main])
    of_measure = effects[main]

    plots = {"main": main_plot(rows, choice)} if choice.x is not None else {}
    plots |= {"effects": effects_plot(rows, of_measure)} if of_measure else {}
    page = render_page(
        Path(__file__).with_name("study_page.html.j2"),
        {
            "study": study,
            "source": recorded.source,
            "title": study.name or Path(recorded.source).stem,
            "folder": str(folder),
            "counts": {"total": recorded.total, "there": count, "failed": failed.num_rows},
            "seconds": float(np.sum(recorded.rows["seconds"].to_numpy())),
            "made_by": {name: _share(recorded.rows[name]) for name in MADE_BY},
            "varied": [(name, _range(rows, name)) for name in varied],
            "fixed": [(name, _shown(rows, name)) for name in study.job.factors if name not in varied],
            "measures": [_summary(rows, name) for name in study.measures],
            "effects": _effect_table(effects, varied),
            "affected": list(effects),
            "choice": choice,
            "without": _without(rows, choice.x),
            "columns": [*varied, *study.measures],
            "worst": _worst(study, rows),
            "failed": failed.slice(0, FAILURES).to_pylist(),
            "listed": recorded.rows.slice(0, ROWS_LISTED).to_pylist(),
            "command": f"proximity study run {shlex.quote(recorded.source)} --only",
        },
        lambda: {name: svg(plot.draw, name, plot.size) for name, plot in plots.items()},
        (shown, words),
    )
    return Report(page, plots)


def shown(value: Any) -> str:
    """Return a value for people: four digits of a number, and a dash for nothing."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return "–"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(shown, value))
    if isinstance(value, float) and not (value.is_integer() and abs(value) < LARGEST_WHOLE):
        return f"{value:.4g}"
    return f"{value:.0f}" if isinstance(value, float) else str(value)


def _effects(rows: Rows, varied: list[str], measure: str) -> list[Effect]:
    """Effects on one measure, the largest first."""
    found = [each for name in varied if (each := effect(rows, name, measure)) is not None]
    return sorted(found, key=lambda each: -each.share)


def _choice(asked: PlotChoice, rows: Rows, measure: str, effects: list[Effect]) -> PlotChoice:
    """What the first plot shows: as the file says, else what has the largest effects."""
    if asked.x is not None:
        return replace(asked, measure=measure)
    names = [each.factor for each in effects if each.factor not in (asked.lines, asked.columns)]
    x = next((name for name in names if rows.is_number(name)), None)
    names = [name for name in names if name != x]
    free = iter(names)
    return PlotChoice(
        measure, x, asked.lines or next(free, None), asked.columns or next(free, None), asked.points
    )


def _without(rows: Rows, x: str | None) -> str:
    """What the levels of conditions without x are, in the plot: ``Dotted: wall coupled.``"""
    if x is None or x not in rows.job.factors:
        return ""
    values, said = rows.values(x), ""
    if NOT_USED in values:
        said += f"Dotted: {without_factor(rows, x)}. "
    return said + (f"Dashed: {words(x)} {rows.label(x, None)}." if None in values else "")


def _effect_table(effects: dict[str, list[Effect]], varied: list[str]) -> list[tuple[str, list[str]]]:
    """A row a factor: which share of each measure's variance lies between its levels."""
    shares = {
        (each.factor, measure): f"{each.share:.0%}" for measure, found in effects.items() for each in found
    }
    return [(name, [shares.get((name, measure), "–") for measure in effects]) for name in varied]


def _worst(study: Study, rows: Rows) -> list[dict[str, Any]]:
    first = study.measures[0]
    numbers = rows.measure(first)
    order = np.argsort(-numbers if study.job.measures[first].is_worse_high else numbers)  # nan last
    worst: list[dict[str, Any]] = rows.table.take(order[: min(WORST, np.isfinite(numbers).sum())]).to_pylist()
    return worst


def _summary(rows: Rows, name: str) -> tuple[str, str, list[float]]:
    numbers = rows.measure(name)
    known = numbers[~np.isnan(numbers)]
    quantiles = np.quantile(known, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist() if len(known) else [np.nan] * 5
    return name, rows.job.measures[name].unit, quantiles


def _range(rows: Rows, name: str) -> str:
    values = rows.values(name)
    given = sorted(set(values) - {None, NOT_USED})
    absent = [rows.label(name, level) for level in (None, NOT_USED) if level in values]
    if len(given) > MOST_X // 4:
        said = [f"{len(given)} values from {rows.label(name, given[0])} to {rows.label(name, given[-1])}"]
    else:
        said = [rows.label(name, value) for value in given]
    unit = rows.job.factors[name].accepted.unit
    return f"{', '.join(said + absent)}{f' [{unit}]' if unit else ''}"


def _shown(rows: Rows, name: str) -> str:
    values = [value for value in rows.values(name) if value != NOT_USED]
    return rows.label(name, values[0]) if values else NOT_USED


def _share(column: Any) -> str:
    """The values of a column, the most frequent first; how many rows each has where there are several."""
    counts = Counter(value or "unknown" for value in column.to_pylist()).most_common()
    return counts[0][0] if len(counts) == 1 else ", ".join(f"{value} ({count})" for value, count in counts)
