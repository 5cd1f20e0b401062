"""Report of an experiment: one page, plots, tables as CSV, and the methods paragraph."""

import base64
import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.lab.experiment.analysis.findings import MEANING, Findings, counts_of, shown
from proximity.lab.experiment.design import CHOICES, Kind, Procedure, Task
from proximity.lab.figures import style
from proximity.lab.figures.pages import filled_in
from proximity.lab.figures.style import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


HEIGHT = 2.4  # inches
TICKS = tuple(digit * 10.0**power for power in range(-4, 5) for digit in (1, 2, 5))  # of logarithmic axes
CURVE_POINTS = 120
Draw = Callable[["Figure", Findings, Task, list[str]], None]
JITTER = 0.12  # of a condition's width, by which the marks of participants lie apart


def draw_plots(findings: Findings, form: str) -> dict[str, bytes]:
    """Return plots as files, by name: psychometric functions, and scores, of each task that was done."""
    plots = {}
    for task in findings.design.tasks:
        done = {score.condition for score in findings.scores if score.task == task.name}
        names = [one.name for one in findings.design.conditions if one.name in done]
        drawn = [("functions", style.PAGE_WIDTH, _draw_functions)] if task.kind is Kind.STIFFER else []
        for name, width, draw in [*drawn, ("scores", style.COLUMN_WIDTH, _draw_scores)] if names else []:

            def draw_all(figure: "Figure", task: Task, draw: Draw = draw, names: list[str] = names) -> None:
                if findings.simulated:
                    figure.suptitle(findings.simulated_note, fontsize=7, color="#b45309")
                draw(figure, findings, task, names)

            plots[f"{task.name}_{name}"] = style.render(draw_all, task, (width, HEIGHT), form)
    return plots


def _draw_functions(figure: "Figure", findings: Findings, task: Task, names: list[str]) -> None:
    """A panel a condition: each participant's function, all answers together, and the mean function."""
    panels = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    levels = np.geomspace(min(task.levels), max(task.levels), CURVE_POINTS)
    for index, (panel, name) in enumerate(zip(panels, names, strict=True)):
        stroke = style.line(style.SERIES[index % len(style.SERIES)])
        own = [
            one for (_, of, on), one in sorted(findings.functions.items()) if (of, on) == (task.name, name)
        ]
        for function in own:
            panel.plot(levels, function.at(levels), color="0.75", linewidth=0.5)
        mean = np.mean([function.at(levels) for function in own], axis=0)
        panel.plot(levels, mean, **{**stroke, "linestyle": "-"})
        counts = counts_of(
            [entry for entry in findings.kept if (entry["task"], entry["condition"]) == (task.name, name)]
        )
        for level, (right, count) in sorted(counts.items()):
            share = right / count
            half = 1.96 * math.sqrt(max(share * (1.0 - share), 0.25 / count) / count)
            panel.errorbar(level, share, half, color=stroke["color"], marker="o", linewidth=0.8)
        panel.axhline(0.5, **style.GUIDE)
        panel.set_xscale("log")
        panel.set_xticks(*_ticks(0.9 * levels[0], 1.1 * levels[-1]))
        panel.minorticks_off()
        panel.set_xlim(0.9 * min(task.levels), 1.1 * max(task.levels))
        panel.set_ylim(0.2, 1.02)
        panel.set_xlabel(f"share of {task.varied}")
    panels[0].set_ylabel("right answers")
    style.letter_panels(panels, names)


