"""Scene changes interrupted at any line by KeyboardInterrupt, and the results of later queries."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapes
from scene_parts import part_of

import proximity
from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

PACKAGE = str(Path(proximity.__file__).parent)
INTERRUPTED = {
    f"{PACKAGE}/{name}.py"
    for name in (
        "scene/scene", "scene/scene_parts", "scene/deformation", "scene/solid", "scene/solid_arrays",
        "scene/queries/queries", "scene/model/scene_state",
    )
}  # fmt: skip
POINTS = np.random.default_rng(3).uniform(-3.0, 12.0, (40, 3))
WAYS = np.random.default_rng(4).normal(size=(40, 3))


def scene_of_parts():
    scene = Scene([part_of(shapes.moved(shapes.cube(), (3.0 * k, 0.0, 0.0)), str(k)) for k in range(4)])
    scene.move("3", shifted(9.0, 2.0))
    scene.distance(POINTS)
    return scene


def shifted(*offset):
    pose = np.eye(4)
    pose[: len(offset), 3] = offset
    return pose


def bulged(scene, name):
    return scene.part(name).solid.mesh.vertices * 1.25 + 0.1


CHANGES = {
    "move a part that stands": lambda scene: scene.move("1", shifted(0.0, 4.0)),
    "move one that has moved": lambda scene: scene.move("3", shifted(8.0, -2.0)),
    "move out of the frame": lambda scene: scene.move("2", shifted(0.0, 0.0, 500.0)),
    "move several": lambda scene: scene.move_many(["0", "3"], [shifted(0.5), shifted(0.0, 5.0)]),
    "hide": lambda scene: scene.hide("1"),
    "show": lambda scene: (scene.hide("2"), scene.distance(POINTS), scene.show("2")),
    "deform": lambda scene: scene.deform("1", bulged(scene, "1")),
    "deform one that has moved": lambda scene: scene.deform("3", bulged(scene, "3")),
    "add": lambda scene: scene.add(part_of(shapes.moved(shapes.cube(), (0.0, 6.0, 0.0)), "4")),
    "remove": lambda scene: scene.remove("0"),
}


def interrupted_at(line, change, scene):
    """Change and query *scene*, interrupted before the *line*-th line executed; return whether it was."""
    left = line

    def watch(frame, event, _):
        nonlocal left
        if frame.f_code.co_filename not in INTERRUPTED:
            return None
        if event == "line":
            left -= 1
            if left == 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return watch

    before = sys.gettrace()
    sys.settrace(watch)
    try:
        change(scene)
        scene.distance(POINTS[:3])
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def answers(scene):
    return (
        scene.signed_distance(POINTS),
        scene.cast_distance(POINTS, WAYS),
        scene.closest_to_segments(POINTS, POINTS + WAYS).distance,
    )


@cache
def solid_of(vertices, faces):
    """A solid of arrays, given as bytes, that are not shared."""
    return Solid(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int32).reshape(-1, 3))


def made_anew(scene):
    """New parts from the meshes alone."""
    parts = []
    for part in scene.parts:
        vertices, faces = part.solid.mesh.vertices.tobytes(), np.int32(part.solid.mesh.faces).tobytes()
        solid = solid_of(vertices, faces)
        parts.append(Part(part.name, solid, part.pose, part.source_faces, is_hidden=part.is_hidden))
    return Scene(parts)


@pytest.mark.parametrize("name", CHANGES)
def test_scene_is_as_its_parts_say_wherever_a_change_is_interrupted(name):
    line, was_interrupted = 0, True
    while was_interrupted:
        line += 1
        scene = scene_of_parts()
        tracker = Tracker(scene, fingers=len(POINTS), radius=0.0, working_range=10.0, budget=10**6)
        tracker.tick(POINTS, 10**6, 10**6)
        held = scene.part("1").solid  # of before: it keeps its shape
        before = held.signed_distance(POINTS)
        was_interrupted = interrupted_at(line, CHANGES[name], scene)

        anew = made_anew(scene)
        for told, true in zip(answers(scene), answers(anew), strict=True):
            np.testing.assert_allclose(told, true, rtol=1e-12, atol=1e-12, err_msg=f"after line {line}")
        np.testing.assert_allclose(held.signed_distance(POINTS), before, rtol=1e-12, atol=1e-12)
        contacts, true = tracker.tick(POINTS, 2 * 10**6, 2 * 10**6), anew.signed_distance(POINTS)
        assert (contacts["lower"] <= true + 1e-12).all(), line
        assert (true <= contacts["upper"] + 1e-12).all(), line
        # Later changes work as well.
        scene.move("3", shifted(1.0, 7.0))
        scene.deform("2", bulged(scene, "2"))
        for told, true in zip(answers(scene), answers(made_anew(scene)), strict=True):
            np.testing.assert_allclose(told, true, rtol=1e-12, atol=1e-12, err_msg=f"after line {line}")
    assert line > 10
