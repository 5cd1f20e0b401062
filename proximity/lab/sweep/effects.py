"""Effects of factors on measures: shares of variance, means of levels, and the plots of a study's page."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from proximity.lab.figures import style
from proximity.lab.figures.pages import COLOURS, DASHES, INK
from proximity.lab.figures.style import Table
from proximity.lab.sweep.design import Job, Kind
from proximity.lab.sweep.study_file import PlotChoice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_LEVELS = 12
"""More values of a number are put into bins of equal counts; a word of more levels has no effect to show."""
BINS = 8
NOT_USED = "not used"
"""Level of a factor in conditions where it does not matter."""

Level = Any
"""A value of a factor: text, a number, or (lowest, highest) of a bin; None where the factor is absent."""


class Rows:
    """Rows of a study as columns, without those that failed."""

    def __init__(self, job: Job, table: Any) -> None:
        self.job, self.table = job, table.filter(table["failure"].is_null())
        self._columns: dict[str, list[Any]] = {}  # those that were asked for

    def values(self, name: str) -> list[Any]:
        """Return a column of those that did not fail; points are tuples."""
        if name not in self._columns:
            self._columns[name] = self._read(name)
        return self._columns[name]

    def _read(self, name: str) -> list[Any]:
        values = [_hashable(value) for value in self.table[name].to_pylist()]
        others = self.job.factors[name].only if name in self.job.factors else {}
        if not others:
            return values
        given = {other: self.values(other) for other in others}
        return [
            value if self.job.matters(name, {other: of[row] for other, of in given.items()}) else NOT_USED
            for row, value in enumerate(values)
        ]

    def measure(self, name: str) -> np.ndarray:
        """Return a column of numbers, nan where there is none, (N,)."""
        absent = (None, NOT_USED)
        return np.array([np.nan if value in absent else value for value in self.values(name)], np.float64)

    def varied(self) -> list[str]:
        """Return the factors with more than one value."""
        return [name for name in self.job.factors if len(set(self.values(name)) - {NOT_USED}) > 1]

    def is_number(self, name: str) -> bool:
        """Return whether a factor is a number, which can be drawn along an axis."""
        return self.job.factors[name].kind in (Kind.NUMBER, Kind.WHOLE)

    def levels(self, name: str, most: int = MOST_LEVELS) -> tuple[list[Level], np.ndarray]:
        """Return the levels of a factor, and which of them each row has, (N,); none where there are too many.

        *most*: levels of a number, before it is put into bins.
        """
        values = self.values(name)
        given = sorted(set(values) - {None, NOT_USED})
        levels: list[Level] = list(given)
        ids = {value: number for number, value in enumerate(given)}
        if len(given) > most:
            if not self.is_number(name):
                return [], np.zeros(len(values), int)
            edges = np.quantile(given, np.linspace(0.0, 1.0, min(BINS, most) + 1))
            bins = np.clip(np.searchsorted(edges, given, side="right") - 1, 0, len(edges) - 2)
            levels = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
            ids = dict(zip(given, bins.tolist(), strict=True))
        for absent in (None, NOT_USED):
            if absent in values:
                ids[absent] = len(levels)
                levels.append(absent)
        return levels, np.array([ids[value] for value in values], int)

    def label(self, name: str, level: Level) -> str:
        """Return a level in words."""
        if level is None:
            return self.job.factors[name].absent
        if isinstance(level, tuple) and len(level) == 2:
            return f"{level[0]:.3g} to {level[1]:.3g}"
        if isinstance(level, tuple):
            return ", ".join(f"{number:g}" for number in level)
        if isinstance(level, float):
            return f"{level:g}" if level.is_integer() else f"{level:.4g}"
        return str(level)


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect of one factor on one measure."""

    factor: str
    measure: str
    share: float  # of the variance, between the means of its levels: 0 to 1
    labels: tuple[str, ...]
    counts: tuple[int, ...]
    means: tuple[float, ...]


