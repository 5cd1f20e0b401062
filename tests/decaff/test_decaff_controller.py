"""The drum's controller: each failure and transition of docs/guide/drums.md, and what never happens."""

import math
from dataclasses import replace

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
from proximity.native import in_c

GLOVE = Glove()
PATH = FingerPath(GLOVE)
MS = 1_000_000
RATE = 1000.0
LIMITS = Limits()
TRACKED = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED
WALL = 0.5  # bend of the contact
ANY_SPEED = Limits(steady=SteadyRule(slow_speed=math.inf))
# What records say beside where the finger touches.
SOFT = {"surface": Surface.DEFORMABLE, "stiffness": 200.0, "damping": 0.0}
SLAVE = {"source": Source.TELEOPERATION, "force": 0.6, "force_is_valid": 1}
LOST = {"flags": 0, "mode": Mode.HOLD}
CLOSING = {"bend_rate": 1.0, "approach_speed": 0.2, "velocity": np.nan, "signed_distance": 0.02}


def contact(pose_ns, bend=0.3, position=WALL, **fields):
    """A record of a finger at a bend whose way meets the wall at *position*."""
    record = frame(1).records[0]
    record["flags"], record["pose_ns"], record["mode"] = TRACKED, pose_ns, Mode.POSITION
    record["bend"], record["contact_bend"], record["contact_bend_error"] = bend, position, 0.0
    distance = float(GLOVE.finger.path_length(bend, position)) if math.isfinite(position) else 0.02
    record["signed_distance"] = record["lower"] = record["upper"] = distance
    for name, value in fields.items():
        record[name] = value
    return record


class Bench:
    """A controller stepped at 1 kHz; finger and drum are where they are put, frames come each sample."""

    def __init__(self, **settings):
        self.controller = FingerController(PATH, RATE, **settings)
        self.now, self.bend, self.force = 0, 0.3, 0.0
        self.ahead = 0  # ns, the servo's own clock
        self.session, self.frame, self.told = 7, None, None  # what was told last, and which frame that was
        self.drum = PATH.retracted  # its position
        self.action = None

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
        """Fresh frames; the drum goes where it is told at once."""
        for _ in range(count):
            self.step(contact(self.now, **({"bend": self.bend} | fields)))
            self.drum = self.action.position
        return self.action

    def age(self, milliseconds, told=None, state=State.LATE):
        """No new frame for so long."""
        for _ in range(milliseconds):
            self.step(told, state)
        return self.action


def approaching(**settings):
    bench = Bench(**settings)
    bench.run(4)
    assert bench.action.state is DrumState.APPROACH
    return bench


def location_of(*records):
    """Where a finger touches by records that follow each other, each of a pose of its own; None: nowhere."""
    bench = Bench()
    for record in records:
        told = record.copy()
        told["pose_ns"] = bench.now
        bench.step(told)
    frames = bench.controller.frames
    return frames.location if frames.has_location else None


def touching(**fields):
    """A finger at the wall, the drum before it, 0.8 N between them."""
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


def test_drum_that_turns_back_is_refused():
    class Backward:
        finger = GLOVE.finger

        def drum_angle(self, bend):
            return -np.asarray(bend)

    with pytest.raises(
        ArgumentError, match="the drum moves backwards at the flat hand, expected a drum that follows"
    ):
        FingerPath(Backward())


def test_place_of_contact_is_extrapolated_where_none_is_told():
    """b + d/(-n.p'), with p' from how the finger moves; a plane at 45 degrees to the way."""
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
    """The pose of the message counts, not where the finger has come since."""
    positions = []
    for latency in (0, 3, 15):
        bench = Bench()
        for _ in range(30):
            bench.bend += 0.002
            told = contact(bench.now - latency * MS, bend=bench.bend - 0.002 * latency, contact_bend_rate=0.5)
            told["contact_bend"] = 0.5 + 0.5e-9 * (bench.now - latency * MS)  # of a wall that goes away
            bench.step(told)
        positions.append(bench.action.position)

    assert positions == pytest.approx([PATH.position(0.5 + 0.5e-9 * 30 * MS)] * 3, abs=1e-9)


@pytest.mark.parametrize("position", [0.2, WALL - 0.001, 0.5])
def test_finger_that_is_free_is_not_pressed_whatever_is_said_of_its_way(position):
    """A position behind a finger that is 20 mm from everything drew the drum onto it, as if it came late."""
    bench = Bench()
    bench.bend, nearest = WALL, PATH.position(WALL) + 0.020
    for _ in range(100):
        action = bench.run(1, position=position, signed_distance=0.021, lower=0.020)
        assert action.state in (DrumState.RETRACTED, DrumState.APPROACH)
        assert action.position >= nearest - 3e-6


