"""Figure of an experiment, with psychometric functions per condition and shares of right answers."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from proximity.lab.experiment.analysis import MEANING, Findings, pooled, shown
from proximity.lab.experiment.design import Kind, Task
from proximity.lab.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT = 2.2  # inches, of a task
CURVE_POINTS = 120
JITTER = 0.12  # of a condition's width, between the marks of participants
TICKS = tuple(digit * 10.0**power for power in range(-4, 5) for digit in (1, 2, 5))


def write_figure(findings: Findings, path: Path) -> None:
    """Write the figure, which has a row per task."""
    size = (style.PAGE_WIDTH, HEIGHT * len(findings.design.tasks))
    style.write_bytes(path, style.render(_draw, findings, size, path.suffix.removeprefix(".")))


def _draw(figure: "Figure", findings: Findings) -> None:
    tasks = findings.design.tasks
    if findings.simulated:
        figure.suptitle(findings.simulated_note, fontsize=7, color="#b45309")
    for row, task in zip(figure.subfigures(len(tasks), 1, squeeze=False).flat, tasks, strict=True):
        names = [one.name for one in findings.design.compared(task)]
        if task.kind is Kind.REAL:
            _draw_shares(row.subplots(), findings, task, names)
            continue
        panels = row.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for index, (panel, name) in enumerate(zip(panels, names, strict=True)):
            _draw_functions(panel, findings, task, name, style.SERIES[index % len(style.SERIES)]["color"])
            panel.set_title(f"{task.name}, {name}", loc="left")
        panels[0].set_ylabel("right answers")


def _draw_functions(panel: "Axes", findings: Findings, task: Task, name: str, colour: str) -> None:
    """Draw the functions of all participants, their mean, and the pooled answers."""
    levels = np.geomspace(min(task.levels), max(task.levels), CURVE_POINTS)
    own = [one.at(levels) for key, one in sorted(findings.functions.items()) if key[:2] == (task.name, name)]
    for curve in own:
        panel.plot(levels, curve, color="0.75", linewidth=0.5)
    if own:
        panel.plot(levels, np.mean(own, axis=0), color=colour)
        right, wrong = pooled(task, findings.kept, name)
        for level, hits, count in zip(task.levels, right, right + wrong, strict=True):
            if count:
                share = hits / count
                half = 1.96 * math.sqrt(max(share * (1.0 - share), 0.25 / count) / count)
                panel.errorbar(level, share, half, color=colour, marker="o", linewidth=0.8)
    panel.axhline(0.5, **style.GUIDE)
    panel.set_xscale("log")
    low, high = 0.9 * levels[0], 1.1 * levels[-1]
    ticks = [tick for tick in TICKS if low <= tick <= high]
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.set(xlim=(low, high), ylim=(0.2, 1.02), xlabel=f"level of {task.varied}")


def _draw_shares(panel: "Axes", findings: Findings, task: Task, names: list[str]) -> None:
    """Draw the share of right answers of each participant, and the means with confidence intervals."""
    for index, name in enumerate(names):
        own = [shown(task.kind, v) for key, v in findings.scores.items() if key[:2] == (task.name, name)]
        at = index + np.linspace(-JITTER, JITTER, len(own))
        panel.plot(at, own, color="0.75", marker=".", markersize=2.5, linestyle="")
        mean = findings.mean(task.name, name)
        middle, low, high = (shown(task.kind, value) for value in (mean.value, mean.lower, mean.upper))
        if math.isfinite(middle):
            half = [[middle - low], [high - middle]] if math.isfinite(low) else None
            panel.errorbar(index, middle, half, marker="o", capsize=2.5,
                           color=style.SERIES[index % len(style.SERIES)]["color"])  # fmt: skip
    panel.axhline(0.5, **style.GUIDE)
    panel.set_xticks(range(len(names)), names)
    panel.set(xlim=(-0.5, len(names) - 0.5), ylim=(0.0, 1.02), ylabel=MEANING[task.kind])
    panel.set_title(task.name, loc="left")
