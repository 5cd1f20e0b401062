"""Plots of FIG 5a to 5h of the paper: the finger as each wall knows it, and the force it feels."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from proximity.studies.figures import style
from proximity.studies.figures.captions import caption
from proximity.studies.figures.tables import Table
from proximity.studies.paper import figure_5
from proximity.studies.paper.figure_5 import DELAY, FIGURES, GAIN_SHARE, PENETRATED, PRESS, SIMULATED
from proximity.studies.paper.reacting_operator import critical_gain, react
from proximity.studies.paper.spring_damper import FINGER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (style.COLUMN_WIDTH, 3.1)
PAGE_SIZE = (style.PAGE_WIDTH, 6.6)
POSITIONS_SHOWN = (-2.0, 10.5)  # mm; before and after, the finger is on its path
POSITION_TICKS = (0, 4, 8)  # mm
FORCES_SHOWN = (-0.06, 1.75)  # N; the same but for 5f, so that figures compare
CAPTIONS = {
    "5a": "real wall",
    "5b": "penetration of 4 mm, no delay",
    "5c": "penetration of 4 mm, and 40 ms of delay",
    "5d": "40 ms of delay, no penetration",
    "5e": "force experienced by penetration alone",
    "5f": "operator reacts, 40 ms late",
    "5g": "as 5c, soft: 100 N/m in all",
    "5h": "as 5c, lightly damped: 1 N·s/m in all",
}

PARAMETERS = (
    f"Finger {FINGER.stiffness:g} N/m and {FINGER.damping:g} N·s/m (the paper's), {1e3 * FINGER.mass:g} g;",
    f"touch at {PRESS.speed:g} m/s, pressed {1e3 * PRESS.depth:g} mm on the real wall (ours).",
)
DASHES = "Where curves coincide, the dashes lie on the black line."
REACTION = f"5f: draws back by {GAIN_SHARE:g} times the stable gain (ours); negative forces are 0."


def numbers(name: str) -> Table:
    """Return the curves of one of the figures.

    Parameters
    ----------
    name : str
        ``"5a"`` and so on.
    """
    times = figure_5.sample_times(style.SAMPLING)
    columns = {
        "time_s": times,
        "real_position_m": PRESS.at(times).position,
        "real_force_N": figure_5.real_wall(times),
    }
    if name != "5a":
        columns["position_m"] = position(name, times)
        columns["force_N"] = FIGURES[name](times)
    return Table(columns)


def position(name: str, times: np.ndarray) -> np.ndarray:
    """Return where a finger is on its wall at some instants, (T,), m: not late, as the force may be.

    Parameters
    ----------
    name : str
        ``"5a"`` and so on.
    times : (T,) float64, s
        When.
    """
    if name == "5f":
        gain = GAIN_SHARE * critical_gain(FINGER, DELAY)
        reaction = react(PENETRATED, FINGER, gain, DELAY, end=float(times[-1]) + DELAY)
        return reaction.position[np.searchsorted(reaction.times, times, side="right") - 1]
    wall = SIMULATED.get("5b" if name == "5e" else name)
    if wall is None:
        return PRESS.at(times).position
    return PRESS.deeper(wall.penetration).at(times).position


def all_numbers() -> Table:
    """Return the curves of all eight figures."""
    times = figure_5.sample_times(style.SAMPLING)
    curves = {f"{name}_force_N": FIGURES[name](times) for name in FIGURES}
    return Table({"time_s": times, **curves})


def drawer(name: str) -> "Callable[[Figure, Table], None]":
    """Return what draws one of the figures: positions above, forces below.

    Parameters
    ----------
    name : str
        ``"5a"`` and so on.
    """

    def draw(figure: "Figure", table: Table) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 3))
        times = 1e3 * table["time_s"]
        above.plot(times, 1e3 * table["real_position_m"], **style.REAL)
        below.plot(times, table["real_force_N"], **style.REAL, label="real wall")
        if name != "5a":
            stroke = style.line(style.COUPLED)
            shown = {"5e": "simulated wall, as in 5b", "5f": "reacting operator"}.get(name, "simulated wall")
            above.plot(times, 1e3 * table["position_m"], **stroke)
            below.plot(times, table["force_N"], **stroke, label=shown)
            style.legend_above(figure, below, 2)
        above.set_ylim(*POSITIONS_SHOWN)
        above.set_yticks(POSITION_TICKS)
        for instant, event in ((PRESS.touch_time, " touch"), (PRESS.loss_time, " leaves")):
            above.text(1e3 * instant, POSITIONS_SHOWN[1], event, va="top", fontsize=6.5, color="0.35")
        above.set_ylabel("position [mm]")
        above.set_title(f"FIG {name}  {CAPTIONS[name]}", loc="left")
        highest = 1.05 * float(table["force_N"].max()) if name == "5f" else FORCES_SHOWN[1]
        below.set_ylim(FORCES_SHOWN[0], highest)
        below.set_ylabel("force [N]")
        below.set_xlabel("time [ms]")
        below.set_xlim(0.0, times[-1])
        _mark_events(above, below)
        last = {"5a": (), "5f": (REACTION, DASHES)}.get(name, (DASHES,))
        caption(figure, *PARAMETERS, *last)

    return draw


def draw_all(figure: "Figure", table: Table) -> None:
    """Draw the forces of all eight figures on a page.

    Parameters
    ----------
    figure : Figure
        Empty.
    table : Table
        As of `all_numbers`.
    """
    panels = figure.subplots(4, 2, sharex=True, sharey=True).ravel()
    times, real = 1e3 * table["time_s"], table["5a_force_N"]
    for panel, name in zip(panels, FIGURES, strict=True):
        panel.plot(times, real, **style.REAL, label="real wall")
        if name != "5a":
            label = "simulated wall"
            panel.plot(times, table[f"{name}_force_N"], **style.line(style.COUPLED), label=label)
        _mark_events(panel)
    style.letter_panels(panels, (CAPTIONS[name] for name in FIGURES))
    panels[0].set_ylim(*FORCES_SHOWN)
    for panel in panels[::2]:
        panel.set_ylabel("force [N]")
    for panel in panels[-2:]:
        panel.set_xlabel("time [ms]")
        panel.set_xlim(0.0, times[-1])
    style.legend_above(figure, panels[1], 2)
    cut = f"Above {FORCES_SHOWN[1]:g} N they are cut off: the highest is {table['5f_force_N'].max():.1f} N."
    dotted = "Dotted: the finger touches, and leaves, the real wall."
    caption(figure, f"{' '.join(PARAMETERS)} {dotted} {DASHES}", f"{REACTION} {cut}")


def _mark_events(*panels: "Axes") -> None:
    """Touch, and loss of the real wall."""
    for panel in panels:
        for instant in (PRESS.touch_time, PRESS.loss_time):
            panel.axvline(1e3 * instant, **style.GUIDE)