CABLE = CableRule(1200.0)


def stretch(bench):
    """By which the drum is sent nearer than the contact, m."""
    return PATH.position(WALL) - bench.action.position


@pytest.mark.parametrize("force", ["force", "motor_force"])
def test_stretch_of_the_cable_is_made_up_for_while_the_drum_is_touched(force):
    """By the force that is measured; where none is, by the motor's; slowly, and gone with the contact."""
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


def test_stopped_drum_goes_all_the_way_back():
    bench = approaching(cable=CABLE)
    bench.bend, bench.force = WALL, 0.6
    bench.run(200)
    bench.controller.stop()

    assert bench.run(1).position == PATH.retracted


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({"stiffness": 0.0}, "stiffness is 0.0, expected a positive number of newtons a metre"),
        ({"smoothing": -1.0}, "smoothing is -1.0, expected a positive number of hertz"),
    ],
)
def test_cable_that_cannot_be_is_named(numbers, sentence):
    with pytest.raises(ArgumentError) as caught:
        CableRule(**numbers)

    assert str(caught.value) == sentence


def test_drum_waits_retracted_until_a_contact_is_told_twice():
    bench = Bench()
    assert bench.step().state is DrumState.RETRACTED
    assert bench.step(contact(bench.now, position=math.nan)).state is DrumState.RETRACTED
    assert bench.step(contact(bench.now)).state is DrumState.RETRACTED
    action = bench.step(contact(bench.now))

    assert (action.state, action.mode) == (DrumState.APPROACH, DriveMode.POSITION)
    assert action.position == pytest.approx(PATH.position(WALL))
    assert action.angle == pytest.approx(float(GLOVE.drum_angle(WALL)), abs=1e-5)
    assert bench.controller.frames.awaited == 1


def test_drum_retracts_when_no_contact_is_expected_any_more():
    bench = approaching()

    assert bench.run(1, position=math.nan).state is DrumState.RETRACTED
    assert bench.action.position == PATH.retracted


def test_touch_is_a_small_gap_or_a_force():
    for gap, force, state in (
        (29e-6, 0.0, DrumState.CONTACT_POSITION),
        (31e-6, 0.0, DrumState.APPROACH),
        (0.5e-3, 0.06, DrumState.CONTACT_POSITION),
        (0.5e-3, 0.04, DrumState.APPROACH),
        (1.5e-3, 0.06, DrumState.APPROACH),  # a force without a touch is the sensor's
    ):
        bench = approaching()
        bench.bend, bench.force = PATH.bend(bench.drum - gap), force
        assert bench.run(1).state is state


def test_touched_drum_holds_up_to_a_millimetre():
    bench = touching()
    position = bench.action.position
    for gap in (0.1e-3, 0.5e-3, 0.99e-3):
        bench.bend, bench.force = PATH.bend(position - gap), 0.0
        action = bench.run(1, position=WALL + 0.003, lower=0.0)  # what is told meanwhile does not move it
        assert (action.state, action.position) == (DrumState.CONTACT_POSITION, position)
    bench.bend = PATH.bend(position - 1.01e-3)
    action = bench.run(1, position=WALL + 0.003)

    assert action.state is DrumState.APPROACH
    assert action.position == pytest.approx(PATH.position(WALL + 0.003))


@pytest.mark.parametrize("surface", [Surface.RIGID, Surface.DEFORMABLE])
def test_drum_leaves_a_finger_that_leans_on_it_when_its_object_has_gone(surface):
    """It was touched again at once: before a soft part a force of nothing was served, and the drum stayed."""
    soft = {"surface": surface, "stiffness": 200.0, "damping": 0.0}
    bench = touching(**soft)
    for _ in range(20):
        action = bench.step(contact(bench.now, bench.bend, WALL + 0.05, **soft))  # a centimetre away
        assert (action.state, action.mode) == (DrumState.APPROACH, DriveMode.POSITION)
        assert action.position == pytest.approx(PATH.position(WALL + 0.05))


def test_rigid_part_of_a_scene_is_never_served_as_a_force():
    bench = touching(limits=ANY_SPEED)

    assert bench.run(400, surface=Surface.RIGID).state is DrumState.CONTACT_POSITION


