"""Bends given with poses: published unchanged, with their rate of change."""

import math

import numpy as np
import pytest
from fake_service import KeepingOutlet, ManualClock, ScriptedInput, filled, publisher
from ticking import MS, line, plate

from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.service import FingerPoses, Service, TrackedContacts
from proximity.tracker.tracker import Tracker

RATE = 2.0  # bends per second


@pytest.fixture(scope="module")
def answers():
    """Contacts of three fingers above a plate, rehearsed as in the loop."""
    made = TrackedContacts(Tracker(Scene([plate()]), fingers=3))
    made.rehearse()
    return made


def told(answers, bends, *, paths=None, ticks=8, every=1):
    """Contacts after some ticks; bends start at *bends* with rate `RATE`, one pose per *every* ticks."""
    poses = answers.new_samples()
    answers.rehearse()  # resets the state of previous calls
    for tick in range(ticks):
        pose = tick // every * every
        poses.positions[:], poses.pose_ns[:] = [[0.0, 0.0, 0.05 - 1e-4 * pose]] * 3, pose * MS
        poses.paths, poses.bends = paths, np.asarray(bends) + RATE * 1e-3 * pose
        contacts = filled(answers, poses, tick * MS)
    return contacts


@pytest.mark.parametrize("every", [1, 4])
def test_bend_that_is_told_without_a_path_is_published_with_its_rate(answers, every):
    contacts = told(answers, [0.1, 0.5, math.nan], every=every, ticks=8 * every)

    pose = 7 * every
    assert contacts["bend"][:2] == pytest.approx([0.1 + RATE * 1e-3 * pose, 0.5 + RATE * 1e-3 * pose])
    assert contacts["bend_rate"][:2] == pytest.approx([RATE, RATE])
    assert np.isnan(contacts[2]["bend"]) and np.isnan(contacts[2]["bend_rate"])
    # Without a path, the bend at contact is unknown.
    assert np.isnan(contacts["contact_bend"]).all()
    assert not (contacts["flags"] & (ContactFlag.ON_PATH | ContactFlag.CONTACT_FOUND)).any()


def test_bend_that_an_input_tells_reaches_the_published_contact(answers):
    def tell(_, now_ns):
        poses = FingerPoses(3)
        poses.positions[:] = [[0.02 * finger, 0.0, 0.05] for finger in range(3)]  # one point: a lost hand
        poses.pose_ns[:] = now_ns
        poses.bends = np.full(3, 0.1 + RATE * 1e-9 * now_ns)
        return poses

    answers.rehearse()
    outlet = KeepingOutlet()
    service = Service(answers, ScriptedInput(tell), [publisher(outlet)], period=0.001, clock=ManualClock(0))
    service.run(tick_count=8)
    contacts = outlet.records[7]

    assert contacts["bend"] == pytest.approx([0.1 + RATE * 8e-3] * 3)
    assert contacts["bend_rate"] == pytest.approx([RATE] * 3)


def test_finger_on_a_path_keeps_what_its_path_tells(answers):
    paths = np.full((3, 2, 3), np.nan)
    paths[0] = line((0.0, 0.0, 0.05), (0.0, 0.0, -0.05))
    contacts = told(answers, [0.2, 0.2, 0.2], paths=paths)

    assert contacts["bend"] == pytest.approx([0.2 + RATE * 7e-3] * 3)
    assert contacts["bend_rate"] == pytest.approx([1.0, RATE, RATE])  # 0.1 m/s on 0.1 m
    assert contacts["contact_bend"][0] == pytest.approx(0.43)
    assert [bool(flags & ContactFlag.ON_PATH) for flags in contacts["flags"]] == [True, False, False]


def test_finger_that_is_not_tracked_has_no_bend(answers):
    poses = FingerPoses(3)
    poses.bends = np.full(3, 0.5)
    assert np.isnan(filled(answers, poses, 0)["bend"]).all()
