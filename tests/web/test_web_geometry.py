"""The geometry of a scene as GLB, read back by trimesh."""

import io

import numpy as np
import pytest
import shapes
import trimesh
from project import MESHES

import proximity
from proximity.pose import Pose
from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.web.display_mesh import coarser, display_mesh
from proximity.web.geometry import scene_glb


def read(data):
    """Return a GLB's vertices and faces in the scene's frame by part name, and its lines."""
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    found = {}
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        found[node] = (
            trimesh.transform_points(scene.geometry[geometry].vertices, matrix),
            scene.geometry[geometry],
        )
    return found


def test_faces_of_every_part_are_where_the_scene_has_them():
    scene = proximity.load(MESHES / "assembly.step")
    found = read(scene_glb(scene))
    for part in scene.parts:
        vertices, geometry = found[f"{part.name} faces"]
        drawn = vertices[geometry.faces]
        expected = part.pose.point(part.solid.mesh.vertices)[part.solid.mesh.faces]
        np.testing.assert_allclose(drawn, expected, atol=1e-8)


def test_edges_of_a_cube_are_its_twelve_and_its_normals_are_flat():
    drawn = display_mesh(*shapes.cube(2.0))

    assert len(drawn.edges) == 12
    assert len(drawn.positions) == 24
    assert sorted(np.abs(drawn.normals).sum(axis=1)) == pytest.approx(np.ones(24))
    lengths = np.linalg.norm(np.diff(drawn.positions[drawn.edges], axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(lengths, lengths[0])


def test_a_sphere_is_smooth_and_has_no_edges():
    solid = proximity.load(MESHES / "sphere.stl").parts[0].solid

    drawn = display_mesh(solid.mesh.vertices, solid.mesh.faces)

    assert len(drawn.edges) == 0
    assert len(drawn.positions) == solid.mesh.vertex_count
    outward = drawn.positions / np.linalg.norm(drawn.positions, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", outward, drawn.normals).min() > 0.999


def test_borders_of_an_open_surface_are_edges():
    vertices, faces = shapes.cube(1.0)
    drawn = display_mesh(vertices, faces[2:])
    assert len(drawn.edges) == 12


def test_a_face_without_area_does_not_harm():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], float)
    drawn = display_mesh(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
    assert np.isfinite(drawn.normals).all()


def test_a_part_far_from_the_origin_keeps_its_shape():
    far = np.array([1e4, -2e4, 3e4])
    vertices, faces = shapes.cube(0.001, tuple(far))
    part = Part("small", Solid(vertices, faces), Pose(), np.arange(len(faces), dtype=np.int32))

    drawn = display_mesh(part.solid.mesh.vertices, part.solid.mesh.faces)

    restored = drawn.positions[drawn.faces].astype(float) + drawn.centre
    np.testing.assert_allclose(restored, vertices[faces], atol=1e-10)


@pytest.mark.parametrize("is_closed", [True, False])
def test_large_parts_are_drawn_coarser_and_look_alike(is_closed):
    ball = trimesh.creation.icosphere(5)
    faces = ball.faces if is_closed else ball.faces[:-1]

    vertices, fewer = coarser(np.array(ball.vertices), np.array(faces, np.int64), 4000)

    assert 500 < len(fewer) <= 4000
    radii = np.linalg.norm(vertices[np.unique(fewer)], axis=1)
    assert radii.min() > 0.98
    assert radii.max() < 1.001


def test_a_coarser_scene_says_so():
    scene = proximity.load(MESHES / "sphere.stl")

    data = trimesh.load(io.BytesIO(scene_glb(scene, max_faces=400)), file_type="glb")

    assert len(next(iter(data.geometry.values())).faces) <= 400
    text = scene_glb(scene, max_faces=400)
    assert b'"face_count":1280' in text


def test_two_parts_of_one_name_of_node_do_not_mix():
    scene = Scene([Solid(*shapes.cube(1.0), name="a"), Solid(*shapes.cube(1.0, (3, 0, 0)), name="b")])
    found = read(scene_glb(scene))
    assert {"a faces", "a edges", "b faces", "b edges"} <= set(found)
