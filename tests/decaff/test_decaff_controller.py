"""The drum's controller: each failure and transition of docs/guide/drums.md, and its safety properties."""

import math
import operator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sealed_frames import frame

from proximity.decaff.controller import compiled
from proximity.decaff.controller.controller import (
    DrumState,
    FingerController,
    FrameMark,
    Observation,
    SurfaceLaw,
    Trust,
    required_damping,
)
from proximity.decaff.controller.served_drum import move
from proximity.decaff.controller.settings import (
    SERVO_LAG,
    CableRule,
    ControllerSettings,
    Limits,
    SteadyRule,
)
from proximity.decaff.drum.servo import DriveMode, servo_for
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.message import ContactFlag, Mode, Source, State, Surface
from proximity.native import declaration

GLOVE = Glove()
PATH = FingerPath(GLOVE)
MS = 1_000_000
RATE = 1000.0
LIMITS = Limits()
TRACKED = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED
WALL = 0.5  # bend of the contact
ANY_SPEED = Limits(steady=SteadyRule(slow_speed=math.inf))
# Fields of records other than the position of contact.
SOFT = {"surface": Surface.DEFORMABLE, "stiffness": 200.0, "damping": 0.0}
SLAVE = {"source": Source.TELEOPERATION, "force": 0.6, "force_is_valid": 1}
LOST = {"flags": 0, "mode": Mode.HOLD}
CLOSING = {"bend_rate": 1.0, "approach_speed": 0.2, "velocity": np.nan, "signed_distance": 0.02}
RETRACTED, APPROACH, POSITION, CONTACT_FORCE, HOLD, FREEZE, FAULT = DrumState


def contact(pose_ns, /, bend=0.3, position=WALL, **fields):
    """Return a record of a finger at a bend whose path meets the wall at *position*."""
    record = frame(1).records[0]
    record["flags"], record["pose_ns"], record["mode"] = TRACKED, pose_ns, Mode.POSITION
    record["bend"], record["contact_bend"], record["contact_bend_error"] = bend, position, 0.0
    distance = float(GLOVE.finger.path_length(bend, position)) if math.isfinite(position) else 0.02
    record["signed_distance"] = record["lower"] = record["upper"] = distance
    for name, value in fields.items():
        record[name] = value
    return record


class Bench:
    """A controller stepped at 1 kHz with given finger and drum positions and a frame each sample."""

    def __init__(self, **settings):
        self.controller = FingerController(PATH, RATE, **settings)
        self.now, self.bend, self.force = 0, 0.3, 0.0
        self.ahead = 0  # ns by which the servo's clock is ahead
        self.session, self.frame, self.told = 7, None, None  # the newest record and its frame
        self.drum = PATH.retracted  # m, position
        self.action = None

    def place(self, fields):
        """Set finger, drum, force and clocks from *fields*; return the fields of the record."""
        names = {"finger": "bend", "felt": "force"} | dict.fromkeys(
            ("drum", "session", "now", "ahead", "frame")
        )
        for name in fields.keys() & names.keys():
            setattr(self, names[name] or name, fields[name])
        return {name: value for name, value in fields.items() if name not in names}

    def step(self, told=None, state=State.OK, **seen):
        self.now += MS
        given = {"bend": self.bend, "drum_angle": PATH.drum_angle(self.drum), "force": self.force} | seen
        if told is not None and (self.told is None or told.tobytes() != self.told):
            sequence = 0 if self.frame is None else self.frame.sequence + 1
            self.frame, self.told = FrameMark(self.session, sequence, self.now), told.tobytes()
        given = {"sample_ns": self.now + self.ahead, "frame": self.frame} | given
        self.action = self.controller.step(Observation(self.now, state=state, contact=told, **given))
        return self.action

    def run(self, count, **fields):
        """Step with fresh frames; the drum reaches its target immediately."""
        for _ in range(count):
            self.step(contact(self.now, **({"bend": self.bend} | fields)))
            self.drum = self.action.position
        return self.action

    def age(self, milliseconds, told=None, state=State.LATE):
        """Step without new frames for a number of milliseconds."""
        for _ in range(milliseconds):
            self.step(told, state)
        return self.action


def approaching(finger=0.3, **settings):
    bench = Bench(**settings)
    bench.bend = finger
    bench.run(4)
    assert bench.action.state is DrumState.APPROACH
    return bench


def location_of(*records):
    """Return the position of contact from successive records, each of a new pose, or None."""
    bench = Bench()
    for record in records:
        told = record.copy()
        told["pose_ns"] = bench.now
        bench.step(told)
    frames = bench.controller.frames
    return frames.location if frames.has_location else None


def touching(**fields):
    """Return a bench with a finger at the wall, the drum at its contact, 0.8 N between them."""
    bench = approaching(**{name: fields.pop(name) for name in ("drum", "limits") if name in fields})
    bench.bend = WALL
    bench.force = 0.8
    bench.run(3, **fields)
    return bench


def test_places_agree_with_the_glove():
    for bend in (0.0, 0.123, 0.5, 0.9):
        position = float(GLOVE.finger.path_length(0.0, bend))
        assert PATH.position(bend) == pytest.approx(position, abs=1e-6)
        assert PATH.bend(position) == pytest.approx(bend, abs=1e-5)
        assert PATH.drum_angle(position) == pytest.approx(float(GLOVE.drum_angle(bend)), abs=1e-5)
        assert PATH.drum_position(float(GLOVE.drum_angle(bend))) == pytest.approx(position, abs=1e-6)
    assert PATH.retracted > PATH.position(1.0)


