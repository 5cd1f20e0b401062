"""Devices of the closed loop: links, coupled walls, and gloves with a drum."""

import math
from dataclasses import dataclass, field

import numpy as np

from proximity.checks import finite, not_negative, positive, whole
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.errors import ArgumentError
from proximity.lab.simulation import loop_kernels
from proximity.lab.simulation.target_policies import Holding
from proximity.lab.simulation.tip_cable import TipCable


@dataclass(frozen=True, slots=True)
class Link:
    """The moving link of the replica, and the hardness of its touch of the drum."""

    mass: float = 0.005  # kg, at the fingertip; assumed
    damping: float = 0.0  # N s/m
    contact_stiffness: float = 50_000.0  # N/m; assumed
    contact_damping: float = 20.0  # N s/m; assumed: with it an ideal drum errs as docs/science/drum.md says

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kilograms")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("contact_stiffness", self.contact_stiffness, "newtons a metre")
        not_negative("contact_damping", self.contact_damping, "newton seconds a metre")


COUPLED_MOTOR = DRUMS["gear14"]
"""Of a traditional glove, which turns with the finger: with more gearing it would be felt more."""
COUPLED_DEVICE = Link(mass=Link().mass + COUPLED_MOTOR.mass, damping=0.05)
"""Link and rotor of a traditional glove, which hang on the finger; the damping is assumed."""


@dataclass(frozen=True, slots=True)
class CoupledWall:
    """A traditional wall: a spring and a damper on sampled positions, late, held, never pulling."""

    stiffness: float  # N/m
    damping: float  # N s/m, on the difference of two samples
    rate: float = 1000.0  # Hz
    latency: float = 0.001  # s, beyond sampling and holding
    resolution: float = COUPLED_MOTOR.resolution  # m, of its encoder

    def __post_init__(self) -> None:
        not_negative("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("rate", self.rate, "hertz")
        not_negative("latency", self.latency, "seconds")
        not_negative("resolution", self.resolution, "metres")


@dataclass(frozen=True, slots=True)
class Sensing:
    """Measurement of distances to the wall: rate, latency, range and errors."""

    rate: float = 1000.0  # Hz
    latency: float = 0.001  # s, from measurement to delivery
    reach: float = 0.100  # m, farther distances are not reported
    bias: float = 0.0  # m, added to each
    scale_error: float = 0.0  # share, by which each is too large
    noise: float = 0.0  # m, rms
    wall_speed: float = 0.0  # m/s, positive away from the finger
    resolution: float = 0.0  # m, of the potentiometer's reading of the link; 0: none
    phase: float = 0.5  # of a period, before the first measurement; assumed
    seed: int = 7

    def __post_init__(self) -> None:
        positive("rate", self.rate, "hertz")
        not_negative("latency", self.latency, "seconds")
        positive("reach", self.reach, "metres")
        finite("bias", self.bias, "metres")
        finite("scale_error", self.scale_error, "shares")
        not_negative("noise", self.noise, "metres")
        finite("wall_speed", self.wall_speed, "metres a second")
        not_negative("resolution", self.resolution, "metres")
        if not not_negative("phase", self.phase, "periods") < 1.0:
            raise ArgumentError(f"phase is {self.phase!r}, expected one below 1 of a period")
        whole("seed", self.seed, 0)

    def as_array(self) -> np.ndarray:
        """Return its numbers as the kernels read them."""
        array = np.zeros(loop_kernels.SENSING_SIZE)
        array[loop_kernels.SENSING_RATE] = self.rate
        array[loop_kernels.SENSING_LATENCY] = self.latency
        array[loop_kernels.SENSING_REACH] = self.reach
        array[loop_kernels.SENSING_BIAS] = self.bias
        array[loop_kernels.SENSING_SCALE_ERROR] = self.scale_error
        array[loop_kernels.SENSING_WALL_SPEED] = self.wall_speed
        array[loop_kernels.SENSING_PHASE] = self.phase
        array[loop_kernels.SENSING_RESOLUTION] = self.resolution
        return array

    def noises(self, duration: float) -> np.ndarray:
        """Return the error of each distance that is measured in so many seconds, m; the same on every run."""
        if self.noise == 0.0:
            return np.zeros(1)
        count = math.ceil(duration * self.rate) + 1
        return self.noise * np.random.default_rng(self.seed).standard_normal(count)


@dataclass(frozen=True, slots=True)
class Decaff:
    """A glove with a contact drum: what it is made of, and what it is given."""

    drum: Drum = DRUMS[USUAL_GEAR]
    servo: Servo = None  # type: ignore[assignment]  # None: the one that suits the drum, at 3 kHz
    link: Link = field(default_factory=Link)
    sensing: Sensing = field(default_factory=Sensing)
    holding: Holding = field(default_factory=Holding)
    cable: TipCable | None = None  # between finger and link; None: the finger holds the link itself

    def __post_init__(self) -> None:
        if self.servo is None:
            object.__setattr__(self, "servo", servo_for(self.drum, SERVO_RATE))

    @classmethod
    def of(cls, glove: Glove) -> "Decaff":
        """Return a glove's drum, with the wall at random within a count of its encoder, without its cable."""
        return cls(with_random_phases(glove.tip_drum(), 1)[0])