def test_teleoperation_serves_the_force_once_it_is_steady():
    slave = SLAVE | {"surface": Surface.RIGID}
    bench = touching(limits=ANY_SPEED, **slave)
    assert bench.action.state is DrumState.CONTACT_POSITION
    action = bench.run(200, **slave)
    assert (action.state, action.mode, action.force) == (
        DrumState.CONTACT_FORCE,
        DriveMode.FORCE,
        pytest.approx(0.6),
    )
    assert action.start_force == pytest.approx(0.8, abs=0.02)  # bumpless: from what is felt
    assert action.force_slew == 0.0  # the servo's own, as a handover needs

    bench.force = 0.04
    assert bench.run(19, **slave).state is DrumState.CONTACT_FORCE
    assert bench.run(2, **slave).state is DrumState.CONTACT_POSITION


def test_teleoperation_goes_back_to_position_when_the_force_is_not_measured_any_more():
    """Whether the finger is still there could not be told: the drum would press until it met something."""
    bench = touching(limits=ANY_SPEED, **SLAVE)
    bench.run(200, **SLAVE)
    bench.force = math.nan

    assert bench.run(19, **SLAVE).state is DrumState.CONTACT_FORCE
    assert {bench.run(2, **SLAVE).state for _ in range(100)} == {DrumState.CONTACT_POSITION}
    bench.force = 0.8
    assert bench.run(200, **SLAVE).state is DrumState.CONTACT_FORCE


def test_teleoperation_goes_back_to_position_when_the_slave_is_off_its_object():
    bench = touching(limits=ANY_SPEED, **SLAVE)
    bench.run(200, **SLAVE)

    assert bench.run(1, **SLAVE, signed_distance=0.6e-3).state is DrumState.CONTACT_POSITION
    states = {bench.run(1, **SLAVE, signed_distance=0.6e-3).state for _ in range(100)}
    assert states == {DrumState.CONTACT_POSITION}  # it went to and fro, a sample each: the force is steady
    assert bench.run(1, **SLAVE).state is DrumState.CONTACT_FORCE


def test_drum_before_a_soft_surface_goes_back_where_it_has_come_too_near():
    """Touched on its path, it served a force of nothing: by what its motor had done it went on, 12 mm far."""
    for beyond, mode in ((0.2e-3, DriveMode.FORCE), (0.4e-3, DriveMode.POSITION)):
        bench = touching(**SOFT)
        bench.drum = PATH.position(WALL) - beyond
        bench.bend = PATH.bend(bench.drum)
        action = bench.step(contact(bench.now, bench.bend, **SOFT))
        assert action.mode is mode
        assert action.position == pytest.approx(PATH.position(WALL))


def test_deformable_surface_is_served_by_its_law_from_the_touch_on():
    bench = Bench()
    bench.run(4, **SOFT)
    bench.bend, bench.force = WALL, 0.1
    assert bench.run(1, **SOFT).state is DrumState.CONTACT_FORCE
    bench.bend = PATH.bend(PATH.position(WALL) + 0.002)
    bench.drum = PATH.position(bench.bend)
    for _ in range(40):
        bench.step(contact(bench.now, bench.bend, signed_distance=-0.002, lower=-0.002, **SOFT))

    assert bench.action.mode is DriveMode.FORCE
    assert bench.action.force == pytest.approx(0.4, rel=1e-3)
    assert bench.action.force_slew == math.inf


@pytest.mark.parametrize(("stiffness", "damping"), [(100.0, 0.3), (1e5, 0.5), (1e6, 50.0)])
def test_displayed_law_is_passive_whatever_the_surface(stiffness, damping):
    law = SurfaceLaw(ControllerSettings(3000.0))
    k, b = law.displayed(stiffness, damping)

    assert 0.0 < k <= stiffness and b <= damping
    assert required_damping(k, b, 1 / 3000.0, 1) < 2.0 * (1 + 1e-9)
    assert (k, b) == (stiffness, damping) or required_damping(stiffness, damping, 1 / 3000.0, 1) >= 2.0


def test_damping_that_the_drum_lacks_is_reported():
    """The servo's own damping does not count: it is sampled and late."""
    assert SurfaceLaw(ControllerSettings(3000.0)).lacking(800.0, 0.5) == required_damping(
        800.0, 0.5, 1 / 3000.0, 1
    )
    assert SurfaceLaw(ControllerSettings(3000.0), 3.0).lacking(800.0, 0.5) == 0.0
    assert FingerController(PATH).law.lacking(800.0, 0.0) > 0.0


