"""The thickness at points: against formulas, and against brute force over all triangles."""

import numpy as np
import pytest
import shapes
from project import MESHES
from thick_parts import prism, surface_points, tube

import oracle
import proximity
from proximity import ArgumentError, NotWatertightError, Part, Pose, Scene, SceneError, Solid
from proximity.scene.walls import thickness

EXACT = 1e-12
TOLERANCE = thickness.TOLERANCE


def scene_of(mesh, *, seed=None, scale=1.0, offset=(0.0, 0.0, 0.0)):
    """A scene of one part; with a seed it is turned and moved in the scene."""
    solid = Solid(mesh[0] * scale + np.asarray(offset), mesh[1])
    pose = Pose() if seed is None else Pose(shapes.rotation(seed), [3.0, -2.0, 0.5])
    return Scene([Part("part", solid, pose, np.arange(solid.mesh.face_count, dtype=np.int32))])


def in_scene(scene, points):
    return scene.parts[0].pose.point(np.asarray(points, float))


def assert_bounds(found, expected, *, size=1.0):
    """Both bounds contain the expected diameter, and meet the tolerance."""
    assert (found.lower <= expected + EXACT * size).all()
    assert (found.upper >= expected - EXACT * size).all()
    assert (found.upper - found.lower <= TOLERANCE * found.upper + 1e-11 * size).all()


@pytest.mark.parametrize("seed", [None, 5])
@pytest.mark.parametrize("sides", [(10.0, 8.0, 1.0), (1.0, 1.0, 1.0), (0.001, 0.3, 2.0)])
def test_plates_have_their_thickness(sides, seed):
    mesh = shapes.box((0, 0, 0), sides)
    scene, sides = scene_of(mesh, seed=seed), np.array(sides)
    points, faces = surface_points(mesh, 2500, 7)
    axis = np.array([2, 2, 2, 2, 1, 1, 1, 1, 0, 0, 0, 0])[faces]
    walls = np.minimum(points, sides - points)
    walls[np.arange(len(points)), axis] = np.inf
    # The ball meets the other side, or the nearest of the four sides around.
    expected = np.minimum(sides[axis], 2.0 * walls.min(axis=1))

    found = scene.thickness(in_scene(scene, points))
    np.testing.assert_allclose(found.ray, sides[axis], atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(found.opposite - found.point, axis=1), found.ray, atol=1e-11)
    assert_bounds(found, expected, size=10.0)


@pytest.mark.parametrize("degrees", [1.0, 20.0, 45.0, 89.0, 120.0])
def test_wedges_have_the_thickness_of_formulas(degrees):
    angle = np.radians(degrees)
    scene = scene_of(prism(angle), seed=3)
    distance = np.geomspace(1e-6, 0.4, 50)
    points = np.stack([distance, np.full(50, 2.0), np.zeros(50)], axis=1)

    found = scene.thickness(in_scene(scene, points))
    if degrees < 89.5:
        ray = distance * np.tan(angle)
        np.testing.assert_allclose(found.ray[ray < 0.9], ray[ray < 0.9], rtol=1e-6, atol=1e-11)
    assert_bounds(found, 2.0 * distance * np.tan(angle / 2), size=10.0)


def test_tube_has_the_thickness_between_its_facets():
    scene, half = scene_of(tube(8.0, 10.0, 40.0, 64)), np.pi / 64
    angle, z = 2 * half * (np.arange(64) + 0.5), 20.0
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], axis=1)

    found = scene.thickness(10.0 * np.cos(half) * outward + [0, 0, z])
    np.testing.assert_allclose(found.ray, 2.0 * np.cos(half), rtol=1e-12)
    assert_bounds(found, 2.0 * np.cos(half), size=40.0)


