"""The ray walk of a part and of a scene: against the oracle, watertight, and where nothing must go wrong."""

from fractions import Fraction

import numba
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from models import model_of

import oracle
from proximity.kernels.geometry.frames import direction_to_local, to_local
from proximity.kernels.layout import NO_FACE, NO_PART, NODE_STRIDE
from proximity.kernels.ray import hit_rows, ray_lanes, walk
from proximity.kernels.scene import ray_queries
from proximity.native.simd import bits, lane, splat32
from proximity.pose import Pose

TEN_KILOMETRES = np.array([10_000.0, -7_000.0, 3_000.0])
ALL_ROWS = np.empty(0, np.int64)


# ---------------------------------------------------------------------------------------------- helpers


class Hits:
    """The columns of `cast_batch` by name."""

    def __init__(self, model, origins, directions, *, limit=np.inf, order=ALL_ROWS, rows=None):
        origins, directions = np.broadcast_arrays(
            np.atleast_2d(np.asarray(origins, float)), np.atleast_2d(np.asarray(directions, float))
        )
        table = np.full((len(origins), hit_rows.RAY_ANSWER_WIDTH), 7.0)
        self.reals, self.choices = (
            table[:, : hit_rows.RAY_ANSWER_REALS],
            table.view(np.int32)[:, hit_rows.RAY_ANSWER_PART :],
        )
        self.choices[:] = 7
        self.zero_row = ray_queries.cast_batch(
            model.packed,
            np.ascontiguousarray(origins),
            np.ascontiguousarray(directions),
            order,
            np.array([limit]),
            table,
        )
        self.distance, self.point = self.reals[:, hit_rows.RAY_ANSWER_DISTANCE], self.reals[:, 1:4]
        self.normal, self.barycentric = self.reals[:, 4:7], self.reals[:, 7:10]
        self.part, self.face = self.choices.T


def directions_of(count, seed):
    return np.random.default_rng(seed).normal(size=(count, 3))


def needles():
    """A fan of slivers around a point, closed by a second fan below: heights down to 1e-9."""
    angle = np.sort(np.random.default_rng(3).random(40)) * 2 * np.pi
    angle[20:] = angle[19] + np.arange(20) * 1e-9
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(40)], axis=1)
    vertices = np.concatenate([ring, [[0.1, 0.2, 0.5]], [[0.1, 0.2, -0.25]]])
    i, j = np.arange(40), np.roll(np.arange(40), -1)
    up, down = np.stack([i, j, np.full(40, 40)], axis=1), np.stack([j, i, np.full(40, 41)], axis=1)
    return vertices, np.concatenate([up, down])


def gear():
    """The toothed sample part, or a prism with teeth of its kind."""
    angle = np.arange(24) * np.pi / 12
    radius = np.where(np.arange(24) % 2, 1.0, 0.75)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    low, high = np.full((24, 1), -0.2), np.full((24, 1), 0.2)
    vertices = np.concatenate([np.hstack([ring, low]), np.hstack([ring, high]), [[0, 0, -0.2], [0, 0, 0.2]]])
    i, j = np.arange(24), np.roll(np.arange(24), -1)
    center = np.full(24, 48)
    parts = [[i, j, j + 24], [i, j + 24, i + 24], [center, j, i], [center + 1, i + 24, j + 24]]
    return vertices, np.concatenate([np.stack(part, axis=1) for part in parts])


CLEAR_SIGHT = {"torus": 0.8}
"""Farther than this a ray may touch the surface and pass: there rounding decides, here and in the oracle."""
CLOSED = {
    "sphere": (shapes.sphere(subdivisions=2), np.zeros(3)),
    "box": (shapes.cube(2.0, (0.0, 0.0, 0.0)), np.zeros(3)),
    "fine box": (shapes.quartered(*shapes.quartered(*shapes.cube(2.0, (0.0, 0.0, 0.0)))), np.zeros(3)),
    "torus": (shapes.torus(), np.array([2.0, 0.0, 0.0])),
    "gear": (gear(), np.zeros(3)),
    "needles": (needles(), np.array([0.1, 0.2, 0.1])),
}