def effect(rows: Rows, factor: str, measure: str) -> Effect | None:
    """Return the effect of a factor on its own, the others as they come; None where it cannot be seen."""
    levels, ids = rows.levels(factor)
    numbers = rows.measure(measure)
    is_known = np.isfinite(numbers)
    ids, numbers = ids[is_known], numbers[is_known]
    is_used = np.array([levels[level] != NOT_USED for level in ids.tolist()], bool) if levels else ids < 0
    ids, numbers = ids[is_used], numbers[is_used]
    present = [level for level in range(len(levels)) if (ids == level).any()]
    if len(present) < 2 or not numbers.var() > 0.0:
        return None
    counts = [int((ids == level).sum()) for level in present]
    if max(counts) < 2 and not rows.is_number(factor):  # names of rows, such as files
        return None
    means = [float(numbers[ids == level].mean()) for level in present]
    between = np.average((np.array(means) - numbers.mean()) ** 2, weights=counts)
    labels = tuple(rows.label(factor, levels[level]) for level in present)
    return Effect(factor, measure, float(between / numbers.var()), labels, tuple(counts), tuple(means))


def _hashable(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


MOST_X, MOST_LINES, MOST_PANELS = 40, 10, 4
LOG_RATIO = 10.0
"""From smallest to largest, from which on an axis is logarithmic."""
CROWDED = 200.0
"""The same, from which on its ticks are the decades alone."""
LOWEST_SHOWN = 1e-4
"""Of the largest value on a logarithmic axis: what is smaller may be nothing but rounding."""
WITHOUT_X = {NOT_USED: (0, (1, 1.5)), None: (0, (6, 2))}
"""Strokes of the level of conditions without x: dotted where x does not matter, dashed where it is absent."""
BAND = (0.1, 0.9)
"""Quantiles between which a band lies, where a point is the median of several conditions."""
WIDEST, NARROWEST, PANEL_HEIGHT = 6.0, 1.9, 3.2  # inches, of all panels and of one
ACROSS, SMALL_WIDTH, SMALL_HEIGHT = 4, 1.6, 2.6  # small panels side by side; inches, at least, of one
MARKERS = "osD^vPX<>h"
STROKES = {
    "real": style.REAL, "coupled": style.COUPLED, "decaff": style.TIME_STAMPED, "naive": style.NAIVE,
    "latched": style.LATCHED, "feed-forward": style.SERIES[2], "time-stamped": style.TIME_STAMPED,
}  # fmt: skip
"""Levels that other figures draw, too: they look the same here."""
DRAWN_IN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "1": ("%", 100.0)}
"""Units that axes have instead of those of rows, and how many make one of them."""


class Plot(NamedTuple):
    """A plot of a study, for its page and for files beside it."""

    draw: "Callable[[Figure, Any], None]"
    size: tuple[float, float]  # inches
    numbers: Table


def words(name: str) -> str:
    """Return the name of a factor or a measure as a label has it."""
    return name.replace("_", " ")


def without_factor(rows: Rows, x: str) -> str:
    """Return in words in which conditions a factor does not matter: wall coupled."""
    others = rows.job.factors[x].only if x in rows.job.factors else {}
    found = {
        f"{words(other)} {value}"
        for other in others
        for value, own in zip(rows.values(other), rows.values(x), strict=True)
        if own == NOT_USED
    }
    return ", ".join(sorted(found))


