"""The job ``press``: one simulated press on a wall, compared with the same press on a real wall."""

import inspect
import math
from dataclasses import replace
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
    MOST_DAMPED,
    POLICIES,
    RATES_ALLOWED,
    SPEEDS_ALLOWED,
    STIFFEST,
    Wall,
)
from proximity.lab.simulation.sweeps import Stretch, best_coupled_wall, with_latency, with_transmission
from proximity.lab.sweep.design import Factor, Job, Kind, Measure, Values
from proximity.lab.sweep.node_files import NodeFiles
from proximity.service.config.table_fields import Range

REPORTED = {"wall": (Wall.COUPLED, Wall.DECAFF)}
ON_DRUM = {"wall": (Wall.DECAFF,)}
WITH_CABLE = {**ON_DRUM, "cable_stiffness": ()}
COUPLED = {"wall": (Wall.COUPLED,)}
TOGETHER = ("stiffness", "damping")


INTEGRAL_TIME: float = inspect.signature(Servo).parameters["integral_time"].default


def _number(default: float | None, accepted: Range, **more: Any) -> Factor:
    return Factor(Kind.NUMBER, default, accepted, **more)


FACTORS = {
    "wall": Factor(Kind.WORD, Wall.DECAFF.value, words=tuple(Wall)),
    "speed": _number(0.1, Range("m/s", *SPEEDS_ALLOWED)),
    "hold": _number(HOLD_TIME, Range("s", 0.11, 10.0)),
    "latency": _number(0.001, Range("s", 0.0, LONGEST_LATENCY), only=REPORTED),
    "rate": _number(1000.0, Range("Hz", *RATES_ALLOWED), only=REPORTED),
    "stiffness": _number(None, Range("N/m", 0.0, STIFFEST), absent="tuned", only=COUPLED),
    "damping": _number(None, Range("N s/m", 0.0, MOST_DAMPED), absent="tuned", only=COUPLED),
    "drum": Factor(Kind.WORD, USUAL_GEAR, words=tuple(GEARS), only=ON_DRUM),
    "policy": Factor(Kind.WORD, "time-stamped", words=tuple(POLICIES), only=ON_DRUM),
    "encoder_counts": Factor(Kind.WHOLE, Motor().encoder_counts, Range("a turn", 1, 10**9), only=ON_DRUM),
    "motor_friction": _number(Motor().friction, Range("N m", 0.0, 10.0), only=ON_DRUM),
    "servo_rate": _number(SERVO_RATE, Range("Hz", 100.0, 50_000.0), only=ON_DRUM),
    "deadband": _number(DEADBAND_COUNTS, Range("encoder counts", 0.0, 100.0), only=ON_DRUM),
    "integral_time": _number(
        INTEGRAL_TIME,
        Range("s", 0.0, 100.0, is_above=True),
        absent="none",
        only=ON_DRUM,
    ),
    "cable_stiffness": _number(None, Range("N/m", 10.0, 1e7), absent="rigid", only=ON_DRUM),
    "sheath_friction": _number(devices.FRICTION, Range("", 0.0, 2.0), only=WITH_CABLE),
    "stretch": Factor(Kind.WORD, Stretch.LEFT.value, words=tuple(Stretch), only=WITH_CABLE),
    "seed": Factor(Kind.WHOLE, PHASE_SEED, Range("", 0, 2**32 - 1), only=ON_DRUM),
}
"""SI units; the seed decides where the wall lies between two counts of the drum's encoder."""

MEASURES = {
    "force_error": Measure("1"),
    "onset": Measure("s"),
    "penetration": Measure("m"),
    "steady_error": Measure("N"),
    "ripple": Measure("N"),
    "swing": Measure("N"),
    "peak": Measure("N"),
    "peak_error": Measure("N", is_worse_high=False),
    "work_error": Measure("J"),
    "stiffness_used": Measure("N/m"),
    "damping_used": Measure("N s/m"),
}
"""As of `metrics.Deviation`; the last two are the gains of a coupled wall, given or tuned, else None."""


def run(values: Values, files: NodeFiles) -> dict[str, Any]:
    """Return the measures of one press."""
    del files
    hand, coupled = Hand(), None
    press = hand.press(values["speed"], hold=values["hold"])
    if values["wall"] == Wall.REAL:
        response = real_wall(hand, press)
    elif values["wall"] == Wall.COUPLED:
        coupled = _coupled(values)
        response = coupled_wall(hand, press, coupled)
    else:
        response = decaff(hand, press, _glove(values), POLICIES[values["policy"]])
    found = deviation(response)
    return {
        "force_error": found.error,
        **{name: getattr(found, name) for name in MEASURES if hasattr(found, name)},
        "stiffness_used": None if coupled is None else coupled.stiffness,
        "damping_used": None if coupled is None else coupled.damping,
    }


def _coupled(values: Values) -> CoupledWall:
    stiffness, damping = (values[name] for name in TOGETHER)
    if stiffness is None and damping is None:
        return _tuned(values["rate"], values["latency"])
    if stiffness is None or damping is None:
        raise ArgumentError("stiffness and damping belong together: expected both as numbers, or both tuned")
    return CoupledWall(stiffness, damping, values["rate"], values["latency"])


@lru_cache(maxsize=256)
def _tuned(rate: float, latency: float) -> CoupledWall:
    return best_coupled_wall(Hand(), rate, latency)


@lru_cache(maxsize=256)
def _servo(drum: Drum, rate: float) -> Servo:
    return servo_for(drum, rate)


def _glove(values: Values) -> Decaff:
    known = DRUMS[values["drum"]]
    motor = replace(known.motor, encoder_counts=values["encoder_counts"], friction=values["motor_friction"])
    drum = replace(known, motor=motor)
    integral_time = values["integral_time"]
    servo = replace(
        _servo(drum, values["servo_rate"]),
        deadband=values["deadband"] * drum.resolution,
        integral_time=math.inf if integral_time is None else integral_time,
    )
    phase = float(np.random.default_rng(values["seed"]).uniform(-0.5, 0.5))
    glove = with_latency(Decaff(replace(drum, encoder_phase=phase), servo), values["latency"], values["rate"])
    if values["cable_stiffness"] is None:
        return glove
    usual = devices.TipCable.of(Glove(), friction=values["sheath_friction"])
    cable = replace(usual, stiffness=values["cable_stiffness"])
    return with_transmission(glove, cable, Stretch(values["stretch"]))


PRESS = Job("press", FACTORS, MEASURES, run, together=TOGETHER)
