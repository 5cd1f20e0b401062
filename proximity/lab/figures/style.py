"""Style of all figures: for a column or a page of a journal, readable without colours.

A kind of wall has the same stroke in every figure. Colours are Okabe and Ito's, which people who are blind
to some tell apart; dashes and marks tell the strokes apart in grey. Nothing here touches matplotlib's state
beyond the block that draws. Matplotlib is imported when it is needed.
"""

import io
import os
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proximity.errors import ArgumentError
from proximity.lab.figures.tables import Table
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN_WIDTH = 3.4  # inches, the width of a journal's column
SAMPLING = 1e-4  # s, of the curves
PAGE_WIDTH = 7.0  # inches, of both columns
FORMATS = ("png", "svg", "pdf")
DOTS_PER_INCH = 300

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
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same on every machine
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


def load_figure() -> "type[Figure]":
    """Return matplotlib's class of figures."""
    with needed("figures need", "sim"):
        try:
            figure: type[Figure] = import_module("matplotlib.figure").Figure
        except ValueError as unfit:  # of MPLBACKEND, though nothing is shown
            raise ArgumentError(f"figures need matplotlib, which cannot be used ({unfit})") from unfit
    return figure


def check_format(form: str) -> None:
    """Refuse what is no format of figures."""
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
) -> bytes:
    """Return a figure as the bytes of a file; the same table gives the same bytes."""
    check_format(form)
    new_figure = load_figure()
    dates: dict[str, Any] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with _look(look or {}):
        figure = new_figure(figsize=size, layout="constrained")
        draw(figure, table)
        stream = io.BytesIO()
        figure.savefig(stream, format=form, dpi=DOTS_PER_INCH, metadata=dates[form])
    return stream.getvalue()


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file, at once and wholly; one that is there is replaced."""
    with whole_file(path) as stream:
        stream.write(content)


def write_table(path: str | os.PathLike[str], table: Table) -> None:
    """Write a table as CSV, at once and wholly; a file that is there is replaced."""
    text = io.StringIO()
    table.write_csv(text)
    write_bytes(Path(path), text.getvalue().encode())


def letter_panels(panels: "Iterable[Axes]", captions: Iterable[str]) -> None:
    """Put (a), (b) and so on, and what they show, above panels."""
    for letter, panel, caption in zip("abcdefgh", panels, captions, strict=False):
        panel.set_title(f"({letter}) {caption}", loc="left")


def legend_above(figure: "Figure", panel: "Axes", columns: int) -> None:
    """Put a panel's legend above all panels, where it covers nothing."""
    handles, names = panel.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=columns)


def _look(own: dict[str, Any]) -> AbstractContextManager[None]:
    context: AbstractContextManager[None] = import_module("matplotlib").rc_context({**LOOK, **own})
    return context
