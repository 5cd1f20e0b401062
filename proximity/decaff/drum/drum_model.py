"""Model of the contact drum: motor, gear, friction, limits, encoder, pulse width.

All that acts at the rim is given there, behind the gear, so that a drum compares with the finger it stops: a
gear of n multiplies the motor's force by n, and the mass of its rotor by n². What drives it is in `servo`.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from proximity.decaff.arguments import finite, not_negative, positive, whole
from proximity.decaff.drum import drum_kernels as kernels

RIM_RADIUS = 0.010  # m; assumed
REFERENCE_SHARE = 0.5  # of the force limit, that the reference's acceleration may ask for; assumed
PHASE_SEED = 29  # of walls that lie at random within an encoder count
PAD_STIFFNESS = 200.0  # N/m, of a fingertip; the paper's


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor of the 20 W class, at its own shaft."""

    inertia: float = 1.5e-6  # kg m², of the rotor; assumed: 15 g at the rim
    torque: float = 0.28  # N m, at most; assumed: 28 N at the rim
    speed: float = 1000.0  # rad/s, at most; assumed: 1 m/s behind a gear of 10
    friction: float = (
        4.5e-4  # N m; assumed: with it, 0.045 N at the rim, drums settle as science/drum.md says
    )
    encoder_counts: int = 2000  # a turn; assumed: 31 µm at the rim
    duty_bits: int = 0  # of the pulse width, either way; 0: continuous
    electrical_time: float = 0.0  # s, inductance over resistance; 0: the current follows at once
    current_bandwidth: float = 1000.0  # Hz, of the current's loop; assumed

    def __post_init__(self) -> None:
        positive("inertia", self.inertia, "kilogram square metres")
        positive("torque", self.torque, "newton metres")
        positive("speed", self.speed, "radians a second")
        not_negative("friction", self.friction, "newton metres")
        whole("encoder_counts", self.encoder_counts, 1)
        whole("duty_bits", self.duty_bits, 0)
        not_negative("electrical_time", self.electrical_time, "seconds")
        positive("current_bandwidth", self.current_bandwidth, "hertz")


@dataclass(frozen=True, slots=True)
class Drum:
    """A motor, a gear and a rim; what is given of it holds at the rim."""

    motor: Motor = field(default_factory=Motor)
    ratio: float = 1.0  # turns of the motor to one of the drum
    radius: float = RIM_RADIUS  # m
    gear_limit: float = 100.0  # N, that its teeth and bearings carry; assumed
    usable_acceleration: float | None = (
        None  # m/s², of the reference; None: half of what the force limit allows
    )
    encoder_phase: float = 0.0  # of a count, by which one lies beyond the position 0

    def __post_init__(self) -> None:
        positive("ratio", self.ratio, "turns to a turn")
        positive("radius", self.radius, "metres")
        positive("gear_limit", self.gear_limit, "newtons")
        finite("encoder_phase", self.encoder_phase, "counts")
        if self.usable_acceleration is not None:
            positive("usable_acceleration", self.usable_acceleration, "metres a second squared")

    @property
    def mass(self) -> float:
        """Mass of the rotor as felt at the rim, kg."""
        return self.motor.inertia * (self.ratio / self.radius) ** 2

    @property
    def force_limit(self) -> float:
        """At the rim, N."""
        return min(self.motor.torque * self.ratio / self.radius, self.gear_limit)

    @property
    def speed_limit(self) -> float:
        """At the rim, m/s."""
        return self.motor.speed * self.radius / self.ratio

    @property
    def friction(self) -> float:
        """Coulomb friction at the rim, N."""
        return self.motor.friction * self.ratio / self.radius

    @property
    def resolution(self) -> float:
        """Resolution of the encoder at the rim, m."""
        return 2.0 * math.pi * self.radius / (self.motor.encoder_counts * self.ratio)

    @property
    def force_step(self) -> float:
        """Step by which the pulse width changes the force, N; 0: continuous."""
        bits = self.motor.duty_bits
        return self.motor.torque * self.ratio / self.radius / 2.0**bits if bits else 0.0

    @property
    def acceleration(self) -> float:
        """Acceleration of the servo's reference, m/s²."""
        if self.usable_acceleration is not None:
            return self.usable_acceleration
        return REFERENCE_SHARE * self.force_limit / self.mass

    def motor_torque(self, force: float) -> float:
        """Return the torque of the motor for a force at the rim, N m at its shaft; no more than it may.

        Parameters
        ----------
        force : float, N
            At the rim, of either sign; infinite: all there is.
        """
        most = self.force_limit
        return min(max(force, -most), most) * self.radius / self.ratio

    def motor_speed(self, speed: float) -> float:
        """Return the speed of the motor for one of the rim, rad/s at its shaft; no more than it has.

        Parameters
        ----------
        speed : float, m/s
            Of the rim, of either sign.
        """
        most = self.speed_limit
        return min(max(speed, -most), most) * self.ratio / self.radius

    def as_array(self) -> np.ndarray:
        """Return its numbers as the kernels read them."""
        array = np.zeros(kernels.DRUM_SIZE)
        array[kernels.DRUM_MASS] = self.mass
        array[kernels.DRUM_FRICTION] = self.friction
        array[kernels.DRUM_FORCE_LIMIT] = self.force_limit
        array[kernels.DRUM_SPEED_LIMIT] = self.speed_limit
        array[kernels.DRUM_RESOLUTION] = self.resolution
        array[kernels.DRUM_FORCE_STEP] = self.force_step
        array[kernels.DRUM_OFFSET] = self.encoder_phase * self.resolution
        array[kernels.DRUM_STALL_FORCE] = self.motor.torque * self.ratio / self.radius
        array[kernels.DRUM_ELECTRICAL_TIME] = self.motor.electrical_time
        array[kernels.DRUM_CURRENT_RATE] = 2.0 * math.pi * self.motor.current_bandwidth
        return array


def with_random_phases(drum: Drum, count: int) -> list[Drum]:
    """Return the same drum several times, each with its encoder's counts elsewhere; the same on every run.

    Parameters
    ----------
    drum : Drum
        As it is.
    count : int
        How many.
    """
    phases = np.random.default_rng(PHASE_SEED).uniform(-0.5, 0.5, count)
    return [replace(drum, encoder_phase=float(phase)) for phase in phases]


DIRECT = Drum(usable_acceleration=800.0)  # m/s², assumed; half the force would give 933 m/s²
GEAR4 = Drum(ratio=4.0)
GEAR10 = Drum(ratio=10.0)
DRUMS = {"direct": DIRECT, "gear4": GEAR4, "gear10": GEAR10}
