"""Degenerate cases that break engines of this kind, one test each, through the public API."""

import judging
import numpy as np
import pytest
import shapes

import oracle
from proximity.errors import MeshError
from proximity.scene.queries.results import Feature
from proximity.scene.sign import SignMethod
from proximity.scene.solid import Solid

CUBE = Solid(*shapes.cube())
POINTS = np.random.default_rng(7).uniform(-2.0, 2.0, (200, 3))


def assert_is_right(vertices, faces, points=POINTS):
    """Compare distances and results of any mesh with the oracle."""
    solid = Solid(vertices, faces)
    hit = solid.closest(points)
    judging.assert_distance_is_right(hit.signed_distance, vertices, faces, points)
    judging.assert_distance_is_right(solid.distance(points), vertices, faces, points)
    judging.assert_answer_holds_together(hit, solid.mesh.vertices, solid.mesh.faces, points)
    return solid


@pytest.mark.parametrize("corner", shapes.cube()[0][[0, 5]].tolist())
def test_query_on_a_corner(corner):
    hit = CUBE.closest(corner)

    assert (hit.signed_distance, hit.feature) == (0.0, Feature.VERTEX)
    assert hit.point.tolist() == corner
    outward = (np.array(corner) - 0.5) / np.sqrt(0.75)
    assert np.abs(hit.gradient - outward).max() <= 1e-15


def test_query_on_an_edge():
    hit = CUBE.closest((1.0, 1.0, 0.25))

    assert (hit.signed_distance, hit.feature) == (0.0, Feature.EDGE)
    assert hit.point.tolist() == [1.0, 1.0, 0.25]
    assert hit.gradient == pytest.approx([0.5**0.5, 0.5**0.5, 0.0], abs=1e-15)


def test_query_on_a_diagonal_within_a_side():
    """The diagonal is an edge between coplanar faces."""
    hit = CUBE.closest((0.5, 0.5, 1.0))

    assert hit.signed_distance == 0.0
    assert hit.gradient.tolist() == [0.0, 0.0, 1.0]


def test_query_at_the_centre_of_a_sphere():
    """All faces are equally near: the traversal must test them all and find the true minimum."""
    vertices, faces = shapes.sphere(subdivisions=4)

    hit = Solid(vertices, faces).closest((0.0, 0.0, 0.0))

    expected = oracle.closest(vertices, faces, np.zeros(3)).distance
    assert hit.signed_distance == pytest.approx(-expected, rel=1e-15)
    assert np.abs(hit.gradient - hit.point / expected).max() <= 1e-15


@pytest.mark.parametrize(
    ("corners", "faces"),
    [
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]),
    ],
    ids=["faces back to back", "face without area"],
)
@pytest.mark.parametrize("place", [0.0, 0.25], ids=["corner", "edge"])
def test_where_no_way_leads_out_the_gradient_is_zero_on_the_surface_and_a_unit_beside_it(
    corners, faces, place
):
    hit = Solid(corners, faces).closest([[place, 0.0, 0.0], [place, -1e-3, 0.0]])

    assert hit.signed_distance.tolist() == [0.0, 1e-3]
    assert hit.gradient.tolist() == [[0.0, 0.0, 0.0], [0.0, -1.0, 0.0]]


@pytest.mark.parametrize("offset", [1e-15, 1e-12, 1e-9])
def test_query_a_hair_beside_every_feature_has_the_right_side(offset):
    """Along the pseudo-normals of corners, edges and faces of a body with convex and concave edges."""
    solid = Solid(*shapes.hollow_cube())
    on_surface = solid.closest(np.concatenate([solid.mesh.vertices, POINTS]))
    step = offset * on_surface.gradient

    outside, inside = (solid.signed_distance(on_surface.point + way * step) for way in (1.0, -1.0))

    # Coordinates within 1.5 are rounded to 2e-16.
    room = 5e-16
    assert (outside >= -room).all() and (inside <= room).all()
    if offset > 1e-14:
        assert (outside > 0.0).all() and (inside < 0.0).all()


def test_segment_along_an_edge():
    beside = CUBE.closest_to_segments((-1.0, 1.0, 2.0), (3.0, 1.0, 2.0))
    on_it = CUBE.closest_to_segments((-1.0, 1.0, 1.0), (3.0, 1.0, 1.0))

    assert beside.distance == 1.0
    assert on_it.distance == 0.0
    assert 0.25 <= on_it.fraction <= 0.5


def test_segment_within_a_face():
    assert CUBE.closest_to_segments((0.25, 0.25, 1.0), (0.75, 0.5, 1.0)).distance == 0.0


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]]),
        ([[0, 0, 0], [1, 0, 0], [0.25, 0, 0]], [[0, 1, 2]]),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 1]]),
        ([[0.5, 0.25, 0.125]] * 3, [[0, 1, 2]]),
    ],
    ids=["one face", "back to back", "no area", "a vertex twice", "a point"],
)
def test_mesh_of_next_to_nothing_has_distances_and_nothing_within(vertices, faces):
    solid = assert_is_right(vertices, faces)

    assert (solid.signed_distance(POINTS) >= 0.0).all()


