"""Gloved fingers: from calibration file, knuckle pose and encoder counts to the bend at contact."""

import math
import shutil

import glove_files
import numpy as np
import pytest
import shapes
from fake_service import MS, Newest, QueueInlet, filled
from hypothesis import given, settings
from hypothesis import strategies as st
from project import MESHES
from ticking import solid

from proximity.decaff.glove.calibrated_glove import read_glove
from proximity.errors import DecaffError, ServiceError
from proximity.message import GLOVE_POSES, POSES, ContactFlag, Message
from proximity.scene.scene import Scene
from proximity.service import FingerPoses, MessageInput, TrackedContacts
from proximity.service.config import read_scene_file
from proximity.service.hosting.service_assembly import read_gloves
from proximity.service.inputs import inbox
from proximity.tracker.placement import turn_about_axes
from proximity.tracker.tracker import Tracker

NOW = 9000 * MS
TURN = turn_about_axes((20.0, -35.0, 50.0))
KNUCKLE = np.array([0.3, -0.2, 1.1])
PLANE_BEND = 0.174204922
"""Bend at which the pad touches the plane y = -45 mm of the finger's frame (reference value)."""
SCENE = '[[parts]]\nfile = "box.stl"\n[input]\nposes = "mailbox:gloves"\n[glove]\n'


@pytest.fixture
def folder(tmp_path):
    shutil.copy(MESHES / "box.stl", tmp_path)
    glove_files.write(tmp_path / "glove.json")
    return tmp_path


@pytest.fixture
def gloves_of(folder):
    """Fingertip paths of two fingers, from a scene file with the given [glove] text."""

    def read(text, count=2):
        (folder / "cell.toml").write_text(SCENE + text)
        return read_gloves(read_scene_file(folder / "cell.toml"), count)

    return read


@pytest.fixture(scope="module")
def ways(tmp_path_factory):
    """Fingertip paths of two fingers."""
    folder = tmp_path_factory.mktemp("ways")
    shutil.copy(MESHES / "box.stl", folder)
    glove_files.write(folder / "glove.json")
    (folder / "cell.toml").write_text(SCENE + 'calibration = "glove.json"')
    return read_gloves(read_scene_file(folder / "cell.toml"), 2)


def poses(bend=math.nan, counts=math.nan, **fields):
    """A message of two fingers at the same pose."""
    message = Message(GLOVE_POSES, 2)
    records = message.records
    records["finger"], records["pose_ns"] = [0, 1], NOW
    records["rotation"], records["translation"] = TURN, KNUCKLE
    records["bend"], records["counts"] = bend, counts
    for name, value in fields.items():
        records[name] = value
    return message


def stream(gloves):
    return Newest(MessageInput("queue:", 2, clock=lambda: NOW, gloves=gloves), FingerPoses(2), NOW)


def world(point):
    return TURN @ point + KNUCKLE


def test_counts_become_bend_fingertip_and_path(gloves_of, inlet):
    source = stream(gloves_of('calibration = "glove.json"'))
    inlet.put(poses(counts=[glove_files.HAND.counts(0.25), math.nan], bend=[math.nan, 0.5]))
    polled = source.poll(NOW)

    finger = glove_files.HAND.finger
    assert polled.bends == pytest.approx([0.25, 0.5], abs=1e-3)  # seven points of a table
    for row in range(2):
        tip = world(finger.point_hand(polled.bends[row]))
        assert polled.positions[row] == pytest.approx(tip, abs=3e-5)
        assert polled.paths[row, -1] == pytest.approx(world(finger.point_hand(1.0)))
    assert polled.pose_ns.tolist() == [NOW, NOW] and source.notes == []


def test_glove_tells_the_tracker_where_its_finger_will_touch(gloves_of, inlet):
    """The paper's plane, transformed to the hand."""
    vertices, faces = shapes.box((-0.3, -0.2, -0.3), (0.3, -0.045, 0.3))
    scene = Scene([solid((vertices @ TURN.T + KNUCKLE, faces), "plane")])
    answers = TrackedContacts(Tracker(scene, fingers=2))
    source = stream(gloves_of('calibration = "glove.json"'))
    inlet.put(poses(bend=[0.1, 0.15]))
    contacts = filled(answers, source.poll(NOW), NOW)

    assert contacts["bend"] == pytest.approx([0.1, 0.15])
    assert contacts["contact_bend"] == pytest.approx([PLANE_BEND] * 2, abs=2e-4)  # 0.03 mm of a polyline
    assert ((contacts["flags"] & ContactFlag.CONTACT_FOUND) != 0).all()


def test_finger_that_bends_beyond_its_table_goes_straight_on(gloves_of, inlet):
    source = stream(gloves_of('calibration = "glove.json"'))
    inlet.put(poses(bend=[-0.03, 1.03]))
    polled = source.poll(NOW)

    for row in range(2):
        tip = world(glove_files.HAND.finger.point_hand(polled.bends[row]))
        assert polled.positions[row] == pytest.approx(tip, abs=5e-4)


