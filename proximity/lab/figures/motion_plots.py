"""Plot of the motion of drums to a target."""

from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.controller.served_drum import move, settling_time
from proximity.decaff.drum.drum_model import Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, servo_for
from proximity.decaff.glove.glove import Glove, tip_drums
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption, gears_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAVEL = 0.030  # m, from the drum's waiting position
ARRIVED_WITHIN = 1e-4  # m, from the target
DURATION = 0.080  # s, of the motions shown
SIZE = (style.COLUMN_WIDTH, 2.8)
OURS = Glove()
STROKES = (style.COUPLED, style.TIME_STAMPED, style.LATCHED, style.NAIVE)  # of gears in their order


def _placed(glove: Glove) -> dict[str, Drum]:
    """Return drums by gear, with the wall at random within a count of the encoder."""
    return {name: with_random_phases(drum, 1)[0] for name, drum in tip_drums(glove).items()}


def numbers(glove: Glove = OURS) -> Table:
    """Return the distance of each drum from its target over time, and its settling time."""
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


def draw(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw the motions of the drums, from the table of `numbers`."""
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
