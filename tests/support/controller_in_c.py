"""Compare the drum's controller in C, as a program, with the package's controller."""

import struct
import subprocess
from pathlib import Path

import numpy as np
from compiling_c import WARNINGS, c_compiler, run

from proximity.decaff.controller.chip_sources import write_controller
from proximity.decaff.controller.controller import STATES
from proximity.decaff.controller.settings import ControllerSettings
from proximity.decaff.glove.glove import Glove

DRIVER = Path(__file__).with_name("clients") / "controller_driver.c"
SANITIZERS = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
STRICT = ["-std=c99", *WARNINGS, "-Wshadow", "-Wconversion", "-Wundef"]
SOURCES = ("decaff_controller.c", "decaff_glove.c")
NUMBERS = (
    "position", "angle", "force", "speed_cap", "force_cap", "start_force", "torque", "torque_cap",
    "motor_speed_cap", "force_slew",
)  # fmt: skip
WORDS = ("state", "mode", "trust", "fault", "seen", "dropped", "awaited", "zero")
ANSWER = np.dtype([(name, "<i4") for name in WORDS] + [(name, "<f8") for name in NUMBERS])
NANOMETRE = 1e-9


def build(folder, settings=None, options=SANITIZERS):
    """Compile a program that answers events by the controller in C."""
    write_controller([Glove()], folder, settings or ControllerSettings())
    target = folder / "driver"
    sources = [folder / name for name in SOURCES]
    run(c_compiler(), *STRICT, *options, f"-I{folder}", *sources, DRIVER, "-lm", "-o", target)
    return target


class Events:
    """Events for the controller, and the answers of the controller in Python."""

    def __init__(self, shares_clock=True, key=None, position=0.0):
        begin = struct.pack("<BB32sd", shares_clock, key is not None, key or bytes(32), position)
        self.data, self.expected = bytearray(b"B" + begin), []

    def datagram(self, data, now_ns):
        self.data += b"D" + struct.pack("<qI", now_ns, len(data)) + bytes(data)

    def look(self, seen, answer):
        measured = struct.pack(
            "<qddddB", seen.sample_ns, seen.bend, seen.drum_angle, seen.force, seen.motor_force,
            seen.has_fault,
        )  # fmt: skip
        self.data += b"L" + measured
        self.expected.append(answer)

    def answers(self, program, folder):
        """Return the bytes that a program answers."""
        events, answers = folder / "events", folder / "answers"
        events.write_bytes(self.data)
        done = subprocess.run(
            [*map(str, program), str(events), str(answers)], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return answers.read_bytes()


def answer_of(controller, action, state):
    """Pack the package's controller's answer in the driver's format."""
    words = (
        STATES.index(action.state), int(action.mode), int(controller.trust), controller.known.fault,
        int(state), controller.frames.dropped, controller.frames.awaited, 0,
    )  # fmt: skip
    return np.array((*words, *(getattr(action, name) for name in NUMBERS)), ANSWER)


def compare(found, expected):
    """Check that states are equal, positions within a nanometre, other values within rounding."""
    assert len(found) == len(expected)
    for name in WORDS:
        off = np.flatnonzero(found[name] != expected[name])
        assert not len(off), (name, off[0], found[off[0]], expected[off[0]])
    np.testing.assert_allclose(found["position"], expected["position"], rtol=0.0, atol=NANOMETRE)
    for name in NUMBERS[1:]:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-8, atol=1e-10, err_msg=name)
