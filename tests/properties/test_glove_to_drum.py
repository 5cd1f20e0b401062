"""End-to-end path of a bend: calibration file, potentiometer, service, contact, drum."""

import math

import glove_files
import numpy as np
import pytest
import shapes
from fake_service import MS, Newest, QueueInlet, filled
from ticking import solid

from proximity.decaff.glove.calibrated_glove import read_glove
from proximity.decaff.simulated_drums import DrumBench
from proximity.message import FRAME, GLOVE_POSES, Message, State
from proximity.scene.scene import Scene
from proximity.service import FingerPoses, MessageInput, TrackedContacts
from proximity.service.config import read_scene_file
from proximity.service.hosting.service_assembly import read_gloves
from proximity.service.inputs import inbox
from proximity.tracker.placement import turn_about_axes
from proximity.tracker.tracker import Tracker
from proximity.transport import Reading

TURN, KNUCKLE = turn_about_axes((20.0, -35.0, 50.0)), np.array([0.3, -0.2, 1.1])
PLANE_BEND = 0.174204922
"""Bend at which the pad touches the plane y = -45 mm of the finger's frame (reference value)."""
MM_AN_ANGLE = 0.1
"""Approximate fingertip displacement per drum angle, m/rad (reference value)."""
SCENE = """
[[parts]]
file = "{meshes}/box.stl"
[input]
poses = "mailbox:gloves"
[glove]
calibration = "glove.json"
"""


def counts_read(bend):
    """Reading of the true hand's potentiometer, in whole counts."""
    return float(glove_files.HAND.counts(bend))


@pytest.fixture
def glove_and_ways(tmp_path, request):
    path = glove_files.write(tmp_path / "glove.json")
    (tmp_path / "cell.toml").write_text(SCENE.format(meshes=request.config.rootpath / "meshes"))
    return read_glove(path), read_gloves(read_scene_file(tmp_path / "cell.toml"), 1)


def test_drum_stands_where_the_finger_of_the_calibrated_glove_touches(glove_and_ways, monkeypatch):
    """A finger closes on a plane at 0.4 bends per second; the inputs are counts and the knuckle's pose."""
    glove, ways = glove_and_ways
    queue = QueueInlet()
    monkeypatch.setattr(inbox, "open_inlet", lambda address: queue)
    now_ns = 0
    source = Newest(MessageInput("queue:", 1, clock=lambda: now_ns, gloves=ways), FingerPoses(1), now_ns)
    vertices, faces = shapes.box((-0.3, -0.2, -0.3), (0.3, -0.045, 0.3))
    answers = TrackedContacts(
        Tracker(Scene([solid((vertices @ TURN.T + KNUCKLE, faces), "plane")]), fingers=1)
    )
    bench, message = DrumBench(1000.0, [glove]), Message(GLOVE_POSES, 1)
    header, placed, told = Message(FRAME, 1).header, [], []
    for tick in range(450):
        now_ns = tick * MS
        record = message.records
        record["finger"], record["pose_ns"], record["bend"] = 0, now_ns, math.nan
        record["rotation"], record["translation"] = TURN, KNUCKLE
        record["counts"] = counts_read(0.4e-3 * tick)
        queue.put(message, sequence=tick)
        contacts = filled(answers, source.poll(now_ns), now_ns)
        header["sequence"], header["start_ns"] = tick, now_ns
        bench.step(Reading(State.OK, True, now_ns, 0, header, contacts), now_ns)
        (finger,) = bench.fingers
        if contacts["signed_distance"][0] > 0.0:
            told.append(contacts["contact_bend"][0])
        if finger.action.position < finger.path.retracted:
            placed.append(finger.action.angle)

    true = float(glove_files.HAND.drum_angle(PLANE_BEND)) + glove_files.MOUNTED
    assert max(abs(angle - true) for angle in placed) < 0.3e-3 / MM_AN_ANGLE
    assert finger.action.state.value == "position" and finger.touches == 1
    assert finger.plant.angle == pytest.approx(true, abs=0.3e-3 / MM_AN_ANGLE)
    assert finger.has_bend and finger.faults == 0 and bench.warnings() == []
    assert told[0] == pytest.approx(PLANE_BEND, abs=1e-3) and max(told) - min(told) < 1e-4
