"""The least thickness of whole parts: against formulas, and rays of brute force from random points."""

import numpy as np
import pytest
import shapes
from manifold3d import Manifold
from project import MESHES
from thick_parts import block, covered_pocket, mesh_of, prism, surface_points, tube

import oracle
import proximity
from proximity import ArgumentError, NotWatertightError, Part, Pose, Scene, Solid

EXACT = 1e-10


def scene_of(mesh, seed=None, scale=1.0):
    """A scene of one part; with a seed it is turned and moved in the scene."""
    pose = Pose() if seed is None else Pose(shapes.rotation(seed), [3.0, -2.0, 0.5])
    return Scene([Part("part", Solid(mesh[0] * scale, mesh[1]), pose, np.arange(len(mesh[1])))])


def walls_of(mesh, *, seed=None, scale=1.0, **options):
    return scene_of(mesh, seed, scale).parts[0].thin_places(**options)


def frustum(bottom, top, height):
    """A truncated pyramid, as a block with a draft."""
    vertices, faces = shapes.box((-0.5, -0.5, 0.0), (0.5, 0.5, height))
    vertices[:, :2] *= np.where(vertices[:, 2:] > 0.5 * height, top, bottom)
    return vertices, faces


SOLIDS = {
    "cube": (shapes.cube, 1.0),
    "plate": (lambda: shapes.box((0, 0, 0), (10, 20, 1.5)), 1.5),
    "hollow cube": (shapes.hollow_cube, 1.0),
    "tube": (lambda: tube(8.0, 10.0, 40.0, 64), 2.0 * np.cos(np.pi / 64)),
    "wedge of 30 degrees": (lambda: prism(np.pi / 6), 0.0),
    "wedge of 1 degree": (lambda: prism(np.pi / 180), 0.0),
    "wedge of 60 degrees": (lambda: prism(np.pi / 3), 4.0),  # its width
    "draft of 3 degrees": (lambda: frustum(10.0, 9.5, 5.0), 5.0),
    "draft with a thin top": (lambda: frustum(10.0, 9.9, 0.25), 0.25),
    "pocket": (lambda: mesh_of(block((0, 0, 0), (50, 50, 5)) - block((9, 9, 0.2), (9.3, 9.3, 9))), 0.2),
    "slot": (lambda: mesh_of(block((0, 0, 0), (9, 9, 9)) - block((4, -1, 2), (4.1, 10, 10))), 2.0),
    "fins": (
        lambda: mesh_of(
            block((0, 0, 0), (9, 5, 2)) + block((1, 0, 1), (1.25, 5, 6)) + block((4, 0, 1), (6, 5, 6))
        ),
        0.25,
    ),
}


@pytest.mark.parametrize("seed", [None, 4])
@pytest.mark.parametrize("name", SOLIDS)
def test_least_thickness_is_that_of_the_formula(name, seed):
    make, expected = SOLIDS[name]
    mesh = make()
    size = np.ptp(mesh[0], axis=0).max()
    found = walls_of(mesh, seed=seed)

    assert found.lower <= expected + EXACT and found.upper >= expected - EXACT
    assert found.upper - found.lower <= 1e-5 * size
    if expected:
        length = np.linalg.norm(found.point - found.opposite)
        assert length == pytest.approx(found.upper, abs=EXACT * size)
    assert found.thickness[0] <= found.upper + EXACT and (np.diff(found.thickness) >= -1e-9).all()


def test_surfaces_that_are_only_in_line_are_no_wall():
    """The bottom of one block and the top of its neighbor are in line along an edge only."""
    solid = block((0, 0, 0), (1, 1, 2)) + block((1, 0, -5), (2, 1, 0.5))
    found = walls_of(mesh_of(solid), seed=8)

    assert found.lower == pytest.approx(1.0, abs=EXACT) and found.upper == pytest.approx(1.0, abs=EXACT)


def random_solids():
    rng = np.random.default_rng(3)
    shell = shapes.join(
        shapes.sphere(10, 2), shapes.inside_out(shapes.moved(shapes.sphere(8, 2), (1, 0.5, 0)))
    )
    boxes = Manifold()
    for _ in range(12):
        at, size = rng.uniform(-1, 1, 3), rng.uniform(0.2, 2, 3)
        boxes += Manifold.cube(size).rotate(rng.uniform(0, 90, 3)).translate(at)
    for _ in range(12):
        at, size = rng.uniform(-1, 1, 3), rng.uniform(0.1, 0.6, 3)
        boxes -= Manifold.cube(size).rotate(rng.uniform(0, 90, 3)).translate(at)
    plate, gear = (proximity.load(MESHES / f"{name}.stl").parts[0].solid.mesh for name in ("plate", "gear"))
    return {
        "shell": shell,
        "torus": shapes.torus(2.0, 0.5, 24, 12),
        "boxes": mesh_of(boxes),
        "plate": (plate.vertices, plate.faces),
        "gear": (gear.vertices, gear.faces),
        "cylinder": mesh_of(Manifold.cylinder(0.3, 2.0, 1.8, 200)),
    }


