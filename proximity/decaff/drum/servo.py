"""Settings of a drum's servo, and commands of a controller to it.

The servo itself is C code that also runs on the chip. It holds the drum at its target as a sampled wall
would, and the stability of such a wall limits its stiffness (science/drum.md). It acts one sample late, plus
the motor's latency. Its reference is never faster than the drum can follow and still stop.
"""

import math
from dataclasses import dataclass, replace
from enum import IntEnum

from scipy.optimize import minimize_scalar

from proximity.checks import not_negative, positive
from proximity.decaff.drum import drum_kernels
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.sampled_mass import (
    Gains,
    SampledMass,
    characteristic,
    damping_window,
    maximum_stiffness,
    spectral_radius,
)
from proximity.errors import ArgumentError


class DriveMode(IntEnum):
    """State of the motor's driver."""

    FREE = drum_kernels.MODE_FREE
    """No power, and windings open."""
    POSITION = drum_kernels.MODE_POSITION
    FORCE = drum_kernels.MODE_FORCE
    BRAKED = drum_kernels.MODE_BRAKED
    """No power, and windings shorted, so that a moving drum brakes itself."""


@dataclass(frozen=True, slots=True)
class DrumCommand:
    """Command of a controller to the drum's servo for one sample."""

    mode: DriveMode = DriveMode.POSITION
    target: float = 0.0  # m, or N on the finger
    speed_cap: float = math.inf  # m/s, of the reference
    force_cap: float = math.inf  # N, of the motor
    start_force: float = math.nan  # N, force reference at a change to force; nan: 0, which is not bumpless

    force_slew: float = 0.0  # N/s, of the force reference; 0: the servo's default, inf: a step


SERVO_RATE = 3000.0  # Hz, default; assumed
DEADBAND_COUNTS = 0.5  # of the encoder
MAX_LAG = 5e-3  # m, lag of a drum with a latency behind an accelerating reference; assumed
INTEGRAL_TURN = 4.0  # rad of the servo's swing, integral time of a drum with a latency; assumed
FORCE_DAMPING_SHARE = 0.25  # of mass over latency, damping of a drum with a latency in force mode; assumed
WELL_DAMPED_SHARE = 0.2  # share of the largest stiffness at which a servo is well damped
SIMULATION_STEP = 1e-5  # s, of the plant, at most: 0.03 rad of a 5 g link's bounce on its drum


@dataclass(frozen=True, slots=True)
class Servo:
    """Settings of a drum's servo."""

    rate: float  # Hz
    stiffness: float  # N/m
    damping: float  # N s/m
    acceleration: float  # m/s², of the reference
    speed: float  # m/s, of the reference
    integral_time: float = 0.080  # s; assumed: gives the settling of drums in docs/science/drum.md
    force_gain: float = 10.0  # 1/s, of the force integrator; assumed: below damping over mass when held
    force_damping: float = 2.0  # N s/m, while the force is served; assumed
    force_slew: float = 5.0  # N/s, of the force reference
    smoothing: float = 20.0  # Hz, of the motor's force at the start of a change to force; assumed
    deadband: float = 0.0  # m, within which a reference at rest counts as reached, to prevent hunting

    def __post_init__(self) -> None:
        positive("rate", self.rate, "hertz")
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("acceleration", self.acceleration, "metres a second squared")
        positive("speed", self.speed, "metres a second")
        positive("integral_time", self.integral_time, "seconds", may_be_infinite=True)
        not_negative("force_gain", self.force_gain, "1/s")
        not_negative("force_damping", self.force_damping, "newton seconds a metre")
        positive("force_slew", self.force_slew, "newtons a second", may_be_infinite=True)
        positive("smoothing", self.smoothing, "hertz")
        not_negative("deadband", self.deadband, "metres")

    @property
    def period(self) -> float:
        """Period of a sample, s."""
        return 1.0 / self.rate


def best_damped(device: SampledMass, share: float = WELL_DAMPED_SHARE) -> Gains:
    """Return a share of the largest stable stiffness, and the damping that is best for it.

    It is the damping with which disturbances die out fastest.
    """
    if not positive("share", share, "shares") < 1.0:
        raise ArgumentError(f"share is {share!r}, expected one below 1 of the largest stiffness")
    stiffness = share * maximum_stiffness(device).stiffness
    found = minimize_scalar(
        lambda damping: float(spectral_radius(characteristic(device, stiffness, damping))),
        bounds=damping_window(device, stiffness),
        method="bounded",
        options={"xatol": 1e-9 * device.damping_unit},
    )
    return Gains(stiffness, float(found.x))


def servo_for(drum: Drum, rate: float) -> Servo:
    """Return the servo that suits a drum. It is best damped at a fifth of the largest stable stiffness."""
    period, latency = 1.0 / positive("rate", rate, "hertz"), drum.motor.latency
    gains = best_damped(SampledMass(drum.mass, period, 1 + math.ceil(latency / period - 1e-9)))
    servo = Servo(
        rate,
        gains.stiffness,
        gains.damping,
        drum.acceleration,
        drum.planned_speed,
        deadband=DEADBAND_COUNTS * drum.resolution,
    )
    if not latency > 0.0:
        return servo
    swing = math.sqrt(gains.stiffness / drum.mass)  # rad/s
    return replace(
        servo,
        acceleration=min(servo.acceleration, MAX_LAG * swing**2),
        integral_time=max(servo.integral_time, INTEGRAL_TURN / swing),
        force_damping=min(servo.force_damping, FORCE_DAMPING_SHARE * drum.mass / latency),
    )


def steps_a_sample(rate: float, step: float = SIMULATION_STEP) -> int:
    """Return the number of plant steps per sample for a step of at most *step* seconds."""
    return math.ceil(1.0 / (positive("rate", rate, "hertz") * positive("step", step, "seconds")) - 1e-9)
