"""The common volume of two parts, compared with boxes of known overlap."""

import numpy as np
import pytest
import shapes
from project import MESHES

import proximity
from proximity import MeshError, Pose, Scene, SceneError, Solid, overlap

QUARTER_TURN = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def assert_is(found, volume, lower, upper):
    assert found.volume == pytest.approx(volume, rel=1e-12)
    np.testing.assert_allclose(found.lower, lower, atol=1e-14)
    np.testing.assert_allclose(found.upper, upper, atol=1e-14)


def cubes(offset, size=0.1):
    middle = 0.5 * size
    scene = Scene([Solid(*shapes.cube(size, [middle] * 3), name=name) for name in "ab"])
    scene.move("b", Pose(None, offset))
    return scene


def test_of_two_cubes_it_is_a_box():
    found = overlap(cubes([0.09, 0.02, -0.03]), "a", "b")

    assert_is(found, 0.01 * 0.08 * 0.07, [0.09, 0.02, 0.0], [0.1, 0.1, 0.07])


def test_it_is_given_where_the_parts_stand():
    """A bar of 0.2 x 0.1 x 0.05 m, rotated by 90 degrees about z, spans x = 0.05 to 0.15 m."""
    bar = Solid(*shapes.box([0, 0, 0], [0.2, 0.1, 0.05]), name="bar")
    scene = Scene([Solid(*shapes.cube(0.1, [0.05] * 3), name="cube"), bar])
    scene.move("bar", Pose(QUARTER_TURN, [0.15, -0.1, 0.02]))

    for pair in (("cube", "bar"), ("bar", "cube")):
        found = overlap(scene, *pair)
        assert_is(found, 0.05 * 0.1 * 0.05, [0.05, 0.0, 0.02], [0.1, 0.1, 0.07])


def test_a_part_inside_another_overlaps_by_all_of_itself():
    assert overlap(cubes([0.0, 0.0, 0.0]), "a", "a").volume == pytest.approx(1e-3)

    scene = Scene(
        [Solid(*shapes.cube(0.1, [0.0] * 3), name="a"), Solid(*shapes.cube(0.02, [0.0] * 3), name="b")]
    )
    assert overlap(scene, "a", "b").volume == pytest.approx(8e-6)


@pytest.mark.parametrize("far", [0.0, 1e4])
def test_parts_that_touch_have_none(far):
    """Includes parts rounded to single precision, like those of a STEP file."""
    for x in (0.1, 0.1 * (1.0 - 2.0**-23), 0.1 * (1.0 + 2.0**-23)):
        scene = cubes([x, 0.02, 0.03])
        for name in "ab":
            scene.move(name, Pose(None, scene.part(name).pose.translation + far))
        assert overlap(scene, "a", "b") is None
    assert overlap(cubes([0.1 - 1e-6, 0.0, 0.0]), "a", "b").volume == pytest.approx(1e-8, rel=1e-6)


def test_parts_that_are_apart_have_none():
    """Includes parts with overlapping bounding boxes."""
    assert overlap(cubes([0.2, 0.0, 0.0]), "a", "b") is None

    scene = Scene([Solid(*shapes.tetrahedron(), name=name) for name in "ab"])
    scene.move("b", Pose(np.diag([-1.0, -1.0, 1.0]), [1.2, 1.2, 0.0]))
    assert overlap(scene, "a", "b") is None


def test_a_small_part_far_from_the_origin_overlaps_as_elsewhere():
    scene = cubes([0.0005, 0.0, 0.0], size=0.001)
    for name in "ab":
        scene.move(name, Pose(None, scene.part(name).pose.translation + np.array([1000.0, 0.0, 0.0])))

    assert overlap(scene, "a", "b").volume == pytest.approx(5e-10, rel=1e-9)


def test_what_is_hidden_is_measured_and_stays_hidden():
    scene = cubes([0.09, 0.02, -0.03])
    scene.hide("b")

    assert overlap(scene, "a", "b").volume == pytest.approx(5.6e-5)
    assert scene.part("b").is_hidden


def test_a_part_that_is_no_solid_is_named():
    """Both near the other part and far from it."""
    open_box = Solid(*shapes.open_box(), name="tray")
    scene = Scene([Solid(*shapes.cube(0.1, [9.0, 9.0, 9.0]), name="a"), open_box])
    message = (
        r"^part 'tray' is not a closed solid for manifold3d \(NotManifold\), expected two parts that are"
    )

    for pair in (("a", "tray"), ("tray", "a")):
        with pytest.raises(MeshError, match=message):
            overlap(scene, *pair)
    with pytest.raises(SceneError, match="'lid'"):
        overlap(scene, "a", "lid")


@pytest.mark.processes
def test_the_parts_of_the_sample_assembly_touch_and_do_not_overlap():
    scene = proximity.load(MESHES / "assembly.step")

    assert overlap(scene, "base", "lid") is None and overlap(scene, "lid", "pin") is None
    lid = scene.part("lid").pose
    scene.move("lid", Pose(lid.rotation, lid.translation - [0.0, 0.0, 0.001]))
    found = overlap(scene, "base", "lid")
    assert found.upper[2] - found.lower[2] == pytest.approx(0.001, abs=1e-8)