def test_place_of_contact_is_extrapolated_where_none_is_told():
    """b + d/(-n.p'), with p' from the finger's motion; a plane at 45 degrees to the path."""
    rate, bend, distance = 2.0, 0.3, 0.005
    slope = GLOVE.finger.point_rate(bend)
    along = slope / np.hypot(*slope)
    normal = -(along + np.array([-along[1], along[0]])) / math.sqrt(2.0)
    told = contact(0, bend, math.nan, signed_distance=distance, bend_rate=rate)
    told["normal"][:2], told["normal"][2] = normal, 0.0
    told["velocity"][:2], told["velocity"][2] = rate * slope, 0.0
    location = location_of(told, told)
    assert location.bend == pytest.approx(float(GLOVE.finger.contact_bend(bend, distance, normal)))
    assert location.incidence == pytest.approx(math.sqrt(0.5), rel=0.01)


@pytest.mark.parametrize("fields", [{"bend_rate": 0.0}, {"bend_rate": -1.0}, {"signed_distance": np.inf}])
def test_finger_that_is_not_closing_has_no_place_of_contact(fields):
    told = contact(0, 0.3, math.nan, **({"bend_rate": 1.0, "velocity": [0.0, 0.0, -1.0]} | fields))
    assert location_of(told, told) is None


def test_place_of_contact_does_not_depend_on_latency():
    """The pose of the message counts, not the displacement of the finger since then."""
    positions = []
    for latency in (0, 3, 15):
        bench = Bench()
        for _ in range(30):
            bench.bend += 0.002
            told = contact(bench.now - latency * MS, bend=bench.bend - 0.002 * latency, contact_bend_rate=0.5)
            told["contact_bend"] = 0.5 + 0.5e-9 * (bench.now - latency * MS)  # of a receding wall
            bench.step(told)
        positions.append(bench.action.position)
    assert positions == pytest.approx([PATH.position(0.5 + 0.5e-9 * 30 * MS)] * 3, abs=1e-9)


@pytest.mark.parametrize("position", [0.2, WALL - 0.001, 0.5])
def test_finger_that_is_free_is_not_pressed_whatever_is_said_of_its_way(position):
    """Regression: a position behind a finger 20 mm from every part pulled the drum onto it, as if late."""
    bench = Bench()
    bench.bend, nearest = WALL, PATH.position(WALL) + 0.020
    for _ in range(100):
        action = bench.run(1, position=position, signed_distance=0.021, lower=0.020)
        assert action.state in (DrumState.RETRACTED, DrumState.APPROACH)
        assert action.position >= nearest - 3e-6


CABLE = CableRule(1200.0)


def stretch(bench):
    """Distance by which the drum's target is nearer than the contact, m."""
    return PATH.position(WALL) - bench.action.position


@pytest.mark.parametrize("force", ["force", "motor_force"])
def test_stretch_of_the_cable_is_made_up_for_while_the_drum_is_touched(force):
    """By the measured force, else the motor's; slowly, and only during contact."""
    bench = approaching(cable=CABLE)
    bench.bend, pressing = WALL, {"force": math.nan} | {force: 0.6}
    bench.step(contact(bench.now, WALL), **pressing)
    assert 0.0 <= stretch(bench) < 1e-7
    for milliseconds, share in ((55, 0.15), (80, 0.5), (865, 1.0)):
        for _ in range(milliseconds):
            bench.step(contact(bench.now, WALL), **pressing)
        assert stretch(bench) == pytest.approx(share * 0.6 / 1200.0, rel=0.1)
    assert bench.action.state is DrumState.CONTACT_POSITION
    assert bench.action.angle == pytest.approx(PATH.drum_angle(bench.action.position))
    bench.bend = 0.3
    bench.step(contact(bench.now, 0.3), force=0.0)
    assert stretch(bench) == pytest.approx(0.0, abs=3e-6)


def test_cable_without_a_stiffness_and_a_force_that_nobody_knows_leave_the_drum():
    for options, seen in (({}, {"force": 0.6}), ({"cable": CABLE}, {"force": math.nan})):
        bench = approaching(**options)
        bench.bend, bench.drum = WALL, PATH.position(WALL)
        for _ in range(300):
            bench.step(contact(bench.now, WALL), **seen)
        assert bench.action.state is DrumState.CONTACT_POSITION
        assert stretch(bench) == pytest.approx(0.0, abs=3e-6)


def test_stretch_does_not_grow_while_frames_are_old_and_counts_no_more_than_the_force_that_may_last():
    bench = approaching(cable=CABLE)
    bench.bend, bench.force = WALL, 0.6
    bench.run(100)
    old = contact(bench.now, WALL)
    bench.age(25, old)
    before = stretch(bench)
    bench.age(60, old)
    assert bench.action.state is DrumState.HOLD
    assert stretch(bench) == before
    bench.force = 0.0
    bench.age(200, old)
    assert stretch(bench) < before
    bench.force = 1e3
    for _ in range(1000):
        bench.step(contact(bench.now, WALL))
    assert stretch(bench) == pytest.approx(LIMITS.continuous_force / 1200.0, rel=0.01)