def brute_force_solids():
    rng = np.random.default_rng(2)
    cells = rng.random((4, 4, 4)) < 0.6
    gear = proximity.load(MESHES / "plate.stl").parts[0].solid.mesh
    return {
        "shell": shapes.join(shapes.sphere(10, 2), shapes.inside_out(shapes.sphere(8, 2))),
        "tube": tube(3.0, 3.2, 2.0, 40),
        "torus": shapes.torus(2.0, 0.5, 24, 12),
        "hollow cube": shapes.hollow_cube(),
        "voxels": shapes.voxels(cells),
        "octahedron": shapes.octahedron(),
        "plate": (gear.vertices, gear.faces),
    }


@pytest.mark.parametrize("name", brute_force_solids())
def test_balls_and_rays_agree_with_brute_force(name):
    mesh = brute_force_solids()[name]
    scene = scene_of(mesh)
    if not scene.parts[0].solid.has_inside:
        pytest.skip("no inside")
    mesh = scene.parts[0].solid.mesh.vertices, scene.parts[0].solid.mesh.faces
    points, _ = surface_points(mesh, 400, 11)
    size = np.ptp(mesh[0], axis=0).max()

    found = scene.thickness(points)
    np.testing.assert_allclose(found.point, points, atol=1e-14 * size)
    radius = 0.5 * found.lower
    assert (oracle.closest(*mesh, found.center).distance >= radius - EXACT * size).all()
    # A ball that is larger by a billionth contains a point of the surface.
    larger = 0.5 * found.upper * (1.0 + 1e-9) + 1e-9 * size
    centers = found.point - larger[:, None] * found.normal
    assert (oracle.closest(*mesh, centers).distance < larger).all()
    assert (found.upper - found.lower <= TOLERANCE * found.upper + 1e-10 * size).all()
    start = 1e-9 * size
    rays = oracle.ray(*mesh, found.point - start * found.normal, -found.normal)
    is_clear = found.ray > 2e-9 * size
    np.testing.assert_allclose(found.ray[is_clear], rays.distance[is_clear] + start, rtol=1e-9)
    assert is_clear.mean() > 0.99


def test_result_does_not_depend_on_the_pose_or_the_unit():
    mesh = shapes.torus(2.0, 0.5, 24, 12)
    points, _ = surface_points(mesh, 300, 3)
    expected = scene_of(mesh).thickness(points)

    moved = scene_of(mesh, seed=9)
    found = moved.thickness(in_scene(moved, points))
    np.testing.assert_allclose(found.ray, expected.ray, rtol=1e-9)
    np.testing.assert_allclose(found.upper, expected.upper, rtol=1e-4, atol=1e-9)
    small = scene_of(mesh, scale=1e-3).thickness(1e-3 * points)
    np.testing.assert_allclose(small.ray, 1e-3 * expected.ray, rtol=1e-9)


def test_points_on_edges_and_corners_have_an_answer():
    scene = scene_of(shapes.cube())
    points = np.array([[0, 0, 0], [0.5, 0, 0], [1, 1, 1], [1, 0.5, 1], [0.5, 0.5, 0], [0.25, 0.25, 1.0]])

    found = scene.thickness(points)
    np.testing.assert_allclose(found.ray, 1.0, rtol=1e-8)
    assert (found.lower[:4] == 0.0).all() and (found.upper[:4] < 1e-11).all()
    np.testing.assert_allclose(found.upper[4:], [1.0, 0.5])


def test_ball_does_not_shrink_at_a_concave_edge():
    cells = np.ones((2, 1, 2), bool)
    cells[1, 0, 1] = False  # an L
    found = scene_of(shapes.voxels(cells)).thickness([[1.0 + 1e-9, 0.5, 1.0], [1.5, 0.5, 1.0]])

    np.testing.assert_allclose(found.ray, 1.0)
    np.testing.assert_allclose(found.upper, 1.0, rtol=1e-6)


