"""Shared parts of all figures, which are tables of plotted numbers, strokes, captions, rendering and writing.

A figure fits a column or a page of a journal and is readable without colours. It is drawn from a table, so
that its CSV file contains exactly the plotted numbers. Columns are in SI units, and their names end in the
unit, as ``time_s`` and ``force_N``. A kind of wall has the same stroke in every figure. Colours are those of
Okabe and Ito, which are distinct for the colour-blind, and dashes and marks distinguish the strokes in grey.
Matplotlib's state is unchanged outside the block that draws. Matplotlib is imported on first use.
"""

import csv
import io
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.errors import ArgumentError
from proximity.lab.simulation.devices import Hand
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN_WIDTH = 3.4  # inches, the width of a journal's column
SAMPLING = 1e-4  # s, of the curves
PAGE_WIDTH = 7.0  # inches, of both columns
PANEL_WIDTH, PANEL_HEIGHT = 2.25, 1.8  # inches; narrower panels are stacked with this height
FORMATS = ("png", "svg", "pdf")
DOTS_PER_INCH = 300
M_PER_INCH = 0.0254
CAPTION_SIZE = 5.5  # points
LETTERS_AN_INCH = 23  # of that size, about
TITLE_LETTERS_AN_INCH = 17  # of panel titles, approximately
LABEL_WIDTH = 0.4  # inch: labels at the side of a panel
CAPTION_COLOUR = "0.35"

Stroke = dict[str, Any]

REAL: Stroke = {"color": "black", "linestyle": "-"}
COUPLED: Stroke = {"color": "#D55E00", "linestyle": (0, (5, 2)), "marker": "s"}
NAIVE: Stroke = {"color": "#999999", "linestyle": (0, (3, 1, 1, 1, 1, 1)), "marker": "v"}
LATCHED: Stroke = {"color": "#CC79A7", "linestyle": (0, (1, 1)), "marker": "^"}
FEED_FORWARD: Stroke = {
    "color": "#56B4E9",
    "linestyle": (0, (6, 2, 1, 2)),
    "marker": "D",
    "markersize": 6.0,
    "markerfacecolor": "white",
}
TIME_STAMPED: Stroke = {"color": "#0072B2", "linestyle": "-", "marker": "o"}
FLOOR: Stroke = {"color": "black", "linestyle": (0, (1, 3))}
SERIES: tuple[Stroke, ...] = (
    TIME_STAMPED,
    COUPLED,
    {**FEED_FORWARD, "markersize": 3.2, "markerfacecolor": "#56B4E9"},
    LATCHED,
)
GUIDE: Stroke = {"color": "0.6", "linestyle": ":", "linewidth": 0.6, "zorder": 0.5}

LOOK = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # included in matplotlib, so that it is the same on every machine
    "font.size": 7.5,
    "axes.labelsize": 7.5,
    "axes.titlesize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.2,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "proximity",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True, slots=True)
class Sheet:
    """Printed size of a figure. Text has the same size at any width."""

    width: float | None = None  # m; None: as designed
    has_caption: bool = True


AS_DESIGNED = Sheet()


class Table:
    """Table of named columns of equal length."""

    def __init__(self, columns: Mapping[str, ArrayLike]) -> None:
        self.columns = {name: np.asarray(values) for name, values in columns.items()}
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ArgumentError(f"columns have lengths {lengths}, expected one length")

    @classmethod
    def of_rows(cls, names: Sequence[str], rows: Iterable[Sequence[float | str]]) -> "Table":
        """Return a table from column names and rows."""
        return cls(dict(zip(names, zip(*rows, strict=True), strict=True)))

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column."""
        return self.columns[name]

    def where(self, **values: float | str) -> "Table":
        """Return the rows in which the named columns have the given values."""
        is_meant = np.logical_and.reduce([self.columns[name] == value for name, value in values.items()])
        return Table({name: column[is_meant] for name, column in self.columns.items()})

    def write_csv(self, stream: TextIO) -> None:
        """Write a line of column names and a line per row as CSV. Reading a number gives the same number."""
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))


def load_figure() -> "type[Figure]":
    """Return matplotlib's class of figures."""
    with needed("figures need", "sim"):
        try:
            figure: type[Figure] = import_module("matplotlib.figure").Figure
        except ValueError as unfit:  # of MPLBACKEND, though no window is shown
            raise ArgumentError(f"figures need matplotlib, which cannot be used ({unfit})") from unfit
    return figure


def check_format(form: str) -> None:
    """Raise an error for an unknown format of figures."""
    if form not in FORMATS:
        raise ArgumentError(f"no figures of format {form!r}, expected one of {', '.join(FORMATS)}")


def line(stroke: Stroke) -> Stroke:
    """Return a stroke without its marks, for curves of many points."""
    return {name: value for name, value in stroke.items() if not name.startswith("marker")}


