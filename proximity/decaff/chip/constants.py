"""The constants of the controller in C: those of the Python controller, each with the remark it has there."""

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from types import ModuleType
from typing import Any

from proximity.decaff.chip.remarks import remarks_of
from proximity.decaff.controller import contact_location, controller, frame_trust, surface_law
from proximity.decaff.controller.cable_stretch import CableRule
from proximity.decaff.controller.drum_limits import Limits
from proximity.decaff.controller.steady_force import Handover, SteadyForce, SteadyRule
from proximity.decaff.drum import drum_kernels
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum
from proximity.decaff.drum.servo import Servo, servo_for
from proximity.decaff.glove import finger_path
from proximity.decaff.glove.glove import DRUMS
from proximity.message import contact
from proximity.message.c_header import comment_lines
from proximity.transport import message_check

MODULE_CONSTANTS: tuple[tuple[ModuleType, tuple[str, ...]], ...] = (
    (contact, ("UNIT_ERROR",)),
    (message_check, ("MOST_RUNS", "RESTART_SILENCE_NS")),
    (finger_path, ("LEAST_BEND", "MOST_BEND")),
    (contact_location, ("MOST_RATE", "MOST_LENGTH", "LEAST_CLOSING", "TABLE_ERROR", "MIN_TRAVEL")),
    (frame_trust, ("LARGEST_POSITION_ERROR",)),
    (surface_law, ("DAMPING_SHARE", "DELAY_SAMPLES", "PAD_DAMPING")),
    (controller, ("DRUM_DAMPING", "STRAY_ANGLE")),
    (drum_kernels, ("STANDING",)),
)
COUNTS = {"MOST_RUNS", "STEADY_SAMPLES"}
"""Constants that are numbers of things: unsigned in C."""
SERVO_COLUMNS = (
    "PERIOD", "STIFFNESS", "DAMPING", "INTEGRAL", "ACCELERATION", "SPEED",
    "FORCE_GAIN", "FORCE_DAMPING", "FORCE_SLEW", "DEADBAND",
)  # fmt: skip
DRUM_COLUMNS = ("FORCE_LIMIT", "SPEED_LIMIT")


@dataclass(frozen=True, slots=True)
class ChipSettings:
    """What a controller on a chip is made for; the Python controller is given the same."""

    rate: float = 3000.0  # Hz
    drum: Drum = DRUMS[USUAL_GEAR]
    limits: Limits = field(default_factory=Limits)
    handover: Handover = field(default_factory=Handover)
    servo: Servo | None = None  # None: the one that suits the drum
    cable: CableRule = field(default_factory=CableRule)

    @property
    def used_servo(self) -> Servo:
        """The servo of the drum."""
        return self.servo or servo_for(self.drum, self.rate)


def constants_text(settings: ChipSettings, path_count: int) -> str:
    """Return the lines of C that define all constants.

    Parameters
    ----------
    settings : ChipSettings
        Rate, drum, limits, rules, servo and cable.
    path_count : int
        Tables of fingers' paths that there are.
    """
    lines = [*_definition("PATH_COUNT", path_count, "paths of fingers in decaff_glove.c"), ""]
    for group in (
        _modules(),
        _limits(settings),
        _steady(settings),
        _motion(settings),
        _cable(settings),
        _servo(settings),
    ):
        for name, value, remark in group:
            lines += _definition(name, value, remark)
        lines.append("")
    return "\n".join(lines[:-1])


def number_text(value: float) -> str:
    """Return a number in C, to the last bit."""
    if math.isinf(value):
        return "((double)INFINITY)" if value > 0.0 else "(-(double)INFINITY)"
    return repr(float(value)) if value >= 0.0 else f"({float(value)!r})"


_Constant = tuple[str, Any, str]


def _modules() -> Iterator[_Constant]:
    for module, names in MODULE_CONSTANTS:
        remarks = remarks_of(inspect.getsource(module))
        for name in names:
            yield name, getattr(module, name), remarks[name]


