"""Structures that the C and Python code of the drum's controller share, each field declared once.

`controller_header` writes them into the template ``decaff_controller.h.in``. `TYPES` contains the
corresponding NumPy types.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from proximity.message.c_header import comment_lines

MAX_STEADY = 1024
"""Number of samples in the window of a steady force. A chip uses the number that its settings need."""
HEADER = Path(__file__).with_name("decaff_controller.h.in")


class Member(NamedTuple):
    """One field of a structure."""

    name: str
    kind: str  # of C; "real": decaff_real
    meaning: str = ""
    length: int = 0  # 0: one; else an array, in C of ``DECAFF_MAX_STEADY``


RECORDS = {
    "settings": (
        Member("period", "real", "s between two samples of controller and servo"),
        Member("fresh_ns", "int64_t", "age of a pose: younger, all is normal"),
        Member("stale_ns", "int64_t", "older, the state is unknown"),
        Member("future_ns", "int64_t", "farther in the future, the frame is wrong"),
        Member("freeze_ns", "int64_t", "in contact without data: time without change"),
        Member("ramp_ns", "int64_t", "then the force limit is ramped to zero"),
        Member("watchdog_ns", "int64_t", "between two samples of the servo, at most"),
        Member("touch_gap", "real", "m of finger and drum: nearer is touching"),
        Member("release_gap", "real", "m, farther is released"),
        Member("touch_force", "real", "N"),
        Member("gone_force", "real", "N: with less, a drum that froze retracts"),
        Member("standoff", "real", "m, from a finger that began inside"),
        Member("max_speed", "real", "m/s of any motion: a contact that comes nearer faster is a jump"),
        Member("object_speed", "real", "m/s of objects in old frames"),
        Member("speed_error", "real", "of old frames, times the finger's speed"),
        Member("late_speed", "real", "m/s, of a drum that comes late"),
        Member("late_force", "real", "N, likewise"),
        Member("late_gap", "real", "m, that counts as being there"),
        Member("near_gap", "real", "m: nearer, the energy of a bump is limited"),
        Member(
            "near_motor_speed", "real", "rad/s of the motor's shaft, at which rotor and gear have that energy"
        ),
        Member("continuous_force", "real", "N at the fingertip"),
        Member("peak_force", "real", "N at the fingertip"),
        Member("force_time", "real", "s, over which a force is continuous"),
        Member(
            "heat_force",
            "real",
            "N of the motor, continuous; a driving gear passes on its efficiency's share: "
            "the force on the finger",
        ),
        Member("heat_time", "real", "s, in which the motor warms up"),
        Member("follow_speed", "real", "m/s: slower, a touched part is at rest"),
        Member("speed_decay", "real", "1/s, of the low-pass of the finger's speed"),
        Member("braking", "real", "m/s2, braking of the drum near the finger"),
        Member("unbraked_speed", "real", "m/s: braked too late, in a sample and the servo's lag"),
        Member("shorted_rate", "real", "1/s: loss of the drum's speed per metre, with its windings shorted"),
        Member("shorted_late", "real", "m/s, that it gains before, where its chip hangs"),
        Member("cable_stiffness", "real", "N/m at the fingertip; inf: stretch is not compensated"),
        Member("cable_decay", "real", "1/s, of two low-passes of the force that stretches it"),
        Member("steady_samples", "uint32_t", "window of a steady force; DECAFF_MAX_STEADY at most"),
        Member("steady_share", "real", "of two low-passes in a row"),
        Member("steady_ripple", "real", "N that it may vary by"),
        Member("steady_ripple_share", "real", "of the force, if that is more"),
        Member("steady_slope_of_window", "real", "N that it may drift by"),
        Member("steady_least", "real", "N that it must have"),
        Member("steady_slow_speed", "real", "m/s of the finger"),
        Member("lost_force", "real", "N: with less, for a while, the contact of teleoperation is lost"),
        Member("lost_time", "real", "s"),
        Member("lost_distance", "real", "m of the slave from its object: beyond, the contact is lost"),
        Member("servo_stiffness", "real", "N/m"),
        Member("servo_damping", "real", "N s/m"),
        Member("servo_integral", "real", "N/(m s)"),
        Member(
            "servo_integral_limit",
            "real",
            "N: a blocked drum, as at its stop, does not wind it up further",
        ),
        Member("servo_acceleration", "real", "m/s2, of the reference"),
        Member("servo_speed", "real", "m/s, of the reference"),
        Member("servo_force_gain", "real", "1/s"),
        Member("servo_force_damping", "real", "N s/m"),
        Member("servo_force_slew", "real", "N/s, of a handover"),
        Member("servo_deadband", "real", "m"),
        Member("servo_smoothing_share", "real", "of the low-pass of what the motor does"),
        Member("drum_force_limit", "real", "N at the fingertip"),
        Member("drum_ratio", "real", "turns of the motor to one of the drum"),
        Member("drum_efficiency", "real", "of the gear that drives"),
        Member("drum_latency", "real", "s, from the command of a torque to its effect"),
        Member("motor_torque", "real", "N m at its shaft, at most"),
        Member("motor_speed", "real", "rad/s at its shaft, at most"),
    ),
    "path": (
        Member("count", "size_t"),
        Member("bends", "const decaff_real *"),
        Member("positions", "const decaff_real *", "m"),
        Member("angles", "const decaff_real *", "rad, of the drum where it meets the finger"),
        Member("settings", "const decaff_settings *"),
    ),
    "observation": (
        Member("sample_ns", "int64_t", "of this machine's monotonic clock"),
        Member("now_ns", "int64_t", "the same instant on the clock of the frames"),
        Member("state", "enum proximity_state", "of the newest frame, at that instant"),
        Member("contact", "const proximity_contact *", "this finger's; NULL: no frame yet"),
        Member("session", "uint64_t", "of its frame"),
        Member("sequence", "uint64_t"),
        Member("start_ns", "int64_t"),
        Member("bend", "real", "of the finger, by the potentiometer; NaN: a fault"),
        Member("drum_angle", "real", "rad, by the encoder; NaN: a fault"),
        Member("force", "real", "N, between finger and drum; NaN: not measured"),
        Member("has_fault", "bool", "of motor or current"),
        Member("motor_force", "real", "N, of the motor on the finger; NaN: not known"),
    ),
    "location": (
        Member("bend", "real", "at pose_ns"),
        Member("rate", "real", "1/s, by which it drifts"),
        Member("error", "real", "by which the bend may be off"),
        Member("finger_speed", "real", "m/s, when it was reported"),
        Member("incidence", "real", "cosine between path and normal; NaN: too near"),
        Member("drift", "real", "m/s along the path, with the part's velocity; 0: at rest, or unknown"),
        Member("pose_ns", "int64_t"),
        Member("start_ns", "int64_t", "of the tick that reported it"),
    ),
    "contact_reading": (
        Member("is_known", "bool"),
        Member("surface", "uint8_t"),
        Member("source", "uint8_t"),
        Member("distance", "real", "m"),
        Member("lower", "real", "m"),
        Member("stiffness", "real", "N/m"),
        Member("damping", "real", "N s/m"),
        Member("force", "real", "N; NaN: not reported"),
    ),
    "frame_trust": (
        Member("reading", "decaff_contact_reading", "by the record that was believed last"),
        Member("has_location", "bool", "else no contact is expected"),
        Member("has_pending", "bool"),
        Member("location", "decaff_location"),
        Member("pending", "decaff_location", "to be confirmed by a frame of a second pose"),
        Member("was_outside", "bool"),
        Member("has_pose", "bool"),
        Member("pose_ns", "int64_t", "that is believed"),
        Member("has_frame", "bool"),
        Member("session", "uint64_t", "of the last frame read"),
        Member("sequence", "uint64_t"),
        Member("start_ns", "int64_t"),
        Member("has_newest", "bool"),
        Member("newest_sequence", "uint64_t", "of this run of the service"),
        Member("newest_pose_ns", "int64_t"),
        Member("is_distrusted", "bool"),
        Member("distrust", "enum decaff_trust"),
        Member("dropped", "uint32_t", "records that could not be"),
        Member("awaited", "uint32_t", "contacts that came nearer than can be, until confirmed"),
    ),
    "steady": (
        Member("once", "real", "N, low-passed once"),
        Member("twice", "real", "N, low-passed twice"),
        Member("window", "real", "", MAX_STEADY),
        Member("count", "uint32_t", "present samples, at most those of the window"),
        Member("next", "uint32_t", "row of the window that is the oldest"),
        Member("slow_count", "uint32_t"),
    ),
    "controller": (
        Member("path", "const decaff_path *"),
        Member("state", "enum decaff_drum_state"),
        Member("trust", "enum decaff_trust"),
        Member("fault", "enum decaff_fault"),
        Member("frames", "decaff_frame_trust"),
        Member("is_stopped", "bool"),
        Member("is_late", "bool"),
        Member("has_sample", "bool"),
        Member("sample_ns", "int64_t"),
        Member("is_anew", "bool", "samples were left out before this one"),
        Member("target", "real", "m"),
        Member("force", "real", "N, of the last sample; inf: none was served"),
        Member("finger", "real", "m"),
        Member("speed", "real", "m/s, of the finger"),
        Member("motor_lever", "real", "m of fingertip to a radian of the motor, where the drum stands"),
        Member("serves_force", "bool"),
        Member("weak_for", "real", "s"),
        Member("steady", "decaff_steady"),
        Member("is_releasing", "bool"),
        Member("release_ns", "int64_t", "since when the state is unknown"),
        Member("share", "real", "of the force that is left"),
        Member("mean_force", "real", "N"),
        Member("heat", "real", "of the motor, low-passed square of its force over the continuous one"),
        Member("is_hot", "bool"),
        Member("is_following", "bool", "a part that moves while it is touched"),
        Member("moved_ns", "int64_t", "when it was seen to move last"),
        Member("is_budget_spent", "bool"),
        Member("pressing_once", "real", "N, that stretches the cable, low-passed once"),
        Member("pressing_twice", "real", "N, low-passed twice"),
        Member("stretch", "real", "m, by which the drum is brought nearer"),
    ),
    "action": (
        Member("state", "enum decaff_drum_state"),
        Member("mode", "enum decaff_drive_mode"),
        Member("position", "real", "m, where the drum shall stand"),
        Member("angle", "real", "rad, of the drum, there"),
        Member("force", "real", "N to press with, in force mode"),
        Member("speed_cap", "real", "m/s at the fingertip"),
        Member("force_cap", "real", "N at the fingertip"),
        Member("start_force", "real", "N that a change to force starts from"),
        Member("torque", "real", "N m at the motor's shaft that presses with that force"),
        Member("torque_cap", "real", "N m at the motor's shaft, at most"),
        Member("motor_speed_cap", "real", "rad/s of the motor's shaft, at most"),
        Member("force_slew", "real", "N/s, of the force; 0: the servo's default, inf: a step"),
        Member("heat", "real", "of the motor; from 1 on its force is limited to the continuous one"),
        Member("is_hot", "bool", "that limit is active, until the motor is cooler"),
        Member("is_anew", "bool", "samples were missed: the servo knows no speed, and restarts its mode"),
    ),
    "servo": (
        Member("settings", "const decaff_settings *"),
        Member("last_mode", "enum decaff_drive_mode"),
        Member("demanded", "real", "N, for the next sample"),
        Member("reference", "real", "m"),
        Member("reference_speed", "real", "m/s"),
        Member("integrated", "real", "N"),
        Member("last_position", "real", "m"),
        Member("force_reference", "real", "N"),
        Member("smoothed", "real", "N, what the motor did of late"),
    ),
}
"""Records by name, which is prefixed with ``decaff_`` in C. A record follows those that it contains."""
_NUMBERS = {"bool": "?", "uint8_t": "u1", "uint32_t": "u4", "size_t": "u8", "int64_t": "i8", "uint64_t": "u8"}
_NUMBERS |= {"real": "f8"}


def _types() -> dict[str, np.dtype]:
    types: dict[str, Any] = {}
    for name, members in RECORDS.items():
        fields = []
        for member in members:
            number = "i4" if member.kind.startswith("enum ") else "u8" if member.kind.endswith("*") else None
            kind = number or _NUMBERS.get(member.kind) or types[member.kind.removeprefix("decaff_")]
            fields.append((member.name, kind, (member.length,) if member.length else ()))
        types[name] = np.dtype(fields, align=True)
    return types


TYPES = _types()
"""NumPy types of the records, by the same names."""


def controller_header(max_steady: int = MAX_STEADY) -> str:
    """Return the text of ``decaff_controller.h``. *max_steady*: samples in the window of a steady force."""
    text = HEADER.read_text(encoding="ascii").replace("@MAX_STEADY@", str(max_steady))
    for name, members in RECORDS.items():
        lines = [f"typedef struct decaff_{name} {{", *(line for each in members for line in _lines(each))]
        text = text.replace(f"@{name.upper()}@", "\n".join([*lines, f"}} decaff_{name};"]))
    return text


def _lines(member: Member) -> list[str]:
    kind = "decaff_real" if member.kind == "real" else member.kind
    space = "" if kind.endswith("*") else " "
    line = f"    {kind}{space}{member.name}{'[DECAFF_MAX_STEADY]' if member.length else ''};"
    comment = comment_lines(member.meaning, "    ") if member.meaning else []
    declared = f"{line} {''.join(comment).strip()}".rstrip()
    return [declared] if len(comment) < 2 and len(declared) <= 118 else [*comment, line]
