"""Scenes of meshes in memory through the C library: bit-identical to Python."""

import numpy as np
import pytest
import shapes
from given_meshes import CORNER, NAMED, ONE, TOUCHING, torn
from project import MESHES, SHARED_DATA

from benchmarks.digest.library import LibraryScene
from proximity import ArgumentError, MeshError, Scene, load
from proximity.core import library_in_c
from proximity.native import IS_AHEAD

pytestmark = pytest.mark.skipif(
    not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
    reason="the library is compiled with the kernels",
)


def answers(asked, lower, upper):
    """Return the answers to queries in and near a box, as bytes."""
    rng = np.random.default_rng(5)
    size = (upper - lower).max()
    points = rng.uniform(lower - 0.2 * size, upper + 0.2 * size, (150, 3))
    return [
        np.array(asked.bounds).tobytes(),
        asked.closest(points)._table.tobytes(),
        asked.signed_distance(points).tobytes(),
        asked.cast(points, points[::-1] - points + 0.01 * size)._table.tobytes(),
    ]


def assert_equal_to_python(vertices, faces):
    python, library = Scene.from_mesh(vertices, faces), LibraryScene.of_mesh(vertices, faces)
    assert library.names == [part.name for part in python.parts]
    assert library.sign_reasons == [part.solid.sign_reason for part in python.parts]
    assert answers(library, *python.bounds) == answers(python, *python.bounds)


@pytest.mark.parametrize("name", NAMED)
def test_scene_of_a_mesh_is_that_of_python(name):
    assert_equal_to_python(*NAMED[name])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["cube", "hollow", "touching", "voxels", "inside out"])
def test_scene_of_a_torn_mesh_is_that_of_python(name, seed):
    assert_equal_to_python(*torn(name, seed))


@pytest.mark.parametrize(
    "path", sorted(MESHES.glob("*.stl")) + sorted(MESHES.glob("*.ply")), ids=lambda path: path.name
)
def test_scene_of_a_file_is_that_of_python(path):
    meshes = [part.solid.mesh for part in load(path).parts]
    assert_equal_to_python(*shapes.soup(*shapes.join(*((mesh.vertices, mesh.faces) for mesh in meshes))))


@pytest.mark.slow
def test_scenes_of_real_parts_are_those_of_python():
    paths = sorted(SHARED_DATA.rglob("*.stl"))[:60]
    if not paths:
        pytest.skip("the files are not here")
    for path in paths:
        try:
            parts = load(path, units="mm").parts
        except MeshError:
            continue
        assert_equal_to_python(
            *shapes.join(*((part.solid.mesh.vertices, part.solid.mesh.faces) for part in parts))
        )


@pytest.mark.parametrize(
    ("vertices", "faces", "sentence"),
    [
        (CORNER, ONE[:0], "the mesh has no faces, expected at least one"),
        (CORNER, ONE + 1, "face 0 refers to vertex 3, but the mesh has 3 vertices"),
        (CORNER, -ONE, "face 0 refers to vertex -1, but the mesh has 3 vertices"),
        (CORNER * np.nan, ONE, "vertex 0 of face 0 is not finite: (nan"),
        (CORNER - np.inf, ONE, "vertex 0 of face 0 is not finite: (-inf"),
        (0 * CORNER, ONE, "none of the 1 faces has an area, expected at least one that has"),
        (CORNER[:, :1] * [1, 2, 3], ONE, "none of the 1 faces has an area"),
        (CORNER * 1e160, ONE, "too far from the origin or too small"),
        (CORNER * 1e-160, ONE, "too far from the origin or too small"),
        (shapes.join((CORNER * 1e149, ONE), (CORNER * 1e-140, ONE))[0], np.arange(6).reshape(2, 3), None),
    ],
)
def test_arrays_that_are_no_mesh_are_refused_as_in_python(vertices, faces, sentence):
    if sentence is None:
        assert_equal_to_python(vertices, faces)
        return
    with pytest.raises(MeshError):
        Scene.from_mesh(vertices, faces)
    with pytest.raises(MeshError) as refused:
        LibraryScene.of_mesh(vertices, faces)
    assert sentence in str(refused.value)


def test_vertices_that_no_face_uses_may_hold_anything():
    vertices = np.concatenate([CORNER, [[np.nan, np.inf, 0.0]]])
    assert_equal_to_python(vertices, ONE)


def test_mesh_needs_a_name():
    with pytest.raises(ArgumentError, match="there is no name"):
        scene = LibraryScene()
        scene.call("from_mesh", None, None, 0, None, 0, None)


def test_meshes_are_added_at_poses_and_removed():
    library = LibraryScene()
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = shapes.rotation(4), (0.5, 0, 0)
    library.add(LibraryScene.of_mesh(*shapes.cube(), name="cube"))
    library.add(LibraryScene.of_mesh(*TOUCHING, name="pair"), turned)

    assert library.names == ["cube", "pair.1", "pair.2"]
    library.remove("pair.1")
    assert library.names == ["cube", "pair.2"]
    assert library.pose("pair.2").tolist() == turned.tolist()
