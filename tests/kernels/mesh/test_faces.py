"""Normals and neighbours of faces, and the edges between them."""

import numpy as np
import pytest
import shapes
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from proximity.kernels.mesh.edges import MANY_NEIGHBORS, NO_NEIGHBOR, face_topology, surface_shells
from proximity.kernels.mesh.faces import double_areas, shell_sizes, signed_volume, thin_faces
from proximity.kernels.mesh.positions import merged_faces

SHAPES = {
    "cube": shapes.cube(),
    "ball": shapes.sphere(1.0, 3),
    "torus": shapes.torus(n=40, m=24),
    "sheet": shapes.grid(5, 7),
    "cavity": shapes.hollow_cube(),
}
PLACES = [(1.0, 0.0), (1e-9, 0.0), (1e60, 0.0), (1.0, 1e4)]
"""Scales, and distances from the origin."""


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
    # Regression: a volume of rounding only, negative by chance, reversed all faces.
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


def expected_topology(corners):
    """Neighbours and edge counts by sorting all half-edges."""
    one, other = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low, high, direction = np.minimum(one, other), np.maximum(one, other), np.sign(other - one)
    edge, counts = np.unique(np.stack([low, high], axis=1), axis=0, return_inverse=True, return_counts=True)[
        1:
    ]
    edge, balance = edge.ravel(), np.zeros(len(counts), int)
    np.add.at(balance, edge, direction)
    is_loop = np.bincount(edge, low == high) > 0
    is_pair = (counts == 2) & ~is_loop
    is_opposed = is_pair & (balance == 0)
    neighbors = np.where((counts == 1) | is_loop, NO_NEIGHBOR, MANY_NEIGHBORS)[edge]
    for k in np.flatnonzero(is_opposed):
        pair = np.flatnonzero(edge == k)
        neighbors[pair] = pair[::-1] // 3
    numbers = (
        len(counts),
        ((counts == 1) | is_loop).sum(),
        ((counts > 2) & ~is_loop).sum(),
        (is_pair & ~is_opposed).sum(),
        (~is_loop & (balance != 0)).sum(),
    )
    graph_edges = [np.flatnonzero(edge == k) // 3 for k in np.flatnonzero(is_pair)]
    is_oriented = (is_loop | (np.abs(balance) <= counts % 2)).all()
    return neighbors.reshape(-1, 3), numbers, graph_edges, is_oriented


@pytest.mark.parametrize("corner_count", [1, 2, 3, 5, 30, 1000])
@pytest.mark.parametrize("face_count", [1, 2, 7, 200])
def test_neighbors_edges_and_shells_are_those_of_a_sort(corner_count, face_count):
    rng = np.random.default_rng(7)
    for _ in range(10):
        corners = rng.integers(0, corner_count, (face_count, 3)).astype(np.int32)

        neighbors, numbers = face_topology(corners)
        shell_count, is_oriented = surface_shells(corners)

        expected, expected_numbers, links, expected_orientation = expected_topology(corners)
        np.testing.assert_array_equal(neighbors, expected)
        np.testing.assert_array_equal(numbers, expected_numbers)
        assert shell_count == shell_count_of(face_count, links)
        assert is_oriented == expected_orientation


def shell_count_of(face_count, links):
    one, other = np.array(links, int).reshape(-1, 2).T
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(face_count, face_count))
    return connected_components(graph, directed=False)[0]


def test_corner_that_everything_meets_at_costs_no_more():
    # All edges share one bucket of the last pass, within which sorting takes quadratic time.
    rim = np.random.default_rng(7).permutation(np.arange(1, 10_001)).astype(np.int32)
    fan = np.stack([np.zeros(10_000, np.int32), rim, np.roll(rim, 1)], axis=1)

    neighbors, numbers = face_topology(fan)

    np.testing.assert_array_equal(neighbors[:, 0], np.roll(np.arange(10_000), -1))
    np.testing.assert_array_equal(neighbors[:, 2], np.roll(np.arange(10_000), 1))
    assert numbers.tolist() == [20_000, 10_000, 0, 0, 10_000]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("turn", [1, -1])
def test_long_chains_are_one(seed, turn):
    """A strip of faces, ordered from either end and randomly."""
    rows = np.arange(100_000)[::turn]
    rows = np.random.default_rng(seed).permutation(rows) if seed else rows
    strip = np.stack([rows, rows + 1, rows + 2], axis=1).astype(np.int32)
    strip[rows % 2 == 1] = strip[rows % 2 == 1][:, ::-1]

    assert surface_shells(strip) == (1, True)


@pytest.mark.parametrize("count", [1, 50, 3000])
@pytest.mark.parametrize("grid", [2, 10, 10**6])
def test_equal_positions_are_those_of_a_sort(count, grid):
    rng = np.random.default_rng(7)
    vertices = rng.integers(-grid, grid, (count, 3)) / 7.0
    faces = rng.integers(0, count, (count, 3)).astype(np.int32)

    ids, positions = merged_faces(vertices, faces)

    np.testing.assert_array_equal(positions[ids], vertices[faces])
    assert len(np.unique(positions, axis=0)) == len(positions)
    # Numbers rise with the first vertex at each position.
    used = vertices[np.unique(faces)]
    first = np.unique(used, axis=0, return_index=True)[1]
    np.testing.assert_array_equal(positions, used[np.sort(first)])
    assert not np.signbit(positions[positions == 0.0]).any()
