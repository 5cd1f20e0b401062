"""Motor and gear by their data sheets, and the resulting contact drum at the fingertip.

A radian of the drum is `lever` metres of fingertip, 0.12 on a hand. So a motor behind a gear of n acts there
with n / lever times its torque and (n / lever)² times its inertia. Only this module converts; the lever over
the whole bend is the glove's (`Glove.tip_drum`).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from proximity.checks import finite, not_negative, positive, whole
from proximity.decaff.drum import drum_kernels as kernels
from proximity.errors import ArgumentError

REFERENCE_SHARE = 0.5  # of the force limit, available to the reference's acceleration; assumed
PLANNED_SPEED_SHARE = 0.7  # of the motor's speed, used by the servo; assumed
MAX_LATENCY = 0.020  # s, of a motor: beyond, its servo is softer than a fingertip; assumed
PHASE_SEED = 29  # of walls at random positions within an encoder count
STICTION = 1.5  # ratio of the friction of a rotor at rest to that in motion; assumed
PAD_STIFFNESS = 200.0  # N/m, of a fingertip; the paper's
ARM_INERTIA = 1.6e-5  # kg m², of the arm: a roller of 10 g
ARM_FRICTION = 0.002  # N m; assumed
ARM_SPRING = 0.012  # N m, turns the arm away from the finger, against the gear's play; assumed
GEAR_STIFFNESS = 300.0  # N m/rad, of a gear at the end of its play; assumed
GEAR_DAMPING = 0.02  # N m s/rad; assumed
STOP_GAP = 0.1  # rad, from the retracted drum to its mechanical stop
STOP_STIFFNESS, STOP_DAMPING = 300.0, 1.4  # N m/rad and N m s/rad, of rubber; assumed


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor at its shaft; by default a maxon RE 25, 24 V (118752), by its catalogue page of May 2017.

    The encoder of 500 lines is assumed; the inertia of its code wheel is neglected (at most 0.7 g cm²).
    """

    name: str = "RE 25, 20 W, 24 V"
    inertia: float = 1.08e-6  # kg m², of the rotor
    torque: float = 0.243  # N m, at rest at full voltage: short-term
    continuous_torque: float = 0.0263  # N m, continuous
    heating_time: float = 12.5  # s, thermal time constant of the winding
    speed: float = 1001.0  # rad/s, without a load: 9560 turns a minute
    friction: float = 8.63e-4  # N m: the current without a load, 36.9 mA of 23.4 mN m/A
    encoder_counts: int = 2000  # a turn
    duty_bits: int = 0  # of the pulse width, either way; 0: continuous
    electrical_time: float = 0.103e-3  # s, 0.238 mH over 2.32 ohm; 0: the current follows without delay
    current_bandwidth: float = 1000.0  # Hz, of the current's loop; assumed
    latency: float = 0.0  # s, from the command of a torque to its effect; at most `MAX_LATENCY`

    def __post_init__(self) -> None:
        positive("inertia", self.inertia, "kilogram square metres")
        positive("torque", self.torque, "newton metres")
        positive("continuous_torque", self.continuous_torque, "newton metres")
        positive("heating_time", self.heating_time, "seconds")
        positive("speed", self.speed, "radians a second")
        not_negative("friction", self.friction, "newton metres")
        whole("encoder_counts", self.encoder_counts, 1)
        whole("duty_bits", self.duty_bits, 0)
        not_negative("electrical_time", self.electrical_time, "seconds")
        positive("current_bandwidth", self.current_bandwidth, "hertz")
        if not_negative("latency", self.latency, "seconds") > MAX_LATENCY:
            raise ArgumentError(f"latency is {self.latency:g} seconds, expected {MAX_LATENCY:g} at most")