def main_plot(rows: Rows, choice: PlotChoice) -> Plot:
    """Return a measure over a factor or another measure: a line a level of one factor, a panel of another."""
    x, measure = choice.x, choice.measure
    assert x is not None and measure is not None, "both are chosen"
    panels, of_panel = _levels(rows, choice.columns, MOST_PANELS)
    lines, of_line = _levels(rows, choice.lines, MOST_LINES)
    across, up = (_unit(rows, name)[1] * rows.measure(name) for name in (x, measure))
    worst = np.max if rows.job.measures[measure].is_worse_high else np.min
    summary = worst if choice.points == "worst" else np.median
    draw_line = partial(_draw_line, summary=summary)
    own = rows.values(x)
    without = {kind: np.array([each == kind for each in own], bool) for kind in WITHOUT_X}
    absent = rows.label(x, None) if x in rows.job.factors else ""
    meaning = {NOT_USED: without_factor(rows, x), None: f"{words(x)} {absent}"}

    def draw(figure: "Figure", _: Any) -> None:
        axes = style.panels_across(figure, len(panels))
        for number, (panel, caption) in enumerate(zip(axes, panels, strict=True)):
            for line, label in enumerate(lines):
                is_meant = (of_panel == number) & (of_line == line) & np.isfinite(up)
                draw_one = _draw_points if x in rows.job.measures else draw_line
                has_x = is_meant & np.isfinite(across)
                draw_one(panel, across[has_x], up[has_x], line, label)
                for kind, is_without in without.items():
                    if (is_meant & is_without).any():
                        level = float(summary(up[is_meant & is_without]))
                        panel.axhline(
                            level,
                            color=_stroke(line, label)["color"],
                            linestyle=WITHOUT_X[kind],
                            linewidth=1.4,
                        )
                        panel.plot([], color=INK, linestyle=WITHOUT_X[kind], label=meaning[kind])
            panel.set_title(caption)
            _scale(panel, across, up)
        style.label_shared(axes, _axis(rows, x), _axis(rows, measure))
        handles = {
            name: handle
            for panel in axes
            for handle, name in zip(*panel.get_legend_handles_labels(), strict=True)
        }
        handles = {name: handles[name] for name in sorted(handles, key=lambda name: name in meaning.values())}
        if len(handles) > 1 and style.is_narrow(figure):
            style.legend_of(figure, list(handles.values()), list(handles), 3)
        elif len(handles) > 1:
            figure.legend(handles.values(), handles, loc="outside right center", fontsize=7)

    width = 1.4 + max(WIDEST / len(panels), NARROWEST) * len(panels)
    shown = dict.fromkeys(filter(None, (choice.columns, choice.lines, x, measure)))
    table = Table({_column(rows, name): np.array(list(map(str, rows.values(name)))) for name in shown})
    return Plot(draw, (width, PANEL_HEIGHT), table)