class Backward:
    finger = GLOVE.finger

    def drum_angle(self, bend):
        return -np.asarray(bend)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: CableRule(stiffness=0.0), "stiffness is 0.0, expected a positive number of newtons a metre"),
        (lambda: CableRule(smoothing=-1.0), "smoothing is -1.0, expected a positive number of hertz"),
        (lambda: Limits(near_energy=0.0), "near_energy is 0.0, expected a positive number of joules"),
        (lambda: FingerController(PATH, -1), "rate is -1, expected a positive number of hertz"),
        (
            lambda: FingerPath(Backward()),
            "the drum moves backwards at the flat hand, expected a drum that follows",
        ),
    ],
)
def test_part_or_limit_that_cannot_be_is_named(make, sentence):
    with pytest.raises(ArgumentError) as caught:
        make()
    assert str(caught.value).startswith(sentence)


BACK = PATH.retracted
INSIDE = {"signed_distance": -0.004, "lower": -0.004}
RAN_OUT = {"flags": TRACKED | ContactFlag.ON_PATH, "contact_bend_error": np.inf, "contact_bend_rate": np.nan}
RIGID_SLAVE = SLAVE | {"surface": Surface.RIGID}
DAMPED = {"surface": Surface.DEFORMABLE, "stiffness": 100.0, "damping": 1.0}
BAD = [
    ("signed_distance", math.nan), ("signed_distance", -math.inf), ("signed_distance", 1e4),
    ("normal", [0.0, 0.0, 1.002]), ("normal", [0.0, 0.0, 0.998]), ("bend", 1.2), ("contact_bend", -0.2),
    ("contact_bend_rate", 1e3), ("contact_bend_error", -1.0), ("surface", 9),
]  # fmt: skip
FAULTS = {
    "the potentiometer gives no bend": {"bend": math.nan},
    "the potentiometer reads a bend of 2.85, expected -0.1 to 1.1": {"bend": 2.85},  # broken wire
    "the potentiometer reads a bend of -0.72, expected -0.1 to 1.1": {"bend": -0.72},
    "the encoder gives no drum angle": {"drum_angle": math.inf},
    "the encoder reads a drum angle of 60 rad, but the finger's path goes from 0.0921 to 1.81 rad": {
        "drum_angle": 60.0  # degrees
    },
    "the motor reports a fault": {"has_fault": True},
}


def run(count=1, **fields):
    """Step with fresh frames; the drum reaches its target."""
    return lambda bench: bench.run(count, **bench.place(fields))


def step(count=1, state=State.OK, seen=None, ahead_ns=0, **fields):
    """Step with fresh frames; the drum does not move."""

    def act(bench):
        rest = bench.place(fields)
        for _ in range(count):
            record = contact(bench.now + ahead_ns, **({"bend": bench.bend} | rest))
            bench.step(record, state, **(seen or {}))

    return act


def silence(state=State.OK, **where):
    """Step once without a frame."""
    return lambda bench: bench.step(None, state, **bench.place(where))


def age(milliseconds, **where):
    """Step without new frames for a number of milliseconds."""
    return lambda bench: bench.age(milliseconds, **bench.place(where))


def stop(bench):
    bench.controller.stop()


def reset(bench):
    bench.controller.reset()


def beyond(gap):
    """Return the bend at which the finger is *gap* m beyond the wall."""
    return PATH.bend(PATH.position(WALL) + gap)


def leaning(gap):
    """Return the fields of a finger that has pushed the drum *gap* m beyond the wall."""
    return {"finger": beyond(gap), "drum": PATH.position(WALL) + gap}


kept, farther = operator.eq, operator.gt  # compare a field after the event with before


def at_most(bound):
    return lambda found, before: found <= bound


def at_least(bound):
    return lambda found, before: found >= bound