@pytest.mark.parametrize(
    ("fields", "note"),
    [
        ({"counts": 60_000.0}, "queue:: 2 counts outside the calibration (calibrate again)"),
        ({"bend": 0.3, "rotation": np.diag([1.0, 1.0, -1.0])}, "queue:: 2 rotations that are invalid"),
        ({"bend": 0.3, "translation": math.nan}, None),
        ({"bend": 1e300}, None),
        ({}, None),
    ],
)
def test_what_cannot_be_is_a_finger_that_is_not_tracked(gloves_of, inlet, fields, note):
    source = stream(gloves_of('calibration = "glove.json"'))
    inlet.put(poses(**fields))

    assert np.isnan(source.poll(NOW).positions).all()
    assert source.notes == ([note] if note else [])


@settings(max_examples=200, deadline=None, derandomize=True)
@given(data=st.data())
def test_whatever_numbers_come_nothing_is_raised(ways, data):
    """Not even a warning, which is an error in tests."""
    numbers = st.sampled_from(
        [0.0, 0.5, -1.0, 1e-300, 1e155, 1.7e308, -1.7e308, math.nan, math.inf, -math.inf]
    )
    message, queue = poses(bend=0.3), QueueInlet()
    for name in ("rotation", "translation", "bend", "counts"):
        if data.draw(st.booleans()):
            flat = message.records[name].reshape(2, -1)
            flat[:] = [[data.draw(numbers) for _ in row] for row in flat]
    queue.put(message)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(inbox, "open_inlet", lambda address: queue)
        polled = stream(ways).poll(NOW)

    assert polled is not None and polled.positions.shape == (2, 3)


def test_poses_of_fingertips_are_taken_all_the_same_and_end_the_path(gloves_of, inlet):
    source = stream(gloves_of('calibration = "glove.json"'))
    inlet.put(poses(bend=0.3))
    source.poll(NOW)
    tips = Message(POSES, 1)
    tips.records["finger"], tips.records["pose_ns"], tips.records["position"] = 0, NOW, 0.0
    inlet.put(tips)
    polled = source.poll(NOW)

    assert (polled.positions[0] == 0.0).all()
    assert np.isnan(polled.paths[0]).all() and np.isnan(polled.bends[0])
    assert np.isfinite(polled.paths[1]).all()


def test_without_a_glove_its_poses_are_of_a_kind_that_is_not_expected(inlet):
    source = stream(None)
    inlet.put(poses(bend=0.3))

    assert source.poll(NOW) is None
    assert len(source.notes) == 1


def test_each_finger_may_have_a_calibration_of_its_own(gloves_of, folder):
    glove_files.write(folder / "long.json", phalanges=(0.050, 0.030, 0.022))
    gloves = gloves_of('calibration = ["glove.json", "long.json"]')
    assert gloves.corners[1, 0, 0] - gloves.corners[0, 0, 0] == pytest.approx(0.011)


REFUSED = [
    ('calibration = "none.json"', "6: glove.calibration is 'none.json', but .* is not there, expected a cal"),
    ("", "5: glove.calibration is missing, expected a calibration of a glove, as text in quotes, or a list"),
    ('calibration = "box.stl"', "6: glove.calibration: .*box.stl: is not JSON"),
    ('calibration = "old.json"', "old.json: the calibration is of .*, 31 days ago, expected 30 at most: cal"),
    ('calibration = "far.json"', "expected 0 to 65535 of this potentiometer"),
    ('calibration = ["glove.json", "glove.json", "glove.json"]',
     "6: glove.calibration: 3 calibrations for 2 fingers, expected one for all, or one for each"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_calibration_that_does_not_fit_is_refused_with_its_line(gloves_of, folder, text, message):
    glove_files.write(folder / "old.json", days_ago=31.0)
    glove_files.write(folder / "far.json", counts=np.linspace(60_000, 70_000, 7))
    with pytest.raises(ServiceError, match=message):
        gloves_of(text)


def test_age_of_a_calibration_may_be_said(gloves_of, folder):
    glove_files.write(folder / "old.json", days_ago=31.0)
    assert gloves_of('calibration = "old.json"\nmax_age_days = 60').corners.shape == (2, 65, 3)
    with pytest.raises(DecaffError, match=r"old\.json: the calibration is of .*, expected 7 at most"):
        read_glove(folder / "old.json", 7.0)


def test_glove_is_of_poses_that_come_in(folder):
    recorded = SCENE.replace('poses = "mailbox:gloves"', 'sensor = "mailbox:s"').partition("[input]")[2]
    (folder / "cell.toml").write_text("[input]" + recorded + 'calibration = "glove.json"')
    with pytest.raises(ServiceError, match=r":3: \[glove\] requires"):
        read_scene_file(folder / "cell.toml")
