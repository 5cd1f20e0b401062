"""Closing a scene: what it releases, what remains valid, and what is refused."""

import gc
import sys
from pathlib import Path

import numpy as np
import pytest
from project import MESHES

import proximity

POINT = [0.030, 0.010, 0.005]
IDENTITY = np.eye(4)
USES = {
    "query": lambda scene: scene.closest(POINT),
    "length": len,
    "iteration": list,
    "part": lambda scene: scene[0],
    "parts": lambda scene: scene.parts,
    "bounds": lambda scene: scene.bounds,
    "clearance": lambda scene: scene.clearance(0, 1),
    "move": lambda scene: scene.move("bracket", IDENTITY),
}


def is_mapped(path):
    return str(path) in Path("/proc/self/maps").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    path = tmp_path_factory.mktemp("compiled") / "bracket.prox"
    proximity.load(MESHES / "bracket.stl", units="mm").save(path)
    return path


@pytest.mark.skipif(sys.platform != "linux", reason="reads the maps of Linux")
def test_closing_unmaps_the_file_and_keeps_answers(compiled):
    with proximity.load(compiled) as scene:
        hit = scene.closest(POINT)
        assert is_mapped(compiled)

    gc.collect()
    assert not is_mapped(compiled)
    assert hit.signed_distance == pytest.approx(0.001)
    assert repr(scene) == "Scene(closed)"


def test_parts_of_a_closed_scene_remain_valid(compiled):
    with proximity.load(compiled) as scene:
        part = scene["bracket"]
        expected = scene.closest(POINT)

    assert part.solid.closest(POINT).signed_distance == expected.signed_distance
    assert len(proximity.Scene([part])) == 1


def test_a_tracker_of_a_closed_scene_raises(compiled):
    with proximity.load(compiled) as scene:
        tracker = proximity.Tracker(scene, fingers=1)
        tracker.tick(np.zeros((1, 3)), 0, 0)

    with pytest.raises(proximity.SceneError, match="closed"):
        tracker.tick(np.zeros((1, 3)), 1_000_000, 1_000_000)


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_every_use_of_a_closed_scene_is_refused(compiled, use):
    scene = proximity.load(compiled)
    scene.close()
    scene.close()

    with pytest.raises(proximity.SceneError, match="closed"):
        use(scene)