@pytest.mark.parametrize("name", random_solids())
def test_no_ray_is_shorter_than_the_lower_bound(name):
    mesh = random_solids()[name]
    scene = scene_of(mesh)
    found = scene.parts[0].thin_places(below=1.0, workers=2)
    mesh = scene.parts[0].solid.mesh.vertices, scene.parts[0].solid.mesh.faces
    size, (points, faces) = np.ptp(mesh[0], axis=0).max(), surface_points(mesh, 800, 5)
    # Half of the rays begin near the thinnest positions.
    rng = np.random.default_rng(6)
    near = rng.integers(len(found.points), size=400) if len(found.points) else []
    points[: len(near)] = found.points[near] + rng.normal(scale=0.01 * size, size=(len(near), 3))
    hit = scene.closest(points)
    points, faces = hit.point, hit.face_id
    corners = mesh[0][mesh[1]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    start = 1e-9 * size
    rays = oracle.ray(*mesh, points - start * normals[faces], -normals[faces])
    cosine = -(normals[faces] * normals[rays.face_id]).sum(axis=1)
    length = (rays.distance + start)[(cosine > np.cos(np.pi / 4)) & np.isfinite(rays.distance)]

    assert len(length) > 100
    assert length.min() >= found.lower - 2e-9 * size
    end = oracle.ray(*mesh, found.point + 1e-6 * (found.opposite - found.point), found.opposite - found.point)
    assert end.distance == pytest.approx(found.upper, rel=1e-4, abs=1e-8 * size)
    assert found.upper - found.lower < 1e-4 * size


def test_limit_is_decided():
    plate = shapes.box((0, 0, 0), (10, 10, 1.5))
    thin, exact, thick = (walls_of(plate, below=below) for below in (1.6, 1.5, 1.4))

    assert (thin.is_thin, exact.is_thin, thick.is_thin) == (True, False, False)
    assert thin.share == pytest.approx(200.0 / 260.0, rel=0.01)
    assert exact.share == thick.share == 0.0
    assert len(thin.thickness) == 10 and len(exact.thickness) == 0
    without = walls_of(plate)
    assert without.is_thin is None and np.isnan(without.share)
    cube = walls_of(shapes.cube(), wall_angle=0.0, below=0.5)
    assert (cube.is_thin, cube.share) == (False, 0.0)


def test_limit_between_the_bounds_is_undecided():
    """Rays between the pocket and the bottom leave the material into the cavity, at a steep face."""
    low, middle, high = (walls_of(covered_pocket(), below=below) for below in (2.9, 3.5, 4.1))

    assert (middle.lower, middle.upper) == (pytest.approx(3.0), pytest.approx(4.0))
    assert (low.is_thin, middle.is_thin, high.is_thin) == (False, None, True)


def test_wedge_is_a_wall_only_below_the_angle():
    narrow, wide = (
        walls_of(prism(np.radians(30)), wall_angle=np.radians(each), below=1.0) for each in (31, 29)
    )

    assert (narrow.is_thin, narrow.lower) == (True, 0.0)
    assert (wide.is_thin, wide.lower) == (False, pytest.approx(4.0))


def test_smallest_limit_does_not_accept_a_sharp_edge():
    assert walls_of(prism(np.radians(30)), below=1e-6).is_thin is True
    assert walls_of(prism(np.radians(30)), below=1e-9).is_thin is None


def test_part_without_walls_has_no_least_thickness():
    found = walls_of(shapes.tetrahedron(), below=5.0, wall_angle=0.1)

    assert found.lower == found.upper == np.inf
    assert (found.is_thin, found.share, len(found.thickness)) == (False, 0.0, 0)
    assert np.isinf(found.sample_thickness).all()


def test_samples_cover_the_surface_in_the_scene():
    mesh = shapes.box((0, 0, 0), (1, 2, 3))
    found = walls_of(mesh, seed=2, resolution=0.25)
    sides = np.linalg.norm(found.samples - np.roll(found.samples, 1, axis=1), axis=2)

    assert sides.max() <= 0.25 + 1e-12 and found.resolution == 0.25
    normals = np.cross(found.samples[:, 1] - found.samples[:, 0], found.samples[:, 2] - found.samples[:, 0])
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(22.0)
    scene = scene_of(mesh, seed=2)
    np.testing.assert_allclose(scene.distance(found.samples.reshape(-1, 3)), 0.0, atol=1e-12)
    np.testing.assert_allclose(scene.distance(found.points), 0.0, atol=1e-12)
    assert set(np.round(found.sample_thickness, 9)) == {1.0, 2.0, 3.0}
    apart = np.linalg.norm(found.points[:, None] - found.points, axis=2) + np.eye(len(found.points))
    assert apart.min() >= 0.15


def test_small_and_large_parts_have_the_same_walls():
    for scale in (1e-6, 1e3):
        found = walls_of(tube(8.0, 10.0, 40.0, 24), scale=scale)
        assert found.lower / scale == pytest.approx(2.0 * np.cos(np.pi / 24), rel=1e-9)
        assert found.upper / scale == pytest.approx(2.0 * np.cos(np.pi / 24), rel=1e-9)


def test_faces_without_area_and_needles_do_not_matter():
    vertices, faces = shapes.cube()
    needle = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.5, 0.0, 0.5]])
    found = walls_of(shapes.join((vertices, faces), (needle, np.array([[0, 1, 2]]))))

    assert found.lower == pytest.approx(1.0, abs=EXACT) and found.upper == pytest.approx(1.0, abs=EXACT)


def test_errors_name_their_argument():
    with pytest.raises(NotWatertightError, match="has no thickness"):
        walls_of(shapes.open_box())
    for options, words in (
        ({"below": 0.0}, "below is 0.0"),
        ({"resolution": -1.0}, "resolution is -1.0"),
        ({"resolution": 1e-5}, "more than 1000000 samples"),
        ({"wall_angle": 2.0}, "wall_angle is 2.0"),
        ({"workers": 0}, "workers"),
    ):
        with pytest.raises(ArgumentError, match=words):
            walls_of(shapes.cube(), **options)


def test_record_is_a_table_in_a_notebook():
    assert "<td>True</td>" in walls_of(shapes.cube(), below=2.0)._repr_html_()
    assert "<td>None</td>" in walls_of(shapes.cube())._repr_html_()
