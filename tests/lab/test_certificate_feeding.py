"""Certificates of services that are told more than poses: paths of fingers, and moves of parts."""

import glove_files
import make
import numpy as np
import pytest
from certificates import ball_subject, certificate, found
from project import MESHES

from proximity.decaff.glove.finger import Finger
from proximity.lab.certificate import measurement, service_inputs, wording
from proximity.lab.certificate.document import document
from proximity.lab.certificate.held_parts import measure_held_parts
from proximity.lab.certificate.subject import read_subject
from proximity.pose import Pose
from proximity.service import TrackedContacts
from proximity.service.inputs.gloves import points_on
from proximity.tracker.tracker import Tracker

CORNERS = Finger().path_world(Pose())[None]
MS = 1_000_000
SCENE = """
[fingers]
count = 5
[[parts]]
file = "{box}"
[input]
{input}
"""


def subject_of(tmp_path, inputs, rest=""):
    path = tmp_path / "cell.toml"
    path.write_text(SCENE.format(box=make.FOLDER / "box.stl", input=inputs) + rest)
    return read_subject(path)


@pytest.fixture
def ticks(monkeypatch):
    """What each tick was told: paths, bends, and where the part stood."""
    told, advance = [], Tracker.advance

    def copied(array):
        return None if array is None else array.copy()

    def advance_and_note(tracker, positions, *rest, paths=None, bends=None, **more):
        position = tracker.scene.parts[0].pose.translation.copy()
        told.append((positions.copy(), copied(paths), copied(bends), position, tracker.scene))
        return advance(tracker, positions, *rest, paths=paths, bends=bends, **more)

    monkeypatch.setattr(Tracker, "advance", advance_and_note)
    return told


def test_scene_file_says_whether_paths_and_moves_may_come(tmp_path):
    recorded = subject_of(tmp_path, f'recording = "{make.FOLDER / "hand.csv"}"\nmoves = "mailbox:m"')
    poses = subject_of(tmp_path, 'poses = "mailbox:p"')
    glove_files.write(tmp_path / "glove.json")
    glove = subject_of(tmp_path, 'poses = "mailbox:p"', '[glove]\ncalibration = "glove.json"\n')

    assert recorded.corners is None and recorded.moves
    np.testing.assert_array_equal(poses.corners, CORNERS)
    assert not poses.moves
    assert glove.corners.shape == (5, 65, 3)
    np.testing.assert_allclose(glove.corners[1], glove_files.HAND.finger.path_world(Pose()), atol=1e-12)


def test_motions_with_paths_and_moves_are_timed_where_they_may_come():
    def names(**settings):
        cases = measurement.measure(ball_subject(fingers=2, **settings), found(), 100, 1)
        return [each.name for each in cases if each.counts and "worst" in each.name]

    usual = ["worst, at rest", "worst, passing", "worst, cold start"]
    assert names() == usual
    assert names(corners=CORNERS) == [*usual[:2], "worst, on paths", usual[2]]
    assert names(moves=True) == [*usual[:2], "worst, parts moving", usual[2]]
    assert names(corners=CORNERS, moves=True) == [
        *usual[:2], "worst, on paths", "worst, parts moving", usual[2],
    ]  # fmt: skip


def test_ticks_of_held_parts_are_timed_as_a_motion_of_their_own():
    subject = read_subject(MESHES / "held.toml")

    (timing,) = measure_held_parts(subject, 50, 1)

    assert timing.name == "held pin" and timing.counts and timing.fingers == 2
    assert len(timing.thread_ns) == 50 and (timing.best_ns <= timing.thread_ns).all()
    assert timing.most_work > 0 and timing.shares["exact"] > 0.9
    assert measure_held_parts(ball_subject(fingers=2), 50, 1) == ()


def test_fingers_are_on_their_paths_and_parts_move_in_those_motions_alone(ticks):
    subject = ball_subject(fingers=2, corners=CORNERS, moves=True)
    measurement.measure(subject, found(), 100, 1)

    on_paths = [told for told in ticks if told[1] is not None]
    moving = [told for told in ticks if told[4] is not subject.scene]
    rounds = measurement.REPEATS * (100 + 10)  # and a tenth that is not counted
    assert len(on_paths) == 2 * rounds and len(moving) == rounds
    for positions, paths, bends, _, _ in on_paths:
        np.testing.assert_allclose(points_on(paths, bends), positions, atol=1e-12)
        lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(CORNERS[[0, 0]], axis=1), axis=2))
    positions = np.array([told[3] for told in moving])
    assert np.ptp(positions, axis=0)[2] > 1e-4 and np.abs(positions).max() <= 1.1 * service_inputs.SWAY
    assert (np.diff(positions[:100, 2]) != 0.0).all()
    assert subject.scene.parts[0].pose.is_identity


def test_loop_is_told_what_the_service_may_be_told(ticks, monkeypatch):
    monkeypatch.setattr(TrackedContacts, "is_ticked_by_loop", False)  # where ticks can be seen
    subject = ball_subject(real_time=False, corners=CORNERS, moves=True)

    report = measurement.run_loop(subject, found(), 0.05, 3)

    rehearsal = len(ticks) - report.ticks
    assert all(told[1] is not None for told in ticks[rehearsal:])
    assert len({told[3][2] for told in ticks[rehearsal:]}) > 10
    assert subject.scene.parts[0].pose.is_identity
    assert not any("moves" in note for note in report.notes)


def test_certificate_says_what_was_told():
    plain = document(certificate())["settings"]
    told = document(certificate(corners=CORNERS, moves=True))["settings"]

    assert (plain["path_corners"], plain["parts_move"], wording.fed(plain)) == (None, False, "")
    assert (told["path_corners"], told["parts_move"]) == (65, True)
    assert wording.fed(told) == "; passing also on paths of 65 corners, and with all parts moving"
