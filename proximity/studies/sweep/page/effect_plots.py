"""Plots of a study's page: a measure over one factor with lines and panels, and over every factor alone."""

from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.studies.figures import page_figure
from proximity.studies.figures.page_figure import COLOURS, DASHES, INK
from proximity.studies.sweep.jobs import Kind
from proximity.studies.sweep.page.effects import Effect, Rows
from proximity.studies.sweep.study_file import PlotChoice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_X, MOST_LINES, MOST_PANELS = 40, 10, 4
LOG_RATIO = 10.0
"""From smallest to largest, from which on an axis is logarithmic."""
BAND = (0.1, 0.9)
"""Quantiles between which a band lies, where a point is the median of several conditions."""
PANEL_WIDTH, PANEL_HEIGHT = 2.5, 3.2  # inches
ACROSS = 4  # small panels side by side


def draw_main(rows: Rows, choice: PlotChoice) -> str:
    """Return a measure over a factor or another measure: a line a level of one factor, a panel of another.

    Parameters
    ----------
    rows : Rows
        Of the study.
    choice : PlotChoice
        Of which measure and x are chosen.
    """
    x, measure = choice.x, choice.measure
    assert x is not None and measure is not None, "both are chosen"
    panels, of_panel = _levels(rows, choice.columns, MOST_PANELS)
    lines, of_line = _levels(rows, choice.lines, MOST_LINES)
    across = rows.measure(x)
    up = rows.measure(measure)

    def draw(figure: "Figure", _: Any) -> None:
        axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        for number, (panel, caption) in enumerate(zip(axes, panels, strict=True)):
            for line, label in enumerate(lines):
                is_meant = (of_panel == number) & (of_line == line) & np.isfinite(up)
                draw_one = _draw_points if x in rows.job.measures else _draw_line
                draw_one(panel, across[is_meant], up[is_meant], line, label)
            panel.set(title=caption, xlabel=_axis(rows, x))
            _scale(panel, across, up)
        axes[0].set_ylabel(_axis(rows, measure))
        handles = {
            name: handle
            for panel in axes
            for handle, name in zip(*panel.get_legend_handles_labels(), strict=True)
        }
        if len(lines) > 1:
            figure.legend(
                handles.values(), handles, title=choice.lines, loc="outside right center", fontsize=7
            )

    return page_figure.svg(draw, "main", (1.6 + PANEL_WIDTH * max(2, len(panels)), PANEL_HEIGHT))


def draw_effects(rows: Rows, effects: list[Effect]) -> str:
    """Return a small panel a factor: the mean of a measure at each level.

    Parameters
    ----------
    rows : Rows
        Of the study.
    effects : list of Effect
        On one measure; one at least.
    """
    height = -(-len(effects) // ACROSS)

    def draw(figure: "Figure", _: Any) -> None:
        across = min(len(effects), ACROSS)
        axes = figure.subplots(height, across, sharey=True, squeeze=False)
        for panel, effect in zip(axes.flat, effects, strict=False):
            panel.plot(range(len(effect.means)), effect.means, "o-", color=COLOURS[0])
            panel.set_xticks(range(len(effect.labels)), effect.labels, rotation=60, ha="right")
            panel.set_title(f"{effect.factor}: {effect.share:.0%}")
        for panel in axes.flat[len(effects) :]:
            panel.set_axis_off()
        for row in axes:
            row[0].set_ylabel(f"mean of {_axis(rows, effects[0].measure)}")

    return page_figure.svg(draw, "effects", (0.6 + 2.0 * min(len(effects), ACROSS), 2.6 * height))


def _draw_points(panel: "Axes", across: np.ndarray, up: np.ndarray, line: int, label: str) -> None:
    panel.plot(across, up, ".", color=COLOURS[line % len(COLOURS)], alpha=0.7, markersize=4, label=label)


def _draw_line(panel: "Axes", across: np.ndarray, up: np.ndarray, line: int, label: str) -> None:
    colour, dash = COLOURS[line % len(COLOURS)], DASHES[line % len(DASHES)]
    is_absent = np.isnan(across)
    if is_absent.any():
        panel.axhline(float(np.median(up[is_absent])), color=colour, linestyle=(0, (1, 1.5)), linewidth=1.6)
    points = np.unique(across[~is_absent])
    if not len(points):
        return
    if len(points) > MOST_X:
        _draw_points(panel, across, up, line, label)
        return
    groups = [up[across == point] for point in points]
    if max(map(len, groups)) > 1:
        low, high = np.array([np.quantile(group, BAND) for group in groups]).T
        panel.fill_between(points, low, high, color=colour, alpha=0.15, linewidth=0)
    medians = [float(np.median(group)) for group in groups]
    panel.plot(points, medians, "o", markersize=2.5, linestyle=dash, color=colour, label=label)


def _levels(rows: Rows, name: str | None, most: int) -> tuple[list[str], np.ndarray]:
    """Labels of a factor's levels, and which each row has; one for all where there is no factor."""
    if name is not None:
        levels, ids = rows.levels(name, most)
        if levels:
            return [rows.label(name, level) for level in levels], ids
    return [""], np.zeros(rows.table.num_rows, int)


def _axis(rows: Rows, name: str) -> str:
    factor, measure = rows.job.factors.get(name), rows.job.measures.get(name)
    unit = factor.accepted.unit if factor is not None else measure.unit if measure is not None else ""
    return f"{name} [{unit}]" if unit else name


def _scale(panel: "Axes", across: np.ndarray, up: np.ndarray) -> None:
    scales = ((across, panel.set_xscale, panel.xaxis), (up, panel.set_yscale, panel.yaxis))
    for numbers, set_scale, axis in scales:
        known = numbers[np.isfinite(numbers)]
        if len(known) and known.min() > 0.0 and known.max() > LOG_RATIO * known.min():
            set_scale("log")
            for set_format in (axis.set_major_formatter, axis.set_minor_formatter):
                set_format(_plain)
    panel.tick_params(labelcolor=INK)


def _plain(number: float, _: float) -> str:
    """A tick of a logarithmic axis: 1, 2 and 5 of each decade."""
    return f"{number:g}" if f"{number:e}"[0] in "125" else ""


def is_axis(rows: Rows, name: str) -> bool:
    """Whether a factor is a number, which can be drawn along an axis."""
    return rows.job.factors[name].kind in (Kind.NUMBER, Kind.WHOLE)