def render(
    draw: "Callable[[Figure, Any], None]",
    table: Any,
    size: tuple[float, float],
    form: str,
    *,
    look: dict[str, Any] | None = None,
    sheet: Sheet = AS_DESIGNED,
) -> bytes:
    """Return a figure as the bytes of a file. The same table gives the same bytes."""
    check_format(form)
    new_figure = load_figure()
    dates: dict[str, Any] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with _look(look or {}):
        scale = 1.0 if sheet.width is None else sheet.width / M_PER_INCH / size[0]
        figure = new_figure(figsize=(scale * size[0], scale * size[1]), layout="constrained")
        draw(figure, table)
        if not sheet.has_caption:
            figure.supxlabel("")
        if is_narrow(figure):
            _heighten(figure)
        stream = io.BytesIO()
        figure.savefig(stream, format=form, dpi=DOTS_PER_INCH, metadata=dates[form])
    return stream.getvalue()


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file atomically, replacing an existing one."""
    with whole_file(path) as stream:
        stream.write(content)


def write_table(path: str | os.PathLike[str], table: Table) -> None:
    """Write a table as CSV atomically, replacing an existing file."""
    text = io.StringIO()
    table.write_csv(text)
    write_bytes(Path(path), text.getvalue().encode())


def is_narrow(figure: "Figure", across: int = 2) -> bool:
    """Return whether a figure is too narrow for *across* panels side by side."""
    return bool(figure.get_figwidth() < across * PANEL_WIDTH)


def panels_across(figure: "Figure", count: int, *, share: bool = True) -> "list[Axes]":
    """Return *count* panels, side by side or stacked if the figure is too narrow."""
    if not is_narrow(figure, max(count, 2)):
        return list(figure.subplots(1, count, sharex=share, sharey=share, squeeze=False).flat)
    figure.set_figheight(count * PANEL_HEIGHT)
    return list(figure.subplots(count, 1, sharex=share, sharey=share, squeeze=False).flat)


def label_shared(panels: "Iterable[Axes]", x: str, y: str) -> None:
    """Label axes that panels share, on the outer panels only."""
    for panel in panels:
        panel.set(xlabel=x, ylabel=y)
        panel.label_outer()


def letter_panels(panels: "Iterable[Axes]", captions: Iterable[str]) -> None:
    """Write a letter, such as (a), and a caption above each panel."""
    for letter, panel, title in zip("abcdefgh", panels, captions, strict=False):
        spec = panel.get_subplotspec()
        assert spec is not None, "panels are in a grid"
        grid = spec.get_gridspec()
        figure: Any = panel.get_figure()
        width = figure.get_figwidth() / grid.ncols - LABEL_WIDTH
        most = int(TITLE_LETTERS_AN_INCH * width)
        panel.set_title("\n".join(_wrapped(f"({letter}) {title}", most)), loc="left")


def legend_above(figure: "Figure", panel: "Axes", columns: int) -> None:
    """Draw a panel's legend above all panels."""
    legend_of(figure, *panel.get_legend_handles_labels(), columns)


def legend_of(figure: "Figure", handles: Sequence[Any], names: Sequence[str], columns: int) -> None:
    """Draw a legend above all panels, in at most *columns* columns."""
    for fewer in range(columns, 0, -1):
        legend = figure.legend(handles, names, loc="outside upper center", ncols=fewer)
        if fewer == 1 or legend.get_window_extent().width < figure.bbox.width:
            return
        legend.remove()


def caption(figure: "Figure", *lines: str) -> None:
    """Draw text below a figure."""
    most = int(LETTERS_AN_INCH * figure.get_figwidth())
    wrapped = [part for line in lines for part in _wrapped(line, most)]
    figure.supxlabel("\n".join(wrapped), fontsize=CAPTION_SIZE, color=CAPTION_COLOUR)


def hand_words(hand: Hand) -> str:
    """Return a text about pad, finger and hand."""
    return (
        f"Pad {hand.pad_stiffness:g} N/m, {hand.pad_damping:g} N·s/m (Springer and Ferrier); finger "
        f"{1e3 * hand.finger_mass:g} g, hand {hand.stiffness:g} N/m, {hand.damping:g} N·s/m (ours)"
    )


def gears_words(drum: Drum) -> str:
    """Return a text about the shared properties of drums that are named by their gear."""
    return f"{drum.motor.name}, total gear ratio as named, {1e3 * drum.lever:.0f} mm lever"


def drum_words(drum: Drum) -> str:
    """Return a text about a drum and its effect at the fingertip."""
    return (
        f"drum {drum.words}: {1e3 * drum.mass:.0f} g, servo at {1e-3 * SERVO_RATE:g} kHz, encoder "
        f"{1e6 * drum.resolution:.1f} µm with the wall at random within a count (ours)"
    )


def _wrapped(text: str, most: int) -> list[str]:
    """Wrap a text into lines, without a break between a number and its unit."""
    lines = textwrap.wrap(re.sub(r"(?<=\d) (?=[^\W\d])", "\u00a0", text), most, break_on_hyphens=False)
    return [line.replace("\u00a0", " ") for line in lines]


def _heighten(figure: "Figure") -> None:
    """Add the height of legend and caption to a figure, so that its panels keep their height."""
    texts = [*figure.legends, *figure.texts]
    taken = sum(each.get_window_extent().height for each in texts) / figure.dpi
    figure.set_figheight(figure.get_figheight() + taken)


def _look(own: dict[str, Any]) -> AbstractContextManager[None]:
    context: AbstractContextManager[None] = import_module("matplotlib").rc_context({**LOOK, **own})
    return context
