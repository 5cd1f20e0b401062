"""Plots of a drum's arrival: its motion to a target, and the look-ahead that it needs before a wall."""

from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.controller.served_drum import move, settling_time
from proximity.decaff.drum.drum_model import Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, servo_for
from proximity.decaff.glove.glove import Glove, tip_drums
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption, gears_words, hand_words
from proximity.lab.simulation.devices import Decaff, Hand, Sensing
from proximity.lab.simulation.sweeps import (
    ARRIVED_WITHIN,
    GRID,
    arrival_time,
    look_ahead,
    needed_look_ahead,
    with_latency,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAVEL = 0.030  # m, from where a drum waits
DURATION = 0.080  # s, of the ways shown
SPEEDS = (0.1, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0)  # m/s
LATENCIES = (0.001, 0.010, 0.040)  # s
MOTION_SIZE = (style.COLUMN_WIDTH, 2.8)
SIZE = (style.PAGE_WIDTH, 3.1)
OURS = Glove()
STROKES = (style.COUPLED, style.TIME_STAMPED, style.LATCHED, style.NAIVE)  # of gears in their order


def _placed(glove: Glove) -> dict[str, Drum]:
    """Drums with the wall at random within a count of their encoder."""
    return {name: with_random_phases(drum, 1)[0] for name, drum in tip_drums(glove).items()}


def motion_numbers(glove: Glove = OURS) -> Table:
    """Return how far each drum is from its position after it was sent there, and when it stays there."""
    instants = np.arange(round(DURATION / style.SAMPLING) + 1) * style.SAMPLING
    columns = {"time_s": instants}
    for name, drum in _placed(glove).items():
        servo = servo_for(drum, SERVO_RATE)
        times, positions = move(drum, servo, TRAVEL, DURATION + style.SAMPLING)
        columns[f"{name}_left_m"] = TRAVEL - np.interp(
            instants, np.append(0.0, times), np.append(0.0, positions)
        )
        at_rest = settling_time(drum, servo, TRAVEL, within=ARRIVED_WITHIN)
        columns[f"{name}_settled_s"] = np.full(len(instants), at_rest)
    return Table(columns)


def draw_motion(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw the ways of the drums, as of `motion_numbers`."""
    panel, drums = figure.subplots(), tip_drums(glove)
    for name, stroke in zip(drums, STROKES, strict=False):
        at_rest = float(table[f"{name}_settled_s"][0])
        label = f"{name}, {1e3 * at_rest:.1f} ms"
        panel.plot(1e3 * table["time_s"], 1e3 * table[f"{name}_left_m"], **style.line(stroke), label=label)
        panel.plot(1e3 * at_rest, 1e3 * ARRIVED_WITHIN, color=stroke["color"], marker=stroke["marker"])
    panel.axhline(0.0, **style.GUIDE)
    panel.set_xlim(0.0, 1e3 * DURATION)
    panel.set_xlabel("time [ms]")
    panel.set_ylabel("left to go [mm]")
    panel.legend(title="marks: within 0.1 mm after", title_fontsize=7, loc="upper right")
    servos = {name: servo_for(drum, SERVO_RATE) for name, drum in drums.items()}
    caption(
        figure,
        f"{1e3 * TRAVEL:g} mm from rest to rest, nothing in the path; servos at {1e-3 * SERVO_RATE:g} kHz; "
        "the target is at random within a count of the encoder (ours). At rest all lie on one another. "
        f"{gears_words(glove.tip_drum())}.",
        *(
            f"{name}: {1e3 * drums[name].mass:.0f} g, {1e-3 * servo.stiffness:.3g} kN/m, "
            f"{servo.damping:.0f} N·s/m; up to {servo.acceleration:.0f} m/s², {servo.speed:.2g} m/s; swings "
            f"{-1e3 * table[f'{name}_left_m'].min():.1f} mm past"
            for name, servo in servos.items()
        ),
    )


def numbers(glove: Glove = OURS) -> Table:
    """Return the look-ahead that each drum needs, found by simulated presses and by the formula."""
    hand, rows = Hand(), []
    for name, drum in _placed(glove).items():
        worn = Decaff(drum)
        for latency in LATENCIES:
            reported = with_latency(worn, latency)
            arrival = arrival_time(drum, worn.servo, TRAVEL)
            rows += [
                (
                    name,
                    latency,
                    speed,
                    needed_look_ahead(hand, reported, speed),
                    look_ahead(speed, reported.sensing, arrival),
                )
                for speed in SPEEDS
            ]
    names = ("drum", "latency_s", "speed_m_per_s", "look_ahead_m", "formula_m")
    return Table.of_rows(names, rows)


def draw(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw the look-ahead over speed, a panel a latency, as of `numbers`."""
    panels = style.panels_across(figure, len(LATENCIES))
    for panel, latency in zip(panels, LATENCIES, strict=True):
        for name, stroke in zip(tip_drums(glove), STROKES, strict=False):
            rows = table.where(drum=name, latency_s=latency)
            panel.plot(rows["speed_m_per_s"], 1e3 * rows["formula_m"], **style.line(stroke))
            found = {"color": stroke["color"], "marker": stroke["marker"], "linestyle": "none"}
            panel.plot(rows["speed_m_per_s"], 1e3 * rows["look_ahead_m"], **found)
            panel.plot([], [], **stroke, label=f"drum {name}")
        panel.set_xlim(0.0, 1.05)
    panels[0].plot([], [], "k+", label="marks: simulated")
    panels[0].plot([], [], **style.REAL, label="lines: v (τ + 1/f + t)")
    panels[0].set_ylim(bottom=0.0)
    style.label_shared(panels, "speed of approach [m/s]", "look-ahead needed [mm]")
    style.letter_panels(panels, (f"{1e3 * latency:g} ms of latency" for latency in LATENCIES))
    style.legend_above(figure, panels[0], 5)
    caption(
        figure,
        f"v: speed, τ: latency, f: {Sensing().rate:g} Hz of distances, t: time of arrival after "
        f"{1e3 * TRAVEL:g} mm by the formula. Simulated in steps of {1e3 * GRID:g} mm: the drum is within "
        f"{1e3 * ARRIVED_WITHIN:g} mm as the link comes.",
        f"{hand_words(Hand())}; {gears_words(glove.tip_drum())}; servos at "
        f"{1e-3 * SERVO_RATE:g} kHz, the wall at random within a count of the encoder, no cable "
        "(ours). At low speed marks of several drums lie on one another.",
    )
