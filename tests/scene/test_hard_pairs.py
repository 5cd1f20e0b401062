"""Pairs of parts whose distance is known by whole numbers, in all sizes, places and orders."""

import numpy as np
import pytest
import shapes

from proximity import Pose, Scene, Solid

BOX = shapes.box((0, 0, 0), (4, 4, 4))
SHEET = (np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
T_JUNCTION = (
    np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 0, 0]]),
    np.array([[0, 4, 3], [4, 1, 2], [4, 2, 3]]),
)
PAIRS = {
    "boxes face to face": (BOX, shapes.box((7, 0, 0), (9, 4, 4)), 3),
    "boxes edge to edge": (BOX, shapes.box((7, 8, 0), (9, 9, 4)), 5),
    "boxes corner to corner": (BOX, shapes.box((6, 7, 10), (9, 9, 12)), 7),
    "faces that touch": (BOX, shapes.box((4, 1, 1), (6, 2, 2)), 0),
    "faces that coincide": (BOX, shapes.box((4, 0, 0), (6, 4, 4)), 0),
    "edges that touch": (BOX, shapes.box((4, 4, 0), (6, 6, 4)), 0),
    "corners that touch": (BOX, shapes.box((4, 4, 4), (6, 6, 6)), 0),
    "the same box": (BOX, BOX, 0),
    "boxes that cross": (BOX, shapes.box((3, 3, 3), (6, 6, 6)), 0),
    "a box in another": (BOX, shapes.box((1, 1, 1), (2, 2, 2)), 0),
    "a box in a hollow one": (shapes.hollow_cube(12, 8), shapes.box((-1, -1, -1), (1, 1, 1)), 3),
    "a box in the wall of a hollow one": (shapes.hollow_cube(12, 8), shapes.box((4.5, 0, 0), (5.5, 1, 1)), 0),
    "one of two bodies inside": (
        BOX,
        shapes.join(shapes.box((9, 9, 9), (10, 10, 10)), shapes.cube(1, (2, 2, 2))),
        0,
    ),
    "sheets above each other": (SHEET, shapes.moved(SHEET, (0, 0, 2)), 2),
    "sheets side by side": (SHEET, shapes.moved(SHEET, (6, 0, 0)), 2),
    "a sheet through a box": (BOX, shapes.moved(SHEET, (2, 2, 2)), 0),
    "a sheet in a box": (shapes.box((-1, -1, -1), (5, 5, 5)), SHEET, 0),
    "a box above a T-junction": (T_JUNCTION, shapes.box((1, 1, 3), (3, 3, 5)), 3),
    "an open box around another": (
        shapes.open_box(),
        shapes.box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75)),
        0.25,
    ),
}


@pytest.mark.parametrize("scale", [2.0**-20, 1.0, 2.0**13])
@pytest.mark.parametrize("name", PAIRS)
def test_distances_are_known(name, scale):
    one, other, distance = PAIRS[name]
    solids = [Solid(np.asarray(v) * scale, f, name=n) for n, (v, f) in zip("ab", (one, other), strict=True)]
    for place in (Pose(), Pose(shapes.rotation(5), np.array([1e3, -2e3, 5e2]) * scale)):
        scene = Scene(solids)
        scene.move_many(["a", "b"], [place, place])
        found, back = scene.clearance("a", "b"), scene.clearance("b", "a")
        size = scale * (12.0 if place.is_identity else 3e3)
        assert found.distance == pytest.approx(distance * scale, abs=1e-14 * size)
        assert found.lower <= found.distance == back.distance
        apart = np.linalg.norm(found.point_on_first - found.point_on_second)
        assert apart == pytest.approx(found.distance, abs=1e-14 * size)


@pytest.mark.parametrize("gap", [2.0**-30, -(2.0**-30)])
def test_a_nanometre_apart_and_across_are_told(gap):
    scene = Scene([Solid(*BOX, name="a"), Solid(*shapes.box((4 + gap, 1, 1), (6, 2, 2)), name="b")])
    found = scene.clearance("a", "b")
    assert found.distance == max(gap, 0.0)
    assert found.relation == ("apart" if gap > 0.0 else "crossing")
