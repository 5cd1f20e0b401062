"""A finger resting on a moving part: hand, pad, drum and servo, with frames of a service at 1 kHz."""

from dataclasses import dataclass

import numpy as np
from sealed_frames import frame

from proximity.decaff.controller.controller import FingerController, FrameMark, Observation
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.simulated_drums import DrumPlant
from proximity.message import ContactFlag, Mode, State, Surface

PATH = FingerPath(Glove())
WALL = PATH.position(0.5)  # m, initial position of the part
RATE, MASS, STIFFNESS, DAMPING = 3000.0, 0.010, 300.0, 3.0  # Hz; finger and hand, PAPER.md section 6.1
INTENT = 4e-3  # m, target of the hand beyond the part
TRACKED = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED
NS = 1_000_000_000
LATENCY = 0.003  # s, of frames


@dataclass(frozen=True)
class Situation:
    """The motion of a part, and the expected behaviour."""

    name: str
    offset: object  # offset of the part in m as a function of seconds; positive moves away from the finger
    tilt: object = staticmethod(lambda time: 0.0 * time)  # of the surface's normal, rad


def ramp(distance, speed, begin=0.5):
    """Offset of a part that moves by a distance at a constant speed."""
    return lambda time: np.clip((time - begin) * speed, 0.0, abs(distance)) * np.sign(distance)


def turned(time):
    """Angle of a plate that swings by 0.3 rad at 0.5 Hz from 0.5 s on, rad."""
    return 0.3 * np.sin(2.0 * np.pi * 0.5 * np.maximum(time - 0.5, 0.0))


SITUATIONS = {
    each.name: each
    for each in (
        Situation("comes", ramp(-0.020, 0.050)),
        Situation("leaves", ramp(0.015, 0.050)),
        Situation("turns", lambda time: 0.040 * np.tan(turned(time)), turned),
        Situation("vibrates", lambda time: 1e-3 * np.sin(2.0 * np.pi * 10.0 * np.maximum(time - 0.5, 0.0))),
    )
}


def shown(situation, seconds=1.5, *, hand=lambda time: STIFFNESS, surface=Surface.RIGID, limits=None):
    """Simulate part, drum, finger, force and target, a row per sample; the hand follows a receding part.

    *hand* is its stiffness, N/m, as a function of time in seconds.
    """
    controller, plant = FingerController(PATH, RATE, limits=limits), DrumPlant(PATH)
    record = frame(1).records[0]
    record["flags"], record["mode"], record["surface"] = TRACKED, Mode.POSITION, surface
    record["stiffness"], record["damping"] = 400.0, 0.2
    finger, speed, rows, action, mark = WALL - 0.03, 0.0, [], None, None
    poses = []  # (link, time) pairs until they are sent
    for sample in range(int(seconds * RATE)):
        time = sample / RATE
        now_ns = NS + round(1e9 * time)
        part = WALL + float(situation.offset(time))
        wanted = min(WALL + INTENT, WALL - 0.03 + 0.2 * time) + max(part - WALL, 0.0)
        if action is not None:
            plant.advance(action, finger, 1.0 / RATE)
        link = min(finger, plant.position)
        push = hand(time) * (wanted - finger) - plant.force
        speed = (speed + push / MASS / RATE) / (1.0 + DAMPING / MASS / RATE)
        finger += speed / RATE
        poses.append((time, now_ns, link))
        if sample % 3 == 0 and poses[0][0] <= time - LATENCY:
            while len(poses) > 1 and poses[1][0] <= time - LATENCY:
                poses.pop(0)
            mark = FrameMark(1, 0 if mark is None else mark.sequence + 1, now_ns)
            write(record, situation, *poses[0])
        seen = Observation(
            now_ns, PATH.bend(link), plant.angle, State.OK if mark else State.STALE, record if mark else None,
            plant.force, sample_ns=now_ns, frame=mark,
        )  # fmt: skip
        action = controller.step(seen)
        assert controller.fault == ""
        rows.append((time, part, plant.position, link, plant.force, action.position))
    return np.rec.fromrecords(rows, names="time,part,drum,finger,force,target")


def write(record, situation, time, pose_ns, link):
    """Write a service's record for that pose; a finger that is inside touches at its own position."""
    step, tilt = 1e-5, float(situation.tilt(time))
    part = WALL + float(situation.offset(time))
    speed = float(situation.offset(time + step) - situation.offset(time - step)) / (2.0 * step)
    distance = (part - link) * np.cos(tilt)
    record["pose_ns"], record["bend"] = pose_ns, PATH.bend(link)
    record["contact_bend"] = PATH.bend(part) if distance > 0.0 else PATH.bend(link)
    slope = (PATH.position(PATH.bend(part) + 1e-3) - PATH.position(PATH.bend(part))) / 1e-3
    record["contact_bend_rate"] = speed / slope if distance > 0.0 else np.nan
    record["normal"] = -np.sin(tilt), 0.0, -np.cos(tilt)
    record["part_velocity"] = 0.0, 0.0, speed
    for name in ("signed_distance", "lower", "upper"):
        record[name] = distance
