"""Plots of the force error of coupled walls and drums against speed and latency."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.drum.servo import SERVO_RATE
from proximity.decaff.glove.glove import Glove
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption, drum_words, hand_words
from proximity.lab.simulation import sweeps
from proximity.lab.simulation.closed_loop import ideal_drum
from proximity.lab.simulation.devices import Decaff, Hand
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.target_policies import Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OURS = Glove()
RATE = 1000.0  # Hz, of walls and of distances
SPEEDS = tuple(np.geomspace(0.1, 1.0, 11).tolist())  # m/s
LATENCIES = tuple(1e-3 * np.array([0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30, 40]))  # s
STAIRS = 15  # of the servo's period, from half of one: drawn as steps; beyond, lines between points
STAIR_SIDE = 1e-6  # s, half the step between the two sides of a stair
SPEED_PANELS = (0.001, 0.010)  # s of latency, in the figure against speed
LATENCY_PANELS = (0.1, 0.5)  # m/s, in the figure against latency
SIZE = (style.PAGE_WIDTH, 3.4)
TARGETS = {
    "naive": Target.NAIVE,
    "latched": Target.LATCHED,
    "feed_forward": Target.FEED_FORWARD,
    "time_stamped": Target.TIME_STAMPED,
}
CURVES = (
    ("coupled", style.COUPLED, "coupled wall, best tuned"),
    ("naive", style.NAIVE, "drum, naive"),
    ("latched", style.LATCHED, "drum, latched"),
    ("feed_forward", style.FEED_FORWARD, "drum, feed-forward"),
    ("time_stamped", style.TIME_STAMPED, "drum, time-stamped"),
    ("ideal_drum", style.FLOOR, "drum that never moves"),
)


def numbers(latencies: Sequence[float], speeds: Sequence[float], glove: Glove = OURS) -> Table:
    """Return force errors, with a row per latency and speed. Each coupled wall is tuned for all speeds."""
    hand, speeds, drum = Hand(), tuple(speeds), Decaff.of(glove)
    floor = np.array([deviation(ideal_drum(hand, hand.press(speed))).error for speed in speeds])
    blocks = []
    for latency in latencies:
        wall = sweeps.best_coupled_wall(hand, RATE, latency)
        block = {
            "latency_s": np.full(len(speeds), latency),
            "speed_m_per_s": np.array(speeds),
            "coupled_stiffness_N_per_m": np.full(len(speeds), wall.stiffness),
            "coupled_damping_N_s_per_m": np.full(len(speeds), wall.damping),
            "coupled_error": sweeps.coupled_row(hand, wall, speeds=speeds).errors,
        }
        blocks.append(block | _drum_errors(hand, drum, latency, speeds) | {"ideal_drum_error": floor})
    return Table({name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]})


def _drum_errors(
    hand: Hand, glove: Decaff, latency: float, speeds: tuple[float, ...]
) -> dict[str, np.ndarray]:
    reported = sweeps.with_latency(glove, latency, RATE)
    return {
        f"{name}_error": sweeps.drum_row(hand, reported, target, speeds=speeds).errors
        for name, target in TARGETS.items()
    }


def numbers_against_speed(glove: Glove = OURS) -> Table:
    """Return force errors at many speeds and two latencies."""
    return numbers(SPEED_PANELS, SPEEDS, glove)


def numbers_against_latency(glove: Glove = OURS) -> Table:
    """Return force errors at many latencies and two speeds.

    The error of a drum is a step function of latency, since its servo reads a distance at its next sample.
    Each step therefore has a row on either side. The coupled wall is not tuned there, and is nan.
    """
    tuned = numbers(LATENCIES, LATENCY_PANELS, glove)
    hand, drum = Hand(), Decaff.of(glove)
    blocks = [tuned.columns]
    for stair in range(STAIRS):
        edge = (stair + 0.5) / SERVO_RATE
        for latency in (edge - STAIR_SIDE, edge + STAIR_SIDE):
            block = {name: np.full(len(LATENCY_PANELS), np.nan) for name in tuned.columns}
            block |= {
                "latency_s": np.full(len(LATENCY_PANELS), latency),
                "speed_m_per_s": np.array(LATENCY_PANELS),
                "ideal_drum_error": tuned["ideal_drum_error"][: len(LATENCY_PANELS)],
            }
            blocks.append(block | _drum_errors(hand, drum, latency, LATENCY_PANELS))
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in tuned.columns}
    order = np.argsort(columns["latency_s"], kind="stable")
    return Table({name: column[order] for name, column in columns.items()})


def draw_against_speed(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw force errors over speed with a panel per latency, from `numbers_against_speed`."""
    panels = style.panels_across(figure, len(SPEED_PANELS))
    for panel, latency in zip(panels, SPEED_PANELS, strict=True):
        rows = table.where(latency_s=latency)
        _curves(panel, rows["speed_m_per_s"], rows)
        panel.set_xticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
    style.letter_panels(panels, (f"{1e3 * latency:g} ms of latency" for latency in SPEED_PANELS))
    _finish(figure, panels, glove, "speed of approach [m/s]")


def draw_against_latency(figure: "Figure", table: Table, glove: Glove = OURS) -> None:
    """Draw force errors over latency with a panel per speed, from `numbers_against_latency`."""
    panels = style.panels_across(figure, len(LATENCY_PANELS))
    for panel, speed in zip(panels, LATENCY_PANELS, strict=True):
        rows = table.where(speed_m_per_s=speed)
        _curves(panel, 1e3 * rows["latency_s"], rows)
        ticks = [0.1, 0.3, 1.0, 3.0, 10.0, 40.0]
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    style.letter_panels(panels, (f"approach at {speed:g} m/s" for speed in LATENCY_PANELS))
    _finish(figure, panels, glove, "latency [ms]")


def _curves(panel: "Axes", across: np.ndarray, rows: Table) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    is_tuned = np.isfinite(rows["coupled_error"])
    for name, stroke, label in CURVES:
        errors = rows[f"{name}_error"]
        is_known = np.isfinite(errors)
        marked = np.flatnonzero(is_tuned[is_known]).tolist()
        panel.plot(across[is_known], 100.0 * errors[is_known], **stroke, label=label, markevery=marked)
    panel.minorticks_off()


def _finish(figure: "Figure", panels: "Sequence[Axes]", glove: Glove, across: str) -> None:
    style.label_shared(panels, across, "force error [%]")
    panels[0].set_ylim(1.0, 700.0)
    panels[0].set_yticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
    style.legend_above(figure, panels[0], 3)
    caption(
        figure,
        "Force error: rms of the difference over the real wall's rms, from the touch on. "
        f"{hand_words(Hand())}; {drum_words(glove.tip_drum())}; walls and distances at {1e-3 * RATE:g} "
        "kHz, no cable. Up to 20 ms, feed-forward (large diamonds) and time-stamped lie on one another, "
        "and near the drum that never moves.",
    )