def test_shapes_follow_those_of_the_points():
    scene = scene_of(shapes.cube())
    one = scene.thickness([0.5, 0.5, 2.0])
    assert (one.ray, one.face_id.dtype) == (pytest.approx(1.0), np.int32)
    np.testing.assert_allclose(one.point, [0.5, 0.5, 1.0])
    grid = scene.thickness(np.full((2, 3, 3), 0.4))
    assert grid.lower.shape == (2, 3) and grid.opposite.shape == (2, 3, 3)
    assert not grid.ray.flags.writeable
    assert scene.thickness(np.empty((0, 3))).ray.shape == (0,)
    assert "<td>0, 1</td>" in grid._repr_html_() and "nan" not in one._repr_html_()


def test_rows_that_are_not_finite_have_no_answer():
    found = scene_of(shapes.cube()).thickness([[0.5, 0.5, 1.0], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])

    assert found.face_id.tolist()[1:] == [-1, -1]
    for each in found[:-1]:
        assert np.isnan(each[1:]).all() and np.isfinite(each[0]).all()


def test_cavity_ends_the_material():
    found = scene_of(shapes.hollow_cube(3.0, 1.0)).thickness(
        [[0.0, 0.0, 1.5], [0.0, 0.0, 0.5], [1.0, 1.0, 1.5]]
    )

    np.testing.assert_allclose(found.ray, [1.0, 1.0, 3.0])


def test_ray_leaves_all_bodies_that_overlap():
    mesh = shapes.join(shapes.box((0, 0, 0), (1, 1, 1)), shapes.box((0.25, 0.25, 0.5), (0.75, 0.75, 2)))
    scene = scene_of(mesh)
    if not scene.parts[0].solid.has_inside:
        pytest.skip("no inside")

    np.testing.assert_allclose(scene.thickness([[0.5, 0.5, 2.0], [0.1, 0.1, 1.0]]).ray, [2.0, 1.0])


def test_faces_without_area_do_not_matter():
    vertices, faces = shapes.cube()
    sliver = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.5, 0.0, 1.0]])
    mesh = shapes.join((vertices, faces), (sliver, np.array([[0, 1, 2]])))
    found = scene_of(mesh).thickness([[0.5, 0.0, 1.0], [0.5, 0.5, 1.0]])

    assert found.ray[1] == pytest.approx(1.0)
    assert np.isnan(found.ray[0]) or found.ray[0] >= 0.0


def test_part_far_from_the_origin_keeps_its_bounds():
    scene = scene_of(shapes.box((0, 0, 0), (1, 1, 0.01)), offset=(1e4, 0.0, 0.0))
    found = scene.thickness([[1e4 + 0.5, 0.5, 0.01], [1e4 + 0.003, 0.5, 0.01]])

    np.testing.assert_allclose(found.ray, 0.01, atol=1e-9)
    assert (found.lower <= [0.01, 0.006 + 1e-11]).all() and (found.upper >= [0.01, 0.006 - 1e-11]).all()
    assert (found.upper - found.lower < 1e-7).all()


def test_errors_name_their_argument():
    scene = Scene([Solid(*shapes.cube(), name="a"), Solid(*shapes.open_box(), name="b")])
    with pytest.raises(ArgumentError, match="part is None, expected one of the 2 parts"):
        scene.thickness([0.0, 0.0, 0.0])
    with pytest.raises(NotWatertightError, match="'b' has no thickness"):
        scene.thickness([0.0, 0.0, 0.0], part="b")
    with pytest.raises(SceneError, match="'c'"):
        scene.thickness([0.0, 0.0, 0.0], part="c")
    with pytest.raises(ArgumentError, match="tolerance"):
        scene.thickness([0.0, 0.0, 0.0], part="a", tolerance=-1.0)
    with pytest.raises(ArgumentError, match=r"\(\.\.\., 3\)"):
        scene.thickness([0.0, 0.0], part="a")
    assert scene.thickness([0.5, 0.5, 1.0], part=0).ray == pytest.approx(1.0)


def test_threads_give_the_same_bits():
    mesh = shapes.torus()
    points, _ = surface_points(mesh, 5000, 1)
    one, four = (scene_of(mesh).thickness(points, workers=count) for count in (1, 4))

    for first, second in zip(one, four, strict=True):
        np.testing.assert_array_equal(first, second)
