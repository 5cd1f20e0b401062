"""The drum's controller in C, given what one in Python was given, and compared with it at each sample."""

import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
from compiling_c import WARNINGS, c_compiler, run

from proximity.decaff.chip.constants import ChipSettings
from proximity.decaff.chip.sources import write_controller
from proximity.decaff.controller.controller import FingerController
from proximity.decaff.controller.controller_states import DrumState
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
STATES = list(DrumState)
FAULTS = (  # in the order of enum decaff_fault, by how Python's sentences begin
    "", "the servo was", "the potentiometer gives no bend", "the potentiometer reads a bend of",
    "the encoder gives no drum angle", "the encoder reads a drum angle of", "the motor reports a fault",
)  # fmt: skip
NANOMETRE = 1e-9


def build(folder, settings=None, options=SANITIZERS):
    """A program that answers events by the controller in C."""
    write_controller([Glove()], folder, settings or ChipSettings())
    target = folder / "driver"
    sources = [folder / name for name in SOURCES]
    run(c_compiler(), *STRICT, *options, f"-I{folder}", *sources, DRIVER, "-lm", "-o", target)
    return target


class Events:
    """What the controller meets, and what Python's answered."""

    def __init__(self, shares_clock=True, key=None, position=0.0):
        begin = struct.pack("<BB32sd", shares_clock, key is not None, key or bytes(32), position)
        self.data, self.expected = bytearray(b"B" + begin), []

    def reset(self):
        self.data += b"R"

    def stop(self):
        self.data += b"E"

    def observe(self, seen, answer):
        mark = seen.frame
        has_contact = seen.contact is not None and mark is not None
        session, sequence, start_ns = mark or (0, 0, 0)
        self.data += b"O" + struct.pack(
            "<qqqQQBBddddB", seen.sample_ns, seen.now_ns, start_ns, session, sequence, int(seen.state),
            has_contact, seen.bend, seen.drum_angle, seen.force, seen.motor_force, seen.has_fault,
        )  # fmt: skip
        self.data += seen.contact.tobytes() if has_contact else b""
        self.expected.append(answer)

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
        """The bytes that a program answers."""
        events, answers = folder / "events", folder / "answers"
        events.write_bytes(self.data)
        done = subprocess.run(
            [*map(str, program), str(events), str(answers)], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return answers.read_bytes()


def answer_of(controller, action, state):
    """What a Python controller answered, as the driver writes it."""
    fault = next(i for i in range(len(FAULTS) - 1, -1, -1) if controller.fault.startswith(FAULTS[i]))
    words = (
        STATES.index(action.state), int(action.mode), int(controller.trust), fault, int(state),
        controller.frames.dropped, controller.frames.awaited, 0,
    )  # fmt: skip
    return np.array((*words, *(getattr(action, name) for name in NUMBERS)), ANSWER)


def compare(found, expected):
    """States are equal, positions within a nanometre, all else within its rounding."""
    assert len(found) == len(expected)
    for name in WORDS:
        off = np.flatnonzero(found[name] != expected[name])
        assert not len(off), (name, off[0], found[off[0]], expected[off[0]])
    np.testing.assert_allclose(found["position"], expected["position"], rtol=0.0, atol=NANOMETRE)
    for name in NUMBERS[1:]:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-8, atol=1e-10, err_msg=name)


class Recorder:
    """Notes what each Python controller of a test is given."""

    def __init__(self, monkeypatch):
        self.runs = {}  # by the controller's id: the controller, its settings, what was done with it
        originals = {name: getattr(FingerController, name) for name in ("__init__", "step", "reset", "stop")}

        def start(controller, *arguments, **options):
            self.runs[id(controller)] = controller, options, []
            originals["__init__"](controller, *arguments, **options)

        def step(controller, seen):
            contact = None if seen.contact is None else seen.contact.copy()
            self.runs[id(controller)][2].append(replace(seen, contact=contact))
            return originals["step"](controller, seen)

        def noted(name):
            def call(controller):
                self.runs[id(controller)][2].append(name)
                originals[name](controller)

            return call

        monkeypatch.setattr(FingerController, "__init__", start)
        monkeypatch.setattr(FingerController, "step", step)
        for name in ("reset", "stop"):
            monkeypatch.setattr(FingerController, name, noted(name))

    def compare(self, path, program_of, folder, rate=3000.0, samples=3):
        """Give all of it to Python and to C at a higher rate, *samples* for each that was noted; how many."""
        period_ns, total = round(1e9 / rate), 0
        for _, options, done in self.runs.values():
            controller, events = FingerController(path, rate, **options), Events()
            for what in done:
                if isinstance(what, str):
                    getattr(controller, what)()
                    getattr(events, what)()
                    continue
                for before in range((samples - 1) * period_ns, -1, -period_ns):
                    seen = replace(what, now_ns=what.now_ns - before, sample_ns=what.sample_ns - before)
                    action = controller.step(seen)
                    events.observe(seen, answer_of(controller, action, seen.state))
            program = program_of(ChipSettings(rate, **options))
            found = np.frombuffer(events.answers([program], folder), ANSWER)
            compare(found, np.array(events.expected, ANSWER))
            total += len(found)
        return total
