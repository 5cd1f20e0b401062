"""Plots of an experiment, for a column or a page of a journal."""

import math
from typing import TYPE_CHECKING

import numpy as np

from proximity.lab.experiment.analysis.findings import Findings
from proximity.lab.experiment.analysis.scores import MEANING, counts_of, shown
from proximity.lab.experiment.design import Kind, Task
from proximity.lab.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT = 2.4  # inches
TICKS = tuple(digit * 10.0**power for power in range(-4, 5) for digit in (1, 2, 5))  # of logarithmic axes
CURVE_POINTS = 120
JITTER = 0.12  # of a condition's width, by which the marks of participants lie apart


def draw_plots(findings: Findings, form: str) -> dict[str, bytes]:
    """Return plots as files, by name: psychometric functions, and scores, of each task that was done."""
    plots = {}

    def draw_functions(figure: "Figure", task: Task) -> None:
        _name_simulated(figure, findings)
        _draw_functions(figure, findings, task)

    def draw_scores(figure: "Figure", task: Task) -> None:
        _name_simulated(figure, findings)
        _draw_scores(figure.subplots(), findings, task)

    for task in findings.design.tasks:
        if not any(score.task == task.name for score in findings.scores):
            continue
        if task.kind is Kind.STIFFER:
            size = (style.PAGE_WIDTH, HEIGHT)
            plots[f"{task.name}_functions"] = style.render(draw_functions, task, size, form)
        size = (style.COLUMN_WIDTH, HEIGHT)
        plots[f"{task.name}_scores"] = style.render(draw_scores, task, size, form)
    return plots


def _name_simulated(figure: "Figure", findings: Findings) -> None:
    """Say above the panels that participants are no people, if some are not."""
    if findings.simulated:
        figure.suptitle(findings.said_of_simulated, fontsize=7, color="#b45309")


def _draw_functions(figure: "Figure", findings: Findings, task: Task) -> None:
    """A panel a condition: each participant's function, all answers together, and the mean function."""
    names = _conditions(findings, task)
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
        ticks = [tick for tick in TICKS if 0.9 * levels[0] <= tick <= 1.1 * levels[-1]]
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlim(0.9 * min(task.levels), 1.1 * max(task.levels))
        panel.set_ylim(0.2, 1.02)
        panel.set_xlabel(f"share of {task.varied}")
    panels[0].set_ylabel("right answers")
    style.letter_panels(panels, names)


def _draw_scores(panel: "Axes", findings: Findings, task: Task) -> None:
    """Each participant's score on each condition, and means with confidence intervals."""
    names = _conditions(findings, task)
    by_participant: dict[str, dict[str, float]] = {}
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
        low, high = panel.get_ylim()
        ticks = [tick for tick in TICKS if low <= tick <= high]
        panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
    panel.set_xticks(range(len(names)), names)
    panel.set_xlim(-0.5, len(names) - 0.5)
    panel.set_ylabel(MEANING[task.kind])


def _conditions(findings: Findings, task: Task) -> list[str]:
    """Conditions that a task was done on, in the design's order."""
    done = {score.condition for score in findings.scores if score.task == task.name}
    return [one.name for one in findings.design.conditions if one.name in done]