# ------------------------------------------------------------------------------------------ right answers


@pytest.mark.parametrize("name", CLOSED)
def test_first_hit_is_the_oracles(name):
    (vertices, faces), inside = CLOSED[name]
    rng = np.random.default_rng(11)
    origins = np.concatenate([inside + 0.1 * rng.normal(size=(100, 3)), 3.0 * rng.normal(size=(100, 3))])
    directions = np.concatenate([directions_of(100, 1), inside + 0.5 * directions_of(100, 2) - origins[100:]])
    hits = Hits(model_of((vertices, faces)), origins, directions)
    expected = oracle.ray(vertices, faces, origins, directions)
    assert np.array_equal(np.isfinite(hits.distance), np.isfinite(expected.distance))
    found = np.isfinite(hits.distance)
    # A grazing ray magnifies the rounding of its origin: hence the part of the coordinates.
    np.testing.assert_allclose(hits.distance[found], expected.distance[found], rtol=1e-12, atol=1e-13)
    assert (hits.face[found] == expected.face_id[found]).mean() > 0.98


def test_answers_agree_with_one_another():
    vertices, faces = CLOSED["torus"][0]
    origins = 4.0 * directions_of(300, 5)
    directions = directions_of(300, 6) - origins
    hits = Hits(model_of((vertices, faces)), origins, directions)
    found = hits.face != NO_FACE
    assert 50 < found.sum() < 300
    corners = vertices[faces[hits.face[found]]]
    unit = directions[found] / np.linalg.norm(directions[found], axis=1, keepdims=True)
    assert (hits.barycentric[found] >= 0.0).all()
    np.testing.assert_allclose(hits.barycentric[found].sum(axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(
        (hits.barycentric[found][:, :, None] * corners).sum(axis=1), hits.point[found], atol=4e-15
    )
    np.testing.assert_allclose(
        origins[found] + hits.distance[found, None] * unit, hits.point[found], rtol=0, atol=2e-14
    )
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(hits.normal[found], normal, rtol=0, atol=1e-14)
    missed = ~found
    assert np.isinf(hits.distance[missed]).all() and np.isnan(hits.reals[missed, 1:]).all()
    assert (hits.part[missed] == NO_PART).all() and (hits.part[found] == 0).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from([-300, -20, 0, 3, 300]), st.sampled_from([1e-9, 1.0, 1e60]))
def test_length_of_direction_and_size_of_part_change_nothing(seed, exponent, size):
    rng = np.random.default_rng(seed)
    vertices, faces = CLOSED["gear"][0]
    origin, direction = rng.normal(size=3), rng.normal(size=3)
    here = Hits(model_of((vertices, faces)), origin, direction)
    there = Hits(model_of((size * vertices, faces)), size * origin, direction * 10.0**exponent)
    assert here.face[0] == there.face[0]
    np.testing.assert_allclose(there.distance, size * here.distance, rtol=1e-11)


def test_direction_of_least_and_largest_numbers_is_followed():
    model = model_of(shapes.cube())
    for number in (5e-324, 1e-308, 1e-300, 1e300, 1.7e308):
        hits = Hits(model, [0.25, 0.5, -1.0], [0.0, 0.0, number])
        assert hits.distance[0] == pytest.approx(1.0, rel=1e-15)
        assert Hits(model, [0.25, 0.5, -1.0], [0.0, 0.0, -number]).face[0] == NO_FACE


def test_a_direction_scaled_by_a_power_of_two_answers_the_same_bit_for_bit():
    model = model_of(CLOSED["torus"][0])
    origins, directions = directions_of(100, 8), directions_of(100, 9)
    plain = Hits(model, origins, directions)
    assert np.array_equal(Hits(model, origins, directions * 2.0**-700).reals, plain.reals, equal_nan=True)


def test_distance_from_afar_is_right():
    vertices, faces = shapes.cube(0.1, (0.0, 0.0, 0.0))
    model = model_of((vertices, faces))
    for away in (10.0, 1e4, 1e9, 1e15):
        hits = Hits(model, [0.01, 0.02, away], [0.0, 0.0, -1.0])
        assert hits.distance[0] == pytest.approx(away - 0.05, rel=1e-15)
        np.testing.assert_allclose(hits.point[0], [0.01, 0.02, 0.05], rtol=1e-15)
        assert Hits(model, [0.01, 0.02, away], [0.0, 0.0, 1.0]).face[0] == NO_FACE
        assert Hits(model, [0.01, 0.0501, away], [0.0, 0.0, -1.0]).face[0] == NO_FACE


@pytest.mark.parametrize("away", [1e20, 1e90, 1e150, 1e300, 1.7e308])
def test_rays_from_beyond_everything_end(away):
    scene = model_of(CLOSED["sphere"][0], shapes.moved(CLOSED["box"][0], (5.0, 0.0, 0.0)))
    hits = Hits(scene, away * np.sign(directions_of(20, 4)), directions_of(20, 4))
    assert np.isinf(hits.distance).all()


# --------------------------------------------------------------------------------------------- watertight


@pytest.mark.parametrize("offset", [np.zeros(3), TEN_KILOMETRES], ids=["here", "ten kilometres away"])
@pytest.mark.parametrize("name", CLOSED)
def test_no_ray_slips_through_corners_edges_and_faces(name, offset):
    (vertices, faces), inside = CLOSED[name]
    vertices, inside = vertices + offset, inside + offset
    corners = vertices[faces]
    middles = np.concatenate([(corners[:, k] + corners[:, (k + 1) % 3]) / 2 for k in range(3)])
    targets = np.concatenate([vertices, middles, corners.mean(axis=1)])
    model = model_of((vertices, faces))
    for start in inside + 0.02 * np.vstack([np.zeros(3), directions_of(5, 21)]):
        hits = Hits(model, start, targets - start)
        assert (hits.face != NO_FACE).all()
        reach = np.linalg.norm(targets - start, axis=1)
        seen = reach < CLEAR_SIGHT.get(name, np.inf)
        assert seen.sum() > 50 and (hits.distance[seen] <= reach[seen] * (1 + 1e-9) + 1e-9).all()


def test_no_ray_of_a_lattice_slips_between_faces_of_a_lattice():
    """Rays along axes and diagonals, all of them exactly through corners and along edges."""
    vertices, faces = CLOSED["fine box"][0]
    model = model_of((vertices, faces))
    steps = np.arange(-1.0, 1.25, 0.25)
    y, z = (grid.ravel() for grid in np.meshgrid(steps, steps))
    hits = Hits(model, np.stack([np.full_like(y, -3.0), y, z], axis=1), [1.0, 0.0, 0.0])
    assert (hits.distance == 2.0).all()
    ways = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 3)
    ways = ways[np.any(ways != 0.0, axis=1)]
    hits = Hits(model, np.zeros(3), ways)
    np.testing.assert_allclose(hits.distance, np.linalg.norm(ways, axis=1), rtol=1e-15)


