"""The controller in C connected to a simulated plant that is not part of the package."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from compiling_c import c_compiler

from proximity.decaff.drum.drum_model import GEARS, Motor

PLANT = Path(__file__).with_name("clients") / "drum_in_plant.c"
POWERED, UNPOWERED = 1.0, 1.25  # mJ, limits of the energy of a hit
WRITE = """
import sys
from proximity.decaff.controller.chip_sources import write_controller
from proximity.decaff.controller.settings import ControllerSettings
from proximity.decaff.glove.glove import DRUMS, Glove
write_controller([Glove()], sys.argv[1], ControllerSettings(drum=DRUMS[sys.argv[2]]))
"""


def built(folder, gear, root=PLANT.parents[3], options=("-O2",)):
    """Compile a program of a gear's drum with the controller of the checkout *root*."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-W", "ignore", "-c", WRITE, folder, gear]
    subprocess.run(command, check=True, cwd=root, env={"PYTHONPATH": str(root)}, stderr=subprocess.DEVNULL)
    motor, geared = Motor(), GEARS[gear]
    numbers = {
        "INERTIA": motor.inertia + geared.inertia, "STALL": motor.torque, "SPEED": motor.speed,
        "FRICTION": motor.friction, "CONTINUOUS": motor.continuous_torque,
        "ELECTRICAL_TIME": motor.electrical_time, "CURRENT_RATE": 2.0 * math.pi * motor.current_bandwidth,
        "ENCODER_COUNTS": motor.encoder_counts, "RATIO": geared.ratio, "EFFICIENCY": geared.efficiency,
        "BACKLASH": geared.backlash,
    }  # fmt: skip
    macros = [f"-D{name}={number!r}" for name, number in numbers.items()]
    if "BRAKED" not in (folder / "decaff_controller.h").read_text():
        macros.append("-DBEFORE")
    sources = [PLANT, folder / "decaff_controller.c", folder / "decaff_glove.c"]
    program = folder / "plant"
    command = [c_compiler(), "-std=c99", *options, *macros, f"-I{folder}", *sources, "-lm", "-o", program]
    subprocess.run([*map(str, command)], check=True)
    return program


def said(program, *words):
    """Run a program; return its output as words per line."""
    done = subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True)
    return [line.split() for line in done.stdout.splitlines()]


def hits(program, seed, count):
    """Energies of all hits of *count* seeded presses, mJ: powered, and unpowered."""
    rows = np.array(said(program, "episodes", seed, count), np.float64)
    return rows[rows[:, 0] == 0.0, 1], rows[rows[:, 0] == 1.0, 1]


def hazards(program):
    """Result of each known hazard, by name."""
    return {name: float(numbers[0]) for name, *numbers in said(program, "hazards", 1)}
