"""The clearance between two parts, beside shapes that are known and another library."""

import numpy as np
import pytest
import shapes
import trimesh
from manifold3d import Manifold, Mesh

import proximity
from proximity import Scene, SceneError, Solid, clearance

FAR = 100.0


def test_of_two_cubes_it_is_the_gap_between_their_sides():
    scene = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1), name="b")])
    scene.move("b", proximity.Pose(None, [0.13, 0.02, 0.0]))

    found = clearance(scene, "a", "b")

    assert found.distance == pytest.approx(0.03, abs=1e-15)
    np.testing.assert_allclose(found.point_on_second - found.point_on_first, [0.03, 0, 0], atol=1e-15)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_what_another_library_finds(seed):
    rng = np.random.default_rng(seed)
    shapes_ = [trimesh.creation.icosphere(2, 0.02), trimesh.creation.torus(0.05, 0.01, 24, 12)]
    scene = Scene(
        [Solid(mesh.vertices, mesh.faces, name=name) for mesh, name in zip(shapes_, "ab", strict=True)]
    )
    solids = []
    for mesh, name in zip(shapes_, "ab", strict=True):
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, 3] = rng.normal(size=3) * 0.05
        scene.move(name, matrix)
        there = mesh.copy().apply_transform(matrix)
        single = Mesh(
            vert_properties=there.vertices.astype(np.float32), tri_verts=there.faces.astype(np.uint32)
        )
        solids.append(Manifold(single))

    found = clearance(scene, "a", "b")

    assert found.distance == pytest.approx(
        solids[0].min_gap(solids[1], FAR), abs=1e-7
    )  # it computes in float32
    apart = np.linalg.norm(found.point_on_second - found.point_on_first)
    assert found.distance == pytest.approx(apart, abs=1e-15)
    assert clearance(scene, "b", "a").distance == found.distance


def test_parts_that_cross_or_are_inside_one_another_have_none():
    middle = (0, 0, 0)
    scene = Scene([Solid(*shapes.cube(0.1, middle), name="a"), Solid(*shapes.cube(0.02, middle), name="b")])
    for place in ([0.05, 0.01, 0.02], [0.01, 0.01, 0.01]):
        scene.move("b", proximity.Pose(None, place))
        assert clearance(scene, "a", "b").distance == 0.0
        assert clearance(scene, "b", "a").distance == 0.0


def test_what_is_hidden_is_measured_and_stays_hidden():
    scene = Scene(
        [Solid(*shapes.cube(0.1, (0, 0, 0)), name="a"), Solid(*shapes.cube(0.1, (0.2, 0, 0)), name="b")]
    )
    scene.hide("b")

    assert clearance(scene, "a", "b").distance == pytest.approx(0.1)
    assert scene.part("b").is_hidden


def test_a_part_that_is_not_there_is_named():
    scene = Scene([Solid(*shapes.cube(0.1), name="a")])
    with pytest.raises(SceneError, match="'lid'"):
        clearance(scene, "a", "lid")
