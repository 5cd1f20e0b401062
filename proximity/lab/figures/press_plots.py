"""Plot of one simulated press: finger, link and drum, and the force beside the real wall's."""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from proximity.lab.figures import style
from proximity.lab.figures.style import COINCIDE, Table, caption, hand_words
from proximity.lab.simulation.closed_loop import Response
from proximity.lab.simulation.simulated_press import Simulation, Wall, describe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (style.COLUMN_WIDTH, 4.4)
BEFORE = 40.0  # ms shown before the contact
AFTER = 30.0  # ms shown after the hand has left
MARGIN = 1.0  # mm, above and below what finger and wall do
DEEPEST = -4.0  # mm: farther off, the finger is on its path
STROKES = {
    Wall.REAL: style.REAL,
    Wall.COUPLED: style.COUPLED,
    Wall.DECAFF: {**style.TIME_STAMPED, "linestyle": (0, (3, 1))},
}


def numbers(simulation: Simulation) -> Table:
    """Return a press every 0.1 ms, and the same on a real wall."""
    return curves(simulation.response, simulation.real, has_drum=simulation.setup.wall == Wall.DECAFF)


def curves(response: Response, real: Response, *, has_drum: bool, ideal: Response | None = None) -> Table:
    """Return a press every 0.1 ms beside others at the same instants."""
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
    """Draw a press."""
    above, below, error = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    times, stroke = 1e3 * table["time_s"], style.line(STROKES[wall])
    is_there = table["finger_m"] >= 1e-3 * DEEPEST
    above.plot(times, 1e3 * table["finger_m"], **stroke, label="finger")
    for name, dashes in (("link", (0, (1, 1))), ("drum", (0, (6, 2, 1, 2)))):
        if f"{name}_m" in table.columns and wall != Wall.REAL:
            curve = 1e3 * table[f"{name}_m"]
            above.plot(times, curve, color="0.45", linestyle=dashes, label=name)
    below.plot(times, table["real_force_N"], **style.REAL, label="force, real wall")
    is_engine = "ideal_force_N" in table.columns
    if is_engine:
        ideal = style.line(style.COUPLED)
        below.plot(times, table["ideal_force_N"], **ideal, label="force, ideal distance")
    if wall != Wall.REAL:
        below.plot(
            times, table["force_N"], **stroke, label=f"force, {'engine' if is_engine else f'{wall} wall'}"
        )
        off = 1e3 * (table["force_N"] - table["real_force_N"])
        error.plot(times, off, **stroke)
    if is_engine:
        error.plot(times, 1e3 * (table["ideal_force_N"] - table["real_force_N"]), **ideal)
    for panel in (above, error):
        panel.axhline(0.0, **style.GUIDE)
    top = 1e3 * max(float(np.max(table[name])) for name in ("finger_m", "link_m"))
    above.set_ylim(DEEPEST - MARGIN, top + MARGIN)
    above.set_xlim(max(-BEFORE, times[0]), float(times[is_there][-1]) + AFTER)
    above.set_ylabel("position past the wall [mm]")
    below.set_ylabel("force [N]")
    error.set_ylabel("force error [mN]")
    error.set_xlabel("time after the touch [ms]")
    caption(figure, *note.splitlines(), COINCIDE)
    handles, names = above.get_legend_handles_labels()
    more, their = below.get_legend_handles_labels()
    figure.legend(handles + more, names + their, loc="outside upper center", ncols=3)


def write(path: str | os.PathLike[str], simulation: Simulation) -> None:
    """Write a press to a file, as a figure or as CSV, at once and wholly."""
    note = f"{describe(simulation)}\n{simulation.setup.speed:g} m/s. {hand_words(simulation.response.hand)}"
    write_curves(path, numbers(simulation), simulation.setup.wall, note)


def write_curves(path: str | os.PathLike[str], table: Table, wall: Wall, note: str = "") -> None:
    """Write curves to a file, as a figure or as CSV, at once and wholly."""
    form = Path(path).suffix.lower().removeprefix(".")
    if form == "csv":
        style.write_table(path, table)
        return
    drawn = style.render(partial(draw, wall=wall, note=note), table, SIZE, form)
    style.write_bytes(path, drawn)