def effects_plot(rows: Rows, effects: list[Effect]) -> Plot:
    """Return a small panel a factor: the mean of a measure at each level; only numbers are joined."""
    measure = effects[0].measure
    height, factor = -(-len(effects) // ACROSS), _unit(rows, measure)[1]

    def draw(figure: "Figure", _: Any) -> None:
        across = min(len(effects), ACROSS, max(1, int(figure.get_figwidth() / SMALL_WIDTH)))
        down = -(-len(effects) // across)
        if across < min(len(effects), ACROSS):
            figure.set_figheight(SMALL_HEIGHT * down)
        axes = figure.subplots(down, across, sharey=True, squeeze=False)
        for panel, effect in zip(axes.flat, effects, strict=False):
            joined = "o-" if rows.is_number(effect.factor) else "o"
            means = [factor * mean for mean in effect.means]
            panel.plot(range(len(means)), means, joined, color=COLOURS[0])
            panel.margins(x=0.1)
            panel.set_xticks(range(len(effect.labels)), effect.labels, rotation=60, ha="right")
            panel.set_title(f"{_column(rows, effect.factor)}\n{effect.share:.0%} of variance")
        for panel in axes.flat[len(effects) :]:
            panel.set_axis_off()
        for row in axes:
            row[0].set_ylabel(f"mean {_axis(rows, measure)}")

    levels = [
        (each.factor, label, count, mean)
        for each in effects
        for label, count, mean in zip(each.labels, each.counts, each.means, strict=True)
    ]
    mean = f"mean of {_column(rows, measure)}"
    table = Table.of_rows(("factor", "level", "conditions", mean), levels)
    return Plot(draw, (0.6 + 2.0 * min(len(effects), ACROSS), SMALL_HEIGHT * height), table)


def _draw_points(panel: "Axes", across: np.ndarray, up: np.ndarray, line: int, label: str) -> None:
    panel.plot(across, up, ".", color=_stroke(line, label)["color"], alpha=0.7, markersize=4, label=label)


def _draw_line(
    panel: "Axes",
    across: np.ndarray,
    up: np.ndarray,
    line: int,
    label: str,
    *,
    summary: Callable[[np.ndarray], Any],
) -> None:
    stroke = _stroke(line, label)
    points = np.unique(across)
    if not len(points):
        return
    if len(points) > MOST_X:
        _draw_points(panel, across, up, line, label)
        return
    groups = [up[across == point] for point in points]
    if summary is np.median and max(map(len, groups)) > 1:
        low, high = np.array([np.quantile(group, BAND) for group in groups]).T
        panel.fill_between(points, low, high, color=stroke["color"], alpha=0.15, linewidth=0)
    panel.plot(
        points,
        [float(summary(group)) for group in groups],
        **stroke,
        label=label,
    )


def _levels(rows: Rows, name: str | None, most: int) -> tuple[list[str], np.ndarray]:
    """Labels of a factor's levels, and which each row has; one for all where there is no factor."""
    if name is not None:
        levels, ids = rows.levels(name, most)
        if levels:
            return [_level_words(rows, name, level) for level in levels], ids
    return [""], np.zeros(rows.table.num_rows, int)


def _si_unit(rows: Rows, name: str) -> str:
    factor, measure = rows.job.factors.get(name), rows.job.measures.get(name)
    return factor.accepted.unit if factor is not None else measure.unit if measure is not None else ""


def _unit(rows: Rows, name: str) -> tuple[str, float]:
    """The unit in which something is drawn, and what numbers in SI units are multiplied by."""
    unit = _si_unit(rows, name)
    return DRAWN_IN.get(unit, (unit, 1.0))


def _axis(rows: Rows, name: str) -> str:
    unit, _ = _unit(rows, name)
    return f"{words(name)} [{unit}]" if unit else words(name)


def _column(rows: Rows, name: str) -> str:
    """The name of a column or factor, whose numbers are in SI units."""
    unit = _si_unit(rows, name)
    return f"{words(name)} [{unit}]" if unit else words(name)


def _level_words(rows: Rows, name: str, level: Level) -> str:
    """A level in a legend or above a panel: latency 0.01 s."""
    unit, factor = _unit(rows, name)
    has_unit = level not in (None, NOT_USED) and not isinstance(level, str)
    if has_unit and isinstance(level, float):
        level = factor * level
    elif has_unit:
        unit = _si_unit(rows, name)
    return f"{words(name)} {rows.label(name, level)} {unit if has_unit else ''}".rstrip()


def _scale(panel: "Axes", across: np.ndarray, up: np.ndarray) -> None:
    scales = ((across, panel.set_xscale, panel.xaxis), (up, panel.set_yscale, panel.yaxis))
    for numbers, set_scale, axis in scales:
        known = numbers[np.isfinite(numbers)]
        if len(known) and known.min() > 0.0 and known.max() > LOG_RATIO * known.min():
            set_scale("log")
            is_long = known.max() > CROWDED * known.min()
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(_nothing if is_long else _two_and_five)
    most = np.max(up, where=np.isfinite(up), initial=0.0)
    if panel.get_yscale() == "log" and panel.get_ylim()[0] < LOWEST_SHOWN * most:
        panel.set_ylim(bottom=LOWEST_SHOWN * most)
    panel.tick_params(labelcolor=INK)


def _two_and_five(number: float, _: float) -> str:
    """The label of a tick between the decades of a logarithmic axis."""
    return f"{number:g}" if f"{number:e}"[0] in "25" else ""


def _nothing(number: float, _: float) -> str:
    return ""


def _stroke(line: int, label: str) -> style.Stroke:
    """How a line is drawn: as in other figures where they have it, else by its number."""
    own = {"color": COLOURS[line % len(COLOURS)], "linestyle": DASHES[line % len(DASHES)],
           "marker": MARKERS[line % len(MARKERS)]}  # fmt: skip
    known = STROKES.get(label.rpartition(" ")[2], own)
    return {**known, "markersize": 3.2, "color": INK if known["color"] == "black" else known["color"]}