def test_faces_without_area_among_others_change_nothing():
    vertices, faces = shapes.cube()
    more = np.concatenate([faces, [[0, 1, 1], [2, 2, 2]]])

    assert_is_right(vertices, more)
    assert np.array_equal(Solid(vertices, more).distance(POINTS), CUBE.distance(POINTS))


def test_duplicate_faces():
    vertices, faces = shapes.cube()

    solid = assert_is_right(vertices, np.concatenate([faces, faces]))

    assert np.array_equal(solid.distance(POINTS), CUBE.distance(POINTS))


def test_ten_thousand_copies_of_one_face():
    """All centroids are equal: building must end, with a shallow tree."""
    solid = Solid([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([[0, 1, 2]], (10_000, 1)))

    assert solid.distance((0.25, 0.25, 2.0)) == 2.0
    # The surface is recognised as open without testing all faces in every query.
    assert solid.bvh.block_count <= 2500


def test_faces_nested_about_one_centroid():
    sizes = 2.0 ** -np.arange(60.0)
    corner = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
    vertices = (sizes[:, None, None] * corner).reshape(-1, 3)

    assert_is_right(vertices, np.arange(180).reshape(-1, 3))


def test_needles_of_all_lengths():
    """The textbook formula is off by most of the distance here."""
    rng = np.random.default_rng(8)
    length = 10.0 ** rng.uniform(-6.0, 0.0, (300, 1))
    start, way = rng.uniform(-1.0, 1.0, (300, 3)), rng.normal(size=(300, 3))
    width = length * 10.0 ** rng.uniform(-15.0, -3.0, (300, 1)) * rng.normal(size=(300, 3))
    corners = np.stack([start, start + length * way, start + 0.3 * length * way + width], axis=1)

    assert_is_right(corners.reshape(-1, 3), np.arange(900).reshape(-1, 3))


def test_coordinates_near_a_million_metres():
    offset = np.array([1e6, -1e6, 1e6])

    assert_is_right(shapes.octahedron()[0] + offset, shapes.octahedron()[1], POINTS + offset)


def test_part_of_a_millimetre_ten_kilometres_away():
    """Bitwise equal: 2^-10 m and 2^14 m add without rounding."""
    vertices, faces = shapes.cube()
    scale, offset = 2.0**-10, np.array([2.0**14, -(2.0**13), 0.0])
    points = np.round(POINTS * 2.0**20) / 2.0**20

    far = Solid(vertices * scale + offset, faces).signed_distance(points * scale + offset)

    assert np.array_equal(far, CUBE.signed_distance(points) * scale)


@pytest.mark.parametrize("size", [1e-140, 1e-9, 1e140])
def test_part_of_any_size_that_can_be_computed_with(size):
    solid = Solid(*shapes.cube(size, (0, 0, 0)))

    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert solid.signed_distance((size, 0.0, 0.0)) == pytest.approx(0.5 * size, rel=1e-14)
    assert solid.signed_distance((0.4 * size, 0.0, 0.0)) == pytest.approx(-0.1 * size, rel=1e-14)
    assert solid.contains((0.0, 0.4 * size, 0.0))


@pytest.mark.parametrize("size, extent", [(1e-160, r"1e-160"), (1e160, r"2e\+160")])
def test_part_beyond_any_size_is_refused(size, extent):
    message = rf"^the part reaches to 1e.160 m and is {extent} m long; coordinates up to 1e\+150 m"
    with pytest.raises(MeshError, match=message):
        Solid(*shapes.octahedron(size) if size > 1 else shapes.box((0, 0, 0), (size, size, size)))


def test_part_flat_to_one_layer_of_numbers():
    """A plate whose thickness is one step of float64 at its position."""
    step = np.spacing(1.0)
    solid = assert_is_right(*shapes.box((0.0, 0.0, 1.0), (1.0, 1.0, 1.0 + step)))

    assert solid.distance((0.5, 0.5, 1.0 + 2.0 * step)) == step


def test_garbage_is_built_and_asked_without_harm():
    """Random bit patterns as coordinates and any indices: invalid meshes are refused, others work."""
    rng = np.random.default_rng(9)
    for _ in range(30):
        vertices = rng.integers(0, 2**64, (40, 3), np.uint64).view(np.float64)
        wild = rng.random(40) < 0.7
        vertices[wild] = rng.uniform(-1.0, 1.0, (int(wild.sum()), 3))
        faces = rng.integers(0, 40, (60, 3))
        try:
            solid = Solid(vertices, faces)
        except MeshError as refused:
            assert "not finite" in str(refused) or "can be computed with" in str(refused)
            solid = Solid(np.where(np.abs(vertices) <= 1.0, vertices, 0.5), faces)
        distances = solid.distance(POINTS)
        assert (distances >= 0.0).all()
