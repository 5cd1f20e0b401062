"""Plots of FIG 5a to 5h of the paper, with the finger's position on each wall and the force on it."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption
from proximity.lab.paper import figure_5
from proximity.lab.paper.figure_5 import (
    DELAY,
    FIGURES,
    GAIN_SHARE,
    PENETRATED,
    PRESS,
    SIMULATED,
    critical_gain,
    react,
)
from proximity.lab.paper.walls import FINGER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (style.COLUMN_WIDTH, 3.1)
PAGE_SIZE = (style.PAGE_WIDTH, 8.8)
NARROW_HEIGHT = 7.2  # inches, of all eight in one column
POSITIONS_SHOWN = (-2.0, 10.5)  # mm; before and after, the finger is on its path
POSITION_TICKS = (0, 4, 8)  # mm
FORCES_SHOWN = (-0.06, 1.75)  # N; the same except for 5f, so that figures are comparable
CAPTIONS = {
    "5a": "real wall",
    "5b": "penetration of 4 mm",
    "5c": "4 mm, and 40 ms of delay",
    "5d": "40 ms of delay alone",
    "5e": "force felt, as 5b",
    "5f": "operator reacts 40 ms late",
    "5g": "as 5c, 100 N/m in all",
    "5h": "as 5c, 1 N·s/m in all",
}

PARAMETERS = (
    f"Finger {FINGER.stiffness:g} N/m and {FINGER.damping:g} N·s/m (Springer and Ferrier), "
    f"{1e3 * FINGER.mass:g} g;",
    f"touch at {PRESS.speed:g} m/s, pressed {1e3 * PRESS.depth:g} mm on the real wall (ours).",
)
DASHES = "Where curves coincide, the dashes lie on the black line."
REACTION = f"5f: draws back by {GAIN_SHARE:g} times the stable gain (ours); negative forces are 0."


def numbers(name: str) -> Table:
    """Return the curves of one of the figures, such as ``"5a"``."""
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
    """Return the position of a finger on its wall at some instants, (T,), m, without the force's delay."""
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
    columns = {"time_s": times}
    for name in FIGURES:
        columns[f"{name}_position_m"] = position(name, times)
        columns[f"{name}_force_N"] = FIGURES[name](times)
    return Table(columns)


def drawer(name: str) -> "Callable[[Figure, Table], None]":
    """Return the drawing function of a figure, such as ``"5a"``, with positions above and forces below."""

    def draw(figure: "Figure", table: Table) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 3))
        real = table["real_position_m"], table["real_force_N"]
        simulated = None if name == "5a" else (table["position_m"], table["force_N"])
        _draw_pair(above, below, name, table["time_s"], real, simulated)
        if simulated is not None:
            style.legend_above(figure, below, 2)
        for instant, event in ((PRESS.touch_time, " touch"), (PRESS.loss_time, " leaves")):
            above.text(1e3 * instant, POSITIONS_SHOWN[1], event, va="top", fontsize=6.5, color="0.35")
        above.set_ylabel("position [mm]")
        above.set_title(f"FIG {name}  {CAPTIONS[name]}", loc="left")
        below.set_ylabel("force [N]")
        below.set_xlabel("time [ms]")
        last = {"5a": (), "5f": (REACTION, DASHES)}.get(name, (DASHES,))
        caption(figure, *PARAMETERS, *last)

    return draw


def draw_all(figure: "Figure", table: Table) -> None:
    """Draw positions and forces of all eight figures on a page, from the table of `all_numbers`."""
    if style.is_narrow(figure):
        figure.set_figheight(NARROW_HEIGHT)
    grid = figure.subplots(8, 2, sharex=True, height_ratios=(2, 3) * 4)
    pairs = [(grid[row, column], grid[row + 1, column]) for row in range(0, 8, 2) for column in range(2)]
    real = table["5a_position_m"], table["5a_force_N"]
    for (above, below), name in zip(pairs, FIGURES, strict=True):
        simulated = None if name == "5a" else (table[f"{name}_position_m"], table[f"{name}_force_N"])
        _draw_pair(above, below, name, table["time_s"], real, simulated)
    for above, below in pairs[::2]:
        above.set_ylabel("x [mm]")
        below.set_ylabel("F [N]")
    for _, below in pairs[-2:]:
        below.set_xlabel("time [ms]")
    style.letter_panels([above for above, _ in pairs], (CAPTIONS[name] for name in FIGURES))
    style.legend_above(figure, pairs[1][1], 2)
    dotted = "Dotted: the finger touches, and leaves, the real wall."
    other = "5f has another scale of forces."
    caption(figure, f"{' '.join(PARAMETERS)} {dotted} {DASHES}", f"{REACTION} {other}")


def _draw_pair(
    above: "Axes",
    below: "Axes",
    name: str,
    times: np.ndarray,
    real: tuple[np.ndarray, np.ndarray],
    simulated: tuple[np.ndarray, np.ndarray] | None,
) -> None:
    """Draw positions, m, above and forces, N, below, of a real and a simulated wall at *times*, s."""
    above.plot(1e3 * times, 1e3 * real[0], **style.REAL)
    below.plot(1e3 * times, real[1], **style.REAL, label="real wall")
    if simulated is not None:
        shown = {"5e": "simulated wall, as in 5b", "5f": "reacting operator"}.get(name, "simulated wall")
        above.plot(1e3 * times, 1e3 * simulated[0], **style.line(style.COUPLED))
        below.plot(1e3 * times, simulated[1], **style.line(style.COUPLED), label=shown)
    above.set_ylim(*POSITIONS_SHOWN)
    above.set_yticks(POSITION_TICKS)
    highest = 1.05 * float(simulated[1].max()) if simulated is not None and name == "5f" else FORCES_SHOWN[1]
    below.set_ylim(FORCES_SHOWN[0], highest)
    below.set_xlim(0.0, 1e3 * float(times[-1]))
    _mark_events(above, below)


def _mark_events(*panels: "Axes") -> None:
    """Mark the touch and the loss of the real wall."""
    for panel in panels:
        for instant in (PRESS.touch_time, PRESS.loss_time):
            panel.axvline(1e3 * instant, **style.GUIDE)
