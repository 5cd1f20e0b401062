"""Scenes from files and trimesh objects: names, poses, units, and shared data."""

import re
import subprocess
import sys
from types import SimpleNamespace

import mesh_files
import numpy as np
import pytest
import shapes
import trimesh
from project import MESHES

import proximity
from proximity import Part, Scene, Solid, from_mesh, from_trimesh, to_trimesh
from proximity.errors import ArgumentError, MeshError, SceneError
from proximity.scene import solid_arrays


def pair_in_three_places(tmp_path):
    """Two boxes as one mesh, instanced twice and, mirrored, a third time."""
    pair = shapes.join(shapes.cube(0.1), shapes.moved(shapes.cube(0.1), (0.3, 0.0, 0.0)))
    nodes = [
        {"mesh": 0, "name": "left"},
        {"mesh": 0, "name": "right", "translation": [1.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.6, 0.8]},
        {"mesh": 0, "name": "other", "translation": [0.0, 1.0, 0.0], "scale": [-1.0, 1.0, 1.0]},
    ]
    path = tmp_path / "pair.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[pair]], nodes)))
    return proximity.load(path)


def test_instances_of_one_mesh_share_their_solids(tmp_path):
    scene = pair_in_three_places(tmp_path)

    assert [part.name for part in scene.parts] == [
        "left.1", "left.2", "right.1", "right.2", "other.1", "other.2",
    ]  # fmt: skip
    solids = [part.solid for part in scene.parts]
    assert solids[0] is solids[2] and solids[1] is solids[3]
    assert solids[4] is not solids[0]  # the mirrored one has other vertices


def test_instances_answer_as_parts_that_were_made_for_themselves(tmp_path):
    scene = pair_in_three_places(tmp_path)
    apart = [
        Part(
            part.name,
            proximity.Solid(part.solid.mesh.vertices, part.solid.mesh.faces),
            part.pose,
            part.source_faces,
        )
        for part in scene.parts
    ]
    points = np.random.default_rng(3).uniform(-0.5, 1.5, (2000, 3))

    found, expected = scene.closest(points), Scene(apart).closest(points)

    for field in ("signed_distance", "point", "gradient", "part"):  # ties may give another face
        assert np.allclose(getattr(found, field), getattr(expected, field), rtol=0.0, atol=1e-14)


def test_memory_of_a_shared_solid_is_counted_once(tmp_path):
    scene = pair_in_three_places(tmp_path)
    solids = {part.solid for part in scene.parts}
    meshes = sum(solid.mesh.vertices.nbytes + solid.mesh.faces.nbytes for solid in solids)
    assert len(solids) == 4
    assert scene.memory_bytes - scene.snapshot().memory_bytes == meshes


def test_file_that_places_a_part_too_far_off_is_refused(tmp_path):
    nodes = [{"mesh": 0, "name": "lid", "translation": [1e200, 0.0, 0.0]}]
    path = tmp_path / "far.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[shapes.cube()]], nodes)))

    with pytest.raises(proximity.MeshError) as refusal:
        proximity.load(path)

    assert str(refusal.value).startswith(
        f"{path}: part 'lid' would be moved by 1e+200 m, which is farther than"
    )


@pytest.mark.processes
def test_progress_of_loading_counts_meshes():
    counted = []

    proximity.load(MESHES / "assembly.step", progress=lambda done, total: counted.append((done, total)))

    total = len(counted)
    assert total > 1 and counted == [(done, total) for done in range(1, total + 1)]


def test_many_small_parts_are_each_assembled_once(tmp_path, monkeypatch):
    """Regression: each cube of a file was assembled twice."""
    made = []
    fill = solid_arrays.fill_part
    monkeypatch.setattr(solid_arrays, "fill_part", lambda *given: made.append(1) or fill(*given))
    cubes = [shapes.moved(shapes.cube(0.1 + 0.001 * k), (0.3 * k, 0.0, 0.0)) for k in range(20)]
    path = tmp_path / "cubes.glb"
    nodes = [{"mesh": row} for row in range(20)]
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[cube] for cube in cubes], nodes)))
    scene = proximity.load(path)

    assert made == [1] * 20
    for part in scene.parts:
        assert scene.signed_distance(part.pose.point(np.mean(part.solid.bounds, axis=0))) < 0.0


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
    # Instances of a mesh with the same deformation share a tree.
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


@pytest.mark.parametrize("given", [box(), trimesh.Scene(box())], ids=["mesh", "scene"])
@pytest.mark.parametrize("take", [Solid, Scene, lambda mesh: Scene([mesh]), Scene.from_mesh])
def test_who_hands_one_to_a_constructor_is_told_of_the_conversion(take, given):
    with pytest.raises(ArgumentError, match=r"^a trimesh\.\w+ was given: proximity\.from_trimesh makes"):
        take(given)


