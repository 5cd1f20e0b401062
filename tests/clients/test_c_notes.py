"""Notes of the C library on probable mistakes: those of Python, each once."""

import ctypes

import numpy as np
import pytest
import shapes

import proximity
from benchmarks.digest.library import LibraryTracker, through_library
from proximity import ArgumentError
from proximity.core import library_in_c
from proximity.native import IS_AHEAD

pytestmark = pytest.mark.skipif(
    not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
    reason="the library is compiled with the kernels",
)
LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p)
SECOND = 10**9
NEAR, IN_MM = [[0.0, 0.0, 0.06], [0.0, 0.0, 0.07]], [[0.0, 0.0, 60.0], [0.0, 0.0, 70.0]]


def ball():
    return proximity.Scene([proximity.Solid(*shapes.sphere(0.05, 3), name="ball")])


def noting(opened):
    """Attach a log; return the list of its notes, and the callback to keep alive."""
    notes = []
    log = LOG(lambda _, sentence: notes.append(sentence.decode()))
    opened._library.proximity_set_log(opened._scene, log, None)
    return notes, log


@pytest.mark.parametrize("question", ["closest", "signed_distance", "distance"])
@pytest.mark.parametrize("count", [2, 100])
def test_points_in_millimetres_are_noted_once_as_python_warns(question, count):
    scene, points = ball(), np.tile(IN_MM, (count // 2, 1))
    opened = through_library(scene)
    with pytest.warns(proximity.UnitsWarning) as warned:
        getattr(scene, question)(points)
    getattr(opened, question)(points)  # before a log is set
    notes, _log = noting(opened)

    for rows in (NEAR, points, points):
        getattr(opened, question)(rows)

    assert notes == [str(warned[0].message)]


@pytest.mark.parametrize(
    ("tips", "pose_ns", "now_ns"),
    [
        (IN_MM, 5 * SECOND, 5 * SECOND),
        (NEAR, 5 * SECOND + 12_300_000, 5 * SECOND),
        (NEAR, 9 * SECOND, 5 * SECOND),
        (NEAR, 5 * SECOND, 9 * SECOND),
        (NEAR, 5 * SECOND, 5 * SECOND),
    ],
)
def test_ticks_are_noted_once_as_by_python(tips, pose_ns, now_ns):
    scene = ball()
    expected, tracker = proximity.Tracker(scene, fingers=2), LibraryTracker(scene, fingers=2)
    notes, _log = noting(tracker._scene)
    for tick in range(3):
        for each in (expected, tracker):
            each.tick(tips, pose_ns + tick * 10**6, now_ns + tick * 10**6)

    # The suggested calls have other names in C.
    assert [note.split(";")[0] for note in notes] == [note.split(";")[0] for note in expected.notes]
    assert all(
        "two clocks: take both from one" in note or ";" not in note or "give the" in note for note in notes
    )


def test_posted_pose_of_another_clock_is_noted_once():
    scene = ball()
    tracker = LibraryTracker(scene, fingers=2)
    notes, _log = noting(tracker._scene)
    for tick in range(3):
        tracker._scene.post("ball", np.eye(4), tick * 10**6)
        tracker.tick(NEAR, 60 * SECOND + tick * 10**6, 60 * SECOND + tick * 10**6)

    assert len(notes) == 1 and notes[0].startswith(
        "the pose posted of part 'ball' is 60 s older than the fingers: "
    )


@pytest.mark.parametrize(
    ("ticks", "name"),
    [
        ([(SECOND, 5)], "now_ns"),
        ([(5, 5)], "now_ns"),
        ([(5, SECOND - 100)], None),
        ([(5, 5 * SECOND)], "pose_ns"),
        ([(0, 0)], None),
        ([(0, 0), (1, 1)], "now_ns"),
        ([(SECOND, SECOND), (SECOND + 1, SECOND + 1)], "now_ns"),
        ([(-SECOND, -SECOND)], None),
        ([(2**62, 2**62)], None),
        ([(1_700_000_000 * SECOND, 1_700_000_000 * SECOND)], None),
    ],
)
def test_seconds_are_refused_where_python_refuses_them(ticks, name):
    for made, word in (
        (LibraryTracker, name),
        (proximity.Tracker, name and name.replace("pose_ns", "t_pose_ns")),
    ):
        tracker = made(ball(), fingers=2)
        *before, (pose_ns, now_ns) = ticks
        for each in before:
            tracker.tick(NEAR, *each)
        if name is None:
            tracker.tick(NEAR, pose_ns, now_ns)
            continue
        value = now_ns if name == "now_ns" else pose_ns
        with pytest.raises(
            ArgumentError, match=rf"^{word} is {value}, expected nanoseconds.*looks like seconds"
        ):
            tracker.tick(NEAR, pose_ns, now_ns)
