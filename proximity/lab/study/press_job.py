"""The job ``press``, which compares one simulated press on a wall with the same press on a real wall."""

import inspect
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from proximity.decaff.drum.drum_model import GEARS, PHASE_SEED, USUAL_GEAR, Drum, Motor
from proximity.decaff.drum.servo import DEADBAND_COUNTS, SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.errors import ArgumentError
from proximity.lab.simulation import devices
from proximity.lab.simulation.closed_loop import coupled_wall, decaff, real_wall
from proximity.lab.simulation.devices import HOLD_TIME, CoupledWall, Decaff, Hand
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.simulated_press import (
    LONGEST_LATENCY,
    MAX_DAMPED,
    POLICIES,
    RATES_ALLOWED,
    SPEEDS_ALLOWED,
    STIFFEST,
    Wall,
)
from proximity.lab.simulation.sweeps import Stretch, best_coupled_wall, with_latency, with_transmission
from proximity.service.config.table_fields import Range

INTEGRAL_TIME: float = inspect.signature(Servo).parameters["integral_time"].default
RANGES = {
    "speed": Range("m/s", *SPEEDS_ALLOWED),
    "hold": Range("s", 0.11, 10.0),
    "latency": Range("s", 0.0, LONGEST_LATENCY),
    "rate": Range("Hz", *RATES_ALLOWED),
    "stiffness": Range("N/m", 0.0, STIFFEST),
    "damping": Range("N s/m", 0.0, MAX_DAMPED),
    "encoder_counts": Range("a turn", 1, 10**9),
    "motor_friction": Range("N m", 0.0, 10.0),
    "servo_rate": Range("Hz", 100.0, 50_000.0),
    "deadband": Range("encoder counts", 0.0, 100.0),
    "integral_time": Range("s", 0.0, 100.0, is_above=True),
    "cable_stiffness": Range("N/m", 10.0, 1e7),
    "sheath_friction": Range("", 0.0, 2.0),
    "seed": Range("", 0, 2**32 - 1),
}
WORDS = {"wall": tuple(Wall), "drum": tuple(GEARS), "policy": tuple(POLICIES), "stretch": tuple(Stretch)}


@dataclass(frozen=True, slots=True, kw_only=True)
class PressFactors:
    """Factors of the job with their defaults, in SI units.

    None selects the best gains of a coupled wall, no integral, or a rigid cable. *seed*: of the wall's
    position between two counts of the drum's encoder.
    """

    wall: str = Wall.DECAFF.value
    speed: float = 0.1
    hold: float = HOLD_TIME
    latency: float = 0.001
    rate: float = 1000.0
    stiffness: float | None = None
    damping: float | None = None
    drum: str = USUAL_GEAR
    policy: str = "time-stamped"
    encoder_counts: int = Motor().encoder_counts
    motor_friction: float = Motor().friction
    servo_rate: float = SERVO_RATE
    deadband: float = DEADBAND_COUNTS
    integral_time: float | None = INTEGRAL_TIME
    cable_stiffness: float | None = None
    sheath_friction: float = devices.FRICTION
    stretch: str = Stretch.LEFT.value
    seed: int = PHASE_SEED

    def __post_init__(self) -> None:
        for name, accepted in RANGES.items():
            value = getattr(self, name)
            if value is not None and not accepted.holds(value):
                raise ArgumentError(f"{name} is {value}, expected a number {accepted}")
        for name, words in WORDS.items():
            if getattr(self, name) not in words:
                raise ArgumentError(f"{name} is {getattr(self, name)!r}, expected one of {', '.join(words)}")


def press(**values: Any) -> dict[str, Any]:
    """Return the measures of one press in SI units, as in `metrics.Deviation`.

    *values*: those of `PressFactors`.
    """
    factors = PressFactors(**values)
    hand, coupled = Hand(), None
    motion = hand.press(factors.speed, hold=factors.hold)
    if factors.wall == Wall.REAL:
        response = real_wall(hand, motion)
    elif factors.wall == Wall.COUPLED:
        coupled = _coupled(factors)
        response = coupled_wall(hand, motion, coupled)
    else:
        response = decaff(hand, motion, _glove(factors), POLICIES[factors.policy])
    found = deviation(response)
    return {
        "force_error": found.error,
        **{name: getattr(found, name) for name in MEASURES},
        "stiffness_used": None if coupled is None else coupled.stiffness,
        "damping_used": None if coupled is None else coupled.damping,
    }


press.__signature__ = inspect.signature(PressFactors)  # type: ignore[attr-defined]
MEASURES = ("onset", "penetration", "steady_error", "ripple", "swing", "peak", "peak_error", "work_error")


def _coupled(factors: PressFactors) -> CoupledWall:
    stiffness, damping = factors.stiffness, factors.damping
    if stiffness is None and damping is None:
        return _tuned(factors.rate, factors.latency)
    if stiffness is None or damping is None:
        raise ArgumentError("stiffness and damping belong together: expected both or neither")
    return CoupledWall(stiffness, damping, factors.rate, factors.latency)


@lru_cache(maxsize=256)
def _tuned(rate: float, latency: float) -> CoupledWall:
    return best_coupled_wall(Hand(), rate, latency)


@lru_cache(maxsize=256)
def _servo(drum: Drum, rate: float) -> Servo:
    return servo_for(drum, rate)


def _glove(factors: PressFactors) -> Decaff:
    known = DRUMS[factors.drum]
    motor = replace(known.motor, encoder_counts=factors.encoder_counts, friction=factors.motor_friction)
    drum = replace(known, motor=motor)
    integral_time = factors.integral_time
    servo = replace(
        _servo(drum, factors.servo_rate),
        deadband=factors.deadband * drum.resolution,
        integral_time=math.inf if integral_time is None else integral_time,
    )
    phase = float(np.random.default_rng(factors.seed).uniform(-0.5, 0.5))
    glove = with_latency(Decaff(replace(drum, encoder_phase=phase), servo), factors.latency, factors.rate)
    if factors.cable_stiffness is None:
        return glove
    usual = devices.TipCable.of(Glove(), friction=factors.sheath_friction)
    cable = replace(usual, stiffness=factors.cable_stiffness)
    return with_transmission(glove, cable, Stretch(factors.stretch))