@pytest.mark.processes
def test_trimesh_is_not_imported_to_be_refused():
    code = (
        "import sys, proximity; proximity.Solid; proximity.from_trimesh; assert 'trimesh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


VERTICES, FACES = shapes.cube(2.0)
OPEN3D = SimpleNamespace(vertices=VERTICES, triangles=FACES)
PYVISTA = SimpleNamespace(points=VERTICES, faces=np.insert(FACES, 0, 3, axis=1).ravel())


@pytest.mark.parametrize(
    "mesh", [OPEN3D, PYVISTA, proximity.TriangleMesh(VERTICES, FACES), box(units="in", size=2.0)]
)
def test_meshes_of_other_libraries_are_taken_by_their_arrays(mesh):
    scene = from_mesh(mesh, units="inches", name="die")

    assert scene["die"].solid.has_inside
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), np.ptp(np.asarray(VERTICES), axis=0) * 0.0254)


FLATTENED = trimesh.Scene()
FLATTENED.add_geometry(box(), node_name="flat", transform=np.diag([1.0, 1.0, 0.0, 1.0]))
MIXED = trimesh.Scene([box(), box(units="inches")])


@pytest.mark.parametrize(
    ("take", "mesh", "units", "message"),
    [
        (from_trimesh, box(units=None), None,
         "the mesh names no unit, expected units to be given: one of m, dm, cm, mm, "),
        (from_trimesh, box(), "m", "units are given as m, mm, expected one unit for all meshes"),
        (from_trimesh, MIXED, None, "units are given as in, mm, expected one unit"),
        (from_trimesh, box(units="angstroms"), None, "unknown unit 'angstroms', expected one of m, dm"),
        (from_trimesh, np.eye(3), "m", "a ndarray was given, expected a trimesh.Trimesh or a trimesh.Scene"),
        (from_trimesh, FLATTENED, None, "part 'flat': it is placed by a matrix that flattens it"),
        (from_mesh, OPEN3D, None, "the mesh names no unit, expected units to be given"),
        (from_mesh, OPEN3D, "parsec", "unknown unit 'parsec', expected one of m, dm"),
        (from_mesh, SimpleNamespace(points=VERTICES, faces=[4, 0, 1, 2, 3]), "m",
         "the mesh has faces that are no triangles"),
        (from_mesh, SimpleNamespace(vertices=VERTICES, triangles=FACES[:0]), "m",
         "the SimpleNamespace holds no faces"),
        (from_mesh, VERTICES, "m", "a ndarray was given, expected a mesh of trimesh, PyVista or Open3D"),
    ],
)  # fmt: skip
def test_what_is_no_mesh_is_refused(take, mesh, units, message):
    with pytest.raises(MeshError, match=f"^{re.escape(message)}"):
        take(mesh, units=units)


def test_scene_becomes_one_of_trimesh_and_comes_back(tmp_path):
    scene = proximity.load(MESHES / "assembly.glb")
    scene.move("lid", proximity.Pose(None, [0.1, 0.0, 0.0]))

    there = to_trimesh(scene)
    back = from_mesh(there)

    assert set(there.graph.nodes_geometry) == {part.name for part in scene}
    np.testing.assert_allclose(back.bounds, scene.bounds)
    assert back["lid"].pose.translation.tolist() == [0.1, 0.0, 0.0]
    with pytest.raises(ArgumentError, match=r"^a Trimesh was given, expected a proximity\.Scene"):
        to_trimesh(box())


def test_parts_are_found_by_name_and_by_index():
    scene = proximity.load(MESHES / "assembly.glb")
    hit = scene.closest([0.03, 0.02, 0.1])

    assert scene[hit.part] is scene["lid"] is scene.part(3)
    assert [part.name for part in scene] == [part.name for part in scene.parts] and len(scene) == 4
    for missing in (4, "cover", None, proximity.NO_PART):
        with pytest.raises(SceneError, match=r"^no part is named"):
            scene[missing]


@pytest.mark.parametrize("units", ["inch", "Inches", "IN", "in"])
def test_units_may_be_spelt_as_people_do(units):
    assert proximity.load(MESHES / "box.stl", units=units).report.units == "in"


def test_unit_that_has_no_effect_is_a_warning_and_a_scale_is_the_way_out(tmp_path):
    path = MESHES / "assembly.glb"
    with pytest.warns(proximity.UnitsWarning, match="units='mm' has no effect, .* are in m; .*scale="):
        whole = proximity.load(path, units="mm")
    small = proximity.load(path, units="metres", scale=1e-3)
    assert np.allclose(small.bounds[1], 1e-3 * whole.bounds[1])

    whole.save(tmp_path / "whole.prox")
    with pytest.warns(proximity.UnitsWarning, match="in m;"):
        proximity.load(tmp_path / "whole.prox", units="in")
    with pytest.raises(proximity.ArgumentError, match="a compiled scene is not scaled"):
        proximity.load(tmp_path / "whole.prox", scale=2.0)
    with pytest.raises(proximity.ArgumentError, match="scale is 0"):
        proximity.load(path, scale=0.0)


def test_scene_file_is_no_file_of_parts(tmp_path):
    (tmp_path / "cell.toml").write_text("[service]")
    with pytest.raises(proximity.MeshFormatError, match=r"named like a scene file.*`proximity compile`"):
        proximity.load(tmp_path / "cell.toml")
