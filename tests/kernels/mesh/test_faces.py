"""Normals and neighbours of faces, and the edges between them."""

import numpy as np
import pytest
import shapes
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from proximity.kernels.mesh.edges import connected, sorted_half_edges
from proximity.kernels.mesh.faces import double_areas, shell_sizes, signed_volume, thin_faces

SHAPES = {
    "cube": shapes.cube(),
    "ball": shapes.sphere(1.0, 3),
    "torus": shapes.torus(n=40, m=24),
    "sheet": shapes.grid(5, 7),
    "cavity": shapes.hollow_cube(),
}
PLACES = [(1.0, 0.0), (1e-9, 0.0), (1e60, 0.0), (1.0, 1e4)]
"""Scales, and how far from the origin."""


def placed(name, place):
    vertices, faces = SHAPES[name]
    scale, offset = place
    return scale * vertices + offset, faces.astype(np.int32)


def expected_areas(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("place", PLACES)
def test_areas_are_those_of_the_cross_product(name, place):
    vertices, faces = placed(name, place)

    np.testing.assert_allclose(double_areas(vertices, faces), expected_areas(vertices, faces), rtol=1e-12)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("place", PLACES)
def test_volume_has_the_sign_of_the_winding_wherever_the_part_is(place, way):
    cube, ball = (
        signed_volume(v, f[:, ::way].copy()) for v, f in (placed(n, place) for n in ("cube", "ball"))
    )

    assert (np.sign(cube), np.sign(ball)) == (way, way)
    assert abs(cube) == pytest.approx(48.0, rel=1e-7)  # six times that of a cube whose half side is one


def test_flat_and_single_points_enclose_nothing():
    vertices, faces = placed("sheet", (1.0, 0.0))

    assert signed_volume(vertices, faces) == 0.0
    assert signed_volume(np.ones((3, 3)), np.array([[0, 1, 2]], np.int32)) == 0.0


@pytest.mark.parametrize("way", [1, -1])
def test_ball_and_the_same_inside_out_enclose_nothing(way):
    # Was: rounding, and so by chance less than nothing; then all faces were turned.
    vertices, faces = shapes.sphere(1.0, 3)
    rotated = vertices @ shapes.rotation(7).T
    both = np.concatenate([faces[:, ::way], faces[:, ::-way]]).astype(np.int32)

    assert signed_volume(rotated, both) == 0.0


def test_rows_that_no_face_uses_may_hold_anything():
    vertices, faces = placed("cube", (1.0, 0.0))
    more = np.concatenate([vertices, [[np.nan, np.inf, 1e300]]])

    assert signed_volume(more, faces) == signed_volume(vertices, faces)
    np.testing.assert_array_equal(double_areas(more, faces), double_areas(vertices, faces))


@pytest.mark.parametrize("height", [1e-3, 0.5, 0.9, 2.0])
def test_thin_is_what_is_no_higher_above_its_longest_side(height):
    rng = np.random.default_rng(7)
    vertices = rng.normal(size=(600, 3)) * [1.0, 1.0, 0.01]
    faces = rng.integers(0, 600, (400, 3)).astype(np.int32)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    longest = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2).max(axis=0)

    is_thin = thin_faces(vertices, faces, height)

    np.testing.assert_array_equal(is_thin, expected_areas(vertices, faces) <= height * longest)
    assert height > 1.0 or 0 < is_thin.sum() < len(is_thin)


def test_faces_with_two_corners_in_one_are_thin_whatever_the_height():
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])

    assert thin_faces(vertices, np.array([[0, 1, 1], [0, 0, 0]], np.int32), 0.0).all()


def test_shells_are_told_apart():
    (cube, cube_faces), (ball, ball_faces) = SHAPES["cube"], shapes.inside_out(SHAPES["ball"])
    corners, faces = np.concatenate([cube + 7.0, ball]), np.concatenate([cube_faces, ball_faces + len(cube)])
    triangles = corners[faces]
    labels = np.repeat([1, 0], [len(cube_faces), len(ball_faces)])
    mixed = np.random.default_rng(7).permutation(len(labels))

    volumes, areas, reach = shell_sizes(corners, faces[mixed].astype(np.int32), labels[mixed], 2)

    side = np.ptp(cube[:, 0])
    assert volumes[1] == pytest.approx(6.0 * side**3)
    assert -8.0 * np.pi < volumes[0] < -0.95 * 8.0 * np.pi
    assert areas[1] == pytest.approx(12.0 * side**2)
    for shell in range(2):
        first = triangles[mixed][labels[mixed] == shell][:, 0]
        assert reach[shell] == pytest.approx(np.linalg.norm(first - first[0], axis=1).max())


def expected(corners):
    one, other = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low, high, is_backward = np.minimum(one, other), np.maximum(one, other), one > other
    order = np.lexsort((is_backward, high, low))
    edges = np.stack([low, high], axis=1)[order]
    starts = np.flatnonzero(np.concatenate([[True], (edges[1:] != edges[:-1]).any(axis=1)]))
    counts = np.diff(starts, append=len(order))
    forward = ~is_backward[order]
    totals = np.concatenate([[0], np.cumsum(forward)])
    is_loop = edges[starts, 0] == edges[starts, 1]
    return order, forward, starts, counts, totals[starts + counts] - totals[starts], is_loop


@pytest.mark.parametrize("corner_count", [1, 2, 3, 5, 30, 1000])
@pytest.mark.parametrize("face_count", [1, 2, 7, 200])
def test_half_edges_are_in_the_order_of_a_sort(corner_count, face_count):
    rng = np.random.default_rng(7)
    for _ in range(10):
        corners = rng.integers(0, corner_count, (face_count, 3)).astype(np.int32)

        for found, right in zip(sorted_half_edges(corners), expected(corners), strict=True):
            np.testing.assert_array_equal(found, right)


def test_corner_that_everything_meets_at_costs_no_more():
    # All in one place of the last pass: what is sorted within such places takes the square of it.
    rim = np.random.default_rng(7).permutation(np.arange(1, 10_001)).astype(np.int32)
    fan = np.stack([np.zeros(10_000, np.int32), rim, np.roll(rim, 1)], axis=1)

    for found, right in zip(sorted_half_edges(fan), expected(fan), strict=True):
        np.testing.assert_array_equal(found, right)


@pytest.mark.parametrize(
    ("count", "links"), [(1, 0), (1, 3), (7, 0), (50, 20), (50, 60), (3000, 2000), (3000, 9000)]
)
@pytest.mark.parametrize("seed", range(3))
def test_labels_are_those_of_scipy(count, links, seed):
    one, other = np.random.default_rng(seed).integers(count, size=(2, links))
    graph = coo_array((np.ones(links, bool), (one, other)), shape=(count, count))
    found, expected = connected_components(graph, directed=False)

    labels = connected(count, one, other)

    assert labels.dtype == np.int32
    np.testing.assert_array_equal(labels, expected)
    assert labels.max() + 1 == found


@pytest.mark.parametrize("turn", [1, -1])
def test_long_chains_are_one(turn):
    row = np.ascontiguousarray(np.arange(100_000)[::turn])

    assert not connected(len(row), row[:-1], row[1:].copy()).any()


def test_of_nothing_there_is_nothing():
    assert len(connected(0, np.empty(0, np.int64), np.empty(0, np.int64))) == 0