def test_a_face_seen_edge_on_is_not_hit_but_its_neighbour_is():
    vertices, faces = shapes.cube()
    hits = Hits(model_of((vertices, faces)), [-1.0, 0.3, 1.0], [1.0, 0.0, 0.0])
    assert hits.distance[0] == 1.0
    np.testing.assert_array_equal(hits.normal[0], [-1.0, 0.0, 0.0])


@pytest.mark.internals
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-8, 1e-15, 1e-160]))
def test_the_side_of_an_edge_is_never_wrong(seed, size):
    """Two triangles at one edge may both be hit, or one; never none."""
    rng = np.random.default_rng(seed)
    b = rng.normal(size=2) * size
    c = -b * rng.random() * 2.0 ** rng.integers(-30, 30) + rng.integers(-2, 3, 2) * 2.0**-52 * size
    a = rng.normal(size=2)
    u, _, _, _ = _sides(*a, *b, *c)
    exact = Fraction(b[0]) * Fraction(c[1]) - Fraction(b[1]) * Fraction(c[0])
    assert not (u > 0.0 and exact < 0) and not (u < 0.0 and exact > 0)
    if size > 1e-100:
        assert (u == 0.0) == (exact == 0)


@numba.njit
def _sides(ax, ay, bx, by, cx, cy):
    return walk.ray_triangle_sides((0.0, 0.0, 0.0), 0.0, 0.0, (ax, ay, 1.0), (bx, by, 1.0), (cx, cy, 1.0))


