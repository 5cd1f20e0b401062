"""Settings of a drum's controller, and their numbers in the C code."""

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from proximity.checks import not_negative, positive
from proximity.decaff.controller.compiled import SETTINGS, memory
from proximity.decaff.controller.records import MAX_STEADY
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum
from proximity.decaff.drum.servo import SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import DRUMS
from proximity.errors import ArgumentError
from proximity.system.time_units import NS_PER_MS

TOUCH_GAP = 30e-6  # m, of drum and finger or link, below which they touch; assumed
RELEASE_GAP = 1e-3  # m, beyond which they are released; assumed
MIN_WINDOW = 2  # samples
NEAR_SHARE = 0.35  # usable share of the energy near the finger, as servo and play add to it; assumed


@dataclass(frozen=True, slots=True)
class SteadyRule:
    """Rule by which a force counts as steady."""

    cutoff: float = 50.0  # Hz, of two low-passes in a row
    window: float = 0.050  # s, looked back on
    ripple: float = 0.02  # N, variation of the force
    ripple_share: float = 0.05  # of the force, if that is larger
    slope: float = 0.5  # N/s, over the window
    least: float = 0.05  # N, minimum force
    slow_speed: float = 2e-3  # m/s, of the finger during the window; inf: not checked

    def __post_init__(self) -> None:
        positive("cutoff", self.cutoff, "hertz")
        positive("window", self.window, "seconds")
        not_negative("ripple", self.ripple, "newtons")
        not_negative("ripple_share", self.ripple_share, "shares")
        positive("slope", self.slope, "newtons a second")
        not_negative("least", self.least, "newtons")
        positive("slow_speed", self.slow_speed, "metres a second", may_be_infinite=True)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of ages, speeds, forces and lengths. All are our own, as the paper gives none."""

    fresh_ns: int = 20 * NS_PER_MS  # age of a pose up to which operation is normal
    stale_ns: int = 100 * NS_PER_MS  # age of a pose beyond which the state is unknown
    future_ns: int = 5 * NS_PER_MS  # time in the future beyond which a frame is invalid
    freeze_ns: int = 250 * NS_PER_MS  # time without change, in contact without data
    ramp_ns: int = 250 * NS_PER_MS  # then the force limit is ramped to zero
    watchdog_ns: int = 10 * NS_PER_MS  # between two samples of the servo
    touch_gap: float = TOUCH_GAP  # m
    release_gap: float = RELEASE_GAP  # m
    touch_force: float = 0.05  # N
    gone_force: float = 0.1  # N, below which a drum that froze retracts
    standoff: float = 5e-3  # m, from a finger that started inside; assumed
    max_speed: float = 3.0  # m/s, of any motion; a faster approach of the contact is a jump
    object_speed: float = 0.5  # m/s, v_obj_max of old frames; assumed
    speed_error: float = 0.05  # eps of old frames, times the finger's speed; assumed
    late_speed: float = 0.05  # m/s, of a late drum
    late_force: float = 1.0  # N
    late_gap: float = 0.3e-3  # m, distance that counts as reached
    near_gap: float = 2e-3  # m, within which the energy of a bump is limited
    near_energy: float = 1e-3  # J
    continuous_force: float = 10.0  # N, at the fingertip
    peak_force: float = 20.0  # N
    force_time: float = 1.0  # s, duration of a continuous force; assumed
    follow_speed: float = 1e-3  # m/s, below which a touched part is at rest; assumed
    lost_force: float = 0.05  # N, below which the contact is lost after a while
    lost_time: float = 0.020  # s
    lost_distance: float = 0.5e-3  # m, of slave and object, beyond which the contact is lost; inf: never
    steady: SteadyRule = field(default_factory=SteadyRule)  # for the change from a position to a force

    def __post_init__(self) -> None:
        for name in (one.name for one in fields(self) if one.name != "steady"):
            may_be_infinite = name == "lost_distance"
            positive(name, getattr(self, name), _unit(name), may_be_infinite=may_be_infinite)

    def near_speed(self, mass: float) -> float:
        """Return the maximum planned speed of approach of drum and finger, m/s."""
        return math.sqrt(2.0 * NEAR_SHARE * self.near_energy / mass)


def _unit(name: str) -> str:
    for ending, unit in (
        ("_ns", "nanoseconds"),
        ("_gap", "metres"),
        ("_force", "newtons"),
        ("_speed", "metres a second"),
        ("_energy", "joules"),
        ("_time", "seconds"),
        ("_error", "shares"),
    ):
        if name.endswith(ending):
            return unit
    return "metres"


def steady_numbers(rate: float, rule: SteadyRule) -> dict[str, float]:
    """Return the settings of the C code for a rule at a rate in hertz."""
    period = 1.0 / positive("rate", rate, "hertz")
    samples = max(MIN_WINDOW, round(rule.window * rate))
    if samples > MAX_STEADY:
        raise ArgumentError(
            f"the window of a steady force has {samples} samples ({rule.window:g} s at {rate:g} Hz), "
            f"expected at most {MAX_STEADY}"
        )
    numbers = {
        f"steady_{name}": getattr(rule, name) for name in ("ripple", "ripple_share", "least", "slow_speed")
    }
    return numbers | {
        "steady_samples": samples,
        "steady_share": low_pass(rule.cutoff, period),
        "steady_slope_of_window": rule.slope * samples * period,
    }


def low_pass(cutoff: float, period: float) -> float:
    """Return the gain of a first-order low-pass with a cutoff in hertz."""
    return 1.0 - math.exp(-2.0 * math.pi * cutoff * period)


BRAKING_SHARE = 0.5  # usable share of the drum's braking near the finger; assumed
SHORTED_SHARE = 0.8  # usable share of the braking of a motor with shorted windings; assumed
HANG_TIME = 1e-3  # s, until the hardware's watchdog brakes a drum whose chip hangs
SERVO_LAG = 2e-3  # s, lag of the drum's speed behind a new cap, six samples of the servo; assumed
SPEED_CUTOFF = 50.0  # Hz, of the finger's speed by the potentiometer; assumed
OF_SERVO = (
    "stiffness", "damping", "acceleration", "speed", "force_gain", "force_damping", "force_slew", "deadband",
)  # fmt: skip
"""Numbers of a `Servo` that are passed on unchanged."""


@dataclass(frozen=True, slots=True)
class CableRule:
    """Compensation of a cable's stretch, which is off unless the stiffness of the cable is given.

    The drum moves too far with a stiffness that is too small, and not far enough with one that is too large.
    """

    stiffness: float = math.inf  # N/m at the fingertip; inf: stretch is not compensated
    smoothing: float = 2.0  # Hz, of two low-passes of the force; 10 Hz with a force sensor, no more without

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        positive("smoothing", self.smoothing, "hertz")


@dataclass(frozen=True, slots=True)
class ControllerSettings:
    """Settings of a controller in a simulation, in a service or on a chip."""

    rate: float = SERVO_RATE  # Hz, of controller and servo
    drum: Drum = DRUMS[USUAL_GEAR]
    limits: Limits = field(default_factory=Limits)
    servo: Servo | None = None  # None: the one that suits the drum
    cable: CableRule = field(default_factory=CableRule)

    def record(self) -> tuple[Any, np.ndarray]:
        """Return the settings in the layout of the C code, as a record and as its bytes."""
        _, record, content = memory(SETTINGS)
        servo = self.servo or servo_for(self.drum, self.rate)
        numbers = servo_numbers(self.drum, servo, self.limits.continuous_force)
        for name, number in (numbers | self._of_rules() | self._of_motion(servo)).items():
            record[name] = number
        return record, content

    def _of_rules(self) -> dict[str, float]:
        named = (name for name in Limits.__slots__ if name in (SETTINGS.names or ()))
        numbers = {name: getattr(self.limits, name) for name in named}
        return numbers | steady_numbers(self.rate, self.limits.steady) | {"period": 1.0 / self.rate}

    def _of_motion(self, servo: Servo) -> dict[str, float]:
        braking = BRAKING_SHARE * servo.acceleration
        lag = 1.0 / self.rate + SERVO_LAG + self.drum.motor.latency
        motor, hang = self.drum.motor, HANG_TIME + 1.0 / self.rate
        rate = SHORTED_SHARE * motor.torque / (motor.speed * (motor.inertia + self.drum.gear.inertia))
        return {
            "near_motor_speed": self.limits.near_speed(self.drum.mass) * self.drum.turn,
            "braking": braking,
            "unbraked_speed": braking * lag,
            "shorted_rate": rate / (1.0 + rate * hang),
            "shorted_late": servo.acceleration * hang / (1.0 + rate * hang),
            "speed_decay": 2.0 * math.pi * SPEED_CUTOFF,
            "heat_force": self.drum.continuous_motor_force,
            "heat_time": self.drum.motor.heating_time,
            "cable_stiffness": self.cable.stiffness,
            "cable_decay": 2.0 * math.pi * self.cable.smoothing,
        }


def servo_numbers(drum: Drum, servo: Servo, continuous_force: float) -> dict[str, float]:
    """Return the settings of the C servo, for a drum and a continuous force, N."""
    return {f"servo_{name}": getattr(servo, name) for name in OF_SERVO} | {
        "period": servo.period,
        "servo_integral": servo.stiffness / servo.integral_time,
        "servo_integral_limit": drum.friction + continuous_force / drum.gear.efficiency,
        "servo_smoothing_share": low_pass(servo.smoothing, servo.period),
        "drum_force_limit": drum.force_limit,
        "drum_ratio": drum.gear.ratio,
        "drum_efficiency": drum.gear.efficiency,
        "drum_latency": drum.motor.latency,
        "motor_torque": drum.motor_torque(math.inf),
        "motor_speed": drum.motor_speed(math.inf),
    }
