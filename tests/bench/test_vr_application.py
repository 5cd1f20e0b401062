"""VR applications that are timed: as many fingers as are said, every pose answered, and what a row shows."""

from dataclasses import asdict

import numpy as np
import pytest
from project import MESHES

from benchmarks.service import vr_application
from benchmarks.service.vr_application import HEADINGS, PATHS, VrCase, VrRow, measure
from proximity.recording import read_recording


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(("count", "is_moving"), [(5, False), (10, True)])
def test_an_application_serves_the_fingers_that_are_said(path, count, is_moving, monkeypatch):
    served = set()
    parts_of = vr_application.parts_of
    monkeypatch.setattr(
        vr_application, "parts_of", lambda *given: (served.add(len(parts_of(*given)[1])), parts_of(*given))[1]
    )
    case = VrCase(path, finger_count=count, is_moving=is_moving, seconds=0.5)

    row = measure([str(MESHES / "bracket.stl")], case, read_recording(MESHES / "hand.csv"))

    assert served == {count}
    assert 30 < row.answered_count <= row.pose_count < 60
    assert 0.0 < row.motion_to_distance_p50 <= row.motion_to_distance_p99 <= row.motion_to_distance_p999
    assert 0.0 < row.tick_p50 <= row.tick_p99
    assert (row.bridge_share is None) is (path == "native")
    assert len(row.cells) == len(HEADINGS)
    assert VrRow.of(asdict(row)) == row


def test_ticks_with_a_new_pose_are_told_from_those_without():
    timed = vr_application._Timed(sent=[0, 100_000_000])
    for pose, arrival, took in ((0, 10, 70), (0, 20, 5), (0, 30, 7), (100_000_000, 100_000_040, 90)):
        timed.frames.append((pose + 1, arrival, took))

    row = vr_application._row(VrCase(), timed, 12)

    np.testing.assert_allclose([row.tick_p50, row.idle_tick_p50], [80e-9, 6e-9])
    np.testing.assert_allclose(row.motion_to_distance_p50, 25e-9)
    assert (row.pose_count, row.answered_count) == (2, 2)
