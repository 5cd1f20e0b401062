"""Figure of a study, which shows a measure over a factor.

A second factor has a line for each level, and a third a panel for each level.
"""

import math
import statistics
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proximity.errors import ArgumentError
from proximity.lab.figures import style
from proximity.lab.study.study_file import NONE, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black", "0.5")
DASHES = ("-", "-", "--", "-.", (0, (4, 1, 1, 1)), ":", "-", (0, (1, 1)))
HEIGHT = 2.4  # inches, of a row of panels
MAX_PANELS, MAX_LINES, ACROSS = 4, 8, 2
WITHOUT_X = (":", "--")
"""Strokes of horizontal lines for conditions without x, one for each wall."""
LOG_RATIO = 10.0
"""Ratio of largest to smallest value from which an axis is logarithmic."""

Row = dict[str, Any]


def write_figure(study: Study, rows: Sequence[Row], path: Path) -> None:
    """Write the figure of the rows that did not fail."""
    found = [row for row in rows if row["failure"] is None]
    if not found:
        raise ArgumentError(f"{study.results}: no condition has results to draw")
    chosen = chosen_axes(study, found)
    lines = -(-len(_grouped(found, chosen.get("columns"), MAX_PANELS)) // ACROSS)
    size = (style.PAGE_WIDTH, HEIGHT * lines)
    drawn = style.render(lambda figure, _: _draw(figure, found, chosen), None, size, path.suffix[1:])
    style.write_bytes(path, drawn)


def chosen_axes(study: Study, rows: Sequence[Row]) -> dict[str, str]:
    """Return the columns of measure, x, lines and panels.

    Unless the file names them, the first that vary are used.
    """
    factors = list(study.conditions[0].values)
    measures = [name for name in rows[0] if name not in (*factors, "seconds") and _is_number(rows, name)]
    chosen = {key: name for key, name in study.plot.items() if name}
    for key, name in chosen.items():
        if key != "points" and name not in rows[0]:
            raise ArgumentError(f"plot.{key} is {name!r}, expected one of {', '.join((*factors, *measures))}")
    if "x" not in chosen:
        varied = [name for name in factors if len({row[name] for row in rows}) > 1]
        numeric = [name for name in varied if _is_number(rows, name)]
        chosen["x"] = (numeric or varied or factors)[0]
        others = [name for name in varied if name not in chosen.values()]
        chosen = dict(zip(("lines", "columns"), others, strict=False)) | chosen
    return {"measure": measures[0]} | chosen


def _draw(figure: "Figure", rows: Sequence[Row], chosen: dict[str, str]) -> None:
    panels = _grouped(rows, chosen.get("columns"), MAX_PANELS)
    names = list(_grouped(rows, chosen.get("lines"), MAX_LINES))
    across = min(len(panels), ACROSS)
    grid = figure.subplots(-(-len(panels) // across), across, sharex=True, sharey=True, squeeze=False)
    axes = list(grid.flat)
    for unused in axes[len(panels) :]:
        unused.set_axis_off()
    for panel, (name, own) in zip(axes, panels.items(), strict=False):
        for level, line in _grouped(own, chosen.get("lines"), MAX_LINES).items():
            index = names.index(level)
            _draw_line(panel, line, chosen, level, {"color": COLOURS[index], "linestyle": DASHES[index]})
        _scale(panel, rows, chosen)
        if "columns" in chosen:
            panel.set_title(f"{chosen['columns']} = {name}", loc="left")
    style.label_shared(axes, chosen["x"], chosen["measure"])
    if "lines" in chosen:
        handles, labels = axes[0].get_legend_handles_labels()
        style.legend_of(figure, handles, [f"{chosen['lines']} = {label}" for label in labels], 5)


def _draw_line(panel: "Axes", rows: Sequence[Row], chosen: dict[str, str], label: str, stroke: Row) -> None:
    """Draw the median or the worst value at each x, with a band from minimum to maximum around a median."""
    middle = max if chosen["points"] == "worst" else statistics.median
    values: dict[Any, list[float]] = defaultdict(list)
    for row in rows:
        if row[chosen["measure"]] is not None:
            group = row.get("wall") if row[chosen["x"]] is None else None
            values[row[chosen["x"]], group].append(row[chosen["measure"]])
    given = sorted(x for x, _ in values if x is not None)
    for number, key in enumerate(sorted(str(group) for x, group in values if x is None)):
        level = next(own for (x, group), own in values.items() if x is None and str(group) == key)
        panel.axhline(middle(level), color=stroke["color"], linestyle=WITHOUT_X[number % len(WITHOUT_X)])
    if given:
        own = [values[x, None] for x in given]
        panel.plot(given, [middle(one) for one in own], marker="o", label=label, **stroke)
        if middle is not max and any(len(one) > 1 for one in own):
            low, high = ([end(one) for one in own] for end in (min, max))
            panel.fill_between(given, low, high, color=stroke["color"], alpha=0.15, linewidth=0.0)


def _scale(panel: "Axes", rows: Sequence[Row], chosen: dict[str, str]) -> None:
    """Use logarithmic axes for positive numbers that span a wide range."""
    for axis, key in (("x", "x"), ("y", "measure")):
        numbers = [row[chosen[key]] for row in rows if isinstance(row[chosen[key]], int | float)]
        if numbers and min(numbers) > 0.0 and max(numbers) > LOG_RATIO * min(numbers):
            panel.set(**{f"{axis}scale": "log"})


def _grouped(rows: Sequence[Row], name: str | None, most: int) -> dict[str, list[Row]]:
    """Return rows by the text of their level in a column, or all rows without a column."""
    if name is None:
        return {"": list(rows)}
    levels = sorted({row[name] for row in rows}, key=lambda one: (one is None, one))
    if len(levels) > most:
        raise ArgumentError(f"{name} has {len(levels)} levels, expected {most} or fewer to draw")
    return {_label(one): [row for row in rows if row[name] == one] for one in levels}


def _label(level: Any) -> str:
    return NONE if level is None else f"{level:g}" if isinstance(level, float) else str(level)


def _is_number(rows: Sequence[Row], name: str) -> bool:
    values = [row[name] for row in rows if row.get(name) is not None]
    return bool(values) and all(isinstance(one, int | float) and math.isfinite(one) for one in values)
