"""The oracle against analytic solids, and against itself in fractions."""

import numpy as np
import pytest

import oracle

ROUNDING = 2.0**-52
CUBE_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
CUBE_SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_FACES = np.array([[a, *pair] for a, b, c, d in CUBE_SIDES for pair in ((b, c), (c, d))])


def around_cube(count, seed):
    return np.random.default_rng(seed).uniform(-1.5, 2.5, (count, 3))


def on_grid(seed, count, size=4):
    """Return points of a small integer grid: many ties, parallels and degenerate faces."""
    return np.random.default_rng(seed).integers(0, size, (count, 3)).astype(np.float64)


def largest_error(vertices, faces, points):
    """Return the largest error of the distance, relative to the oracle's bound."""
    found = oracle.closest(vertices, faces, points)
    exact = np.array([oracle.root(oracle.closest_exact(vertices, faces, point)) for point in points])
    allowed = 1e-13 * exact + ROUNDING * max(abs(vertices).max(), abs(points).max())
    return (abs(found.distance - exact) / allowed).max()


def test_distance_to_a_cube_is_the_formula():
    points = around_cube(300, seed=1)
    expected = abs(oracle.box(points, [0, 0, 0], [1, 1, 1]))
    np.testing.assert_allclose(
        oracle.closest(CUBE_CORNERS, CUBE_FACES, points).distance, expected, rtol=1e-15, atol=4 * ROUNDING
    )


def test_point_and_weights_belong_to_the_face():
    points = around_cube(300, seed=2)
    found = oracle.closest(CUBE_CORNERS, CUBE_FACES, points)
    corners = CUBE_CORNERS[CUBE_FACES[found.face_id]]
    np.testing.assert_allclose(
        np.einsum("nk,nkd->nd", found.barycentric, corners), found.point, atol=4 * ROUNDING
    )
    np.testing.assert_allclose(
        np.linalg.norm(points - found.point, axis=1), found.distance, atol=4 * ROUNDING
    )
    assert (found.barycentric >= 0).all()
    np.testing.assert_allclose(found.barycentric.sum(axis=1), 1.0, rtol=2 * ROUNDING)


def test_shapes_follow_the_points_and_bad_rows_have_no_answer():
    one = oracle.closest(CUBE_CORNERS, CUBE_FACES, [0.5, 0.5, 3.0])
    assert one.distance.shape == () and one.distance == 2.0 and one.point.tolist() == [0.5, 0.5, 1.0]
    grid = oracle.closest(CUBE_CORNERS, CUBE_FACES, [[[2.0, 0.5, 0.5], [np.nan, 0.0, 0.0]]])
    assert grid.distance.tolist() == [[1.0, np.inf]]
    assert grid.face_id[0, 1] == oracle.NO_FACE and np.isnan(grid.point[0, 1]).all()
    assert oracle.closest(CUBE_CORNERS, CUBE_FACES, np.empty((0, 3))).point.shape == (0, 3)


@pytest.mark.parametrize("seed", range(4))
def test_grid_triangles_agree_with_fractions(seed):
    vertices, points = on_grid(seed, 30), on_grid(seed + 100, 20, size=6) - 1.0
    faces = np.random.default_rng(seed + 200).integers(0, len(vertices), (25, 3))
    assert largest_error(vertices, faces, points) <= 1.0


