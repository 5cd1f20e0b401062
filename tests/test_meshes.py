"""The sample parts: the files are what the script makes, solids all, with the distances that it promises."""

import io
import sys

import make
import manifold3d
import numpy as np
import pytest
import trimesh

import oracle

SOLID_NAMES = ["box.stl", "sphere.stl", "torus.ply", "hollow_box.stl", "bracket.stl", "plate.stl", "gear.stl"]
ASSEMBLY_NAMES = ["assembly.glb", "assembly.step"]
PART_NAMES = {"base", "lid", "pin_left", "pin_right"}
SINGLE = 1e-5  # mm, more than single precision moves a corner of parts of this size


@pytest.fixture(scope="module")
def made():
    return make.small_files()


def parts_of(name, content):
    """Name, vertices in millimetres of the world, and faces of each part, as another library reads them."""
    scene = trimesh.load_scene(io.BytesIO(content), file_type=name.rpartition(".")[2], process=False)
    scale = 1000.0 if name in ASSEMBLY_NAMES else 1.0
    for node in sorted(scene.graph.nodes_geometry):
        pose, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        vertices = np.asarray(mesh.vertices) @ pose[:3, :3].T + pose[:3, 3]
        yield node, scale * vertices, np.asarray(mesh.faces)


def all_parts(name):
    return list(parts_of(name, (make.FOLDER / name).read_bytes()))


def volume(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return (a * np.cross(b, c)).sum() / 6.0


def signed_distance(parts, point):
    """Least signed distance to any of the parts, each judged by itself."""
    distances = []
    for _, vertices, faces in parts:
        inside = oracle.winding_number(vertices, faces, point) > 0.5
        distances.append(oracle.closest(vertices, faces, point).distance * (1 - 2 * inside))
    return min(distances)


@pytest.mark.parametrize("name", SOLID_NAMES + ASSEMBLY_NAMES)
def test_file_is_what_the_script_makes(name, made):
    """Byte for byte; or, with other versions of the libraries, the same shape cut into other triangles."""
    if (make.FOLDER / name).read_bytes() == made[name]:
        return
    for kept, new in zip(all_parts(name), parts_of(name, made[name]), strict=True):
        assert kept[0] == new[0]
        assert volume(*kept[1:]) == pytest.approx(volume(*new[1:]), rel=1e-6)
        for (_, vertices, _), (_, others, faces) in ((kept, new), (new, kept)):
            assert oracle.closest(others, faces, vertices[::23]).distance.max() < SINGLE


def test_every_file_is_listed_here_and_all_are_small(made):
    assert sorted(made) == sorted(SOLID_NAMES + ASSEMBLY_NAMES)
    assert sum(map(len, made.values())) < 1_500_000
    kept = {path.name for path in make.FOLDER.iterdir() if path.is_file() and path.suffix != ".py"}
    # points.csv and the scene files are written by hand.
    assert kept == {*made, "points.csv", "hand.csv", "demo.toml", "held.toml"}


@pytest.mark.parametrize("name", SOLID_NAMES + ASSEMBLY_NAMES)
def test_every_part_is_a_solid(name):
    for part, vertices, faces in all_parts(name):
        corners, ids = np.unique(vertices, axis=0, return_inverse=True)
        mesh = manifold3d.Mesh64(corners, ids.reshape(-1)[faces].astype(np.uint64))
        solid = manifold3d.Manifold(mesh)
        assert solid.status() == manifold3d.Error.NoError, part
        assert solid.volume() == pytest.approx(volume(vertices, faces), rel=1e-9) and solid.volume() > 0, part


@pytest.mark.parametrize("name", ASSEMBLY_NAMES)
def test_assemblies_name_their_parts(name):
    assert {part for part, _, _ in all_parts(name)} == PART_NAMES


def test_pins_of_the_assembly_stand_in_a_group():
    scene = trimesh.load_scene(make.FOLDER / "assembly.glb")
    assert scene.graph.transforms.parents["pin_left"] == scene.graph.transforms.parents["pin_right"] == "pins"


def test_parts_of_the_assembly_fill_their_holes_and_do_not_overlap():
    total = sum(volume(vertices, faces) for _, vertices, faces in all_parts("assembly.glb"))
    assert total == pytest.approx(60 * 40 * 16 - 28 * 20 * 9, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "point", "distance"),
    [
        ("box.stl", [20, 15, 10], -10.0),
        ("box.stl", [43, 34, 20], 5.0),
        ("sphere.stl", [0, 0, 0], -20.0),
        ("hollow_box.stl", [25, 17.5, 12.5], 7.5),
        ("hollow_box.stl", [50, 20, 15], -10.0),
        ("bracket.stl", [30, 10, 5], 1.0),
        ("bracket.stl", [30, 10, 2], -2.0),
        ("plate.stl", [5, 5, 2.5], 3 * np.cos(np.pi / 16)),
        ("plate.stl", [75, 75, 2.5], -2.5),
        ("gear.stl", [0, 0, 4], 5 * np.cos(np.pi / 64)),
        ("gear.stl", [0, 0, 16], np.hypot(5 * np.cos(np.pi / 64), 2)),
        ("assembly.glb", [30, 20, 7.5], 4.5),
        ("assembly.glb", [30, 20, 18], 2.0),
        ("assembly.step", [30, 25, 9], 3.0),
        ("assembly.step", [52, 20, 30], 2.0),
    ],
)
def test_known_distance(name, point, distance):
    allowed = 0.091 if name == "sphere.stl" else SINGLE
    assert signed_distance(all_parts(name), np.array(point)) == pytest.approx(distance, abs=allowed)


def test_sphere_is_within_its_sphere_as_little_as_promised():
    points = np.random.default_rng(1).uniform(-0.030, 0.030, (100, 3))
    excess = _signed(make.sphere(), points) - oracle.sphere(points, 0.020)
    assert excess.min() > -1e-15 and 0.080e-3 < excess.max() < 0.091e-3


def test_torus_is_as_near_to_its_torus_as_promised():
    points = np.random.default_rng(2).uniform(-0.050, 0.050, (100, 3)) * [1, 1, 0.5]
    error = abs(_signed(make.torus(), points) - oracle.torus(points, 0.030, 0.010))
    assert 0.086e-3 < error.max() < 0.172e-3


def test_torus_file_holds_every_digit():
    _, vertices, _ = all_parts("torus.ply")[0]
    np.testing.assert_allclose(oracle.torus(vertices, 30.0, 10.0), 0.0, atol=2e-14)


def _signed(mesh, points):
    inside = oracle.winding_number(*mesh, points) > 0.5
    return oracle.closest(*mesh, points).distance * (1 - 2 * inside)


def test_plate_reaches_the_size_that_benchmarks_name():
    vertices, faces = make.plate(hole_count=784, segments=96)
    assert len(faces) == 304_204
    assert volume(vertices, faces) == pytest.approx(
        (0.28**2 - 784 * _polygon_area(0.003, 96)) * 0.005, rel=1e-9
    )


def _polygon_area(radius, sides):
    return 0.5 * sides * radius**2 * np.sin(2 * np.pi / sides)


def test_large_files_go_where_they_are_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(make, "large_files", lambda: {"huge.stl": b"12345"})
    monkeypatch.setattr(sys, "argv", ["make.py", "--large", str(tmp_path / "new")])
    make.main()
    assert (tmp_path / "new" / "huge.stl").read_bytes() == b"12345"
    assert capsys.readouterr().out.split() == ["5", "bytes", "huge.stl"]
