"""Coverage of a calibration's intervals on a drum with more effects than the fitted model.

    python bench/calibration.py [--gloves 20] [--drum gear51]

`SimulatedGlove` responds to a chirp with the fitted model: inertia, Coulomb and viscous friction, a spring.
Here the drum also has friction proportional to its gear's load, stiction and cogging. The table has, for each
number, the share of 95 % intervals that contain the true value with either drum, and the median error.
"""

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from proximity.decaff.calibration.drum_chirp import HELD_BEND
from proximity.decaff.calibration.readings import Readings
from proximity.decaff.calibration.results import Session
from proximity.decaff.calibration.simulated_glove import (
    RATE,
    SimulatedGlove,
)
from proximity.decaff.calibration.tasks import Bench
from proximity.decaff.glove.glove import Glove, with_gear

STICTION, STRIBECK_SPEED = 1.4, 0.3  # friction at rest over that in motion; rad/s of the transition
COGGING, TEETH = 0.15, 14  # of the friction; periods per turn of the rotor
STEPS = 12  # of the plant, to a sample
SHOWN = ("drum_mass", "drum_friction", "drum_latency", "cable_stiffness")


class RicherGlove(SimulatedGlove):
    """A simulated glove with gear friction proportional to its load, stiction, and cogging."""

    def _swung(self, plant: np.ndarray, times: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Return the angles of the richer drum, (N,), rad, from rest at 0."""
        mass, friction, viscous, stiffness, damping = plant[0].tolist()
        step, loss = 1.0 / (RATE * STEPS), self._drum.loss
        teeth, cogging = TEETH * self._drum.gear.ratio, COGGING * friction
        angle = speed = 0.0
        angles = []
        for torque in np.interp(times - self._drum_latency, times, torques, left=0.0).tolist():
            angles.append(angle)
            for _ in range(STEPS):
                reaction = min(0.0, stiffness * angle + damping * speed) if stiffness and angle < 0.0 else 0.0
                slides = 1.0 + (STICTION - 1.0) * math.exp(-((speed / STRIBECK_SPEED) ** 2))
                held = (friction * slides + loss * abs(reaction)) / mass * step
                pull = torque - viscous * speed - reaction + cogging * math.sin(teeth * angle)
                free = speed + pull / mass * step
                speed = math.copysign(max(abs(free) - held, 0.0), free)
                angle += speed * step
        return np.array(angles)


def _errors(kind: type[SimulatedGlove], design: Glove, gloves: int) -> dict[str, np.ndarray]:
    """Return errors of each number, (gloves, 2): as shares of the half-width and of the true value."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in SHOWN}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(gloves):
            glove = kind(seed, design)
            session = Session(
                Bench(glove.instruments, design), Readings(Path(folder) / f"{seed}.json", "richer"), ()
            )
            while (asked := session.next()) is not None:
                session.take(asked, lambda part, asked=asked, glove=glove: glove.prepare(asked, part))
            for one in session.estimates():
                if one.key in found:
                    truth = glove.truth[one.key]
                    found[one.key].append(((one.value - truth) / one.half_width, one.value / truth - 1.0))
    return {name: np.array(rows) for name, rows in found.items()}


def main() -> None:
    """Print the coverage with the model's drum and with the richer one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gloves", type=int, default=20)
    parser.add_argument("--drum", default="gear51")
    options = parser.parse_args()
    design = with_gear(Glove(), options.drum)
    print(f"{options.gloves} gloves, {options.drum}, bend {HELD_BEND:g}")
    print(f"{'':18}{'the model':>22}{'the richer drum':>24}")
    tables = [_errors(kind, design, options.gloves) for kind in (SimulatedGlove, RicherGlove)]
    for name in SHOWN:
        cells = []
        for table in tables:
            rows = table[name]
            inside = np.count_nonzero(np.abs(rows[:, 0]) <= 1.0)
            cells.append(f"{inside:3d} of {len(rows)}, {100 * np.median(rows[:, 1]):+6.1f} %")
        print(f"{name:18}{cells[0]:>22}{cells[1]:>24}")


if __name__ == "__main__":
    main()
