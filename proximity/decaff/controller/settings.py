"""Settings of a drum's controller, and the numbers in which its C code has them."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from proximity.decaff.controller.cable_stretch import CableRule
from proximity.decaff.controller.compiled import SETTINGS, memory
from proximity.decaff.controller.drum_limits import Limits
from proximity.decaff.controller.steady_force import Handover, low_pass, steady_numbers
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum
from proximity.decaff.drum.servo import SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import DRUMS

BRAKING_SHARE = 0.5  # of what the drum can brake with, counted on near the finger; assumed
SERVO_LAG = 2e-3  # s, by which the drum's speed follows a new cap late: six samples of its servo; assumed
SPEED_CUTOFF = 50.0  # Hz, of the finger's speed by the potentiometer; assumed
OF_SERVO = (
    "stiffness", "damping", "acceleration", "speed", "force_gain", "force_damping", "force_slew", "deadband",
)  # fmt: skip
"""Numbers of a `Servo` that are passed on as they are."""


@dataclass(frozen=True, slots=True)
class ControllerSettings:
    """What a controller is made for, in a simulation, a service or a chip."""

    rate: float = SERVO_RATE  # Hz, of controller and servo
    drum: Drum = DRUMS[USUAL_GEAR]
    limits: Limits = field(default_factory=Limits)
    handover: Handover = field(default_factory=Handover)
    servo: Servo | None = None  # None: the one that suits the drum
    cable: CableRule = field(default_factory=CableRule)

    def record(self) -> tuple[Any, np.ndarray]:
        """Return them as the C code has them: a record, and its bytes."""
        _, record, content = memory(SETTINGS)
        servo = self.servo or servo_for(self.drum, self.rate)
        for name, number in (self._of_rules() | self._of_motion(servo) | self._of_servo(servo)).items():
            record[name] = number
        return record, content

    def _of_rules(self) -> dict[str, float]:
        limits, handover = self.limits, self.handover
        numbers = {name: getattr(limits, name) for name in Limits.__slots__ if name in (SETTINGS.names or ())}
        numbers |= {name: getattr(handover, name) for name in ("lost_force", "lost_time", "lost_distance")}
        return numbers | steady_numbers(self.rate, handover.rule) | {"period": 1.0 / self.rate}

    def _of_motion(self, servo: Servo) -> dict[str, float]:
        braking = BRAKING_SHARE * servo.acceleration
        lag = 1.0 / self.rate + SERVO_LAG + self.drum.motor.latency
        return {
            "near_motor_speed": self.limits.near_speed(self.drum.mass) * self.drum.turn,
            "braking": braking,
            "unbraked_speed": braking * lag,
            "speed_decay": 2.0 * math.pi * SPEED_CUTOFF,
            "heat_force": self.drum.continuous_force,
            "heat_time": self.drum.motor.heating_time,
            "cable_stiffness": self.cable.stiffness,
            "cable_decay": 2.0 * math.pi * self.cable.smoothing,
        }

    def _of_servo(self, servo: Servo) -> dict[str, float]:
        drum = self.drum
        return {f"servo_{name}": getattr(servo, name) for name in OF_SERVO} | {
            "servo_integral": servo.stiffness / servo.integral_time,
            "servo_smoothing_share": low_pass(servo.smoothing, servo.period),
            "drum_force_limit": drum.force_limit,
            "drum_ratio": drum.gear.ratio,
            "drum_latency": drum.motor.latency,
            "motor_torque": drum.motor_torque(math.inf),
            "motor_speed": drum.motor_speed(math.inf),
        }
