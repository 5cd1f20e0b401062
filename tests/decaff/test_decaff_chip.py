"""The controller in C, built with sanitizers and for a Cortex-M7, fed with datagrams, its cost counted."""

import math
import re
import shutil
import sys

import numpy as np
import pytest
from compiling_c import c_compiler, run
from controller_in_c import ANSWER, DRIVER, SOURCES, STRICT, Events, answer_of, build, compare
from sealed_frames import frame
from wire import MS, SESSION, Clock, Wire

from proximity.decaff.controller.chip_sources import controller_sources, write_controller
from proximity.decaff.controller.compiled import SETTINGS
from proximity.decaff.controller.controller import (
    DrumState,
    FingerController,
    FrameMark,
    Observation,
    SurfaceLaw,
    Trust,
    largest_passive_stiffness,
)
from proximity.decaff.controller.records import controller_header
from proximity.decaff.controller.settings import CableRule, ControllerSettings, Limits
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.finger_path import MAX_BEND, MIN_BEND, FingerPath
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.message import ContactFlag, Defect, Mode, Source, Surface
from proximity.transport import Subscriber

PATH = FingerPath(Glove())
RATE = 3000.0
PERIOD_NS = 333_333
REASONS = [None, *Defect]
CORTEX_M7 = [
    "-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-O2", "-fno-math-errno",
    "-fstack-usage",
]  # fmt: skip
BUDGET = 216e6 / RATE * 0.2  # cycles per sample: a fifth of a core
CYCLES_AN_INSTRUCTION = 2.0
"""Assumed for a Cortex-M7, which may issue two at a time: flash loads and double precision take longer."""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return build(tmp_path_factory.mktemp("controller"))


class Glove3kHz:
    """A subscriber in Python and a controller at 3 kHz; logs their inputs for the controller in C."""

    def __init__(self, shares_clock=True, cable=None):
        self.clock, self.wire = Clock(), Wire(shares_clock)
        self.subscriber = Subscriber(self.wire, "wire:", clock=self.clock)
        self.controller = FingerController(PATH, RATE, cable=cable)
        self.events, self.defects, self.kinds = Events(shares_clock), [], []  # the input of each answer
        self.drum, self.bend = PATH.retracted, 0.2
        self.has_sensor, self.motor_force = True, 0.0

    def offer(self, data):
        before = self.subscriber.counts.flawed.copy()
        self.wire.put(data)
        list(self.subscriber.frames())
        self.defects.append(next(iter(self.subscriber.counts.flawed - before), None))
        self.events.datagram(data, self.clock.now)
        self.kinds.append("D")

    def sample(self):
        self.clock.now += PERIOD_NS
        reading = self.subscriber.read()
        finger = PATH.position(self.bend)
        pressing = max(0.0, 200.0 * (finger - self.drum))
        force = pressing if self.has_sensor else np.nan
        self.motor_force += 0.3 * (pressing + 0.1 - self.motor_force)
        seen = Observation(
            reading.now_ns, PATH.bend(min(finger, self.drum)), PATH.drum_angle(self.drum), reading.state,
            reading.contacts[0] if len(reading.contacts) else None, force,
            sample_ns=self.clock.now, frame=FrameMark.of(reading.header), motor_force=self.motor_force,
        )  # fmt: skip
        action = self.controller.step(seen)
        self.events.look(seen, answer_of(self.controller, action, reading.state))
        self.kinds.append("L")
        self.drum += min(max(action.position - self.drum, -2.5 / RATE), 2.5 / RATE)
        return action

    def check(self, program, folder):
        self.compare(self.events.answers([program], folder))

    def compare(self, data):
        """Compare the answers to datagrams and those to samples."""
        ends = np.cumsum([4 if kind == "D" else ANSWER.itemsize for kind in self.kinds])
        assert ends[-1] == len(data)
        answers = {"D": [], "L": []}
        for kind, answer in zip(self.kinds, np.split(np.frombuffer(data, np.uint8), ends[:-1]), strict=True):
            answers[kind].append(answer.tobytes())
        found = np.frombuffer(b"".join(answers["D"]), "<i4")
        assert [REASONS[number] for number in found] == self.defects
        compare(np.frombuffer(b"".join(answers["L"]), ANSWER), np.array(self.events.expected, ANSWER))


