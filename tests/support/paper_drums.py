"""Drums of the reference values: a 20 W motor with gear ratios of 12.2, 48.8 and 122."""

from proximity.decaff.drum.drum_model import Drum, Gear, Motor
from proximity.decaff.glove.glove import Glove
from proximity.lab.simulation.devices import Decaff, Link

LEVER = Glove().tip_drum().lever
MOTOR = Motor(
    "20 W class", inertia=1.5e-6, torque=0.28, continuous_torque=0.0288, heating_time=12.6, speed=1000.0,
    friction=4.5e-4, electrical_time=0.0,
)  # fmt: skip


def paper_drum(ratio: float, **settings: float) -> Drum:
    """Return that motor with a lossless gear whose teeth carry 100 N at the fingertip."""
    return Drum(LEVER, MOTOR, Gear(f"{ratio:.3g}:1", ratio, torque=100.0 * LEVER), **settings)


GEAR12, GEAR49, GEAR122 = (
    paper_drum(100.0 * LEVER, usable_acceleration=800.0),
    paper_drum(400.0 * LEVER),
    paper_drum(1000.0 * LEVER),
)
PAPER_DRUMS = {"gear12": GEAR12, "gear49": GEAR49, "gear122": GEAR122}
PAPER_GLOVE = Decaff(GEAR49)
PAPER_DESIGN = Glove(motor=MOTOR, gear=GEAR49.gear)
PAPER_DEVICE = Link(mass=0.020, damping=0.05)  # link and rotor by which a coupled wall loads the finger


def steady_force(hand, depth, wall_stiffness):
    """Static force on a compliant wall, for a hand whose target is *depth* inside, N."""
    return depth / (1.0 / hand.series_stiffness + 1.0 / wall_stiffness)