@pytest.mark.parametrize("thickness", [1e-6, 1e-12, 1e-16, 1e-30, 0.0])
@pytest.mark.parametrize("apex", [0.5, 1e-9, 1.0, 2.0])
def test_needles_agree_with_fractions(thickness, apex):
    """Slivers, caps and degenerate faces, seen from their plane, close to it and from afar."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [apex, thickness, 0.0]]) @ turn + rng.normal(
        size=3
    )
    weights = rng.dirichlet([1, 1, 1], 24)
    offsets = rng.normal(size=(24, 3)) * 10.0 ** rng.uniform(-14, 1, (24, 1))
    assert largest_error(vertices, [[0, 1, 2]], weights @ vertices + offsets) <= 1.0


@pytest.mark.parametrize(
    "corners", [[[1, 2, 3]] * 3, [[0, 0, 0], [1, 1, 1], [1, 1, 1]], [[0, 0, 0], [2, 2, 2], [1, 1, 1]]]
)
def test_faces_without_area_agree_with_fractions(corners):
    assert largest_error(np.array(corners, dtype=np.float64), [[0, 1, 2]], on_grid(5, 40, size=6)) <= 1.0


@pytest.mark.parametrize("scale", [2.0**-200, 2.0**200])
def test_powers_of_two_change_nothing(scale):
    points = around_cube(50, seed=6)
    found = oracle.closest(CUBE_CORNERS, CUBE_FACES, points)
    scaled = oracle.closest(CUBE_CORNERS * scale, CUBE_FACES, points * scale)
    np.testing.assert_array_equal(scaled.distance, found.distance * scale)
    np.testing.assert_array_equal(scaled.face_id, found.face_id)


def test_no_face_is_spared_wrongly():
    """Many faces in many blocks give the same as each face alone."""
    rng = np.random.default_rng(7)
    vertices, points = (
        rng.normal(size=(60, 3)) * 10.0 ** rng.uniform(-3, 3, (60, 1)),
        rng.normal(size=(40, 3)),
    )
    faces = rng.integers(0, 60, (300, 3))
    alone = np.array([oracle.closest(vertices, [face], points).distance for face in faces])
    found = oracle.closest(vertices, faces, points)
    np.testing.assert_array_equal(found.distance, alone.min(axis=0))
    np.testing.assert_array_equal(found.face_id, alone.argmin(axis=0))


def test_winding_number_of_a_cube_is_one_inside_and_zero_outside():
    points = around_cube(300, seed=8)
    inside = oracle.box(points, [0, 0, 0], [1, 1, 1]) < 0
    np.testing.assert_allclose(oracle.winding_number(CUBE_CORNERS, CUBE_FACES, points), inside, atol=1e-14)


def test_winding_number_counts_copies_and_turns():
    twice = np.concatenate([CUBE_FACES, CUBE_FACES])
    assert oracle.winding_number(CUBE_CORNERS, twice, [0.5, 0.5, 0.4]) == pytest.approx(2.0, abs=1e-14)
    assert oracle.winding_number(CUBE_CORNERS, CUBE_FACES[:, ::-1], [0.5, 0.5, 0.4]) == pytest.approx(
        -1.0, abs=1e-14
    )


def test_winding_number_of_one_face_is_its_solid_angle():
    """A face of an octant covers an eighth of the sphere; of a cube, seen from the centre, a twelfth."""
    octant = oracle.winding_number(np.eye(3), [[0, 1, 2]], [0.0, 0.0, 0.0])
    assert octant == pytest.approx(1 / 8, rel=1e-15)
    assert oracle.winding_number(CUBE_CORNERS, CUBE_FACES[:1], [0.5] * 3) == pytest.approx(1 / 12, rel=1e-14)


@pytest.mark.parametrize("width", [1e-6, 1e-13])
def test_winding_number_is_right_a_hair_from_needles(width):
    """Inside and outside, 1e-9 from the faces of a cube with needles along two of its sides."""
    vertices, faces = needle_cube(width)
    picks = np.random.default_rng(9).integers(0, len(faces), 200)
    weights = np.random.default_rng(10).dirichlet([0.3, 0.3, 0.3], 200)
    corners = vertices[faces[picks]]
    directions = np.random.default_rng(11).normal(size=(200, 3))
    points = np.einsum("nk,nkd->nd", weights, corners) + 1e-9 * directions
    clearance = oracle.box(points, [0, 0, 0], [1, 1, 1])
    is_clear = abs(clearance) > 1e-11
    assert is_clear.sum() > 190 and 20 < (clearance < 0).sum() < 180
    found = oracle.winding_number(vertices, faces, points[is_clear])
    np.testing.assert_allclose(found, clearance[is_clear] < 0, atol=1e-14)


def needle_cube(width):
    """Return a unit cube with strips of needles along an edge of its bottom and top."""
    xs = np.array([0.0, width, 2 * width, 1.0])
    vertices = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in xs])
    loop = [0, 1, 2, 3, 7, 6, 5, 4]
    strips = [[k, k + 1, k + 5, k, k + 5, k + 4] for k in range(3)]
    caps = np.array(strips).reshape(-1, 3)
    walls = [[a, b, b + 8, a, b + 8, a + 8] for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
    return vertices, np.concatenate([caps[:, ::-1], caps + 8, np.array(walls).reshape(-1, 3)])


def test_ray_distance_to_a_cube_is_the_formula():
    found = oracle.ray(
        CUBE_CORNERS, CUBE_FACES, [[-1.0, 0.3, 0.4], [0.5, 0.3, 0.4], [2.0, 0.3, 0.4]], [2.0, 0.0, 0.0]
    )
    assert found.distance.tolist() == [1.0, 0.5, np.inf]
    assert found.crossing_count.tolist() == [0, 1, 0]
    assert found.face_id[2] == oracle.NO_FACE


def test_rays_through_edges_and_corners_cross_once():
    """From points of a fine grid inside, towards every corner, edge middle and face diagonal of the cube."""
    targets = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 3), axis=-1).reshape(-1, 3)
    origins = np.stack(np.meshgrid(*[[0.25, 0.5, 0.75]] * 3), axis=-1).reshape(-1, 3)
    directions = targets[None] - origins[:, None]
    is_way = directions.any(axis=-1)
    found = oracle.ray(
        CUBE_CORNERS, CUBE_FACES, np.broadcast_to(origins[:, None], directions.shape), directions
    )
    assert (found.crossing_count[is_way] == 1).all()
    reaches = np.linalg.norm(directions, axis=-1)
    is_target_outside = is_way & (abs(targets - 0.5).max(axis=1) == 0.5)[None]
    np.testing.assert_allclose(
        found.distance[is_target_outside], reaches[is_target_outside], rtol=2 * ROUNDING
    )


def test_crossings_of_any_ray_are_the_winding_number():
    """Two cubes, one inside the other and turned inside out, on an integer grid: ties everywhere."""
    vertices = np.concatenate([4 * CUBE_CORNERS, 2 * CUBE_CORNERS + 1])
    faces = np.concatenate([CUBE_FACES, CUBE_FACES[:, ::-1] + 8])
    origins, directions = on_grid(11, 400, size=13) / 2 - 1.25, on_grid(12, 400, size=5) - 2.0
    directions[~directions.any(axis=1)] = [1.0, 0.0, 0.0]
    found = oracle.ray(vertices, faces, origins, directions)
    outer = oracle.box(origins, [0, 0, 0], [4, 4, 4]) < 0
    inner = oracle.box(origins, [1, 1, 1], [3, 3, 3]) < 0
    np.testing.assert_array_equal(found.crossing_count, outer.astype(int) - inner)
    assert np.isfinite(found.distance[outer]).all()


def test_ray_from_the_surface_hits_at_once_and_along_a_face_hits_its_rim():
    start = oracle.ray(CUBE_CORNERS, CUBE_FACES, [0.0, 0.3, 0.4], [-1.0, 0.0, 0.0])
    assert (start.distance, start.crossing_count) == (0.0, 0)
    along = oracle.ray(CUBE_CORNERS, CUBE_FACES, [-1.0, 0.25, 1.0], [1.0, 0.0, 0.0])
    assert along.distance == 1.0


def test_segment_distance_to_a_cube_is_that_of_its_nearest_point():
    rng = np.random.default_rng(13)
    starts, ends = rng.uniform(-1.5, 2.5, (2, 200, 3))
    fractions = np.linspace(0.0, 1.0, 2001)[:, None, None]
    samples = oracle.box(starts + fractions * (ends - starts), [0, 0, 0], [1, 1, 1])
    found = oracle.segment_distance(CUBE_CORNERS, CUBE_FACES, starts, ends)
    crosses = (samples.min(axis=0) < 0) & (samples.max(axis=0) > 0)
    assert (found.distance[crosses] == 0.0).all()
    step = np.linalg.norm(ends - starts, axis=1) / 2000
    sampled = abs(samples).min(axis=0)
    clear = samples.min(axis=0) > step
    assert (found.distance <= sampled + 1e-15).all()
    assert (found.distance[clear] >= (sampled - step)[clear]).all()


def test_witness_points_lie_on_both_and_are_that_far_apart():
    rng = np.random.default_rng(14)
    starts, ends = rng.uniform(-1.5, 2.5, (2, 200, 3))
    found = oracle.segment_distance(CUBE_CORNERS, CUBE_FACES, starts, ends)
    gaps = np.linalg.norm(found.point_on_segment - found.point_on_solid, axis=1)
    np.testing.assert_allclose(gaps, found.distance, atol=4 * ROUNDING)
    np.testing.assert_allclose(oracle.box(found.point_on_solid, [0, 0, 0], [1, 1, 1]), 0.0, atol=4 * ROUNDING)
    pieces = [np.linalg.norm(end - found.point_on_segment, axis=1) for end in (starts, ends)]
    np.testing.assert_allclose(sum(pieces), np.linalg.norm(ends - starts, axis=1), rtol=8 * ROUNDING)


@pytest.mark.parametrize(
    ("start", "end", "distance"),
    [
        pytest.param([2, 2, -1], [2, 2, 2], 2**0.5, id="parallel to an edge"),
        pytest.param([0.2, 0.3, 3], [0.7, 0.6, 3], 2.0, id="parallel to a face"),
        pytest.param([3, 0.5, 0.5], [3, 0.5, 0.5], 2.0, id="no length"),
        pytest.param([-1, 0, 1], [2, 0, 1], 0.0, id="along an edge"),
        pytest.param([0.1, 0.2, 1], [0.7, 0.6, 1], 0.0, id="within a face"),
        pytest.param([0.5, 0.5, 0.5], [0.5, 0.5, 0.75], 0.25, id="inside"),
        pytest.param([2, 0.5, 2], [2, 0.5, 0.5], 1.0, id="ends beside a face"),
        pytest.param([2, 0.5, 2], [2, 2, 0.5], 1.125**0.5, id="beside a corner"),
        pytest.param([1.5, 0.5, 2], [3.5, 0.5, 1], 5**0.5 / 2, id="nearest at its start"),
        pytest.param([3, 0.5, 1], [1, 0.5, 3], 2**0.5, id="crosswise over an edge"),
    ],
)
def test_segments_in_every_position(start, end, distance):
    found = oracle.segment_distance(CUBE_CORNERS, CUBE_FACES, start, end)
    assert found.distance == pytest.approx(distance, rel=1e-15, abs=1e-16)


def test_segment_without_length_is_a_point():
    points = around_cube(100, seed=15)
    found = oracle.segment_distance(CUBE_CORNERS, CUBE_FACES, points, points)
    np.testing.assert_array_equal(found.distance, oracle.closest(CUBE_CORNERS, CUBE_FACES, points).distance)
    np.testing.assert_allclose(found.point_on_segment, points, rtol=ROUNDING)


def test_formulas_at_points_known_by_heart():
    assert oracle.sphere([[0, 0, 0], [3, 4, 0]], 2.0).tolist() == [-2.0, 3.0]
    assert oracle.box([[1, 1, 1], [5, 6, 1]], [0, 0, 0], [2, 2, 2]).tolist() == [-1.0, 5.0]
    assert oracle.torus([[0, 0, 0], [3, 0, 0], [0, 3, 2]], 3.0, 1.0).tolist() == [2.0, -1.0, 1.0]
    assert oracle.capsule([[0, 0, 5], [0, 3, 1]], [0, 0, 0], [0, 0, 2], 1.0).tolist() == [2.0, 2.0]


def test_curved_solids_are_approached_as_their_facets_grow_finer():
    """Error falls with the square of the facet size; the surface lies within, so distances only grow."""
    points = np.random.default_rng(16).uniform(-5, 5, (60, 3))
    expected = oracle.torus(points, 3.0, 1.0)
    errors = []
    for count in (24, 48):
        vertices, faces = torus_facets(count)
        sign = 1.0 - 2.0 * np.rint(oracle.winding_number(vertices, faces, points))
        errors.append(abs(sign * oracle.closest(vertices, faces, points).distance - expected).max())
    assert errors[1] < 4.5 * (np.pi / 48) ** 2 and 3.0 < errors[0] / errors[1] < 5.0


def torus_facets(count):
    ring, tube = np.meshgrid(*[2 * np.pi * np.arange(count) / count] * 2, indexing="ij")
    radius = 3.0 + np.cos(tube)
    vertices = np.stack([radius * np.cos(ring), radius * np.sin(ring), np.sin(tube)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    a, b = i * count + j, (i + 1) % count * count + j
    c, d = (i + 1) % count * count + (j + 1) % count, i * count + (j + 1) % count
    return vertices, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
