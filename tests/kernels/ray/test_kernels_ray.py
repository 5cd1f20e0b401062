"""Kernels of the ray traversal: boxes, edge functions, ties, row order, and packets of eight rays.

The tests of queries in `tests/scene` compare their hits with the oracle.
"""

from fractions import Fraction

import numba
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from models import arrays_of, model_of
from part_arrays import part_arrays

from proximity.kernels import answers
from proximity.kernels.geometry.frames import direction_to_local, to_local
from proximity.kernels.layout import NO_FACE, NO_PART, NODE_STRIDE, ModelArrays
from proximity.kernels.ray import ray_lanes, walk
from proximity.kernels.scene.queries import ray_queries
from proximity.native import packed
from proximity.native.simd import bits, lane, splat32
from proximity.pose import Pose

ALL_ROWS = np.empty(0, np.int64)


class Hits:
    """The columns of `cast_batch` by name."""

    def __init__(self, model, origins, directions, *, limit=np.inf, order=ALL_ROWS, rows=None):
        origins, directions = np.broadcast_arrays(
            np.atleast_2d(np.asarray(origins, float)), np.atleast_2d(np.asarray(directions, float))
        )
        table = np.full((len(origins), answers.RAY_ANSWER_WIDTH), 7.0)
        self.reals, self.choices = (
            table[:, : answers.RAY_ANSWER_REALS],
            table.view(np.int32)[:, answers.RAY_ANSWER_PART :],
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
        self.distance, self.point = self.reals[:, answers.RAY_ANSWER_DISTANCE], self.reals[:, 1:4]
        self.normal, self.barycentric = self.reals[:, 4:7], self.reals[:, 7:10]
        self.part, self.face = self.choices.T


def directions_of(count, seed):
    return np.random.default_rng(seed).normal(size=(count, 3))


FINE_BOX = shapes.quartered(*shapes.quartered(*shapes.cube(2.0, (0.0, 0.0, 0.0))))
SPHERE = shapes.sphere(subdivisions=2)


def test_direction_of_min_and_largest_numbers_is_followed():
    model = model_of(shapes.cube())
    for number in (5e-324, 1e-308, 1e-300, 1e300, 1.7e308):
        hits = Hits(model, [0.25, 0.5, -1.0], [0.0, 0.0, number])
        assert hits.distance[0] == pytest.approx(1.0, rel=1e-15)
        assert Hits(model, [0.25, 0.5, -1.0], [0.0, 0.0, -number]).face[0] == NO_FACE


def test_no_ray_of_a_lattice_slips_between_faces_of_a_lattice():
    """Rays along axes and diagonals, all exactly through corners and along edges."""
    vertices, faces = FINE_BOX
    model = model_of((vertices, faces))
    steps = np.arange(-1.0, 1.25, 0.25)
    y, z = (grid.ravel() for grid in np.meshgrid(steps, steps))
    hits = Hits(model, np.stack([np.full_like(y, -3.0), y, z], axis=1), [1.0, 0.0, 0.0])
    assert (hits.distance == 2.0).all()
    ways = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 3)
    ways = ways[np.any(ways != 0.0, axis=1)]
    hits = Hits(model, np.zeros(3), ways)
    np.testing.assert_allclose(hits.distance, np.linalg.norm(ways, axis=1), rtol=1e-15)


@pytest.mark.parametrize("count", [2, 15, 16, 17, 64, 400])
@pytest.mark.parametrize("mesh", [shapes.tetrahedron(), FINE_BOX, SPHERE], ids=["one block", "ties", "ball"])
def test_rays_that_are_walked_in_turns_hit_the_same(mesh, count):
    """The model is made to look larger than the caches; some rays miss, stop short, or are invalid."""
    model = model_of(mesh)
    padding = np.zeros(ray_queries.IN_TURNS_FROM // 8)
    larger = packed(ModelArrays(np.concatenate([model.reals, padding]), *arrays_of(model)[1:]))
    origins, directions = (
        3.0 * directions_of(count, 1),
        -directions_of(count, 1) + directions_of(count, 2) / 4,
    )
    directions[::7], directions[5::13], origins[3::11] = [0.0, 0.0, 1.0], 0.0, np.nan
    origins[::14], origins[7::14] = [0.25, 0.5, -9.0], [0.5, 0.5, -9.0]
    for limit in (np.inf, 2.0):
        tables = [np.full((count, answers.RAY_ANSWER_WIDTH), 7.0) for _ in range(2)]
        for asked, table in zip((model.packed, larger), tables, strict=True):
            ray_queries.cast_batch(asked, origins, directions, ALL_ROWS, np.array([limit]), table)
        assert tables[0].tobytes() == tables[1].tobytes()
        assert count < 15 or limit < np.inf or np.isfinite(tables[0][:, 0]).any()


@pytest.mark.internals
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-8, 1e-15, 1e-160]))
def test_the_side_of_an_edge_is_never_wrong(seed, size):
    """One or both of two triangles at an edge may be hit, never neither."""
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