# ---------------------------------------------------------------------------------------------- box test


@numba.njit
def _open_lanes(node, ox, oy, oz, dx, dy, dz, best, margin):
    """Which lanes are open, and the bound of lane 0."""
    aim = (*walk.slab(ox, dx, margin), *walk.slab(oy, dy, margin), *walk.slab(oz, dz, margin))
    best32 = walk.bound_of_parameter(best, 0.0)
    bounds, _, is_open = walk.open_boxes(node, 0, aim, splat32(np.float32(0.0)), best32)
    return bits(is_open), lane(bounds, 0)


def node_of(lower, upper):
    """One box in lane 0, the other lanes unused."""
    node = np.zeros(NODE_STRIDE, np.float32)
    node[:24], node[24:48] = np.inf, -np.inf
    node[[0, 8, 16]], node[[24, 32, 40]] = lower, upper
    return node


@pytest.mark.internals
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-300, 1e-18, 1e-9, 1.0]))
def test_a_box_is_open_to_every_ray_that_meets_something_in_it(seed, flatness):
    """The ray ends in a corner of the box, at the very parameter that is the bound."""
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-1, 1, 3).astype(np.float32)
    upper = np.minimum(lower + np.float32(rng.random() * 2.0 ** -rng.integers(0, 30)), np.float32(1.0))
    target = np.where(rng.random(3) < 0.5, lower, upper).astype(np.float64)
    direction = rng.normal(size=3) * np.where(np.arange(3) == rng.integers(3), flatness, 1.0)
    direction /= np.abs(direction).max()
    length = rng.random() * 2.0 ** -rng.integers(0, 20)
    origin = target - length * direction
    if np.abs(origin).max() > 2.0:
        return
    open_bits, bound = _open_lanes(node_of(lower, upper), *origin, *direction, length, walk.SLAB_MARGIN)
    assert open_bits == 1
    assert 0.0 <= bound <= np.float32(length) * (1 + 1e-6) + 1e-38


@pytest.mark.internals
def test_a_box_that_is_missed_by_little_is_shut():
    node = node_of([0.25] * 3, [0.5] * 3)
    margin = walk.SLAB_MARGIN
    assert _open_lanes(node, -1.0, 0.5 + 4e-6, 0.3, 1.0, 0.0, 0.0, np.inf, margin)[0] == 0
    assert _open_lanes(node, -1.0, 0.5, 0.3, 1.0, 0.0, -0.0, np.inf, margin)[0] == 1
    assert _open_lanes(node, -1.0, 0.5, 0.3, 1.0, 0.0, -0.0, 1.24, margin)[0] == 0
    assert _open_lanes(node, -1.0, 0.5, 0.3, -1.0, 0.0, -0.0, np.inf, margin)[0] == 0


# ------------------------------------------------------------------------------------- starts, ends, ties


def test_a_ray_that_starts_on_the_surface_hits_it_at_once():
    vertices, faces = CLOSED["sphere"][0]
    corners = vertices[faces]
    starts = np.concatenate([vertices, corners.mean(axis=1)])
    model = model_of((vertices, faces))
    for way in (starts, -starts):
        hits = Hits(model, starts, way)
        assert (hits.distance[: len(vertices)] == 0.0).all()
        assert (hits.distance >= 0.0).all() and (hits.distance < 1e-14).all()