@dataclass(frozen=True, slots=True)
class Gear:
    """A gear between motor and drum by its data sheet; by default none."""

    name: str = "none"
    ratio: float = 1.0  # turns of the motor to one of the drum
    efficiency: float = 1.0  # share of the torque that is transmitted
    backlash: float = 0.0  # rad of the drum
    torque: float = math.inf  # N m at the drum, short-term limit of teeth and bearings
    continuous_torque: float = math.inf  # N m at the drum
    inertia: float = 0.0  # kg m² at the motor's shaft
    input_speed: float = math.inf  # rad/s of the motor, continuous

    def __post_init__(self) -> None:
        positive("ratio", self.ratio, "turns to a turn")
        if not positive("efficiency", self.efficiency, "shares") <= 1.0:
            raise ArgumentError(f"efficiency is {self.efficiency!r}, expected 1 at most")
        not_negative("backlash", self.backlash, "radians")
        positive("torque", self.torque, "newton metres", may_be_infinite=True)
        positive("continuous_torque", self.continuous_torque, "newton metres", may_be_infinite=True)
        not_negative("inertia", self.inertia, "kilogram square metres")
        positive("input_speed", self.input_speed, "radians a second", may_be_infinite=True)


_FAST = 6000.0 * 2.0 * math.pi / 60.0
GEARS = {
    "gear14": Gear("GP 32 A, 14:1", 14.0, 0.75, math.radians(0.8), 3.4, 2.25, 0.8e-7, _FAST),
    "gear51": Gear("GP 32 A, 51:1", 51.0, 0.70, math.radians(1.0), 6.5, 4.5, 0.7e-7, _FAST),
    "gear111": Gear("GP 32 A, 111:1", 111.0, 0.70, math.radians(1.0), 6.5, 4.5, 0.7e-7, _FAST),
}
"""Planetary gears of maxon that fit that motor, by their total reduction.

Those of three stages have the numbers of the data sheet of 86:1 (166167), of the same design. The one of two
stages has efficiency, backlash and inertia of the ceramic gear of two stages (GP 32 C, 166936); its torques
are typical values for this size.
"""
USUAL_GEAR = "gear51"
FORMER_NAMES = {"direct": "gear14", "gear4": "gear51", "gear10": "gear111"}
"""Former drums, for which a metre of rim was a metre of fingertip, and their nearest equivalents."""


def gear_named(name: str) -> Gear:
    """Return one of `GEARS`; for a former drum's name raise an error that names its nearest equivalent."""
    if name in FORMER_NAMES:
        raise ArgumentError(
            f"drum is {name!r}, the gear of a drum that no hand can wear: expected {FORMER_NAMES[name]!r}, "
            f"the total gearing that comes nearest, or another of {', '.join(GEARS)}"
        )
    if name not in GEARS:
        raise ArgumentError(f"drum is {name!r}, expected one of {', '.join(GEARS)}")
    return GEARS[name]


