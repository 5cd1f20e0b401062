"""Plot of the stability region of the sampled wall of equation (1) for several sample delays."""

from typing import TYPE_CHECKING

import numpy as np

from proximity.decaff.drum.sampled_mass import Gains, SampledMass, maximum_stiffness
from proximity.lab.figures import style
from proximity.lab.figures.style import Table, caption
from proximity.lab.stability import boundary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DELAYS = (0, 1, 2, 3)  # samples
PAPER_WALL = Gains(stiffness=3900.0, damping=60.0)  # the paper's, "marginally stable" at d = 1
SIZE = (style.PAGE_WIDTH, 2.9)


def numbers() -> Table:
    """Return the edges of the stability regions, and the stiffest wall of each."""
    pieces = []
    for delay in DELAYS:
        device = SampledMass(delay_samples=delay)
        stiffness, damping = boundary(device)
        stiffest = maximum_stiffness(device)
        pieces.append((delay, "edge", damping, stiffness))
        pieces.append((delay, "stiffest", np.array([stiffest.damping]), np.array([stiffest.stiffness])))
    return Table(
        {
            "delay_samples": np.concatenate([np.full(len(one[2]), one[0]) for one in pieces]),
            "kind": np.concatenate([np.full(len(one[2]), one[1]) for one in pieces]),
            "damping_N_s_per_m": np.concatenate([one[2] for one in pieces]),
            "stiffness_N_per_m": np.concatenate([one[3] for one in pieces]),
        }
    )


def draw(figure: "Figure", table: Table) -> None:
    """Draw all regions in one panel, and the small ones enlarged in another."""
    whole, part = style.panels_across(figure, 2, share=False)
    for panel, delays in ((whole, DELAYS), (part, DELAYS[1:])):
        for delay in delays:
            _region(panel, table, delay)
        panel.plot(
            PAPER_WALL.damping,
            1e-3 * PAPER_WALL.stiffness,
            "k*",
            markersize=7,
            linestyle="none",
            label="the paper's wall: 3900 N/m, 60 N·s/m",
        )
        panel.set_xlim(left=0.0)
        panel.set_ylim(bottom=0.0)
        panel.locator_params(axis="y", nbins=6)
        panel.set_xlabel("damping [N·s/m]")
        panel.set_ylabel("stiffness [kN/m]")
    style.letter_panels((whole, part), ("stable below the line; mark: stiffest wall", "the same, d = 1 to 3"))
    style.legend_above(figure, whole, 5)
    device = SampledMass()
    caption(
        figure,
        f"Wall of equation (1): a mass of {device.mass:g} kg at {1.0 / device.period:g} Hz (the paper's); d: "
        "samples from a measurement to its force, 1 in equation (1). Computed from the roots (ours).",
    )


def _region(panel: "Axes", table: Table, delay: int) -> None:
    edge = table.where(delay_samples=delay, kind="edge")
    stiffest = table.where(delay_samples=delay, kind="stiffest")
    stroke = style.line(style.SERIES[delay])
    damping, stiffness = edge["damping_N_s_per_m"], 1e-3 * edge["stiffness_N_per_m"]
    panel.fill_between(damping, stiffness, color=stroke["color"], alpha=0.08, linewidth=0.0)
    panel.plot(damping, stiffness, **stroke)
    panel.plot([], [], **style.SERIES[delay], label=f"d = {delay}")
    panel.plot(
        stiffest["damping_N_s_per_m"],
        1e-3 * stiffest["stiffness_N_per_m"],
        **(style.SERIES[delay] | {"linestyle": "none"}),
    )