def test_what_lies_behind_is_not_hit():
    model = model_of(shapes.grid())
    assert Hits(model, [1.3, 1.4, -1e-9], [0.0, 0.0, -1.0]).face[0] == NO_FACE
    assert Hits(model, [1.3, 1.4, 1e-9], [0.0, 0.0, -1.0]).distance[0] == pytest.approx(1e-9)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -2.0), (0.0, 3.0, -4.0)])
def test_the_limit_is_inclusive(direction):
    model = model_of(shapes.grid())
    origin = np.array([1.25, 0.25, 0.5])
    distance = Hits(model, origin, direction).distance[0]
    assert Hits(model, origin, direction, limit=distance).distance[0] == distance
    assert Hits(model, origin, direction, limit=np.nextafter(distance, 0.0)).face[0] == NO_FACE
    assert Hits(model, origin, direction, limit=0.0).face[0] == NO_FACE


def test_a_limit_changes_no_answer_within_it():
    model = model_of(CLOSED["torus"][0])
    origins = 3.0 * directions_of(200, 13)
    directions = directions_of(200, 14) - origins
    free = Hits(model, origins, directions)
    bound = Hits(model, origins, directions, limit=3.0)
    near = free.distance <= 3.0
    assert 0 < near.sum() < 200
    assert np.array_equal(bound.reals[near], free.reals[near])
    assert np.isinf(bound.distance[~near]).all()


def test_of_equal_faces_the_lowest_slot_is_taken():
    vertices, faces = shapes.grid(2, 2)
    copies = np.concatenate([faces] * 20)
    model = model_of((vertices, copies))
    slot_faces = model.part_arrays(0).bvh.slot_faces
    hits = Hits(model, [0.6, 0.3, 1.0], [0.0, 0.0, -1.0])
    equal = np.flatnonzero(np.isin(slot_faces, np.flatnonzero((copies == copies[hits.face[0]]).all(axis=1))))
    assert slot_faces[equal[0]] == hits.face[0]


@pytest.mark.parametrize("is_fused", [False, True])
def test_of_equal_parts_the_lowest_is_taken(is_fused):
    meshes = [shapes.moved(shapes.cube(), (0.0, 0.0, 5.0)), *[CLOSED["fine box"][0]] * 9]
    hits = Hits(model_of(*meshes, is_fused=is_fused), [0.1, 0.2, -3.0], [[0.0, 0.0, 1.0], [0.01, 0.02, 1.0]])
    assert (hits.part == 1).all()


