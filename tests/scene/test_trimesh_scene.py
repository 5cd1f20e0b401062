"""Objects of trimesh as scenes: names, places, units, and what says how where they are not taken."""

import re
import subprocess
import sys

import numpy as np
import pytest
import shapes
import trimesh

from proximity import Scene, Solid, from_trimesh
from proximity.errors import ArgumentError, MeshError


def box(*, units="mm", size=20.0):
    mesh = trimesh.creation.box((size, size, size))
    mesh.units = units
    return mesh


def turned_and_shifted(seed, shift):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = shapes.rotation(seed), shift
    return matrix


def test_mesh_is_a_scene_in_metres():
    scene = from_trimesh(box(), name="die")

    assert [part.name for part in scene.parts] == ["die"]
    np.testing.assert_allclose(scene.bounds, [[-0.01] * 3, [0.01] * 3])
    assert scene.signed_distance((0.0, 0.0, 0.005)) == pytest.approx(-0.005)
    assert repr(scene.report) == "LoadReport('', trimesh.Trimesh, mm declared, 0 notes)"


def test_kinds_of_meshes_are_meshes():
    class Mine(trimesh.Trimesh):
        pass

    primitive = trimesh.primitives.Sphere(radius=2.0)
    assert from_trimesh(primitive, units="cm").bounds[1][0] == pytest.approx(0.02)
    mine = Mine(box().vertices, box().faces)
    assert from_trimesh(mine, units="m").bounds[1][0] == 10.0


def test_scene_has_its_nodes_as_parts_where_the_graph_puts_them():
    scene = trimesh.Scene()
    mesh = trimesh.creation.annulus(2.0, 5.0, 3.0)
    mesh.units = "in"
    matrices = {
        "still": np.eye(4),
        "turned": turned_and_shifted(1, (10.0, 2.0, 3.0)),
        "grown": turned_and_shifted(2, (0.0, 20.0, 0.0)) @ np.diag([2.0, 2.0, 2.0, 1.0]),
        "mirrored": turned_and_shifted(3, (0.0, 0.0, 30.0)) @ np.diag([-1.0, 1.0, 1.0, 1.0]),
        "stretched": turned_and_shifted(4, (-30.0, 0.0, 0.0)) @ np.diag([1.0, 3.0, 0.5, 1.0]),
    }
    for name, matrix in matrices.items():
        scene.add_geometry(mesh, node_name=name, geom_name="ring", transform=matrix)
    scene.add_geometry(mesh, node_name="child", parent_node_name="grown", transform=matrices["turned"])
    matrices["child"] = matrices["grown"] @ matrices["turned"]

    parts = {part.name: part for part in from_trimesh(scene).parts}

    assert set(parts) == set(matrices)
    centres = mesh.triangles_center
    for name, matrix in matrices.items():
        part = parts[name]
        expected = (centres @ matrix[:3, :3].T + matrix[:3, 3]) * 0.0254
        own = part.solid.mesh
        found = part.pose.point(own.vertices[own.faces].mean(axis=1))
        np.testing.assert_allclose(found, expected[part.source_faces], atol=1e-12, err_msg=name)
        assert part.solid.has_inside
        assert "turned" not in part.solid.sign_reason, name
    # The same mesh, deformed alike, has one tree.
    assert parts["still"].solid.mesh.vertices is parts["turned"].solid.mesh.vertices


def test_what_has_no_faces_is_left_out_and_said():
    scene = trimesh.Scene([box(), trimesh.PointCloud(np.eye(3))])

    loaded = from_trimesh(scene)

    assert len(loaded.parts) == 1
    assert loaded.report.notes == ("1 of its geometries have no faces and were ignored",)
    with pytest.raises(MeshError, match=r"^the trimesh.Scene holds no faces$"):
        from_trimesh(trimesh.Scene(trimesh.PointCloud(np.eye(3))), units="m")


@pytest.mark.parametrize(
    "declared, given, metres",
    [("mm", None, 1e-3), ("millimeters", "mm", 1e-3), (None, "in", 0.0254), ("inches", None, 0.0254)],
)
def test_unit_is_that_of_the_mesh_or_of_the_caller(declared, given, metres):
    assert from_trimesh(box(units=declared, size=2.0), units=given).bounds[1][0] == pytest.approx(metres)


@pytest.mark.parametrize(
    "mesh, units, message",
    [
        (box(units=None), None, "the mesh names no unit, expected units to be given: one of m, dm, cm, mm, "),
        (box(), "m", "units are given as m, mm, expected one unit for all meshes"),
        (trimesh.Scene([box(), box(units="inches")]), None, "units are given as in, mm, expected one unit"),
        (box(units="angstroms"), None, "there is no unit 'angstroms', expected one of m, dm"),
        (np.eye(3), "m", "a ndarray was given, expected a trimesh.Trimesh or a trimesh.Scene"),
    ],
)
def test_what_cannot_be_taken_is_refused(mesh, units, message):
    with pytest.raises(MeshError, match=f"^{re.escape(message)}"):
        from_trimesh(mesh, units=units)


def test_matrix_that_flattens_is_refused_with_the_name():
    scene = trimesh.Scene()
    scene.add_geometry(box(), node_name="flat", transform=np.diag([1.0, 1.0, 0.0, 1.0]))

    with pytest.raises(MeshError, match=r"^part 'flat': it is placed by a matrix that flattens it"):
        from_trimesh(scene)


@pytest.mark.parametrize("given", [box(), trimesh.Scene(box())], ids=["mesh", "scene"])
@pytest.mark.parametrize("take", [Solid, Scene, lambda mesh: Scene([mesh]), Scene.from_mesh])
def test_who_hands_one_to_a_constructor_is_told_of_the_conversion(take, given):
    with pytest.raises(ArgumentError, match=r"^a trimesh\.\w+ was given: proximity\.from_trimesh makes"):
        take(given)


def test_trimesh_is_not_imported_to_be_refused():
    code = (
        "import sys, proximity; proximity.Solid; proximity.from_trimesh; assert 'trimesh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