# Each failure and transition: the initial bench; then events, the state after each, and further fields.
# "at": the bend of the drum's target.
TRANSITIONS = {
    "the drum waits retracted until a contact is told twice": [Bench, (silence(), RETRACTED),
        (step(position=math.nan), RETRACTED), (step(), RETRACTED),
        (step(), APPROACH, {"mode": DriveMode.POSITION, "at": WALL, "awaited": 1}),
        (run(), APPROACH, {"angle": pytest.approx(float(GLOVE.drum_angle(WALL)), abs=1e-5)})],
    "no contact is expected any more": [approaching, (run(position=math.nan), RETRACTED, {"position": BACK})],
    **{
        f"touch at {gap} m and {force} N": [approaching, (run(finger=beyond(-gap), felt=force), state)]
        for gap, force, state in (  # force without a touch is a sensor error
            (29e-6, 0.0, POSITION), (31e-6, 0.0, APPROACH), (0.5e-3, 0.06, POSITION),
            (0.5e-3, 0.04, APPROACH), (1.5e-3, 0.06, APPROACH))
    },
    "a touched drum holds up to a millimetre": [touching,  # new positions do not move it
        *((run(finger=beyond(-gap), felt=0.0, position=WALL + 0.003, lower=0.0), POSITION, {"position": kept})
          for gap in (0.1e-3, 0.5e-3, 0.99e-3)),
        (run(finger=beyond(-1.01e-3), position=WALL + 0.003), APPROACH, {"at": WALL + 0.003})],
    **{
        # Regression: it counted as touched; a soft part served a force of 0, and the drum did not move.
        f"the object a finger leans on has gone, {fields['surface'].name}": [partial(touching, **fields),
            *[(step(position=WALL + 0.05, **fields), APPROACH,  # a centimetre away
               {"mode": DriveMode.POSITION, "at": WALL + 0.05})] * 20]
        for fields in (SOFT, SOFT | {"surface": Surface.RIGID})
    },
    "a rigid part of a scene is never served as a force": [partial(touching, limits=ANY_SPEED),
        (run(400, surface=Surface.RIGID), POSITION)],
    "teleoperation serves the force once it is steady": [partial(touching, limits=ANY_SPEED, **RIGID_SLAVE),
        (None, POSITION),
        (run(200, **RIGID_SLAVE), CONTACT_FORCE, {"mode": DriveMode.FORCE, "force": pytest.approx(0.6)}),
        # Bumpless: starts at the measured force and follows the servo's slew limit, as a handover needs.
        (None, CONTACT_FORCE, {"start_force": pytest.approx(0.8, abs=0.02), "force_slew": 0.0}),
        (run(19, felt=0.04, **RIGID_SLAVE), CONTACT_FORCE), (run(2, **RIGID_SLAVE), POSITION)],
    # Without a measured force, contact is unknown: the drum would press until it met an obstacle.
    "the force of teleoperation is not measured any more": [partial(touching, limits=ANY_SPEED, **SLAVE),
        (run(200, **SLAVE), CONTACT_FORCE), (run(19, felt=math.nan, **SLAVE), CONTACT_FORCE),
        *[(run(2, **SLAVE), POSITION)] * 100,
        (run(200, felt=0.8, **SLAVE), CONTACT_FORCE)],
    "the slave is off its object": [partial(touching, limits=ANY_SPEED, **SLAVE),
        (run(200, **SLAVE), CONTACT_FORCE),
        # Regression: the state alternated each sample; the force is steady.
        *[(run(**SLAVE, signed_distance=0.6e-3), POSITION)] * 101,
        (run(**SLAVE), CONTACT_FORCE)],
    **{
        # Regression: touched on its path, it served a force of 0 and by its motor's estimate moved on 12 mm.
        f"a drum {near} m too near a soft surface": [partial(touching, **SOFT),
            (step(**leaning(-near), **SOFT), state, {"mode": mode, "at": WALL})]
        for near, state, mode in (
            (0.2e-3, CONTACT_FORCE, DriveMode.FORCE), (0.4e-3, POSITION, DriveMode.POSITION))
    },
    "a deformable surface is served by its law from the touch on": [Bench, (run(4, **SOFT), APPROACH),
        (run(finger=WALL, felt=0.1, **SOFT), CONTACT_FORCE),
        (step(40, **leaning(0.002), signed_distance=-0.002, lower=-0.002, **SOFT), CONTACT_FORCE,
         {"mode": DriveMode.FORCE, "force": pytest.approx(0.4, rel=1e-3), "force_slew": math.inf})],
    "the law never pulls a finger that leaves at a metre a second": [partial(touching, **DAMPED),
        (step(30, **leaning(0.002), **DAMPED), CONTACT_FORCE),
        (step(**leaning(0.001), **DAMPED), CONTACT_FORCE),
        (step(**leaning(0.0001), **DAMPED), CONTACT_FORCE, {"mode": DriveMode.FORCE, "force": 0.0})],
    "after 100 ms the drum retracts": [approaching,
        (age(102), RETRACTED, {"position": BACK, "speed_cap": math.inf, "force_cap": math.inf})],
    "in contact the drum holds up to 100 ms": [touching,
        (age(60), HOLD, {"position": kept, "force_cap": kept}), (run(), POSITION)],
    "in contact the drum freezes and then its force goes": [touching,
        (age(99), HOLD, {"position": kept, "force_cap": kept}),
        (age(2), FREEZE, {"position": kept, "force_cap": kept}),
        (age(248), FREEZE, {"position": kept, "force_cap": kept}),
        (age(127), FREEZE, {"position": kept, "force_cap": pytest.approx(0.5 * LIMITS.peak_force, rel=0.02)}),
        (age(1, felt=0.09), RETRACTED, {"position": BACK})],
    "a frame that comes during the ramp does not let the drum snap": [touching, (age(99 + 2 + 400), FREEZE),
        (step(**leaning(0.004)), POSITION, {"speed_cap": at_most(0.05), "force_cap": at_most(1.0)})],
    **{
        f"a service that is {state.name}, whatever the age": [approaching, (step(state=state), RETRACTED)]
        for state in (State.STALE, State.STARTING, State.STOPPING)
    },
    # An old frame of a tracked finger does not restore it.
    "tracking is lost in free space": [approaching, (step(**LOST), RETRACTED), (silence(), RETRACTED)],
    "tracking is lost in contact": [touching, (step(**LOST), FREEZE), (silence(), FREEZE)],
    **{
        f"a frame of {field} {value} is dropped and counted, and the old one ages": [approaching,
            (step(25, **{field: value}), APPROACH, {"dropped": 25, "trust": Trust.OLD, "position": farther})]
        for field, value in BAD
    },
    "a pose from the future or the past is dropped": [approaching,
        (step(ahead_ns=7 * MS), APPROACH, {"dropped": 1}),  # 6 ms ahead when read
        (step(ahead_ns=5 * MS), APPROACH, {"dropped": 1}),  # 4 ms
        (step(), APPROACH), (step(ahead_ns=-9 * MS), APPROACH, {"dropped": 3})],
    "a jump towards the finger needs a second frame": [approaching,
        (run(position=WALL - 0.05), APPROACH, {"position": kept}),
        (run(), APPROACH, {"position": kept}),  # the second disagreed
        (run(position=WALL - 0.05), APPROACH, {"position": kept}),
        (run(position=WALL - 0.05), APPROACH, {"at": WALL - 0.05}),
        (run(position=WALL), APPROACH, {"at": WALL})],  # moving away needs no confirmation
    # 63 mm nearer: possible in 60 ms, but only a lead of up to 20 ms is accepted unconfirmed.
    "a jump towards the finger after a silence": [partial(approaching, finger=0.05), (age(60), APPROACH),
        (step(position=0.2), APPROACH, {"position": at_least(PATH.position(WALL) - 1e-9), "awaited": 2}),
        (step(position=0.2), APPROACH, {"at": 0.2})],
    # Poses at 60 Hz, frames at 1 kHz: the drum stood up to 20 ms where the part had been.
    "a part that moves between two poses is followed at once": [approaching, (step(pose_ns=4 * MS), APPROACH),
        *((step(pose_ns=4 * MS, position=beyond(away)), APPROACH, {"at": beyond(away), "awaited": 1})
          for away in (1e-3, 30e-3, 29e-3, 26.1e-3))],  # from the wall; nearer at 2.9 m/s
    "a jump towards the finger is not confirmed by frames of the same pose": [approaching,
        *((step(pose_ns=4 * MS, position=WALL - nearer), APPROACH, {"position": kept})
          for nearer in np.linspace(0.05, 0.049, 10)),
        (None, APPROACH, {"awaited": 2}),  # including that of the start
        (step(position=WALL - 0.049), APPROACH, {"at": WALL - 0.049})],
    # Its poses begin at 0 again; a nearer position is confirmed by a second frame.
    "a service on a machine that started anew is followed": [approaching, (run(1000), APPROACH),
        (silence(State.STALE, session=8, now=0, ahead=1004 * MS), RETRACTED),
        (run(3), APPROACH, {"trust": Trust.FRESH, "dropped": 0})],
    "a frame that was overtaken is dropped": [approaching, (step(), APPROACH),
        (step(frame=FrameMark(7, 1, 5 * MS), position=WALL + 0.1), APPROACH, {"position": kept}),
        (step(2, position=WALL + 0.1), APPROACH, {"dropped": 3, "position": kept})],
    "a finger that begins inside is given way until it was outside": [Bench,
        (run(5, **INSIDE, flags=TRACKED | ContactFlag.INSIDE, position=0.2), RETRACTED, {"position": BACK}),
        (run(2, position=0.4), APPROACH, {"at": 0.4})],
    "a finger that jumps inside is given way": [approaching,
        (run(finger=0.49, **INSIDE, flags=TRACKED | ContactFlag.JUMPED, position=0.2), APPROACH,
         {"position": pytest.approx(PATH.position(0.49) + LIMITS.standoff, abs=1e-5)}),
        (run(5, **INSIDE, position=0.2), APPROACH, {"position": kept}),
        (run(finger=0.3, position=0.4), APPROACH, {"at": 0.4})],
    **{
        # The finger may have moved anywhere since: as at the start.
        f"a finger that is found inside after a silence: {name}": [approaching, (doubt, RETRACTED),
            (run(5, finger=0.49, drum=BACK, **INSIDE, position=0.49), None,
             {"position": at_least(PATH.position(0.49) + LIMITS.standoff - 1e-9)}),
            (run(3, finger=0.3, position=0.4), None, {"at": 0.4})]
        for name, doubt in {"lost": step(**LOST), "stale": step(state=State.STALE), "old": age(110)}.items()
    },
    "a part that is put where the finger is gives it way": [approaching,
        (run(5, **INSIDE, position=0.3), APPROACH,  # 20 mm nearer within a millisecond
         {"position": at_least(min(PATH.position(WALL) - 1e-9, PATH.position(0.3) + LIMITS.standoff)),
          "speed_cap": at_least(1e-9)}),
        (run(3, finger=0.28, position=0.4), APPROACH, {"at": 0.4})],
    # The finger closes on a surface that it will pass: on a known path no contact is extrapolated.
    "a path that is not known is guessed": [Bench,
        (run(5, position=math.nan, **CLOSING), APPROACH, {"at": 0.3 + 0.02 / 0.2})],
    "a path that is free to the fist brings no drum near": [Bench,
        (run(5, position=math.nan, flags=TRACKED | ContactFlag.ON_PATH, **CLOSING), RETRACTED,
         {"position": BACK})],
    # The steps did not suffice: the path is free up to 0.35, which is not a contact. While the finger closes
    # on a surface, the contact is the extrapolated one, but not before the end of the free part.
    "a path that was not followed to a contact brings no drum near": [Bench,
        (run(5, position=0.35, **RAN_OUT, bend_rate=0.0), RETRACTED),
        (run(5, position=0.35, **RAN_OUT, **CLOSING), APPROACH, {"at": 0.3 + 0.02 / 0.2}),
        (run(5, position=0.45, **RAN_OUT, **CLOSING), APPROACH, {"at": 0.45}),
        (run(5, position=0.35, **RAN_OUT | {"contact_bend_rate": 0.0}, **CLOSING), APPROACH, {"at": 0.35})],
    # A service that repeats a record frame after frame counts as silent.
    "a sequence that stalls is as old as its pose": [approaching, (step(51, pose_ns=4 * MS), APPROACH),
        (step(59, pose_ns=4 * MS), RETRACTED)],
    "a sequence that stalls in contact is as old as its pose": [touching, (step(6, pose_ns=7 * MS), POSITION),
        (step(45, pose_ns=7 * MS), HOLD), (step(59, pose_ns=7 * MS), FREEZE)],
    # A fast drum must be able to brake, and cannot press yet: no force cap before the touch.
    "a late drum comes slowly and weakly": [approaching, (step(finger=beyond(0.004), drum=BACK), APPROACH,
         {"at": WALL, "speed_cap": 0.05, "force_cap": math.inf}),
        (step(**leaning(0.004)), POSITION, {"speed_cap": at_most(0.05), "force_cap": 1.0}),
        (step(**leaning(0.0)), POSITION, {"force_cap": LIMITS.peak_force})],
    # For a finger inside, a tracker reports the contact at the finger; the surface keeps its last position.
    "a finger that is inside does not carry the surface along": [approaching,
        (run(finger=beyond(0.004), drum=BACK, position=beyond(0.004), **INSIDE), None,
         {"at": WALL, "speed_cap": 0.05})],
    **{
        f"a fault turns the motor off until reset, {start.__name__}: {reason}": [start,
            (step(seen=seen), FAULT, {"mode": DriveMode.BRAKED, "force_cap": 0.0, "fault": reason}),
            (run(2), FAULT), (reset, FAULT), (run(2), None, {"mode": DriveMode.POSITION})]
        for reason, seen in FAULTS.items()
        for start in (approaching, touching)
    },
    "the watchdog is 10 ms": [approaching, (run(now=13 * MS), APPROACH),
        (run(now=24 * MS), FAULT, {"fault": "the servo was 11.0 ms from its last sample"})],
    "the drum freezes for its time whatever the clock of the frames does": [touching, (step(**LOST), FREEZE),
        (step(now=10_008 * MS, ahead=-10_000 * MS, **LOST), FREEZE), *[(step(**LOST), FREEZE)] * 239],
    "a pose that lies ahead once the clock was learnt anew is not fresh": [approaching,
        (silence(now=-996 * MS, ahead=1000 * MS), None, {"trust": Trust.STALE, "position": farther})],
    "an emergency stop retracts in contact too": [touching, (stop, None),
        (run(), RETRACTED, {"position": BACK}), (run(5), RETRACTED, {"position": BACK})],
    "a stopped drum goes back by the stretch of its cable too": [partial(approaching, cable=CABLE),
        (run(200, finger=WALL, felt=0.6), POSITION), (stop, None), (run(), RETRACTED, {"position": BACK})],
}  # fmt: skip


