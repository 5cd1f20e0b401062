"""Hands by OpenXR: recorded fingertips through the input, and recorded calls through pyopenxr's structures.

No runtime was to be had for these tests: Debian 12 has no Monado. What a real one does is not tested.
"""

import ctypes
import sys
import threading
import time

import numpy as np
import pytest
from fake_service import polled as polled_once
from project import MESHES

from proximity.errors import MissingLibraryError, ServiceError
from proximity.pose import Pose
from proximity.service import OpenXrInput
from proximity.service.config import read_scene_file
from proximity.service.config.settings import OpenXrEntry
from proximity.service.inputs import openxr_input
from proximity.service.inputs.openxr_input import EXTENSIONS, FINGERS, OpenXrHands
from proximity.tracker.replay import turn_about_axes

Z_UP = Pose(turn_about_axes((90.0, 0.0, 0.0)), (1.0, 0.0, 0.0))


class RecordedHands:
    """Fingertips that were recorded: one answer a call, the last one again and again."""

    def __init__(self, answers):
        self.answers, self.is_over, self.is_closed = list(answers), False, False
        self.has_asked_for_all = threading.Event()

    def tips(self):
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if len(self.answers) == 1:
            self.has_asked_for_all.set()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def close(self):
        self.is_closed = True


def tips_at(height):
    tips = np.full((FINGERS, 3), np.nan)
    tips[1] = 0.1, height, -0.3
    return tips


def polled(given):
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        poses = polled_once(given, time.monotonic_ns())
        if poses is not None:
            return poses
        time.sleep(0.001)
    raise AssertionError("no pose came")


def test_fingertips_come_into_the_scene_with_z_up():
    hands = RecordedHands([(123, tips_at(1.5))])
    given = OpenXrInput(Z_UP, 10, open_hands=lambda: hands)
    poses = polled(given)

    assert poses.positions[1] == pytest.approx([1.1, 0.3, 1.5])
    assert (poses.pose_ns == 123).all() and np.isnan(poses.positions[[0, 2, 9]]).all()
    time.sleep(0.03)
    assert polled_once(given, 0) is None  # the same again is no new pose
    given.close()
    assert hands.is_closed and given.is_over


@pytest.mark.parametrize("count", [2, 12])
def test_fewer_or_more_fingers_may_be_served(count):
    given = OpenXrInput(Pose(), count, open_hands=lambda: RecordedHands([(5, tips_at(1.0))]))
    poses = polled(given)

    assert poses.positions.shape == (count, 3)
    assert poses.positions[1] == pytest.approx([0.1, 1.0, -0.3])
    given.close()


def test_failures_are_counted_and_the_next_pose_is_taken():
    hands = RecordedHands([ServiceError("OpenXR: lost"), ServiceError("OpenXR: again"), (7, tips_at(1.0))])
    given = OpenXrInput(Pose(), 10, open_hands=lambda: hands)

    assert polled(given).pose_ns[1] == 7
    assert given.notes == ["OpenXR failed 2 times, first: OpenXR: lost"]
    given.close()


def scene_file(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(f'[[parts]]\nfile = "{MESHES / "box.stl"}"\n[input]\n{text}\n')
    return path


def test_scene_file_says_where_the_hands_are(tmp_path):
    settings = read_scene_file(scene_file(tmp_path, "openxr = true\nposition = [0.1, 0.2, 0.3]"))

    assert settings.input.openxr == OpenXrEntry((0.1, 0.2, 0.3), (90.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("openxr = false", "input.openxr is false, expected true, or another source of poses"),
        ("openxr = 1", "input.openxr is 1, expected true or false"),
        ("openxr = true\nscale = 2.0", "requires input.recording"),
        ('openxr = true\nposes = "shm://poses"', "is given together with input.openxr"),
    ],
)
def test_scene_file_that_makes_no_sense_is_refused(tmp_path, text, sentence):
    with pytest.raises(ServiceError, match=sentence):
        read_scene_file(scene_file(tmp_path, text))


def test_missing_pyopenxr_is_reported_with_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "xr", None)

    with pytest.raises(
        MissingLibraryError, match=r'input.openxr needs pyopenxr.*pip install "cad-proximity\[openxr\]"'
    ):
        OpenXrHands()


@pytest.fixture
def runtime(monkeypatch):
    """Calls as a runtime answers them, in pyopenxr's own structures; the list of what was called."""
    xr = pytest.importorskip(
        "xr", reason='calls of OpenXR need pyopenxr: pip install "cad-proximity[openxr]"'
    )
    called = []

    def locate(tracker, info, locations):
        called.append(("locate", info.contents.time))
        found = locations.contents
        assert found.joint_count == openxr_input.JOINTS
        found.is_active = 1
        for number, joint in enumerate(found._joint_locations[: found.joint_count]):
            joint.location_flags = 0b1111 if number != 10 else 0b0011  # the index fingertip is not tracked
            joint.pose.position.x = number
        return 0

    locator = xr.functions.PFN_xrLocateHandJointsEXT(locate)
    event = xr.EventDataBuffer()
    changed = ctypes.cast(ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged)).contents
    changed._type = xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED.value
    changed._state = xr.SessionState.READY.value
    events = [event]

    def poll_event(_instance):
        if not events:
            raise xr.EventUnavailable()
        return events.pop(0)

    extensions = [xr.ExtensionProperties(extension_name=name) for name in EXTENSIONS]
    answers = {
        "enumerate_instance_extension_properties": lambda: extensions,
        "create_instance": lambda info: xr.Instance(),
        "get_system": lambda instance, info: xr.SystemId(1),
        "create_session": lambda instance, info: xr.Session(),
        "create_reference_space": lambda session, info: xr.Space(),
        "create_hand_tracker_ext": lambda session, info: xr.HandTrackerEXT(),
        "get_instance_proc_addr": lambda instance, name: ctypes.cast(locator, xr.PFN_xrVoidFunction),
        "convert_timespec_time_to_time_khr": lambda instance, at: xr.Time(at.tv_sec * 10**9 + at.tv_nsec),
        "poll_event": poll_event,
        "begin_session": lambda session, info: called.append("begin"),
    }
    for name in ("destroy_instance", "destroy_session", "destroy_hand_tracker_ext"):
        answers[name] = lambda handle, name=name: called.append(name)
    for name, answer in answers.items():
        monkeypatch.setattr(xr, name, answer)
    return called, extensions


def test_joints_of_both_hands_are_located_for_now(runtime):
    called, _ = runtime
    before = time.monotonic_ns()
    hands = OpenXrHands()
    pose_ns, tips = hands.tips()
    hands.close()

    assert before <= pose_ns <= time.monotonic_ns()
    assert called == [
        "begin", ("locate", pose_ns), ("locate", pose_ns),
        "destroy_hand_tracker_ext", "destroy_hand_tracker_ext", "destroy_session", "destroy_instance",
    ]  # fmt: skip
    assert np.array_equal(tips[:, 0], [5, np.nan, 15, 20, 25] * 2, equal_nan=True)


def test_runtime_without_hands_is_refused(runtime):
    _, extensions = runtime
    del extensions[0]

    with pytest.raises(ServiceError, match="the OpenXR runtime lacks XR_EXT_hand_tracking"):
        OpenXrHands()