def test_a_face_without_area_answers_against_the_ray():
    """Corners on a line, told apart by rounding alone: if it is hit at all, the normal is a number."""
    vertices = np.array(
        [[0.1, 0.1, 0.0], [0.3, 0.3, 0.0], [0.7, 0.7, 0.0], [5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [6.0, 0.0, 0.0]]
    )
    model = model_of((vertices, np.array([[0, 1, 2], [3, 4, 5]])))
    targets = np.linspace(0.1, 0.7, 500)[:, None] * [1.0, 1.0, 0.0]
    hits = Hits(model, [0.3, -0.2, 1.0], targets - [0.3, -0.2, 1.0])
    found = hits.face == 0
    np.testing.assert_allclose(np.linalg.norm(hits.normal[found], axis=1), 1.0, rtol=1e-12)


# ------------------------------------------------------------------------------------- rows and their order


def test_a_row_that_is_no_ray_answers_nan_and_the_others_go_on():
    origins = np.tile([0.5, 0.5, 0.5], (7, 1))
    directions = np.tile([0.0, 0.0, 1.0], (7, 1))
    origins[1, 0], origins[2, 1], directions[3, 2], directions[4, 0] = np.nan, np.inf, np.nan, -np.inf
    directions[5] = 0.0
    hits = Hits(model_of(shapes.cube()), origins, directions)
    assert hits.zero_row == 5
    assert Hits(model_of(shapes.cube()), origins[:5], directions[:5]).zero_row == -1
    assert (hits.distance[[0, 6]] == 0.5).all()
    assert np.isnan(hits.reals[1:6]).all()
    assert (hits.face[1:6] == NO_FACE).all() and (hits.part[1:6] == NO_PART).all()


def test_the_order_changes_no_answer_and_names_the_rows_to_fill():
    model = model_of(CLOSED["gear"][0])
    origins, directions = directions_of(100, 15), directions_of(100, 16)
    plain = Hits(model, origins, directions)
    some = np.random.default_rng(1).permutation(100)[:60]
    hits = Hits(model, origins, directions, order=some)
    assert np.array_equal(hits.reals[some], plain.reals[some], equal_nan=True)
    rest = np.setdiff1d(np.arange(100), some)
    assert (hits.reals[rest] == 7.0).all() and (hits.choices[rest] == 7).all()


def test_no_ray_at_all_is_fine():
    assert len(Hits(model_of(shapes.cube()), np.empty((0, 3)), np.empty((0, 3))).distance) == 0


# ------------------------------------------------------------------------------------------------- scenes


def _parts(count, offset):
    rng = np.random.default_rng(31)
    meshes = [list(CLOSED.values())[k % len(CLOSED)][0] for k in range(count)]
    poses = [Pose(shapes.rotation(k), offset + 3.0 * rng.normal(size=3)) for k in range(count)]
    return meshes, poses


@pytest.mark.parametrize("is_fused", [False, True], ids=["frames of their own", "one frame"])
@pytest.mark.parametrize("offset", [np.zeros(3), TEN_KILOMETRES], ids=["here", "ten kilometres away"])
def test_a_scene_answers_as_all_its_faces_do(offset, is_fused):
    meshes, poses = _parts(14, offset)
    placed = [(pose.point(vertices), faces) for (vertices, faces), pose in zip(meshes, poses, strict=True)]
    scene = model_of(*placed, is_fused=True) if is_fused else model_of(*meshes, poses=poses)
    vertices, faces = shapes.join(*placed)
    first_face = np.cumsum([0] + [len(faces) for _, faces in meshes])
    origins = offset + 5.0 * directions_of(150, 17)
    directions = offset + 2.0 * directions_of(150, 18) - origins
    hits = Hits(scene, origins, directions)
    expected = oracle.ray(vertices, faces, origins, directions)
    assert np.array_equal(np.isfinite(hits.distance), np.isfinite(expected.distance))
    found = np.isfinite(hits.distance)
    assert found.sum() > 50
    rounding = 1e-13 + 1e-15 * np.abs(offset).max() * 100
    np.testing.assert_allclose(hits.distance[found], expected.distance[found], rtol=1e-12, atol=rounding)
    same = first_face[hits.part[found]] + hits.face[found] == expected.face_id[found]
    assert same.mean() > 0.98
    corners = vertices[faces[first_face[hits.part[found]] + hits.face[found]]]
    point = (hits.barycentric[found][:, :, None] * corners).sum(axis=1)
    np.testing.assert_allclose(point, hits.point[found], rtol=0, atol=rounding)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(hits.normal[found], normal, atol=1e-7 if offset.any() else 1e-8)


@pytest.mark.parametrize("is_fused", [False, True], ids=["frames of their own", "one frame"])
def test_no_ray_slips_out_of_a_part_of_a_scene(is_fused):
    meshes, poses = _parts(14, TEN_KILOMETRES)
    placed = [(pose.point(vertices), faces) for (vertices, faces), pose in zip(meshes, poses, strict=True)]
    scene = model_of(*placed, is_fused=True) if is_fused else model_of(*meshes, poses=poses)
    for (name, (_, inside)), pose, (vertices, faces) in zip(CLOSED.items(), poses, meshes, strict=False):
        corners = vertices[faces]
        targets = pose.point(np.concatenate([vertices, (corners[:, 0] + corners[:, 1]) / 2]))
        start = pose.point(inside)
        hits = Hits(scene, start, targets - start)
        reach = np.linalg.norm(targets - start, axis=1)
        seen = reach < CLEAR_SIGHT.get(name, np.inf)
        assert seen.any() and (hits.distance[seen] <= reach[seen] * (1 + 1e-9) + 1e-9).all(), name


def test_a_part_beside_another_answers_as_it_does_alone():
    mesh = CLOSED["torus"][0]
    origins, directions = 3.0 * directions_of(100, 19), directions_of(100, 20)
    alone = Hits(model_of(mesh), origins, directions)
    both = Hits(model_of(mesh, shapes.moved(shapes.cube(), (1e5, 0.0, 0.0))), origins, directions)
    ours = both.part != 1
    assert np.array_equal(alone.face[ours], both.face[ours])
    np.testing.assert_allclose(alone.reals[ours], both.reals[ours], rtol=1e-12, atol=1e-13)


def test_a_scene_looks_no_farther_than_the_limit():
    meshes, poses = _parts(14, np.zeros(3))
    scene = model_of(*meshes, poses=poses)
    origins = 5.0 * directions_of(100, 22)
    free = Hits(scene, origins, -origins)
    for row in np.flatnonzero(np.isfinite(free.distance))[:20]:
        limit = free.distance[row]
        assert Hits(scene, origins[row], -origins[row], limit=limit).distance[0] == limit
        assert np.isinf(Hits(scene, origins[row], -origins[row], limit=np.nextafter(limit, 0)).distance[0])


# ----------------------------------------------------------------------------------------- beside the others


def test_agrees_with_embree_on_a_real_part(shared_data):
    scenes, meshes = (
        pytest.importorskip(f"embreex.{name}") for name in ("rtcore_scene", "mesh_construction")
    )
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(shared_data / "cad" / "featuretype.STL", process=False)
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    rng = np.random.default_rng(23)
    origins, directions = rng.uniform(lower, upper, (2000, 3)), directions_of(2000, 24)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    engine = scenes.EmbreeScene()
    meshes.TriangleMesh(engine, vertices.astype(np.float32), faces.astype(np.int32))
    theirs = engine.run(origins.astype(np.float32), directions.astype(np.float32), query="DISTANCE")
    hits = Hits(model_of((vertices, faces)), origins, directions)
    # float32 at edges and where rays graze
    size = np.linalg.norm(upper - lower)
    agree = np.isclose(np.minimum(theirs, 1e30), np.minimum(hits.distance, 1e30), rtol=1e-4, atol=1e-5 * size)
    differ = np.isfinite(hits.distance) != (theirs < 1e30)
    assert (agree | differ).mean() > 0.998 and differ.sum() <= 4


# ------------------------------------------------------------------------------------- eight at a time


@numba.njit
def made_ready(frames, parts, drift, origins, directions, offsets, limit, aims, views):
    views[ray_lanes.RAY_CHUNK * ray_lanes.VIEW_REACH : ray_lanes.RAY_CHUNK * (ray_lanes.VIEW_REACH + 1)] = (
        limit
    )
    for at in range(0, ray_lanes.RAY_CHUNK, 8):
        ray_lanes.make_ready(frames, parts, 0, drift, origins, directions, offsets, at, aims, views)


@numba.njit
def one_made_ready(frames, parts, origin, way, drift):
    """The same for one ray, by the formulas of a part with a frame of its own."""
    x, y, z = to_local(frames, parts, 0, origin[0], origin[1], origin[2])
    margin = walk.SLAB_MARGIN + drift * max(abs(x), abs(y), abs(z))
    dx, dy, dz = ray_lanes.scaled_direction(way[0], way[1], way[2])
    dx, dy, dz = direction_to_local(frames, parts, 0, dx, dy, dz)
    is_near, entry = True, 0.0
    if walk.is_from_afar(x, y, z):
        is_near, entry, x, y, z = walk.approach(x, y, z, dx, dy, dz)
    aim, view = walk.aim_and_view(x, y, z, dx, dy, dz, margin)
    return is_near, entry, aim, view


@pytest.mark.internals
@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize("drift", [0.0, ray_queries.FAR_MARGIN])
@pytest.mark.parametrize("reach", [0.5, 1e3, 1e90])
def test_eight_rays_are_made_ready_as_each_is(reach, drift, is_turned):
    rng = np.random.default_rng(7)
    pose = Pose(shapes.rotation(3), np.array([0.3, -0.2, 0.1])) if is_turned else Pose()
    model = model_of(shapes.sphere(subdivisions=1), poses=[pose])
    origins = reach * rng.normal(size=(ray_lanes.RAY_CHUNK, 3))
    directions = rng.normal(size=(ray_lanes.RAY_CHUNK, 3))
    directions -= rng.integers(0, 2, (ray_lanes.RAY_CHUNK, 1)) * origins / reach
    directions[::3] *= 10.0 ** rng.uniform(-300, 300, (len(directions[::3]), 1))
    directions[1::7, 0] = 0.0
    directions[2::7, 1:] = -0.0
    order = rng.permutation(ray_lanes.RAY_CHUNK)
    aims, views = np.empty(ray_lanes.AIM_SIZE, np.float32), np.empty(ray_lanes.VIEW_SIZE)
    made_ready(model.frames, model.parts, drift, origins, directions, 3 * order, np.inf, aims, views)

    for k, row in enumerate(order):
        is_near, entry, aim, view = one_made_ready(
            model.frames, model.parts, origins[row], directions[row], drift
        )
        assert (aims[ray_lanes.RAY_CHUNK * ray_lanes.AIM_BOUND + k] < 0.0) != is_near
        assert views[ray_lanes.RAY_CHUNK * ray_lanes.VIEW_IS_SOUND + k] == 1.0
        if is_near:
            assert ray_lanes.aim_of(aims, k) == aim
            assert ray_lanes.view_of(views, k) == view
            assert views[ray_lanes.RAY_CHUNK * ray_lanes.VIEW_START + k] == entry
        assert ray_lanes.direction_of(views, k) == ray_lanes.scaled_direction(*directions[row])


@pytest.mark.parametrize("bad", [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, -np.inf)])
@pytest.mark.parametrize("place", [0, 3, 7])
def test_a_ray_that_cannot_be_asked_does_not_disturb_the_seven_beside_it(place, bad):
    model = model_of(shapes.sphere(subdivisions=2))
    rng = np.random.default_rng(5)
    origins, directions = 0.3 * rng.normal(size=(8, 3)), rng.normal(size=(8, 3))
    expected = Hits(model, origins, directions)
    others = np.arange(8) != place

    for disturbed in ((np.where(others[:, None], origins, bad), directions), (origins, None)):
        starts, ways = disturbed
        if ways is None:
            ways = np.where(others[:, None], directions, bad)
        found = Hits(model, starts, ways)
        assert np.isnan(found.distance[place])
        assert found.part[place] == NO_PART and found.zero_row == ray_queries.NO_ROW
        assert np.array_equal(found.reals[others], expected.reals[others])
        assert np.array_equal(found.choices[others], expected.choices[others])


@pytest.mark.parametrize("count", [1, 7, 8, 9, 63, 64, 65, 130])
def test_any_number_of_rays_is_answered_as_one_by_one(count):
    model = model_of(*(shapes.moved(shapes.sphere(0.4, 2), (x, 0, 0)) for x in range(4)), is_fused=True)
    rng = np.random.default_rng(count)
    origins, directions = rng.normal((1.5, 0.0, 0.0), size=(count, 3)), rng.normal(size=(count, 3))
    together = Hits(model, origins, directions, limit=3.0)

    for k in range(count):
        alone = Hits(model, origins[k], directions[k], limit=3.0)
        assert np.array_equal(alone.reals[0], together.reals[k], equal_nan=True)
        assert np.array_equal(alone.choices[0], together.choices[k])