def _draw_scores(figure: "Figure", findings: Findings, task: Task, names: list[str]) -> None:
    """Each participant's score on each condition, and means with confidence intervals."""
    panel, by_participant = figure.subplots(), dict[str, dict[str, float]]()
    for score in findings.scores:
        if score.task == task.name:
            by_participant.setdefault(score.participant, {})[score.condition] = shown(task.kind, score.value)
    offsets = np.linspace(-JITTER, JITTER, max(len(by_participant), 2))
    for offset, own in zip(offsets, by_participant.values(), strict=False):
        there = [i for i, name in enumerate(names) if name in own]
        panel.plot(
            [i + offset for i in there],
            [own[names[i]] for i in there],
            color="0.75", linewidth=0.5, marker=".", markersize=2.5,
        )  # fmt: skip
    comparison = findings.comparisons[task.name]
    for mean in comparison.means if comparison is not None else ():
        middle, low, high = (shown(task.kind, value) for value in (mean.value, mean.lower, mean.upper))
        position = names.index(mean.condition)
        panel.errorbar(
            position, middle, [[middle - low], [high - middle]],
            color=style.SERIES[position % len(style.SERIES)]["color"], marker="o", capsize=2.5,
        )  # fmt: skip
    if task.kind is Kind.REAL:
        panel.axhline(0.5, **style.GUIDE)
        panel.set_ylim(0.0, 1.02)
    if task.kind in (Kind.STIFFER, Kind.RATING):
        panel.set_yscale("log")
        panel.set_yticks(*_ticks(*panel.get_ylim()))
        panel.minorticks_off()
    panel.set_xticks(range(len(names)), names)
    panel.set_xlim(-0.5, len(names) - 0.5)
    panel.set_ylabel(MEANING[task.kind])


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Ticks of a logarithmic axis, and their labels."""
    ticks = [tick for tick in TICKS if low <= tick <= high]
    return ticks, [f"{tick:g}" for tick in ticks]


HERE = Path(__file__).parent
METHODS = {
    Procedure.CONSTANT: "the method of constant stimuli",
    Procedure.STAIRCASE: "a 3-down-1-up staircase",
    Procedure.QUEST: "QUEST+ (Watson 2017)",
}
ASKED = {
    Kind.STIFFER: "say which of two surfaces is stiffer",
    Kind.REAL: "say which of two walls is the real one",
    Kind.RATING: "rate the stiffness of a surface",
    Kind.CONTACT: "touch a surface once",
    Kind.FREE: "explore a surface",
}


def write_report(findings: Findings, folder: Path) -> list[Path]:
    """Write a report, and return its files, the page first."""
    folder.mkdir(parents=True, exist_ok=True)
    tables, pictures = _tables(findings), draw_plots(findings, "png")
    # Blanks and line ends of the template are joined: a draft for a paper.
    values = {
        "findings": findings,
        "asked": ASKED,
        "methods": METHODS,
        "choices": CHOICES,
        "version": version,
    }
    paragraph = " ".join(filled_in(HERE / "methods.txt.j2", values, is_html=False).split())
    encoded = {name: base64.b64encode(content).decode() for name, content in pictures.items()}
    values |= {"kinds": _kinds(findings), "meaning": MEANING, "shown": shown, "paragraph": paragraph}
    page = filled_in(HERE / "report.html.j2", values | {"pictures": encoded, "tables": list(tables)})
    files = {"report.html": page.encode(), "methods.txt": (paragraph + "\n").encode()}
    files |= {f"{name}.csv": _as_csv(columns, rows) for name, (columns, rows) in tables.items()}
    files |= {f"{name}.png": content for name, content in pictures.items()}
    files |= {f"{name}.pdf": content for name, content in draw_plots(findings, "pdf").items()}
    for name, content in files.items():
        write_bytes(folder / name, content)
    return [folder / name for name in files]


def _kinds(findings: Findings) -> dict[str, Kind]:
    return {task.name: task.kind for task in findings.design.tasks}


def _tables(findings: Findings) -> dict[str, tuple[str, list[tuple[Any, ...]]]]:
    """Tables of a report by name: their columns, and their rows."""
    kinds = _kinds(findings)
    found = [one for one in findings.comparisons.values() if one is not None]
    means = [(one.task, kinds[one.task], mean) for one in found for mean in one.means]
    differences = [(one.task, pair) for one in found for pair in one.differences]
    return {
        "thresholds": ("participant task condition threshold lower upper width lapse trials", [
            (*key, one.threshold, one.lower, one.upper, one.shape.width, one.shape.lapse, one.trials)
            for key, one in sorted(findings.functions.items())
        ]),
        "scores": ("participant task condition score shown trials", [
            (one.participant, one.task, one.condition, one.value, shown(kinds[one.task], one.value),
             one.trials)
            for one in findings.scores
        ]),
        "means": ("task condition mean lower upper p_chance participants", [
            (task, one.condition, *(shown(kind, value) for value in (one.value, one.lower, one.upper)),
             one.p if kind is Kind.REAL else "", one.participants)
            for task, kind, one in means
        ]),
        "models": ("task F df1 df2 p", [(one.task, one.f, *one.df, one.p) for one in found]),
        "differences": ("task first second difference lower upper p_holm BF01 participants", [
            (task, one.less, one.condition, one.value, one.lower, one.upper, one.p, one.bayes_factor_none,
             one.participants)
            for task, one in differences
        ]),
        "exclusions": ("participant trial why", [
            (one.participant, "all" if one.trial is None else one.trial, one.why)
            for one in findings.exclusions
        ]),
        "not_analysed": ("task condition participants why", [
            (one.task, one.condition, " ".join(one.participants) or "all", one.why)
            for one in findings.missing
        ]),
    }  # fmt: skip


def _as_csv(columns: str, rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns.split())
    writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)
    return text.getvalue().encode()
