"""Bodies of a press, which are the hand, walls, links, the cable to them, and gloves with a drum.

The hand's intent is a motion given in advance (`trajectories.Press`), through the surface of the wall to a
depth that is not reached. Springs and dampers connect intent and finger, and finger and surface. The contact
is at position 0 and time 0, and positions are positive into the wall.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from proximity.checks import finite, not_negative, positive, whole
from proximity.decaff.controller.settings import RELEASE_GAP, TOUCH_GAP
from proximity.decaff.drum.drum_model import PAD_STIFFNESS, USUAL_GEAR, Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import CONTACT_BEND, DRUMS, Glove
from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Press

STEADY_FORCE = 0.8  # N: a pad of 200 N/m pressed in by 4 mm
HOLD_TIME = 0.2  # s; assumed
FRICTION = 0.1  # of a cable in a lined sheath; assumed
WRAP = 0.5 * math.pi  # rad, all bends of the sheath together; assumed
PRELOAD = 1.0  # N, of both strands together, which keeps it taut; assumed
LOSS = 0.05  # of critical damping, of link and cable; assumed


@dataclass(frozen=True, slots=True)
class Hand:
    """Hand, finger and pad in series: intent - (spring, damper) - finger - (spring, damper) - surface."""

    stiffness: float = 300.0  # N/m, of hand and arm; assumed
    damping: float = 3.0  # N s/m; assumed
    finger_mass: float = 0.010  # kg; assumed
    pad_stiffness: float = PAD_STIFFNESS
    pad_damping: float = 6.0  # N s/m, the paper's

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("finger_mass", self.finger_mass, "kilograms")
        positive("pad_stiffness", self.pad_stiffness, "newtons a metre")
        not_negative("pad_damping", self.pad_damping, "newton seconds a metre")

    @property
    def series_stiffness(self) -> float:
        """Stiffness of hand and pad in series, N/m, which is the force per displacement of the wall."""
        return 1.0 / (1.0 / self.stiffness + 1.0 / self.pad_stiffness)

    def press(self, speed: float, *, hold: float = HOLD_TIME) -> Press:
        """Return an intent at a speed that exerts `STEADY_FORCE` on a rigid wall during the hold."""
        depth = STEADY_FORCE / self.series_stiffness
        rise = 2.0 * depth / positive("speed", speed, "metres a second")
        return Press(speed, depth, touch_time=0.0, release_time=rise + positive("hold", hold, "seconds"))


@dataclass(frozen=True, slots=True)
class TipCable:
    """Cable between finger and link, described by its effects at the fingertip."""

    stiffness: float  # N/m
    capstan: float = 0.0  # friction as a share of its tension
    drag: float = 0.0  # N, friction without tension
    loss: float = LOSS
    play: float = 0.0  # m, backlash of the finger before the link follows

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("capstan", self.capstan, "shares")
        not_negative("drag", self.drag, "newtons")
        not_negative("loss", self.loss, "shares")
        not_negative("play", self.play, "metres")

    @classmethod
    def of(
        cls, glove: Glove, bend: float = CONTACT_BEND, *, friction: float = FRICTION, wrap: float = WRAP
    ) -> "TipCable":
        """Return the cable of a glove at a bend."""
        capstan = math.expm1(not_negative("friction", friction, "shares") * not_negative("wrap", wrap, "rad"))
        tension_a_newton = float(glove.cable_tension(bend, 1.0))
        drag, play = capstan * PRELOAD / tension_a_newton, float(glove.tip_play(bend))
        return cls(float(glove.tip_stiffness(bend)), capstan, drag, play=play)

    def numbers(self, mass: float) -> tuple[float, ...]:
        """Return stiffness, damping, share and force of friction, and play. *mass*: of the link, kg."""
        damping = 2.0 * self.loss * math.sqrt(self.stiffness * mass)
        return self.stiffness, damping, self.capstan, self.drag, self.play


@dataclass(frozen=True, slots=True)
class Link:
    """Moving link of the replica, with the stiffness and damping of its contact with the drum."""

    mass: float = 0.005  # kg, at the fingertip; assumed
    damping: float = 0.0  # N s/m
    contact_stiffness: float = 50_000.0  # N/m; assumed
    contact_damping: float = 20.0  # N s/m; assumed: gives the error of an ideal drum in docs/science/drum.md

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kilograms")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("contact_stiffness", self.contact_stiffness, "newtons a metre")
        not_negative("contact_damping", self.contact_damping, "newton seconds a metre")


COUPLED_MOTOR = DRUMS["gear14"]
"""Motor of a traditional glove, which turns with the finger. With a larger gear ratio it would be felt more.
"""
COUPLED_DEVICE = Link(mass=Link().mass + COUPLED_MOTOR.mass, damping=0.05)
"""Link and rotor of a traditional glove, which the finger carries. The damping is assumed."""


@dataclass(frozen=True, slots=True)
class CoupledWall:
    """Traditional wall, which is a spring and a damper on sampled positions.

    Its force is delayed, held during a period, and never pulls.
    """

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
    """Measurement of distances to the wall, with its rate, latency, range and errors."""

    rate: float = 1000.0  # Hz
    latency: float = 0.001  # s, from measurement to delivery
    reach: float = 0.100  # m, maximum reported distance
    bias: float = 0.0  # m, added to each
    scale_error: float = 0.0  # relative error of each distance
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

    def noises(self, duration: float) -> np.ndarray:
        """Return the noise of each distance measured in *duration* seconds, m, equal on every run."""
        if self.noise == 0.0:
            return np.zeros(1)
        count = math.ceil(duration * self.rate) + 1
        return self.noise * np.random.default_rng(self.seed).standard_normal(count)


@dataclass(frozen=True, slots=True)
class Holding:
    """Rule by which the target of a drum is held, and the drum's waiting position."""

    retracted: float = 0.030  # m; assumed
    touch_gap: float = TOUCH_GAP  # m, of link and drum, below which they touch
    release_gap: float = RELEASE_GAP  # m, beyond which they are released
    compliance: float = 0.0  # m/N, of the cable, to compensate its stretch while a target is held; 0: off
    smoothing: float = 2.0  # Hz, of the force on the cable; from 10 Hz on, the motor's makes the drum swing
    has_force_sensor: bool = False  # between link and drum; else the motor's force is used

    def __post_init__(self) -> None:
        positive("retracted", self.retracted, "metres")
        positive("touch_gap", self.touch_gap, "metres")
        positive("release_gap", self.release_gap, "metres")
        not_negative("compliance", self.compliance, "metres a newton")
        positive("smoothing", self.smoothing, "hertz")


@dataclass(frozen=True, slots=True)
class Decaff:
    """Parts and settings of a glove with a contact drum."""

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
        """Return the drum of a glove, with the wall at random within a count of its encoder.

        The cable of the glove is left out.
        """
        return cls(with_random_phases(glove.tip_drum(), 1)[0])