def _limits(settings: ChipSettings) -> Iterator[_Constant]:
    remarks = remarks_of(inspect.getsource(Limits))
    for each in fields(Limits):
        yield f"LIMIT_{each.name.upper()}", getattr(settings.limits, each.name), remarks[each.name]


def _steady(settings: ChipSettings) -> Iterator[_Constant]:
    rule, remarks = settings.handover.rule, remarks_of(inspect.getsource(SteadyRule))
    samples = SteadyForce.sample_count(settings.rate, rule)
    yield "STEADY_SAMPLES", samples, f"of {rule.window:g} s, looked back on"
    yield (
        "STEADY_SHARE",
        1.0 - math.exp(-2.0 * math.pi * rule.cutoff * (1.0 / settings.rate)),
        f"of two low-passes in a row at {rule.cutoff:g} Hz",
    )
    yield (
        "STEADY_SLOPE_OF_WINDOW",
        rule.slope * samples * (1.0 / settings.rate),
        f"N: {rule.slope:g} N/s over the window",
    )
    for name in ("ripple", "ripple_share", "least", "slow_speed"):
        yield f"STEADY_{name.upper()}", getattr(rule, name), remarks[name]
    remarks = remarks_of(inspect.getsource(Handover))
    for name in ("lost_force", "lost_time", "lost_distance"):
        yield f"HANDOVER_{name.upper()}", getattr(settings.handover, name), remarks[name]


def _motion(settings: ChipSettings) -> Iterator[_Constant]:
    drum = settings.drum
    braking = controller.BRAKING_SHARE * drum.acceleration
    unbraked = braking * (1.0 / settings.rate + controller.SERVO_LAG)
    yield (
        "SPEED_DECAY",
        2.0 * math.pi * controller.SPEED_CUTOFF,
        f"1/s: {controller.SPEED_CUTOFF:g} Hz, of the finger's speed by the potentiometer",
    )
    yield "NEAR_SPEED", settings.limits.near_speed(drum.mass), "m/s, at which the drum has near_energy"
    yield "BRAKING", braking, "m/s²: the share of what the drum can brake with, counted on near the finger"
    yield "UNBRAKED_SPEED", unbraked, "m/s: what it brakes too late, in a sample and the servo's lag"


def _cable(settings: ChipSettings) -> Iterator[_Constant]:
    cable = settings.cable
    yield "CABLE_STIFFNESS", cable.stiffness, remarks_of(inspect.getsource(CableRule))["stiffness"]
    yield (
        "CABLE_DECAY",
        2.0 * math.pi * cable.smoothing,
        f"1/s: {cable.smoothing:g} Hz, of the force that stretches the cable, low-passed twice",
    )


def _servo(settings: ChipSettings) -> Iterator[_Constant]:
    remarks = remarks_of(inspect.getsource(drum_kernels))
    servo, drum = settings.used_servo, settings.drum
    for prefix, columns, numbers in (
        ("SERVO", SERVO_COLUMNS, servo.as_array()),
        ("DRUM", DRUM_COLUMNS, drum.as_array()),
    ):
        for column in columns:
            name = f"{prefix}_{column}"
            yield name, float(numbers[getattr(drum_kernels, name)]), remarks[name]
    share = 1.0 - math.exp(-2.0 * math.pi * servo.smoothing * servo.period)
    yield "SERVO_SMOOTHING_SHARE", share, f"of a low-pass at {servo.smoothing:g} Hz"
    yield "DRUM_RADIUS", drum.lever, "m of fingertip to a radian of the drum, at half bend"
    yield "DRUM_RATIO", drum.gear.ratio, "turns of the motor to one of the drum"


def _definition(name: str, value: Any, remark: str) -> list[str]:
    """Lines that define a constant, behind its remark."""
    if isinstance(value, int):
        text = f"INT64_C({value})" if name.endswith("_NS") else f"{value}{'u' if name in COUNTS else ''}"
    else:
        text = number_text(value)
    return [*comment_lines(remark, ""), f"#define DECAFF_{name} {text}"]
