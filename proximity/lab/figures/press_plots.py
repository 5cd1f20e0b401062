"""Plot of one simulated press: finger, link and drum, and the force beside the real wall's."""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from proximity.lab.figures import style
from proximity.lab.figures.style import AS_DESIGNED, COINCIDE, Sheet, Table, caption, hand_words
from proximity.lab.simulation.closed_loop import Response
from proximity.lab.simulation.simulated_press import Simulation, Wall, describe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (style.COLUMN_WIDTH, 4.4)
BEFORE = 40.0  # ms shown before the contact
AFTER = 30.0  # ms shown after the hand has left
MARGIN = 1.0  # mm, above and below what finger and wall do
DEEPEST = -4.0  # mm: farther off, the finger is on its path
IMPULSE = 5.0  # ms around the touch, whose errors do not set the scale
HEADROOM = 1.2
STROKES = {
    Wall.REAL: style.REAL,
    Wall.COUPLED: style.COUPLED,
    Wall.DECAFF: {**style.TIME_STAMPED, "linestyle": (0, (3, 1))},
}


def numbers(simulation: Simulation) -> Table:
    """Return a press about every 0.1 ms, and the same on a real wall."""
    return curves(simulation.response, simulation.real, has_drum=simulation.setup.wall == Wall.DECAFF)


def curves(response: Response, real: Response, *, has_drum: bool, ideal: Response | None = None) -> Table:
    """Return a press about every 0.1 ms, in whole steps, beside others at the same instants."""
    stride = max(round(style.SAMPLING / response.step), 1)
    every = slice(response.zero % stride, None, stride)  # the contact among them
    times = response.times[every]
    columns = {
        "time_s": times,
        "intent_m": response.press.at(times).position,
        "finger_m": response.finger[every],
        "link_m": response.link[every],
        "force_N": response.force[every],
        "real_finger_m": real.finger[every],
        "real_force_N": real.force[every],
    }
    if has_drum:
        columns |= {"drum_m": response.drum[every], "drum_force_N": response.contact[every]}
    if ideal is not None:
        columns["ideal_force_N"] = ideal.force[every]
    return Table(columns)


def draw(figure: "Figure", table: Table, wall: Wall, note: str = "") -> None:
    """Draw a press: positions, forces, and how far the force is off."""
    above, below, error = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    times, stroke = 1e3 * table["time_s"], style.line(STROKES[wall])
    is_there = table["finger_m"] >= 1e-3 * DEEPEST
    above.plot(times, 1e3 * table["finger_m"], **stroke, label="finger")
    for name, dashes in (("link", (0, (1, 1))), ("drum", (0, (6, 2, 1, 2)))):
        if f"{name}_m" in table.columns and wall != Wall.REAL:
            above.plot(times, 1e3 * table[f"{name}_m"], color="0.45", linestyle=dashes, label=name)
    below.plot(times, table["real_force_N"], **style.REAL, label="real wall")
    is_engine, largest, is_rest = "ideal_force_N" in table.columns, 0.0, np.abs(times) > IMPULSE
    extremes: list[float] = []  # mN, of the errors
    curves = [("ideal_force_N", style.line(style.COUPLED), "ideal distance")] if is_engine else []
    curves += [("force_N", stroke, "engine" if is_engine else f"{wall} wall")] if wall != Wall.REAL else []
    for column, own, label in curves:
        off = 1e3 * (table[column] - table["real_force_N"])
        below.plot(times, table[column], **own, label=label)
        error.plot(times, off, **own)
        largest = max(largest, float(np.abs(off[is_rest]).max(initial=0.0)))
        extremes += [float(off.min()), float(off.max())]
    for panel in (above, error):
        panel.axhline(0.0, **style.GUIDE)
    largest = largest or 1.0
    error.set_ylim(-HEADROOM * largest, HEADROOM * largest)
    if extremes and max(map(abs, extremes)) > HEADROOM * largest:
        beyond = f"cut off at the touch: from {min(extremes):.0f} to {max(extremes):.0f} mN"
        error.set_title(beyond, loc="right", fontsize=6.5, color=style.CAPTION_COLOUR)
    top = 1e3 * max(float(np.max(table[name])) for name in ("finger_m", "link_m"))
    above.set_ylim(DEEPEST - MARGIN, top + MARGIN)
    above.set_xlim(max(-BEFORE, times[0]), float(times[is_there][-1]) + AFTER)
    for panel, label in ((above, "past the wall [mm]"), (below, "force [N]"), (error, "error [mN]")):
        panel.set_ylabel(label)
    error.set_xlabel("time after the touch [ms]")
    above.legend(loc="lower center", ncols=3)
    below.legend(loc="lower center")
    caption(figure, *note.splitlines(), COINCIDE)


def write(path: str | os.PathLike[str], simulation: Simulation, sheet: Sheet = AS_DESIGNED) -> None:
    """Write a press to a file, as a figure or as CSV, at once and wholly."""
    note = f"{describe(simulation)}\n{simulation.setup.speed:g} m/s. {hand_words(simulation.response.hand)}"
    write_curves(path, numbers(simulation), simulation.setup.wall, note, sheet)


def write_curves(
    path: str | os.PathLike[str], table: Table, wall: Wall, note: str = "", sheet: Sheet = AS_DESIGNED
) -> None:
    """Write curves to a file, as a figure or as CSV, at once and wholly."""
    form = Path(path).suffix.lower().removeprefix(".")
    if form == "csv":
        style.write_table(path, table)
        return
    drawn = style.render(partial(draw, wall=wall, note=note), table, SIZE, form, sheet=sheet)
    style.write_bytes(path, drawn)
