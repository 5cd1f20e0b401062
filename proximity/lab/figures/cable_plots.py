"""Plot of what the cable between hand and replica costs, over its stiffness."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.glove.glove import Glove
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption, drum_words, hand_words
from proximity.lab.simulation import sweeps
from proximity.lab.simulation.closed_loop import coupled_wall, decaff
from proximity.lab.simulation.devices import FRICTION, PRELOAD, WRAP, Decaff, Hand, TipCable
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.sweeps import Stretch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS = Glove()
STIFFNESSES = tuple(np.geomspace(200.0, 1e5, 13).tolist())  # N/m, at the fingertip
SPEEDS = (0.1, 0.5)  # m/s
RATE, LATENCY = 1000.0, 0.001  # Hz, s
SIZE = (style.PAGE_WIDTH, 3.6)
CURVES = {
    "left": (Stretch.LEFT, style.COUPLED, "not compensated"),
    "torque": (Stretch.TORQUE, style.TIME_STAMPED, "compensated by torque"),
    "sensor": (Stretch.SENSOR, style.LATCHED, "compensated by sensor"),
    "slippery": (Stretch.SENSOR, style.SERIES[2], "sensor, no sheath friction"),
}


def numbers(glove: Glove = OURS) -> Table:
    """Return force errors and forces at rest over the stiffness of the cable, a row a speed and stiffness."""
    hand, drum = Hand(), Decaff.of(glove)
    usual, coupled = TipCable.of(glove), sweeps.best_coupled_wall(hand, RATE, LATENCY)
    rows = []
    for speed in SPEEDS:
        press = hand.press(speed)
        bounds = [
            deviation(each).error for each in (coupled_wall(hand, press, coupled), decaff(hand, press, drum))
        ]
        for stiffness in STIFFNESSES:
            found = []
            for name, (stretch, _, _) in CURVES.items():
                cable = TipCable(stiffness) if name == "slippery" else replace(usual, stiffness=stiffness)
                one = deviation(decaff(hand, press, sweeps.with_transmission(drum, cable, stretch)))
                found += [one.error, one.steady_error]
            rows.append((speed, stiffness, usual.stiffness, *found, *bounds))
    columns = [f"{name}_{what}" for name in CURVES for what in ("error", "steady_error_N")]
    names = (
        "speed_m_per_s",
        "stiffness_N_per_m",
        "glove_N_per_m",
        *columns,
        "coupled_error",
        "no_cable_error",
    )
    return Table.of_rows(names, rows)


def draw(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw force errors over the stiffness of the cable, a panel a speed, and the force at rest."""
    panels = style.panels_across(figure, len(SPEEDS) + 1, share=False)
    for panel, speed in zip(panels, SPEEDS, strict=False):
        rows = table.where(speed_m_per_s=speed)
        across = rows["stiffness_N_per_m"]
        for name, (_, stroke, label) in CURVES.items():
            panel.plot(across, 100.0 * rows[f"{name}_error"], **stroke, label=label)
        panel.plot(
            across,
            100.0 * rows["coupled_error"],
            **style.line(style.REAL),
            label="best coupled wall",
        )
        panel.plot(across, 100.0 * rows["no_cable_error"], **style.FLOOR, label="drum, no cable")
        panel.set_yscale("log")
        panel.set_ylim(1.0, 70.0)
        panel.set_yticks([1, 3, 10, 30], ["1", "3", "10", "30"])
        panel.minorticks_off()
        panel.set_ylabel("force error [%]")
    slow = table.where(speed_m_per_s=SPEEDS[0])
    for name, (_, stroke, _) in CURVES.items():
        panels[-1].plot(slow["stiffness_N_per_m"], 1e3 * slow[f"{name}_steady_error_N"], **stroke)
    panels[-1].set_ylabel("error of force at rest [mN]")
    usual = float(table["glove_N_per_m"][0])
    for panel in panels:
        panel.set_xscale("log")
        panel.axvline(usual, **style.GUIDE)
        panel.set_xlabel("cable stiffness [N/m]")
    caption(
        figure,
        f"Errors: against the real wall. Dotted: the glove's cable of {1e-3 * glove.cable.stiffness:g} N/mm, "
        f"{usual:.0f} N/m at the fingertip; friction {FRICTION:g} over {np.degrees(WRAP):.0f}°, "
        f"preload {PRELOAD:g} N (ours). "
        f"{hand_words(Hand())}; {drum_words(glove.tip_drum())}; distances at {1e-3 * RATE:g} kHz, "
        f"{1e3 * LATENCY:g} ms late. Compensated: the stretch of the cable, by the motor's torque or a "
        "force sensor. The coupled wall has no cable. In (c) both sensor curves lie on one another.",
    )
    captions = [f"approach at {speed:g} m/s" for speed in SPEEDS]
    style.letter_panels(panels, [*captions, f"at rest, {SPEEDS[0]:g} m/s"])
    style.legend_above(figure, panels[0], 3)