@dataclass(frozen=True, slots=True)
class Drum:
    """A motor, a gear and the lever of a glove at some bend; derived quantities are at the fingertip."""

    lever: float  # m of fingertip to a radian of the drum
    motor: Motor = field(default_factory=Motor)
    gear: Gear = GEARS[USUAL_GEAR]
    usable_acceleration: float | None = None  # m/s², of the reference; None: half of what the force allows
    encoder_phase: float = 0.0  # of a count, offset of the counts from position 0
    has_teeth: bool = False  # simulated with the gear's play and elasticity, the arm's mass, and stiction

    def __post_init__(self) -> None:
        positive("lever", self.lever, "metres to a radian")
        finite("encoder_phase", self.encoder_phase, "counts")
        if self.usable_acceleration is not None:
            positive("usable_acceleration", self.usable_acceleration, "metres a second squared")

    @property
    def words(self) -> str:
        """Motor, total gearing and lever, for captions."""
        gearing, lever = self.gear.ratio, 1e3 * self.lever
        return f"{self.motor.name}, total gear ratio {gearing:g}:1, {lever:.0f} mm lever"

    @property
    def turn(self) -> float:
        """Turn of the motor per metre of fingertip, rad/m; also newtons per newton metre."""
        return self.gear.ratio / self.lever

    @property
    def mass(self) -> float:
        """Mass of rotor and gear, kg."""
        return (self.motor.inertia + self.gear.inertia) * self.turn**2

    @property
    def force_limit(self) -> float:
        """Short-term force, N."""
        return min(self.motor.torque * self.turn, self.gear.torque / self.lever)

    @property
    def continuous_motor_force(self) -> float:
        """Continuous force of the motor, N, before the gear's loss."""
        lasting = self.motor.continuous_torque * self.turn
        return min(lasting, self.gear.continuous_torque / self.lever / self.gear.efficiency)

    @property
    def continuous_force(self) -> float:
        """Continuous force on a finger, N."""
        return self.continuous_motor_force * self.gear.efficiency

    @property
    def speed_limit(self) -> float:
        """Speed without a load, m/s."""
        return self.motor.speed / self.turn

    @property
    def planned_speed(self) -> float:
        """Largest speed of the servo's reference, m/s."""
        return min(PLANNED_SPEED_SHARE * self.motor.speed, self.gear.input_speed) / self.turn

    @property
    def friction(self) -> float:
        """Coulomb friction without a load, N."""
        return self.motor.friction * self.turn

    @property
    def loss(self) -> float:
        """Share of the force on the finger lost to gear friction."""
        return 1.0 / self.gear.efficiency - 1.0

    @property
    def play(self) -> float:
        """Displacement within the gear's backlash, m."""
        return self.gear.backlash * self.lever

    @property
    def resolution(self) -> float:
        """Step of the encoder, m."""
        return 2.0 * math.pi / (self.motor.encoder_counts * self.turn)

    @property
    def force_step(self) -> float:
        """Step by which the pulse width changes the force, N; 0: continuous."""
        bits = self.motor.duty_bits
        return self.motor.torque * self.turn / 2.0**bits if bits else 0.0

    @property
    def acceleration(self) -> float:
        """Acceleration of the servo's reference, m/s²."""
        if self.usable_acceleration is not None:
            return self.usable_acceleration
        return REFERENCE_SHARE * self.force_limit / self.mass

    def overload_time(self, force: float) -> float:
        """Return the time for which a cold motor may press with a force, s, before its winding is too hot."""
        share = self.motor.continuous_torque * self.turn * self.gear.efficiency / force
        return -self.motor.heating_time * math.log1p(-(share**2)) if share < 1.0 else math.inf

    def motor_torque(self, force: float) -> float:
        """Return the torque of the motor, N m at its shaft, for a force, N, without losses; limited."""
        most = self.force_limit
        return min(max(force, -most), most) / self.turn

    def motor_speed(self, speed: float) -> float:
        """Return the speed of the motor, rad/s at its shaft, for one of the fingertip, m/s; limited."""
        most = self.speed_limit
        return min(max(speed, -most), most) * self.turn

    def reading(self, position: float) -> float:
        """Return a position of the rotor by its encoder, m: that of the nearest count."""
        step, offset = self.resolution, self.encoder_phase * self.resolution
        return math.floor((position - offset) / step + 0.5) * step + offset

    def as_array(self, stop: float = math.inf) -> np.ndarray:
        """Return its numbers in the layout of the kernels, with a mechanical stop at a position, m."""
        motor, lever, squared = self.motor, self.lever, self.lever**2
        stiction, play = (STICTION, self.play) if self.has_teeth else (1.0, 0.0)
        numbers = (
            self.mass, self.friction, stiction, motor.torque * self.turn, self.speed_limit,
            motor.electrical_time, 2.0 * math.pi * motor.current_bandwidth, self.loss,
            play, ARM_INERTIA / squared, ARM_FRICTION / lever, ARM_SPRING / lever, GEAR_STIFFNESS / squared,
            GEAR_DAMPING / squared, stop, STOP_STIFFNESS / squared, STOP_DAMPING / squared,
        )  # fmt: skip
        return np.array([numbers], kernels.DRUM)

    def drive(self, step: float, position: float) -> np.ndarray:
        """Return the state of a drive at rest, with storage for the pending forces of its latency."""
        drive = np.zeros(kernels.DRIVE_SIZE + round(self.motor.latency / step))
        drive[[kernels.DRIVE_POSITION, kernels.DRIVE_ROTOR]] = position
        drive[kernels.DRIVE_MODE] = kernels.MODE_POSITION
        return drive


def with_random_phases(drum: Drum, count: int) -> list[Drum]:
    """Return *count* copies of a drum with different offsets of its encoder; the same on every run."""
    phases = np.random.default_rng(PHASE_SEED).uniform(-0.5, 0.5, count)
    return [replace(drum, encoder_phase=float(phase)) for phase in phases]