def frame_of(glove, number, late_ns=0, **fields_):
    """Return a frame whose first finger meets a wall at half a bend."""
    message = frame(2, glove.clock.now - late_ns)
    record = message.records[0]
    record["flags"], record["mode"] = (
        ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED,
        Mode.POSITION,
    )
    record["bend"], record["contact_bend"], record["surface"] = glove.bend, 0.5, Surface.RIGID
    distance = PATH.position(0.5) - PATH.position(glove.bend)
    for name in ("signed_distance", "lower", "upper"):
        record[name] = distance
    for name, value in fields_.items():
        record[name] = value
    return message


@pytest.mark.parametrize(
    ("shares_clock", "cable", "has_sensor"),
    [
        (True, CableRule(), True),
        (False, CableRule(), True),
        (True, CableRule(1200.0, 10.0), True),
        (False, CableRule(1200.0, 2.0), False),
    ],
)
def test_datagrams_lead_to_the_same_states_and_targets(shares_clock, cable, has_sensor, tmp_path):
    """Presses on a wall, with frames that are late, lost, corrupt, repeated, invalid, or of another run."""
    rng, glove = np.random.default_rng(7), Glove3kHz(shares_clock, cable)
    glove.has_sensor = has_sensor
    ahead = 0 if shares_clock else 3600_000 * MS
    sequence, session, kinds = 0, SESSION, set()
    soft = {"surface": Surface.DEFORMABLE, "stiffness": 800.0, "damping": 1.5}
    slave = {"source": Source.TELEOPERATION, "force": 0.6, "force_is_valid": 1}
    for sample in range(15_000):
        time = sample / RATE
        glove.bend = 0.36 + 0.16 * np.sin(2.0 * np.pi * 0.8 * time)
        if sample % 3 == 0 and not 2400 < sample % 5000 < 2400 + 300 * (sample // 5000):  # and pauses
            what = rng.integers(40)
            extra = [{}, soft, slave][sample // 1500 % 3]
            message = frame_of(glove, sequence, int(rng.choice([0, 1, 3])) * MS - ahead, **extra)
            row = message.records[0]
            if what == 0:
                row[rng.choice(["lower", "predicted_distance", "time_to_contact", "bend"])] = np.nan
            elif what == 1:
                row["position"][1], row["normal"] = rng.choice([np.nan, 0.0]), rng.choice([0.0, np.nan, 1.0])
            elif what == 2:
                row[rng.choice(["surface", "mode", "source", "force_is_valid"])] = 9
            elif what == 3:
                message.header[rng.choice(["state", "source"])] = rng.integers(8)
            elif what == 4:
                message.header[rng.choice(["pose_ns", "publish_ns"])] += int(rng.choice([4, 7, 2**62]))
            elif what == 5:
                row["contact_bend"], row["contact_bend_rate"] = rng.choice([0.3, 0.45, 1.2, np.nan]), -0.5
            elif what == 6 and rng.random() < 0.2:
                session += int(rng.integers(-2, 3))
            elif what == 7:
                row["flags"], row["mode"] = 0, Mode.HOLD
            sequence = max(sequence + int(rng.choice([1] * 12 + [3, 0, -2])), 0)
            data = bytearray(message.seal(session, sequence).tobytes())
            if what == 8:
                data[rng.integers(len(data))] ^= 1 << rng.integers(8)
            elif what == 9:
                data = data[: rng.integers(len(data))]
            glove.offer(data)
        kinds.add(glove.sample().state)
    assert len(kinds) >= 5 + has_sensor and len(set(glove.defects)) >= 6
    glove.check(build(tmp_path, ControllerSettings(RATE, cable=cable)), tmp_path)


@pytest.mark.parametrize("has_sensor", [True, False])
def test_stretch_of_the_cable_is_made_up_for_alike(has_sensor, tmp_path):
    """Two presses of 1.5 s each, with frames at 1 kHz."""
    cable = CableRule(1200.0, 10.0 if has_sensor else 2.0)
    glove, sent = Glove3kHz(cable=cable), []
    glove.has_sensor = has_sensor
    for sample in range(9000):
        glove.bend = 0.2 + min(0.0003 * (sample % 4500), 0.31)
        if sample % 3 == 0:
            glove.offer(frame_of(glove, sample).seal(SESSION, sample).tobytes())
        sent.append(PATH.position(0.5) - glove.sample().position)

    assert sent[4400] == pytest.approx(0.5e-3, rel=0.5)
    glove.check(build(tmp_path, ControllerSettings(RATE, cable=cable)), tmp_path)


def test_what_the_key_does_not_verify_is_not_used(program, tmp_path):
    """Only the datagram with a valid tag is used."""
    from hashlib import blake2s

    key = bytes(range(32))
    glove = Glove3kHz()
    data = frame_of(glove, 0).seal(SESSION, 0).tobytes()
    tagged = data + blake2s(data, key=key, digest_size=16).digest()
    events = Events(key=key)
    for datagram in (data, tagged[:-1], tagged[:-1] + b"x", b"", tagged, tagged):
        events.datagram(datagram, glove.clock.now)
    assert np.frombuffer(events.answers([program], tmp_path), "<i4").tolist() == [9, 9, 9, 9, 0, 6]


def test_sequence_of_nobody_leaves_the_drum_its_frames(program, tmp_path):
    """Regression: after one frame numbered 2**64 - 2 all others counted as overtaken, until a new session."""
    glove = Glove3kHz()
    for sample in range(60):
        glove.bend = 0.3
        wild = 2**64 - 2 if sample == 30 else sample
        if sample % 3 == 0:
            glove.offer(frame_of(glove, sample).seal(SESSION, wild).tobytes())
        action = glove.sample()
    assert action.state is DrumState.APPROACH
    assert glove.defects.count(Defect.OLD) == 1 and glove.defects.count(None) == 19
    glove.check(program, tmp_path)


@pytest.mark.parametrize("instant", [-(2**63), -(2**63) + 1, -1, 2**61 + 1, 2**63 - 1])
@pytest.mark.parametrize("shares_clock", [True, False])
def test_instant_that_no_clock_shows_is_refused(program, instant, shares_clock, tmp_path):
    """Regression: it passed the checks and overflowed in the estimate of the sender's clock."""
    glove = Glove3kHz(shares_clock)
    for sample in range(300):
        message = frame_of(glove, sample)
        if sample % 10 == 5:
            message.header["publish_ns"] = instant
        glove.offer(message.seal(SESSION, sample).tobytes())
        action = glove.sample()
    assert action.state is DrumState.APPROACH and set(glove.defects) <= {None, Defect.CONTENT, Defect.FUTURE}
    assert glove.defects.count(None) == 270
    glove.check(program, tmp_path)


def served(program, folder, mode, targets, positions, speed_cap=np.inf, force_cap=np.inf, measured=np.nan):
    """Return the forces of the servo for targets, m or N, at positions, m."""
    events = Events(position=positions[0])
    for target, position in zip(targets, positions, strict=True):
        numbers = [target, speed_cap, force_cap, np.nan, np.inf, position, measured, 0.0]
        events.data += b"V" + bytes([mode]) + np.array(numbers).tobytes()
    return np.frombuffer(events.answers([program], folder), "<f8")


@pytest.mark.parametrize(("mode", "target"), [(DriveMode.POSITION, 0.05), (DriveMode.FORCE, 0.5)])
def test_encoder_without_a_number_for_a_sample_commands_no_force(program, mode, target, tmp_path):
    """Regression: for that sample and the next the force was 100 N away from the finger."""
    positions = np.full(10, 0.0501)
    positions[5] = np.nan
    found = served(program, tmp_path, mode, np.full(10, target), positions, force_cap=100.0, measured=0.5)
    assert np.abs(found[2:5]).min() > 0.1  # the servo was active before
    assert found[5] == found[6] == 0.0


def test_drum_that_is_held_at_its_stop_winds_no_force_up(program, tmp_path):
    """Regression: 0.05 mm short of its target for 4 s, it reached all 53 N, and lost them as slowly."""
    positions = np.full(12_010, 0.15)
    targets = np.where(np.arange(12_010) < 12_000, positions + 5e-5, positions)
    limit = ControllerSettings(RATE).record()[0].servo_integral_limit
    assert 10.0 < limit < 15.0
    forces = served(program, tmp_path, DriveMode.POSITION, targets, positions)
    assert forces[-1] == pytest.approx(limit, abs=0.1)


def test_drum_that_has_lost_the_finger_brakes_while_it_serves_a_force(program, tmp_path):
    """With 5 N over the millimetre up to the release it hit the finger with 5 mJ."""
    force, slower = (
        served(program, tmp_path, DriveMode.FORCE, np.full(60, 5.0), 0.15 - 0.3 / RATE * np.arange(60), cap)
        for cap in (0.05, 2.0)
    )
    assert force[-1] > 10.0 and slower[-1] < -4.0


@pytest.mark.parametrize("angle", [-0.5, 1.9, 2.4])
def test_path_goes_on_beyond_its_ends(angle):
    """Regression: at the stop, 1.9 rad, the position was the path's end, 1.805 rad, and uncontrollable."""
    least, most = PATH.drum_angles
    end = least if angle < least else most
    beyond = PATH.lever(end) * (angle - end)
    assert abs(beyond) > 0.01
    assert PATH.drum_position(angle) == pytest.approx(PATH.drum_position(end) + beyond)
    assert PATH.drum_angle(PATH.drum_position(angle)) == pytest.approx(angle)
    controller = FingerController(PATH, RATE)
    action = controller.step(Observation(0, 0.2, angle, sample_ns=0))
    assert action.position == PATH.retracted and math.isfinite(action.torque_cap)


@pytest.mark.parametrize("damping", [0.0, 0.3, 0.5, 5.0])
def test_bound_of_passivity_in_closed_form_is_colgates(damping):
    """A drum without damping, a pad of 2 N s/m of which a surface uses half at most."""
    displayed = SurfaceLaw(ControllerSettings(RATE)).displayed(1e6, damping)
    assert displayed[1] == min(damping, 1.0)
    assert displayed[0] == pytest.approx(
        largest_passive_stiffness(2.0, displayed[1], 1.0 / RATE, 1), rel=1e-9
    )


def test_numbers_that_python_has_as_well_are_the_same():
    text = controller_header()
    for name, number in {"LEAST_BEND": MIN_BEND, "MOST_BEND": MAX_BEND}.items():
        (written,) = re.findall(rf"#define DECAFF_{name} (\S*)", text)
        assert float(re.sub(r"[()]", "", written)) == number
    for kind, prefix in ((DrumState, "DRUM_STATE"), (Trust, "TRUST"), (DriveMode, "DRIVE_MODE")):
        written = [int(number) for number in re.findall(rf"    DECAFF_{prefix}_\w+ = (\d)", text)]
        assert written == list(range(len(kind)))
        assert re.findall(rf"    DECAFF_{prefix}_(\w+) = ", text) == [member.name for member in kind]


def test_every_number_is_used():
    files = controller_sources([Glove()])
    code = files["decaff_controller.c"] + files["decaff_controller.h"].partition("decaff_settings;")[2]
    names = re.findall(r"#define (DECAFF_\w+) ", files["decaff_controller.h"])
    used = code + files["decaff_controller.h"]
    assert {name for name in names if len(re.findall(rf"\b{name}\b", used)) < 2} <= {"DECAFF_CONTROLLER_H"}
    assert {name for name in SETTINGS.names if not re.search(rf"(set|settings)->{name}\b", code)} == set()


def test_settings_are_written_to_the_last_bit(tmp_path):
    settings = ControllerSettings(1000.0, DRUMS["gear14"], Limits(max_speed=2.1), cable=CableRule(1234.5))
    record, text = settings.record()[0], controller_sources([Glove()], settings)["decaff_glove.c"]
    for name in SETTINGS.names:
        (written,) = re.findall(rf"    \.{name} = (.*?),?\n", text)
        number = math.inf if "INFINITY" in written else float(re.sub(r"INT64_C|[()]", "", written))
        assert number == record[name]
    assert record.period == 1e-3 and record.max_speed == 2.1 and text.isascii()


def test_calibrated_fingers_have_paths_of_their_own(tmp_path):
    write_controller([Glove(), Glove()], tmp_path)
    run(c_compiler(), *STRICT, "-c", tmp_path / "decaff_glove.c", "-o", tmp_path / "glove.o")
    assert (tmp_path / "decaff_glove.c").read_text().count("sizeof bends_") == 4


def test_cortex_m7_takes_it_with_little_code_and_stack(tmp_path):
    """Print the numbers of docs/guide/controller.md; -s shows them."""
    gcc = shutil.which("arm-none-eabi-gcc")
    if gcc is None:
        pytest.skip("there is no cross compiler arm-none-eabi-gcc")
    write_controller([Glove()], tmp_path)
    sizes = {}
    for name in SOURCES:
        target = tmp_path / name.replace(".c", ".o")
        run(gcc, *STRICT, *CORTEX_M7, "-c", tmp_path / name, "-o", target)
        sizes[name] = [int(word) for word in run("arm-none-eabi-size", target).splitlines()[1].split()[:3]]
    stack = {}
    for line in (tmp_path / "decaff_controller.su").read_text().splitlines():
        where, size, kind = line.split("\t")
        assert kind == "static", line  # not of dynamic size
        stack[where.rpartition(":")[2]] = int(size)
    names = run("arm-none-eabi-nm", "-u", tmp_path / "decaff_controller.o").split()
    needed = {name for name in names if name != "U" and not name.startswith("__aeabi_")}  # compiler helpers
    print(f"\ncode and data, static data, zeroed: {sizes}; stack of the largest functions: ", end="")
    print(sorted(stack.items(), key=lambda entry: -entry[1])[:4])
    assert sizes["decaff_controller.c"][0] < 20_480 and sizes["decaff_controller.c"][1:] == [0, 0]
    assert sum(sorted(stack.values())[-6:]) < 2048  # no call path is deeper
    assert needed <= {"memcpy", "memset", "decaff_paths", "sqrt"}  # no heap, nor other functions of libm


def press(samples):
    """Return the log of a finger that presses on a teleoperated wall until a force is served, at 1 kHz."""
    glove = Glove3kHz()
    slave = {"source": Source.TELEOPERATION, "force": 0.6, "force_is_valid": 1}
    for sample in range(samples):
        glove.bend = min(0.3 + 0.2 * sample / 500, 0.52)
        if sample % 3 == 0:
            glove.offer(frame_of(glove, sample, **slave).seal(SESSION, sample).tobytes())
        glove.sample()
    return glove


def test_sample_costs_less_than_a_fifth_of_a_cortex_m7(tmp_path):
    """Count instructions on a simulated one, with the same states and targets."""
    gcc, qemu = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
    if gcc is None or qemu is None:
        pytest.skip("there is no arm-none-eabi-gcc, or no qemu-system-arm to run a Cortex-M7 with")
    write_controller([Glove()], tmp_path)
    names = ("controller_step", "subscriber_take", "subscriber_look", "servo_step")
    run(
        gcc, "-std=c99", *CORTEX_M7[:-1], "--specs=rdimon.specs", f"-I{tmp_path}",
        *(f"-Wl,--section-start={section}" for section in (".vectors=0", ".init=0x800", ".text=0x1000")),
        "-Wl,--section-start=.data=0x20000000", *(f"-Wl,--wrap=decaff_{name}" for name in names),
        *(tmp_path / name for name in SOURCES), DRIVER, DRIVER.with_name("controller_cortex_m7.c"),
        "-lm", "-o", tmp_path / "driver.elf",
    )  # fmt: skip
    glove = press(1500)
    served = b"V\1" + np.array([0.05, np.inf, 20.0, 0.5, 0.0, 0.0501, 0.5, 0.0]).tobytes()
    (tmp_path / "events").write_bytes(glove.events.data + 1500 * served)
    files = f"arg=driver,arg={tmp_path}/events,arg={tmp_path}/answers"
    told = run(
        qemu, "-M", "mps2-an500", "-nographic", "-icount", "shift=10", "-monitor", "none", "-serial", "none",
        "-semihosting-config", f"enable=on,target=native,{files}", "-kernel", tmp_path / "driver.elf",
    )  # fmt: skip
    glove.compare((tmp_path / "answers").read_bytes()[: -1500 * 8])  # without the servo's answers
    counts = [[float(word) for word in line.split()] for line in told.splitlines()]
    print("\ninstructions, mean and most:", dict(zip(names, (count[1:] for count in counts), strict=True)))
    a_sample = sum(count[0] * count[1] for count in counts) / counts[0][0]
    assert counts[0][0] == 1500 and counts[0][2] > counts[0][1] > 100.0  # the counters worked
    assert a_sample * CYCLES_AN_INSTRUCTION < BUDGET
    assert sum(count[2] for count in counts) < BUDGET  # also with a frame, one cycle each


def test_sample_costs_less_than_a_fifth_of_a_core(tmp_path):
    """Count instructions on this machine: one finger with a frame every third sample."""
    if shutil.which("valgrind") is None or sys.platform != "linux":
        pytest.skip("there is no valgrind to count instructions with")
    program = build(tmp_path, options=["-O2", "-fno-math-errno"])
    glove = press(3000)
    counted = {}
    for function in ("decaff_controller_step", "decaff_subscriber_take", "decaff_subscriber_look"):
        out = tmp_path / f"{function}.out"
        tool = [
            "valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", f"--toggle-collect={function}",
            "--collect-atstart=no", program,
        ]  # fmt: skip
        glove.events.answers(tool, tmp_path)
        (total,) = re.findall(r"^(?:summary|totals): (\d+)", out.read_text(), re.MULTILINE)[:1]
        counted[function] = int(total) / len(glove.events.expected)
    print(f"\ninstructions a sample: {counted}")

    assert all(number > 10.0 for number in counted.values())
    assert sum(counted.values()) * CYCLES_AN_INSTRUCTION < BUDGET