@pytest.mark.parametrize("name", TRANSITIONS)
def test_drum_answers_each_event(name):
    start, *events = TRANSITIONS[name]
    bench = start()
    for event, state, *shown in events:
        before = bench.action
        if event is not None:
            event(bench)
        assert state is None or bench.action.state is state
        for field, expected in (shown[0] if shown else {}).items():
            if field == "at":
                assert bench.action.position == pytest.approx(PATH.position(expected))
                continue
            sources = (bench.action, bench.controller, bench.controller.frames)
            found = next(getattr(source, field) for source in sources if hasattr(source, field))
            if callable(expected):
                assert expected(found, before and getattr(before, field, None)), (field, found, before)
            else:
                assert found == expected, field


@pytest.mark.parametrize(("stiffness", "damping"), [(100.0, 0.3), (1e5, 0.5), (1e6, 50.0)])
def test_displayed_law_is_passive_whatever_the_surface(stiffness, damping):
    law = SurfaceLaw(ControllerSettings(3000.0))
    k, b = law.displayed(stiffness, damping)
    assert law.displayed(math.nan, math.inf)[0] == 0.0
    assert 0.0 < k <= stiffness and b <= damping
    assert required_damping(k, b, 1 / 3000.0, 1) < 2.0 * (1 + 1e-9)
    assert (k, b) == (stiffness, damping) or required_damping(stiffness, damping, 1 / 3000.0, 1) >= 2.0


