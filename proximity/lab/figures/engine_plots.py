"""Plots of the force error with the engine in the loop, against speed and latency."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.lab.engine.engine_loop import EngineSetup, press_on_part
from proximity.lab.engine.finger_placement import place_finger
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption, drum_words, hand_words
from proximity.lab.simulation.closed_loop import ideal_drum
from proximity.lab.simulation.devices import Decaff, Hand
from proximity.lab.simulation.metrics import deviation, drum_offset
from proximity.lab.simulation.target_policies import Target
from proximity.scene.loader import load
from proximity.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OURS = Glove()
SPEEDS = tuple(np.geomspace(0.1, 1.0, 5).tolist())  # m/s
LATENCIES = (0.0, 0.001, 0.003, 0.010)  # s, from a pose until its frame has arrived
START_POSITION = (0.048, 0.030, 0.020)  # m: the finger comes from there to the foot of the bracket
START_DISTANCE = 0.050  # m from the touch, where the hand begins: a drum arrives in time
READINGS = {"controller": None, "latched": Target.LATCHED}
CAPTIONS = {
    "controller": "controller: each distance with its own pose",
    "latched": "each distance with the present position",
}
SIZE = (style.PAGE_WIDTH, 3.5)


def bracket() -> Scene:
    """Return the sample bracket: beside the package in a checkout, inside of it where it was installed."""
    package = Path(__file__).resolve().parents[2]
    for folder in (package / "samples", package.parent / "meshes"):
        if (folder / "bracket.stl").is_file():
            return load(folder / "bracket.stl")
    raise ArgumentError(f"the sample bracket.stl is neither in {package} nor in meshes beside it")


def numbers(glove: Glove = OURS) -> Table:
    """Return force errors of both readings, a row a reading, latency and speed."""
    hand, finger, drum = Hand(), place_finger(bracket(), START_POSITION), Decaff.of(glove).drum
    rows = []
    for speed in SPEEDS:
        press = hand.press(speed)
        ideal = press_on_part(
            finger, press, EngineSetup(drum=drum, start_distance=START_DISTANCE).ideal, hand
        ).error.share
        floor = deviation(ideal_drum(hand, press)).error
        for name, reading in READINGS.items():
            for latency in LATENCIES:
                setup = EngineSetup(
                    latency=latency, reading=reading, drum=drum, start_distance=START_DISTANCE
                )
                felt = press_on_part(finger, press, setup, hand)
                rows.append(
                    (
                        name,
                        latency,
                        speed,
                        felt.error.share,
                        ideal,
                        floor,
                        felt.error.onset,
                        drum_offset(felt.response),
                        felt.reported_contact,
                        felt.reported_error,
                    )
                )
    names = (
        "reading",
        "latency_s",
        "speed_m_per_s",
        "engine_error",
        "ideal_error",
        "ideal_drum_error",
        "onset_s",
        "drum_offset_m",
        "told_contact_m",
        "told_error_m",
    )
    return Table.of_rows(names, rows)


def draw(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw force errors over speed, a panel a reading, as of `numbers`."""
    panels = style.panels_across(figure, len(READINGS))
    for panel, name in zip(panels, READINGS, strict=True):
        _panel(panel, table, name)
    style.label_shared(panels, "speed of approach [m/s]", "force error [%]")
    panels[0].set_ylim(1.0, 150.0)
    panels[0].set_yticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    style.letter_panels(panels, (CAPTIONS[name] for name in READINGS))
    style.legend_above(figure, panels[0], 3)
    setup = EngineSetup()
    caption(
        figure,
        f"Force error: against the real wall. Sample bracket, tracker at {1e-3 * setup.rate:g} kHz, "
        f"0 to 10 ms from a pose to its frame. "
        f"{hand_words(Hand())}; {drum_words(glove.tip_drum())}; no cable. "
        "In (a) the four latencies lie on one another; so do, from 0.2 m/s on, both lines without marks.",
    )


def _panel(panel: "Axes", table: Table, name: str) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    for latency, stroke in zip(LATENCIES, style.SERIES, strict=False):
        rows = table.where(reading=name, latency_s=latency)
        label = f"engine, {1e3 * latency:g} ms"
        panel.plot(rows["speed_m_per_s"], 100.0 * rows["engine_error"], **stroke, label=label)
    ideal = table.where(reading=name, latency_s=LATENCIES[0])
    speeds = ideal["speed_m_per_s"]
    panel.plot(speeds, 100.0 * ideal["ideal_error"], **style.REAL, zorder=1.5, label="ideal distance")
    panel.plot(speeds, 100.0 * ideal["ideal_drum_error"], **style.FLOOR, label="drum that never moves")
    panel.minorticks_off()
    panel.set_xticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
