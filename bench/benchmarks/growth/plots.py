"""Plots of growth: a figure for each axis, a log–log panel for each quantity, with fitted slopes."""

import csv
import dataclasses
import io
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from PIL import Image

from benchmarks.growth.fit import Fit
from benchmarks.growth.samples import GrowthRow
from proximity.lab.figures.style import LOOK

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")  # Okabe and Ito
MARKS = ("o", "s", "^", "D", "v", "P")
PANELS = {1: (4.6, 3.1), 2: (4.3, 3.1), 3: (3.7, 3.1)}  # inches, by how many are side by side
DOTS_PER_INCH = 130
COLOUR_COUNT = 64  # of a PNG: half the bytes, no visible difference
X_LABELS = {
    "faces": "faces of a part",
    "parts": "parts of a scene, 1,250 faces each",
    "points": "points or rays in one call",
    "distance": "distance to the surface, of the diagonal",
    "centre": "faces of a hollow ball, asked at its centre",
    "budget": "work budget, nodes and leaves",
}
MAX_COLUMNS = 3


def write_plots(folder: Path, machine: dict, rows: list[GrowthRow], fits: list[Fit]) -> list[Path]:
    """Write growth_AXIS.csv, .png and .svg for each axis; return their paths."""
    caption = f"{machine['processor'].partition(' (')[0]}, {machine['date'][:10]}; line: fit, faint: p99"
    written = []
    for axis in dict.fromkeys(row.axis for row in rows):
        own = [row for row in rows if row.axis == axis]
        path = folder / f"growth_{axis}"
        with path.with_suffix(".csv").open("w", encoding="utf-8", newline="") as stream:
            table = csv.DictWriter(stream, [field.name for field in dataclasses.fields(GrowthRow)])
            table.writeheader()
            table.writerows(dataclasses.asdict(row) for row in own)
        figure = draw(axis, own, [fit for fit in fits if fit.axis == axis], caption)
        written += [path.with_suffix(".csv"), *save(figure, path)]
    return written


def draw(axis: str, rows: list[GrowthRow], fits: list[Fit], caption: str) -> Figure:
    """Medians with their fitted lines, 99th percentiles faint above them."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    lines = -(-len(quantities) // MAX_COLUMNS)
    columns = -(-len(quantities) // lines)
    width, height = PANELS[columns]
    with matplotlib.rc_context(LOOK):
        figure = Figure((columns * width, lines * height + 0.3), layout="constrained")
        panels = figure.subplots(lines, columns, squeeze=False).reshape(-1)
        series = list(dict.fromkeys(row.series for row in rows))
        for panel, quantity in zip(panels, quantities, strict=False):
            own = [row for row in rows if row.quantity == quantity]
            slopes = {fit.series: fit for fit in fits if fit.quantity == quantity}
            for number, name in enumerate(series):
                _curve(panel, number, name, [row for row in own if row.series == name], slopes.get(name))
            panel.set(xscale="log", yscale="log", xlabel=X_LABELS[axis])
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_ylabel(f"{quantity}, {own[0].unit}")
            if panel.get_legend_handles_labels()[0]:
                panel.legend(fontsize=6.5, handlelength=1.6)
            low, high = panel.get_ylim()
            panel.set_ylim(low, high * (high / low) ** 0.35)  # for the legend
        for panel in panels[len(quantities) :]:
            panel.set_visible(False)
        figure.suptitle(caption, fontsize=6.5, color="0.4", x=0.01, ha="left")
    return figure


def save(figure: Figure, path: Path) -> list[Path]:
    """Write a figure as PNG and SVG; return their paths."""
    with matplotlib.rc_context(LOOK):
        pixels = io.BytesIO()
        figure.savefig(pixels, format="png", dpi=DOTS_PER_INCH)
        Image.open(pixels).convert("RGB").quantize(COLOUR_COUNT).save(path.with_suffix(".png"), optimize=True)
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    return [path.with_suffix(".png"), path.with_suffix(".svg")]


def _curve(panel, number, name, rows, fit):
    if not any(row.median > 0.0 for row in rows):
        return
    style = {"color": COLOURS[number % len(COLOURS)], "marker": MARKS[number % len(MARKS)]}
    x = np.array([row.x for row in rows])
    median = np.array([row.median for row in rows])
    tail = np.array([np.nan if row.p99 is None else row.p99 for row in rows])
    label = name if fit is None else f"{name}: slope {fit.words}"
    panel.plot(x, np.where(median > 0.0, median, np.nan), linestyle="none", label=label, **style)
    panel.plot(x, np.where(tail > 0.0, tail, np.nan), linewidth=0.7, color=style["color"], alpha=0.45)
    if fit is not None:
        ends = np.array([fit.first, fit.last])
        panel.plot(ends, fit.factor * ends**fit.slope, color=style["color"], linewidth=1.1)