def test_damping_that_the_drum_lacks_is_reported():
    """The servo's damping does not count: it is sampled and delayed."""
    assert SurfaceLaw(ControllerSettings(3000.0)).lacking(800.0, 0.5) == required_damping(
        800.0, 0.5, 1 / 3000.0, 1
    )
    assert SurfaceLaw(ControllerSettings(3000.0), 3.0).lacking(800.0, 0.5) == 0.0
    assert FingerController(PATH).law.lacking(800.0, 0.0) > 0.0


def test_from_20_to_100_ms_the_drum_widens_away_from_the_finger():
    bench = approaching()
    position = bench.action.position
    positions = [bench.age(1).position for _ in range(99)]
    age = 0.099 + 1e-3 * (bench.now // MS - 4 - 99)
    assert positions[18] == position
    assert np.all(np.diff(positions) >= 0.0)
    assert positions[-1] == pytest.approx(position + 0.5 * age, abs=1.1e-3)
    assert bench.controller.trust is Trust.OLD


@pytest.mark.parametrize("bend", [0.05, 0.5])
def test_drum_is_retracted_within_150_ms(bend):
    """The fastest motion of a geared drum, from nearly the flat hand to beyond the fist."""
    distance = PATH.retracted - PATH.position(bend)
    _, positions = move(PATH.drum, servo_for(PATH.drum, 3000.0), distance, 0.150)
    assert positions[-1] >= distance - 1e-3


def test_drift_brings_a_contact_no_nearer_than_anything_moves():
    bench = approaching()
    told = contact(bench.now, contact_bend_rate=-90.0)  # 20 m/s
    positions = [bench.step(told).position]
    positions += [bench.age(1).position for _ in range(15)]
    fastest = LIMITS.max_speed * 1e-3
    assert min(np.diff(positions)) >= -fastest - 1e-9
    assert positions[-1] == pytest.approx(PATH.position(WALL) - 16 * fastest, abs=1e-6)


def test_lost_tracking_in_contact_ramps_the_force_and_then_retracts():
    bench = touching()
    caps = [bench.step(contact(bench.now, **LOST), State.DEGRADED).force_cap for _ in range(500)]
    assert caps[249] == caps[0] and caps[-1] < 0.01 * caps[0]
    assert np.all(np.diff(caps) <= 0.0)
    assert bench.action.state is DrumState.FREEZE
    assert bench.step(contact(bench.now, **LOST), State.DEGRADED).state is DrumState.RETRACTED


@pytest.mark.parametrize("jump", [-3_000_023 * MS, -11 * MS, 23 * MS])
def test_clock_of_the_frames_that_jumps_is_no_fault_of_the_servo(jump):
    """The estimate from another machine's frames jumps when a faster one arrives: the motor stays on."""
    for bench in (approaching(), touching()):
        speed = float(bench.controller.known.speed)
        bench.now, bench.ahead = bench.now + jump, bench.ahead - jump
        action = bench.step(None)
        assert (action.mode, bench.controller.fault) == (DriveMode.POSITION, "")
        assert abs(float(bench.controller.known.speed)) <= abs(speed)


def test_drum_and_finger_come_together_no_faster_than_that():
    bench = approaching()
    bench.bend, speed = 0.47, 0.05
    bench.drum = PATH.position(WALL) + 0.010
    caps = {}
    for _ in range(100):  # the finger closes at 50 mm/s, the drum does not move
        bench.bend = PATH.bend(PATH.position(bench.bend) + speed * 1e-3)
        bench.step(contact(bench.now, bench.bend))
        caps[bench.drum - PATH.position(bench.bend)] = bench.action.speed_cap
    bench.bend = PATH.bend(PATH.position(bench.bend) + speed * 1e-3)
    bench.drum = PATH.position(bench.bend) + 1.5e-3
    bench.step(contact(bench.now, bench.bend))
    far = list(caps)[60]  # the speed is low-passed
    assert bench.action.speed_cap <= LIMITS.near_speed(PATH.drum.mass) - speed + 2e-3
    assert bench.action.force_cap == LIMITS.peak_force
    # At half of its acceleration the drum brakes before it is near the finger, which continues to move;
    # braking begins when the next cap has arrived and the servo has followed it.
    closing, near = caps[far] + speed, LIMITS.near_speed(PATH.drum.mass)
    unbraked = closing * (1.0 / RATE + SERVO_LAG)
    assert unbraked + (closing**2 - near**2) / PATH.drum.acceleration == pytest.approx(far - 2e-3, rel=0.1)


def test_force_has_a_peak_and_what_lasts():
    bench = touching()
    bench.force = 18.0
    caps = [bench.run(1).force_cap for _ in range(2000)]
    spent = caps.index(10.0)
    assert caps[0] == 20.0
    assert 1e-3 * spent == pytest.approx(-math.log((18.0 - 10.0) / (18.0 - 0.8 * 3e-3)), abs=0.01)
    assert set(caps[spent:]) == {10.0}
    bench.force = math.nan
    assert bench.run(1).force_cap == 10.0


def test_hot_motor_has_the_force_that_it_holds_for_ever():
    """i2t: 18 N on the finger, with a motor rated for 12 N there, heat it up in its time; less cools it.

    Behind a gear of 70 % efficiency these 12 N are 17.1 N of the motor, which is the limited force.
    """
    motor = PATH.drum.motor
    torque = motor.continuous_torque * 12.0 / PATH.drum.continuous_force
    drum = replace(PATH.drum, motor=replace(motor, continuous_torque=torque, heating_time=2.0))
    bench = touching(limits=Limits(continuous_force=18.0), drum=drum)
    bench.force = 18.0
    actions = [bench.run(1) for _ in range(3000)]
    hot = next(k for k, action in enumerate(actions) if action.is_hot)
    assert 1e-3 * hot == pytest.approx(-2.0 * math.log(1.0 - (12.0 / 18.0) ** 2), abs=0.05)
    assert actions[hot - 1].force_cap > actions[hot].force_cap == pytest.approx(12.0 / drum.gear.efficiency)
    assert actions[hot].heat == pytest.approx(1.0, abs=1e-2)
    bench.controller.reset()
    assert bench.run(1).is_hot  # a reset does not cool the motor
    bench.force = 5.0
    cooled = [bench.run(1) for _ in range(3000)]
    assert cooled[0].is_hot and not cooled[-1].is_hot
    # With hysteresis: otherwise the force would alternate.
    assert next(action.heat for action in cooled if not action.is_hot) == pytest.approx(0.81, abs=1e-2)


def lever_of(bench):
    """Return the lever of the drum at its position in the next sample."""
    return PATH.lever(PATH.drum_angle(bench.drum))


def test_action_tells_the_motor_by_the_parameters_of_the_drum():
    """At the shaft of gear51 1 N at the fingertip is lever / 51, and 1 m/s is 51 / lever."""
    bench = approaching()
    lever = lever_of(bench)
    held = bench.run(1)
    assert (held.torque, held.torque_cap) == (0.0, pytest.approx(6.5 / 51.0))  # the limit of the gear
    assert held.motor_speed_cap == pytest.approx(min(51.0 * held.speed_cap / lever, PATH.drum.motor.speed))
    bench = touching()
    bench.bend = PATH.bend(PATH.position(WALL) + 0.004)
    lever = lever_of(bench)
    late = bench.run(1)
    assert late.torque_cap == pytest.approx(late.force_cap * lever / 51.0)
    bench = touching(**SOFT)
    lever = lever_of(bench)
    pressed = bench.run(1, **SOFT)
    assert pressed.mode is DriveMode.FORCE
    assert pressed.torque == pytest.approx(pressed.force * lever / 51.0)
    off = bench.step(None, has_fault=True)
    assert (off.torque, off.torque_cap) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "instead", "reason"),
    [
        ("extension", lambda: None, "there is no compiled extension for this system"),
        ("digest_in_c", lambda: "other", "its sources were edited since it was compiled"),
    ],
)
def test_controller_that_was_not_compiled_says_what_to_do(name, instead, reason, monkeypatch):
    monkeypatch.setattr(declaration, name, instead)
    compiled.in_c.cache_clear()
    with pytest.raises(ArgumentError, match=f"{reason}; compile it by `python tools/build_kernels.py`"):
        FingerController(PATH)
    compiled.in_c.cache_clear()