@numba.njit
def _open_lanes(node, ox, oy, oz, dx, dy, dz, best, margin):
    """Open lanes, and the bound of lane 0."""
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
    """The ray ends at a corner of the box, at a parameter equal to the bound."""
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


def test_a_ray_that_starts_on_the_surface_hits_it_at_once():
    vertices, faces = SPHERE
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


def test_of_equal_faces_the_lowest_slot_is_taken():
    vertices, faces = shapes.grid(2, 2)
    copies = np.concatenate([faces] * 20)
    model = model_of((vertices, copies))
    slot_faces = part_arrays(model, 0).bvh.slot_faces
    hits = Hits(model, [0.6, 0.3, 1.0], [0.0, 0.0, -1.0])
    equal = np.flatnonzero(np.isin(slot_faces, np.flatnonzero((copies == copies[hits.face[0]]).all(axis=1))))
    assert slot_faces[equal[0]] == hits.face[0]


@pytest.mark.parametrize("is_fused", [False, True])
def test_of_equal_parts_the_lowest_is_taken(is_fused):
    meshes = [shapes.moved(shapes.cube(), (0.0, 0.0, 5.0)), *[FINE_BOX] * 9]
    hits = Hits(model_of(*meshes, is_fused=is_fused), [0.1, 0.2, -3.0], [[0.0, 0.0, 1.0], [0.01, 0.02, 1.0]])
    assert (hits.part == 1).all()


def test_a_face_without_area_answers_against_the_ray():
    """Corners on a line within rounding: if it is hit, the normal is finite."""
    vertices = np.array(
        [[0.1, 0.1, 0.0], [0.3, 0.3, 0.0], [0.7, 0.7, 0.0], [5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [6.0, 0.0, 0.0]]
    )
    model = model_of((vertices, np.array([[0, 1, 2], [3, 4, 5]])))
    targets = np.linspace(0.1, 0.7, 500)[:, None] * [1.0, 1.0, 0.0]
    hits = Hits(model, [0.3, -0.2, 1.0], targets - [0.3, -0.2, 1.0])
    found = hits.face == 0
    np.testing.assert_allclose(np.linalg.norm(hits.normal[found], axis=1), 1.0, rtol=1e-12)


def test_the_order_changes_no_answer_and_names_the_rows_to_fill():
    model = model_of(shapes.torus())
    origins, directions = directions_of(100, 15), directions_of(100, 16)
    plain = Hits(model, origins, directions)
    some = np.random.default_rng(1).permutation(100)[:60]
    hits = Hits(model, origins, directions, order=some)
    assert np.array_equal(hits.reals[some], plain.reals[some], equal_nan=True)
    rest = np.setdiff1d(np.arange(100), some)
    assert (hits.reals[rest] == 7.0).all() and (hits.choices[rest] == 7).all()


@numba.njit
def made_ready(frames, parts, drift, origins, directions, offsets, limit, aims, views):
    views[ray_lanes.RAY_CHUNK * ray_lanes.VIEW_REACH : ray_lanes.RAY_CHUNK * (ray_lanes.VIEW_REACH + 1)] = (
        limit
    )
    for at in range(0, ray_lanes.RAY_CHUNK, 8):
        ray_lanes.make_ready(frames, parts, 0, drift, origins, directions, offsets, at, aims, views)


@numba.njit
def one_made_ready(frames, parts, origin, way, drift):
    """Prepare one ray by the formulas of a part with its own frame."""
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