def test_law_pulls_never_and_is_nothing_for_what_is_no_number():
    soft = {"surface": Surface.DEFORMABLE, "stiffness": 100.0, "damping": 1.0}
    bench = touching(**soft)
    for depth in [0.002] * 30 + [0.001, 0.0001]:  # the finger leaves at a metre a second
        bench.bend = PATH.bend(PATH.position(WALL) + depth)
        bench.drum = PATH.position(bench.bend)
        action = bench.step(contact(bench.now, bench.bend, **soft))
    assert (action.mode, action.force) == (DriveMode.FORCE, 0.0)
    assert SurfaceLaw(ControllerSettings(3000.0)).displayed(math.nan, math.inf)[0] == 0.0


def test_from_20_to_100_ms_the_drum_widens_away_from_the_finger():
    bench = approaching()
    position = bench.action.position
    positions = [bench.age(1).position for _ in range(99)]

    age = 0.099 + 1e-3 * (bench.now // MS - 4 - 99)
    assert positions[18] == position
    assert np.all(np.diff(positions) >= 0.0)
    assert positions[-1] == pytest.approx(position + 0.5 * age, abs=1.1e-3)
    assert bench.controller.trust is Trust.OLD


def test_after_100_ms_the_drum_retracts():
    bench = approaching()
    action = bench.age(102)

    assert (action.state, action.position) == (DrumState.RETRACTED, PATH.retracted)
    assert action.speed_cap == action.force_cap == math.inf


@pytest.mark.parametrize("bend", [0.05, 0.5])
def test_drum_is_retracted_within_150_ms(bend):
    """The fastest that a geared drum goes, from nearly the flat hand to beyond the fist."""
    distance = PATH.retracted - PATH.position(bend)
    _, positions = move(PATH.drum, servo_for(PATH.drum, 3000.0), distance, 0.150)

    assert positions[-1] >= distance - 1e-3


def test_in_contact_the_drum_holds_up_to_100_ms():
    bench = touching()
    position, cap = bench.action.position, bench.action.force_cap

    action = bench.age(60)
    assert (action.state, action.position, action.force_cap) == (DrumState.HOLD, position, cap)
    assert bench.run(1).state is DrumState.CONTACT_POSITION


def test_in_contact_the_drum_freezes_and_then_its_force_goes():
    bench = touching()
    position, cap = bench.action.position, bench.action.force_cap
    bench.age(99)
    first = bench.age(2)
    assert (first.state, first.position, first.force_cap) == (DrumState.FREEZE, position, cap)
    frozen = bench.age(248)
    assert (frozen.state, frozen.force_cap) == (DrumState.FREEZE, cap)
    half = bench.age(127)
    assert half.force_cap == pytest.approx(0.5 * cap, rel=0.02)
    assert half.position == position
    bench.force = 0.09
    assert bench.age(1).state is DrumState.RETRACTED
    assert bench.action.position == PATH.retracted


def test_what_comes_back_during_the_ramp_does_not_snap():
    bench = touching()
    bench.age(99 + 2 + 400)
    bench.bend = PATH.bend(PATH.position(WALL) + 0.004)  # the finger has pushed the drum back
    bench.drum = PATH.position(bench.bend)
    bench.step(contact(bench.now, bench.bend))

    assert bench.action.state is DrumState.CONTACT_POSITION
    assert bench.action.speed_cap <= 0.05
    assert bench.action.force_cap <= 1.0


@pytest.mark.parametrize("state", [State.STALE, State.STARTING, State.STOPPING])
def test_service_that_knows_nothing_retracts_the_drum_whatever_the_age(state):
    bench = approaching()

    assert bench.age(1, contact(bench.now), state).state is DrumState.RETRACTED


def test_lost_tracking_retracts_at_once_and_freezes_in_contact():
    for bench, state in ((approaching(), DrumState.RETRACTED), (touching(), DrumState.FREEZE)):
        assert bench.step(contact(bench.now, **LOST)).state is state
        # and an old frame of a tracked finger does not bring it back
        assert bench.step(None).state is state


BAD = {
    "nan distance": {"signed_distance": math.nan},
    "-inf distance": {"signed_distance": -math.inf},
    "far": {"signed_distance": 1e4},
    "long normal": {"normal": [0.0, 0.0, 1.002]},
    "short normal": {"normal": [0.0, 0.0, 0.998]},
    "bend": {"bend": 1.2},
    "contact bend": {"contact_bend": -0.2},
    "rate": {"contact_bend_rate": 1e3},
    "error": {"contact_bend_error": -1.0},
    "surface": {"surface": 9},
}


@pytest.mark.parametrize("name", BAD)
def test_bad_frame_is_dropped_and_counted_and_the_old_one_ages(name):
    bench = approaching()
    position = bench.action.position
    told = contact(0)
    for field, value in BAD[name].items():
        told[field] = value
    for _ in range(25):
        told["pose_ns"] = bench.now
        bench.step(told)

    assert bench.controller.frames.dropped == 25
    assert bench.controller.trust is Trust.OLD
    assert bench.action.position > position


def test_pose_from_the_future_or_the_past_is_dropped():
    bench = approaching()
    bench.step(contact(bench.now + 7 * MS))  # 6 ms ahead when it is read
    assert bench.controller.frames.dropped == 1
    bench.step(contact(bench.now + 5 * MS))  # 4 ms
    assert bench.controller.frames.dropped == 1
    bench.step(contact(bench.now))
    bench.step(contact(bench.now - 9 * MS))
    assert bench.controller.frames.dropped == 3


def test_jump_towards_the_finger_needs_a_second_frame():
    bench = approaching()
    position = bench.action.position

    assert bench.run(1, position=WALL - 0.05).position == position
    assert bench.run(1).position == position  # the second did not agree
    assert bench.run(1, position=WALL - 0.05).position == position
    assert bench.run(1, position=WALL - 0.05).position == pytest.approx(PATH.position(WALL - 0.05))
    assert bench.run(1, position=WALL).position == pytest.approx(
        PATH.position(WALL)
    )  # away is not waited for


def test_jump_towards_the_finger_is_no_more_believed_after_a_silence():
    """63 mm nearer: in 60 ms a part may go as far, but no farther than 20 ms lead is taken at its word."""
    bench = Bench()
    bench.bend = 0.05
    position = bench.run(4).position
    bench.age(60)
    told = bench.step(contact(bench.now, bench.bend, 0.2))

    assert told.position >= position and bench.controller.frames.awaited == 2
    assert bench.step(contact(bench.now, bench.bend, 0.2)).position == pytest.approx(PATH.position(0.2))


def test_part_that_moves_between_two_poses_is_followed_at_once():
    """Poses at 60 Hz, frames at 1 kHz: up to 20 ms later the drum stood where nothing was any more."""
    bench = approaching()
    pose_ns, position = bench.now, PATH.position(WALL)
    bench.step(contact(pose_ns))
    for away in (1e-3, 30e-3, 29e-3, 26.1e-3):  # of the position; nearer at 2.9 m/s
        there = PATH.bend(position + away)
        assert bench.step(contact(pose_ns, position=there)).position == pytest.approx(PATH.position(there))
    assert bench.controller.frames.awaited == 1  # of the start


def test_jump_towards_the_finger_is_not_confirmed_by_frames_of_the_same_pose():
    bench = approaching()
    position, pose_ns = bench.action.position, bench.now
    for nearer in np.linspace(0.05, 0.049, 10):
        assert bench.step(contact(pose_ns, position=WALL - nearer)).position == position
    assert bench.controller.frames.awaited == 2  # with that of the start

    there = WALL - 0.049
    assert bench.step(contact(bench.now, position=there)).position == pytest.approx(PATH.position(there))


def test_service_on_a_machine_that_started_anew_is_followed():
    """Its poses begin at 0 again; what comes nearer is confirmed by a second one."""
    bench = approaching()
    bench.run(1000)
    bench.session, bench.now, bench.ahead = 8, 0, bench.now
    bench.step(None, State.STALE)
    bench.run(3)

    assert bench.controller.trust is Trust.FRESH
    assert bench.controller.frames.dropped == 0


def test_frame_that_was_overtaken_is_dropped():
    bench = approaching()
    bench.step(contact(bench.now))
    position = bench.action.position
    bench.frame = FrameMark(7, bench.frame.sequence - 3, bench.now)
    for _ in range(3):
        bench.step(contact(bench.now, position=WALL + 0.1))

    assert bench.controller.frames.dropped == 3
    assert bench.action.position == position


def test_finger_that_begins_inside_is_given_way_until_it_was_outside():
    bench = Bench()
    inside = {"signed_distance": -0.004, "lower": -0.004, "flags": TRACKED | ContactFlag.INSIDE}
    assert bench.run(5, **inside, position=0.2).position == PATH.retracted

    assert bench.run(2, position=0.4).position == pytest.approx(PATH.position(0.4))


def test_finger_that_jumps_inside_is_given_way():
    bench = approaching()
    bench.bend = 0.49
    jumped = {"signed_distance": -0.004, "lower": -0.004, "flags": TRACKED | ContactFlag.JUMPED}
    action = bench.run(1, **jumped, position=0.2)
    assert action.position == pytest.approx(PATH.position(0.49) + LIMITS.standoff, abs=1e-5)

    later = bench.run(5, signed_distance=-0.004, lower=-0.004, position=0.2)
    assert later.position == action.position
    bench.bend = 0.3
    assert bench.run(1, position=0.4).position == pytest.approx(PATH.position(0.4))


@pytest.mark.parametrize("silence", ["lost", "stale", "old"])
def test_finger_that_is_found_inside_again_is_given_way(silence):
    """Where it has been meanwhile nobody knows: it is as at the start."""
    bench = approaching()
    inside = {"signed_distance": -0.004, "lower": -0.004, "position": 0.49}
    if silence == "lost":
        bench.step(contact(bench.now, **LOST))
    elif silence == "stale":
        bench.age(1, contact(bench.now), State.STALE)
    else:
        bench.age(110)
    bench.bend = 0.49
    bench.drum = bench.action.position
    assert bench.run(5, **inside).position >= PATH.position(0.49) + LIMITS.standoff - 1e-9

    bench.bend = 0.3
    assert bench.run(3, position=0.4).position == pytest.approx(PATH.position(0.4))


def test_part_that_is_put_where_the_finger_is_gives_it_way():
    bench = approaching()
    position = bench.action.position
    inside = {
        "signed_distance": -0.004,
        "lower": -0.004,
        "position": 0.3,
    }  # 20 mm nearer within a millisecond

    assert bench.run(5, **inside).position >= min(position, PATH.position(0.3) + LIMITS.standoff)
    assert bench.action.state is DrumState.APPROACH and bench.action.speed_cap > 0.0
    bench.bend = 0.28
    assert bench.run(3, position=0.4).position == pytest.approx(PATH.position(0.4))


def test_drift_brings_a_contact_no_nearer_than_anything_moves():
    bench = approaching()
    told = contact(bench.now, contact_bend_rate=-90.0)  # 20 m/s
    positions = [bench.step(told).position]
    positions += [bench.age(1).position for _ in range(15)]

    fastest = LIMITS.max_speed * 1e-3
    assert min(np.diff(positions)) >= -fastest - 1e-9
    assert positions[-1] == pytest.approx(PATH.position(WALL) - 16 * fastest, abs=1e-6)


def test_path_that_is_free_to_the_fist_brings_no_drum_near():
    """The finger closes on a surface that it will pass: where its path is known, nothing is guessed."""
    guessed = Bench().run(5, position=math.nan, **CLOSING)
    assert guessed.position == pytest.approx(PATH.position(0.3 + 0.02 / 0.2))

    known = Bench().run(5, position=math.nan, flags=TRACKED | ContactFlag.ON_PATH, **CLOSING)
    assert (known.state, known.position) == (DrumState.RETRACTED, PATH.retracted)


def test_path_that_was_not_followed_to_a_contact_brings_no_drum_near():
    """Steps did not suffice: free up to 0.35 is all that is known, and that is no contact."""
    ran_out = {
        "flags": TRACKED | ContactFlag.ON_PATH,
        "contact_bend_error": np.inf,
        "contact_bend_rate": np.nan,
    }
    bench = Bench()
    assert bench.run(5, position=0.35, **ran_out, bend_rate=0.0).state is DrumState.RETRACTED

    # While it closes on a surface, the contact is where that leads, and not before what is free.
    action = bench.run(5, position=0.35, **ran_out, **CLOSING)
    assert action.position == pytest.approx(PATH.position(0.3 + 0.02 / 0.2))
    assert bench.run(5, position=0.45, **ran_out, **CLOSING).position == pytest.approx(PATH.position(0.45))

    confirmed = ran_out | {"contact_bend_rate": 0.0}
    assert bench.run(5, position=0.35, **confirmed, **CLOSING).position == pytest.approx(PATH.position(0.35))


def test_sequence_that_stalls_is_as_old_as_its_pose():
    """A service that repeats itself is a service that is silent: the same record, frame after frame."""
    bench, told = approaching(), None
    told = contact(bench.now)
    states = [bench.step(told).state for _ in range(110)]

    assert states[50] is DrumState.APPROACH and states[-1] is DrumState.RETRACTED
    touched = touching()
    told = contact(touched.now, touched.bend)
    held = [touched.step(told).state for _ in range(110)]
    assert (held[5], held[50], held[-1]) == (DrumState.CONTACT_POSITION, DrumState.HOLD, DrumState.FREEZE)


def test_lost_tracking_in_contact_ramps_the_force_and_then_retracts():
    bench = touching()
    caps = [bench.step(contact(bench.now, **LOST), State.DEGRADED).force_cap for _ in range(500)]

    assert caps[249] == caps[0] and caps[-1] < 0.01 * caps[0]
    assert np.all(np.diff(caps) <= 0.0)
    assert bench.action.state is DrumState.FREEZE
    assert bench.step(contact(bench.now, **LOST), State.DEGRADED).state is DrumState.RETRACTED


def test_late_drum_comes_slowly_and_weakly():
    bench = approaching()
    bench.bend = PATH.bend(PATH.position(WALL) + 0.004)
    bench.drum = PATH.retracted
    action = bench.step(contact(bench.now, bench.bend))
    assert action.position == pytest.approx(PATH.position(WALL))
    assert (action.speed_cap, action.state) == (0.05, DrumState.APPROACH)
    assert action.force_cap == math.inf  # what goes away fast must be braked, and nothing is pressed there

    bench.drum = PATH.position(bench.bend)
    action = bench.step(contact(bench.now, bench.bend))
    assert action.state is DrumState.CONTACT_POSITION
    assert action.speed_cap <= 0.05 and action.force_cap == 1.0
    bench.bend, bench.drum = WALL, PATH.position(WALL)
    assert bench.step(contact(bench.now, bench.bend)).force_cap == LIMITS.peak_force


def test_finger_that_is_inside_does_not_carry_the_surface_along():
    """Inside, a tracker tells the touch where the finger is; the surface stays where it was told before."""
    bench = approaching()
    bench.bend = PATH.bend(PATH.position(WALL) + 0.004)
    bench.drum = PATH.retracted
    action = bench.run(1, position=bench.bend, signed_distance=-0.004, lower=-0.004)

    assert action.position == pytest.approx(PATH.position(WALL))
    assert action.speed_cap == 0.05


FAULTS = {
    "the potentiometer gives no bend": {"bend": math.nan},
    "the potentiometer reads a bend of 2.85, expected -0.1 to 1.1": {"bend": 2.85},  # its wire is off
    "the potentiometer reads a bend of -0.72, expected -0.1 to 1.1": {"bend": -0.72},
    "the encoder gives no drum angle": {"drum_angle": math.inf},
    "the encoder reads a drum angle of 60 rad, but the finger's path goes from 0.0921 to 1.81 rad": {
        "drum_angle": 60.0  # degrees
    },
    "the motor reports a fault": {"has_fault": True},
}


@pytest.mark.parametrize("reason", FAULTS)
def test_fault_turns_the_motor_off_until_reset(reason):
    for bench in (approaching(), touching()):
        action = bench.step(contact(bench.now), **FAULTS[reason])
        assert (action.state, action.mode, action.force_cap) == (DrumState.FAULT, DriveMode.BRAKED, 0.0)
        assert bench.controller.fault == reason
        assert bench.run(2).state is DrumState.FAULT
        bench.controller.reset()
        assert bench.run(2).mode is DriveMode.POSITION


def test_watchdog_is_10_ms():
    bench = approaching()
    bench.now += 9 * MS
    assert bench.run(1).state is DrumState.APPROACH
    bench.now += 10 * MS
    assert bench.run(1).state is DrumState.FAULT
    assert bench.controller.fault == "the servo was 11.0 ms from its last sample"


@pytest.mark.parametrize("jump", [-3_000_023 * MS, -11 * MS, 23 * MS])
def test_clock_of_the_frames_that_jumps_is_no_fault_of_the_servo(jump):
    """It is guessed from another machine's frames, and jumps when a faster one comes: the motor stays on."""
    for bench in (approaching(), touching()):
        speed = float(bench.controller.known.speed)
        bench.now, bench.ahead = bench.now + jump, bench.ahead - jump
        action = bench.step(None)

        assert (action.mode, bench.controller.fault) == (DriveMode.POSITION, "")
        assert abs(float(bench.controller.known.speed)) <= abs(speed)


def test_drum_freezes_for_its_time_whatever_the_clock_of_the_frames_does():
    bench = touching()
    bench.step(contact(bench.now, **LOST))
    bench.now, bench.ahead = bench.now + 10_000 * MS, bench.ahead - 10_000 * MS
    states = [bench.step(contact(bench.now, **LOST)).state for _ in range(240)]

    assert set(states) == {DrumState.FREEZE}


def test_pose_that_lies_ahead_once_the_clock_was_learnt_anew_is_not_fresh():
    bench = approaching()
    position = bench.action.position
    bench.now, bench.ahead = bench.now - 1000 * MS, bench.ahead + 1000 * MS
    action = bench.step(None)

    assert bench.controller.trust is Trust.STALE
    assert action.position > position


def test_emergency_stop_retracts_in_contact_too():
    bench = touching()
    bench.controller.stop()

    assert (bench.run(1).state, bench.action.position) == (DrumState.RETRACTED, PATH.retracted)
    assert bench.run(5).position == PATH.retracted


def test_drum_and_finger_come_together_no_faster_than_that():
    bench = approaching()
    bench.bend, speed = 0.47, 0.05
    bench.drum = PATH.position(WALL) + 0.010
    caps = {}
    for _ in range(100):  # the finger closes at 50 mm/s, the drum stays behind
        bench.bend = PATH.bend(PATH.position(bench.bend) + speed * 1e-3)
        bench.step(contact(bench.now, bench.bend))
        caps[bench.drum - PATH.position(bench.bend)] = bench.action.speed_cap
    bench.bend = PATH.bend(PATH.position(bench.bend) + speed * 1e-3)
    bench.drum = PATH.position(bench.bend) + 1.5e-3
    bench.step(contact(bench.now, bench.bend))

    far = list(caps)[60]  # the speed is low-passed
    assert bench.action.speed_cap <= LIMITS.near_speed(PATH.drum.mass) - speed + 2e-3
    assert bench.action.force_cap == LIMITS.peak_force
    # With half of what it has, the drum brakes before the finger, which goes on meanwhile, is near; it begins
    # when the next cap has come and the servo has followed it.
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
    """i2t: 18 N on the finger, of a motor that holds 12 N there, heat it up in its time; with less it cools.

    Behind a gear of 70 % these 12 N are 17.1 N of the motor, which is what is limited.
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
    assert bench.run(1).is_hot  # a reset cools nothing
    bench.force = 5.0
    cooled = [bench.run(1) for _ in range(3000)]
    assert cooled[0].is_hot and not cooled[-1].is_hot
    # Not at once where it is no hotter than it may be: the force would go to and fro.
    assert next(action.heat for action in cooled if not action.is_hot) == pytest.approx(0.81, abs=1e-2)


def lever_of(bench):
    """Of the drum where it stands before the next sample."""
    return PATH.lever(PATH.drum_angle(bench.drum))


def test_action_tells_the_motor_by_the_parameters_of_the_drum():
    """At the shaft of gear51: a newton at the fingertip is the lever / 51, a metre a second 51 / lever."""
    bench = approaching()
    lever = lever_of(bench)
    held = bench.run(1)
    assert (held.torque, held.torque_cap) == (0.0, pytest.approx(6.5 / 51.0))  # all a gear carries
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
    monkeypatch.setattr(in_c, name, instead)
    compiled.in_c.cache_clear()
    with pytest.raises(ArgumentError, match=f"{reason}; compile it by `python tools/build_kernels.py`"):
        FingerController(PATH)
    compiled.in_c.cache_clear()


def test_limits_that_are_none_are_refused():
    with pytest.raises(ArgumentError, match=r"near_energy is 0\.0, expected a positive number of joules"):
        Limits(near_energy=0.0)
    with pytest.raises(ArgumentError, match="rate is -1, expected a positive number of hertz"):
        FingerController(PATH, -1)


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
        "count": st.sampled_from([1, 2, 5, 25, 120]),  # samples without another frame
        "age": st.sampled_from([-10, 0, 1, 15, 30, 90, 200]),  # ms, of the pose as it comes
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
    """The nearest position that a record allows by itself, by the rules of docs/guide/drums.md; inf: none."""
    age = now - int(told["pose_ns"])
    is_good = state in (State.OK, State.DEGRADED) and told["flags"] & ContactFlag.TRACKED
    location = location_of(told, told) if is_good and -5 * MS <= age <= 20 * MS else None
    if location is None:
        return math.inf
    return PATH.position(location.bend + location.rate * 1e-9 * min(max(age, 0), 20 * MS))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(turns=st.lists(TURNS, min_size=2, max_size=12), follows=st.booleans())
def test_no_drum_advances_without_a_sound_and_fresh_frame(turns, follows):
    """Whatever comes, in whatever order: a target that comes nearer has a frame that says so; and forces that
    are served on doubt never grow."""
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