NUMBERS = st.sampled_from([0.0, -1.0, 0.4, 0.5, 0.6, 1e300, math.nan, math.inf, -math.inf])
GARBAGE = st.dictionaries(
    st.sampled_from(
        ["signed_distance", "bend", "bend_rate", "contact_bend", "contact_bend_rate", "contact_bend_error",
         "normal", "velocity", "approach_speed", "lower", "force", "stiffness", "damping"]
    ),
    NUMBERS,
    max_size=2,
)  # fmt: skip
TURNS = st.fixed_dictionaries(
    {
        "count": st.sampled_from([1, 2, 5, 25, 120]),  # samples without a new frame
        "age": st.sampled_from([-10, 0, 1, 15, 30, 90, 200]),  # ms, of the pose on arrival
        "position": st.sampled_from([0.1, 0.3, 0.45, 0.5, 0.55, 0.9, math.nan]),
        "finger": st.sampled_from([0.05, 0.3, 0.449, 0.5, 0.7]),
        "force": st.sampled_from([0.0, 0.04, 0.8, 15.0, math.nan]),
        "state": st.sampled_from([State.OK] * 4 + [State.DEGRADED, State.LATE, State.STALE, State.STOPPING]),
        "is_tracked": st.sampled_from([True] * 4 + [False]),
        "is_inside": st.sampled_from([False] * 4 + [True]),
        "surface": st.sampled_from([Surface.RIGID, Surface.DEFORMABLE]),
        "source": st.sampled_from([Source.GEOMETRY, Source.TELEOPERATION]),
        "garbage": st.one_of(st.just({}), st.just({}), GARBAGE),
    }
)


