"""Slivers folded onto their neighbours: exactly these are found, and no sign near them is wrong."""

import numpy as np
import pytest
import shapes
from models import folded_faces_of
from part_arrays import part_arrays
from scene_parts import part_of

import oracle
import proximity
from proximity.kernels.sign import folded_faces
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.sign import SignMethod
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

SPACING = 0.25


def grid_cube():
    return shapes.quartered(*shapes.quartered(*shapes.cube(1.0, (0.0, 0.0, 0.0))))


def flapped_cube():
    """A cube with a top vertex moved in its plane beyond the outline, which leaves a protruding flap."""
    vertices, faces = grid_cube()
    (row,) = np.flatnonzero((np.abs(vertices - (SPACING, SPACING, 0.5)) < 1e-9).all(axis=1))
    vertices = vertices.copy()
    vertices[row, 0] = 0.6
    return vertices, faces


def beside(faces, face):
    """A face and its edge neighbours."""
    shared = np.isin(faces, faces[face]).sum(axis=1)
    return sorted(np.flatnonzero(shared >= 2).tolist())


def folded_cube():
    """A cube with a top vertex moved in its plane across an edge around it, and the face that flips."""
    vertices, faces = grid_cube()
    (row,) = np.flatnonzero((np.abs(vertices - (0.0, SPACING, 0.5)) < 1e-9).all(axis=1))
    around = faces[(faces == row).any(axis=1)]
    across = 0.5 * (vertices[around[0]].sum(axis=0) - vertices[row])
    vertices = vertices.copy()
    vertices[row] += 1.3 * (across - vertices[row])
    corners = vertices[faces]
    heights = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    (flipped,) = np.flatnonzero((corners[:, :, 2] > 0.49).all(axis=1) & (heights < 0.0))
    return vertices, faces, int(flipped)


def points_over(vertices, face, rng, count):
    """Points above and below a face, at 1e-9 to 0.1."""
    on = rng.dirichlet((1.0, 1.0, 1.0), count) @ vertices[face]
    return on + rng.choice([-1.0, 1.0], (count, 1)) * 10.0 ** rng.uniform(-9, -1, (count, 1)) * (0, 0, 1)


def test_the_face_that_is_folded_over_is_found_and_said():
    vertices, faces, flipped = folded_cube()
    solid = Solid(vertices, faces)
    assert folded_faces_of(solid).tolist() == beside(faces, flipped)
    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert solid.sign_reason.endswith(
        "; 4 faces are folded over, or pass through others, or next to such faces: "
        "there the winding number decides"
    )


@pytest.mark.parametrize("seed", range(3))
def test_side_is_right_around_a_flap_whichever_of_its_layers_is_found(seed):
    """Beyond the outline both sides of both layers are outside."""
    vertices, faces = flapped_cube()
    rng = np.random.default_rng(seed)
    solid = Solid(vertices[:, rng.permutation(3)] if seed else vertices, faces)
    turned = solid.mesh.vertices
    rows = np.flatnonzero(np.isin(faces, np.flatnonzero((vertices > 0.55).any(axis=1))).any(axis=1))
    on = (
        rng.dirichlet((1.0, 1.0, 1.0), 2000)[:, :, None] * turned[solid.mesh.faces[rng.choice(rows, 2000)]]
    ).sum(1)
    points = on + rng.normal(size=(2000, 3)) * 10.0 ** rng.uniform(-9, -1, (2000, 1))
    is_inside = oracle.winding_number(turned, solid.mesh.faces, points) > 0.5

    assert np.array_equal(solid.signed_distance(points) < 0.0, is_inside)


@pytest.mark.parametrize("make", ["tetrahedron", "cube", "sphere", "torus", "hollow_cube"])
def test_nothing_else_is(make):
    solid = Solid(*getattr(shapes, make)())
    assert not part_arrays(solid.snapshot(), 0).folded.any()
    assert "folded" not in solid.sign_reason


def test_sharp_wedge_is_looked_at_and_found_right():
    blade = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 0.05], [1, 0, 0.05]], float)
    faces = np.array([[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4], [4, 5, 2], [5, 3, 2], [0, 4, 2], [1, 3, 5]])
    solid = Solid(blade, faces)
    assert solid.is_watertight
    assert -np.cos(np.arctan(0.05)) < folded_faces.SHARPEST_COSINE
    assert not part_arrays(solid.snapshot(), 0).folded.any()


@pytest.mark.parametrize("count", [1, 5, 200])
def test_side_is_right_over_the_fold(count):
    vertices, faces, flipped = folded_cube()
    points = points_over(vertices, faces[flipped], np.random.default_rng(count), count)
    is_inside = oracle.winding_number(vertices, faces, points) > 0.5
    other = part_of(shapes.cube(), "other", Pose(translation=(5, 0, 0)))
    moved = Scene([part_of((vertices, faces), "folded"), other])
    moved.move("folded", Pose(shapes.rotation(3), np.array([0.1, 0.2, 0.3])))

    for one, own in ((Solid(vertices, faces), points), (moved, moved.parts[0].pose.point(points))):
        assert np.array_equal(one.signed_distance(own) < 0.0, is_inside)
        assert np.array_equal(one.closest(own).signed_distance < 0.0, is_inside)
        assert np.array_equal(one.contains(own), is_inside)
    assert is_inside.any() or count < 200


def test_finger_over_the_fold_is_where_it_is():
    vertices, faces, flipped = folded_cube()
    points = points_over(vertices, faces[flipped], np.random.default_rng(4), 40)
    tracker = Tracker(Scene([part_of((vertices, faces))]), fingers=len(points), radius=0.0)
    contacts = tracker.tick(points, 10**6, 10**6)
    is_inside = oracle.winding_number(vertices, faces, points) > 0.5
    assert np.array_equal(contacts["signed_distance"] < 0.0, is_inside)
    assert (contacts["lower"] <= contacts["upper"]).all()


def test_folds_outlast_another_scene_and_a_file(tmp_path):
    vertices, faces, flipped = folded_cube()
    points = points_over(vertices, faces[flipped], np.random.default_rng(5), 100)
    is_inside = oracle.winding_number(vertices, faces, points) > 0.5
    scene = Scene(
        [part_of(shapes.cube(), pose=Pose(translation=(5, 0, 0))), part_of((vertices, faces), "folded")]
    )
    scene.add(part_of(shapes.sphere(), "more", Pose(translation=(9, 0, 0))))
    scene.save(tmp_path / "folded.prox")
    loaded = proximity.load(tmp_path / "folded.prox")

    assert folded_faces_of(scene.part("folded").solid).tolist() == beside(faces, flipped)
    assert np.array_equal(scene.signed_distance(points) < 0.0, is_inside)
    assert np.array_equal(loaded.signed_distance(points) < 0.0, is_inside)