def told_by(turn, now):
    told = contact(now - turn["age"] * MS, turn["finger"], turn["position"], contact_bend_rate=-0.2)
    told["surface"], told["source"] = turn["surface"], turn["source"]
    told["stiffness"], told["force"], told["force_is_valid"] = 200.0, 0.5, 1
    if turn["is_inside"]:
        told["signed_distance"], told["flags"] = -0.01, TRACKED | ContactFlag.JUMPED
    if not turn["is_tracked"]:
        told["flags"], told["mode"] = 0, Mode.HOLD
    for name, value in turn["garbage"].items():
        told[name] = value
    return told


def justified(told, state, now):
    """Return the nearest position that a record allows, by the rules of docs/guide/drums.md, or inf."""
    age = now - int(told["pose_ns"])
    is_good = state in (State.OK, State.DEGRADED) and told["flags"] & ContactFlag.TRACKED
    location = location_of(told, told) if is_good and -5 * MS <= age <= 20 * MS else None
    if location is None:
        return math.inf
    return PATH.position(location.bend + location.rate * 1e-9 * min(max(age, 0), 20 * MS))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(turns=st.lists(TURNS, min_size=2, max_size=12), follows=st.booleans())
def test_no_drum_advances_without_a_sound_and_fresh_frame(turns, follows):
    """For any inputs, a nearer target is justified by a frame, and forces without fresh frames never grow."""
    bench = Bench()
    before, force, given_records = PATH.retracted, math.inf, []
    for turn in turns:
        bench.bend, bench.force = turn["finger"], turn["force"]
        told = told_by(turn, bench.now + MS)
        given_records.append((told, turn["state"]))
        for _ in range(turn["count"]):
            action = bench.step(told, turn["state"])
            if action.position < before - 1e-12:
                allowed = min(justified(*record, bench.now) for record in given_records)
                assert action.position >= min(before, allowed) - 1e-9
                assert bench.controller.trust is Trust.FRESH
            if action.mode is DriveMode.FORCE:
                assert 0.0 <= action.force <= 10.0
                if bench.controller.trust is not Trust.FRESH:
                    assert action.force <= force < math.inf
            before, force = action.position, action.force if action.mode is DriveMode.FORCE else math.inf
            assert math.isfinite(action.position) and math.isfinite(action.angle)
            assert action.force_cap >= 0.0 and action.speed_cap >= 0.0
            if follows:
                bench.drum = action.position
