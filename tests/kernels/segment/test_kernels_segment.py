"""Segments against boxes, triangles, one part and a scene: correct bounds, and every degenerate case."""

from fractions import Fraction

import numba
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from models import model_of
from nodes import node_of

import oracle
from proximity.kernels import answers
from proximity.kernels.layout import LANES, NO_SLOT
from proximity.kernels.scene.queries import segment_queries
from proximity.kernels.segment import plan as plans
from proximity.kernels.segment.box import node_bounds_sq, open_bound
from proximity.kernels.segment.plan import PLAN, PROBE, make_plan, stack_plans, stack_probes
from proximity.kernels.segment.triangle import WITNESS
from proximity.kernels.segment.walk import segment_in_block
from proximity.native.simd import bits, lane, splat32

ALL_ROWS = np.empty(0, np.int64)
ROUNDING = 2.0**-52
TRIANGLE = (np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]]))
WITHOUT_AREA = (
    np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [0.0, 0.0, 3.0]]),
    np.array([[0, 1, 2], [3, 3, 3], [0, 1, 3], [2, 2, 0]]),
)
MESHES = {
    "triangle": TRIANGLE,
    "without area": WITHOUT_AREA,
    "cube": shapes.cube(),
    "grid": shapes.grid(),
    "torus": shapes.torus(),
    "hollow cube": shapes.hollow_cube(),
}


class Found:
    """The columns of `segment_batch` by name."""

    def __init__(self, model, starts, ends, *, limit=np.inf, order=ALL_ROWS):
        starts, ends = np.broadcast_arrays(
            np.atleast_2d(np.asarray(starts, float)), np.atleast_2d(np.asarray(ends, float))
        )
        self.starts, self.ends = np.ascontiguousarray(starts), np.ascontiguousarray(ends)
        table = np.full((len(starts), answers.SEGMENT_ANSWER_WIDTH), 7.0)
        self.reals = table[:, : answers.SEGMENT_ANSWER_REALS]
        self.choices = table.view(np.int32)[:, answers.SEGMENT_ANSWER_PART :]
        self.choices[:] = 7
        segment_queries.segment_batch(model.packed, self.starts, self.ends, order, np.array([limit]), table)
        self.distance, self.fraction = self.reals[:, 0], self.reals[:, 7]
        self.on_segment, self.on_solid = self.reals[:, 1:4], self.reals[:, 4:7]
        self.barycentric = self.reals[:, 8:11]
        self.part, self.face = self.choices.T


def assert_right(mesh, starts, ends):
    """Compare distances with the oracle's; check that the witness points are on segment and face."""
    vertices, faces = np.asarray(mesh[0]), np.asarray(mesh[1])
    found = Found(model_of(mesh), starts, ends)
    largest = max(np.abs(vertices).max(), np.abs(found.starts).max(), np.abs(found.ends).max())
    expected = oracle.segment_distance(vertices, faces, found.starts, found.ends).distance
    off = np.abs(found.distance - expected)
    assert (off <= 1e-12 * expected + 1e-15 * largest).all(), off.max()
    room = 4.0 * ROUNDING * largest
    gap = np.linalg.norm(found.on_segment - found.on_solid, axis=1)
    assert np.abs(gap - found.distance).max() <= room
    place = found.starts + found.fraction[:, None] * (found.ends - found.starts)
    assert np.abs(place - found.on_segment).max() <= room
    assert (found.barycentric >= 0.0).all()
    assert np.abs(found.barycentric.sum(axis=1) - 1.0).max() <= 4.0 * ROUNDING
    corners = vertices[faces[found.face]]
    assert np.abs((found.barycentric[:, :, None] * corners).sum(axis=1) - found.on_solid).max() <= room
    assert ((found.fraction >= 0.0) & (found.fraction <= 1.0)).all()
    return found


def some_edges(mesh, count, seed):
    """Corners a, b, c of random faces, and random vectors (count, 3)."""
    vertices, faces = mesh
    rng = np.random.default_rng(seed)
    chosen = faces[rng.integers(0, len(faces), count)]
    return *np.moveaxis(vertices[chosen], 1, 0), rng.normal(size=(count, 3))


def needles(aspect, count=40):
    """Triangles at random poses, *aspect* times as long as high."""
    rng = np.random.default_rng(5)
    triangles = []
    for seed in range(count):
        along, across, _ = shapes.rotation(seed)
        origin = rng.normal(size=3)
        triangles.append([origin, origin + along, origin + rng.random() * along + across / aspect])
    return np.array(triangles).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


@pytest.fixture(scope="module", params=sorted(MESHES))
def mesh(request):
    return MESHES[request.param]


@numba.njit(error_model="numpy")
def open_lanes(node, segments, best_sq, far, opened):
    """Lanes that a traversal with that best opens for each segment, and a flag for far segments."""
    plan, probe = stack_plans(1)[0], stack_probes(1)[0]
    for i in range(len(segments)):
        s = segments[i]
        make_plan(plan, probe, s[0], s[1], s[2], s[3], s[4], s[5])
        far[i] = plan.is_far
        bounds = node_bounds_sq(node, 0, plan, probe, plan.is_far != 0)
        opened[i] = bits(bounds <= splat32(open_bound(plan, best_sq[i], np.inf)))


@numba.njit(error_model="numpy")
def bounds_of(node, segment):
    """The bounds of a node's boxes, the square subtracted from them, and the bound for a crossing at 0.5."""
    plan, probe, bounds = stack_plans(1)[0], stack_probes(1)[0], np.zeros(LANES)
    s = segment
    make_plan(plan, probe, s[0], s[1], s[2], s[3], s[4], s[5])
    found = node_bounds_sq(node, 0, plan, probe, plan.is_far != 0)
    for k in range(LANES):
        bounds[k] = lane(found, k)
    return bounds, plan.offset, open_bound(plan, 0.0, 0.5)


def distance_sq_to_segment(point, start, end):
    """Exact squared distance of a point to a segment."""
    p, a, b = ([Fraction(x) for x in each.tolist()] for each in (point, start, end))
    way, arm = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(a, p, strict=True)]
    length_sq = sum(x * x for x in way)
    t = min(max(sum(x * y for x, y in zip(way, arm, strict=True)) / length_sq, 0), 1) if length_sq else 0
    return sum((x - t * y) ** 2 for x, y in zip(arm, way, strict=True))


@pytest.mark.internals
@pytest.mark.parametrize("reach", [0.3, 3.0, 1e2, 1e6, 1e12])
@pytest.mark.parametrize("size", [0.0, 1e-6, 0.1, 1.0])
def test_box_that_holds_the_nearest_point_is_always_opened(reach, size):
    rng = np.random.default_rng(7)
    middles = rng.uniform(-1.0 + size / 2, 1.0 - size / 2, (LANES, 1, 3))
    contents = middles + size * rng.uniform(-0.5, 0.5, (LANES, 4, 3))
    segments = rng.normal(size=(200, 6)) * reach
    segments[::4, 3:] = segments[::4, :3] + 1e-3 * rng.normal(size=(50, 3))
    segments[1::4, 3:] = segments[1::4, :3] + np.eye(3)[rng.integers(0, 3, 50)] * reach
    # Through a box or near it, far at both ends.
    aim = contents[rng.integers(0, LANES, 50), 0] + rng.choice([0.0, 1e-9, 0.1], (50, 1))
    way = rng.normal(size=(50, 3)) * reach
    segments[2::4] = np.concatenate([aim - way, aim + way], axis=1)
    each = [
        [float(min(distance_sq_to_segment(p, s[:3], s[3:]) for p in box)) for box in contents]
        for s in segments
    ]
    # As low as a traversal may compute it for the cut segment.
    best_sq = np.maximum(np.sqrt(np.min(each, axis=1)) * (1.0 - 2.0**-48) - 2.0**-48, 1e-300) ** 2
    opened, far = np.empty(200, np.int64), np.empty(200)

    open_lanes(node_of(contents), segments, best_sq, far, opened)

    nearest = np.argmin(each, axis=1)
    assert ((opened >> nearest) & 1 == 1).all()
    assert (far == (reach > 10.0)).mean() > 0.7


@pytest.mark.internals
def test_bounds_are_tight_along_the_ways_that_matter():
    """Within a tenth of the distance, for small boxes near, beyond and far from segments."""
    rng = np.random.default_rng(8)
    for scale in (1.0, 1e5):
        for _ in range(100):
            contents = rng.uniform(-1.0, 1.0, (LANES, 1, 3)) + 0.01 * rng.normal(size=(LANES, 4, 3))
            contents = np.clip(contents, -1.0, 1.0)
            segment = np.concatenate([rng.normal(size=3), rng.normal(size=3)]) * scale
            bounds, offset, _ = bounds_of(node_of(contents), segment)
            exact = [
                float(min(distance_sq_to_segment(p, segment[:3], segment[3:]) for p in box))
                for box in contents
            ]
            lower, exact = np.sqrt(bounds + offset), np.sqrt(exact)
            assert (lower <= exact * (1 + 1e-6)).all()
            assert (lower >= 0.9 * exact - 0.1).all()


@pytest.mark.internals
def test_unused_lanes_are_never_opened():
    node = node_of(np.zeros((1, 1, 3)))
    segments = np.array([[0.0, 0, 0, 1, 1, 1], [1e6, 1e6, 0, 2e6, 0, 0], [-1e99, 0, 0, 1e99, 1, 1]])
    opened, far = np.empty(3, np.int64), np.empty(3)

    open_lanes(node, segments, np.full(3, np.inf), far, opened)

    assert (opened == 1).all()


@pytest.mark.internals
def test_boxes_behind_a_crossing_are_closed():
    contents = np.linspace(-0.9, 0.9, LANES)[:, None, None] + np.zeros((LANES, 1, 3))
    bounds, _, limit = bounds_of(node_of(contents), np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]))

    assert (bounds < 1.1 * plans.TOUCHING).all() and (np.diff(bounds) > 0.0).all()
    assert (bounds <= limit).tolist() == [True] * 4 + [False] * 4


def plan_of(start, end):
    plan = np.zeros(1, PLAN)[0]
    make_plan(plan, np.zeros(1, PROBE)[0], *(float(x) for x in (*start, *end)))
    return plan


@pytest.mark.internals
def test_segment_near_the_part_is_kept_as_it_is():
    plan = plan_of((-2.0, 0.1, 0.2), (2.0, 0.3, 1.9))

    assert plan.start.tolist() == [-2.0, 0.1, 0.2]
    assert plan.end.tolist() == [2.0, 0.3, 1.9]
    assert (plan.low, plan.high, plan.is_far, plan.offset) == (0.0, 1.0, 0, 0.0)


@pytest.mark.internals
@pytest.mark.parametrize("far", [10.0, 1e6, 1e15])
def test_long_segment_is_cut_on_the_line_to_the_last_bit(far):
    rng = np.random.default_rng(9)
    for _ in range(50):
        start, end = far * rng.normal(size=3), far * rng.normal(size=3)
        # The middle third passes near the origin.
        end = -start * rng.uniform(0.1, 3.0) + rng.normal(size=3)
        plan = plan_of(start, end)
        if far > 10.0:
            assert max(np.abs(plan.start).max(), np.abs(plan.end).max()) < 1e-3 * far
        for point, fraction in ((plan.start, plan.low), (plan.end, plan.high)):
            for axis in range(3):
                exact = Fraction(start[axis]) + Fraction(fraction) * (
                    Fraction(end[axis]) - Fraction(start[axis])
                )
                assert abs(Fraction(point[axis]) - exact) <= Fraction(2.0**-52) * abs(exact)


@pytest.mark.internals
def test_cut_never_takes_the_nearest_point():
    """Corners of the local cube are the surface points farthest from the centre of the cut."""
    rng = np.random.default_rng(10)
    for far in (3.0, 100.0, 1e7):
        for _ in range(100):
            start, end = far * rng.normal(size=3), far * rng.normal(size=3)
            plan = plan_of(start, end)
            for _ in range(5):
                p = rng.choice([-1.0, 1.0], 3)
                t = np.clip((p - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
                assert plan.low - 1e-12 <= t <= plan.high + 1e-12


@pytest.mark.parametrize("length", [1e-200, 1e-15, 1e-8, 1e-2, 1.0, 10.0])
def test_segments_of_any_length(mesh, length):
    rng = np.random.default_rng(11)
    starts = rng.normal(size=(200, 3))
    assert_right(mesh, starts, starts + length * rng.normal(size=(200, 3)))


def test_segments_between_points_of_a_lattice(mesh):
    """Nearly all of them touch the mesh, cross at corners, or lie in planes and along edges."""
    rng = np.random.default_rng(12)
    step = np.abs(mesh[0]).max() / 4
    found = assert_right(mesh, step * rng.integers(-2, 5, (400, 3)), step * rng.integers(-2, 5, (400, 3)))
    assert (found.distance == 0.0).sum() > 10


def test_segment_along_an_edge(mesh):
    a, b, _, _ = some_edges(mesh, 200, 13)
    found = assert_right(mesh, a - 0.3 * (b - a), b + 0.4 * (b - a))
    assert found.distance.max() <= 1e-15 * 4


@pytest.mark.parametrize("off", [0.1, 1e-3, 1e-9, 1e-14])
def test_segment_parallel_to_an_edge_or_nearly(mesh, off):
    a, b, _, way = some_edges(mesh, 200, 14)
    assert_right(mesh, a + 0.1 * way, b + 0.1 * way)
    assert_right(mesh, a + off * way, b + off * way)
    assert_right(mesh, a + 0.1 * way, b + 0.1 * way + off * way[::-1])


@pytest.mark.parametrize("off", [0.0, 1e-3, 1e-9, 1e-14])
def test_segment_in_the_plane_of_a_face_or_nearly(mesh, off):
    a, b, c, way = some_edges(mesh, 200, 15)
    assert_right(mesh, a + off * way, a + 0.3 * (b - a) + 0.4 * (c - a) + off * way[::-1])
    assert_right(mesh, a - 2.0 * (b - a) + off * way, a + 3.0 * (c - a) + off * way[::-1])


def test_segment_from_and_through_a_corner_or_an_edge(mesh):
    a, b, c, way = some_edges(mesh, 200, 16)
    inside = (a + b + c) / 3
    for place in (a, 0.25 * a + 0.75 * b, inside):
        assert_right(mesh, place, place + way)
        found = assert_right(mesh, place - way, place + way)
        assert found.distance.max() <= 1e-15 * 8
    assert_right(mesh, inside, inside[::-1])


@pytest.mark.parametrize("aspect", [1e3, 1e6, 1e9, 1e12])
def test_needles(aspect):
    mesh = needles(aspect)
    rng = np.random.default_rng(17)
    assert_right(mesh, rng.normal(size=(200, 3)), rng.normal(size=(200, 3)))
    a, b, c, way = some_edges(mesh, 200, 18)
    place = a + rng.random((200, 1)) * (b - a) + 0.1 * (c - a)
    assert_right(mesh, place - way, place + way)
    assert_right(mesh, place - way, place - 1e-9 * way)
    assert_right(mesh, place - (b - a) + 1e-3 * way, place + (b - a) + 1e-3 * way)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_segments_far_longer_than_the_part_and_far_away(mesh, far):
    rng = np.random.default_rng(19)
    way, place = far * rng.normal(size=(100, 3)), rng.normal(size=(100, 3))
    assert_right(mesh, place - way, place + way)
    assert_right(mesh, way, way + place)
    assert_right(mesh, way, way[::-1])


def test_long_segment_through_a_part_is_as_right_as_a_short_one():
    """Its ends are exact, so that its rounding is the part's, not that of a million part sizes."""
    mesh, far = MESHES["torus"], 2.0**20
    place = np.round(np.random.default_rng(20).normal(size=(200, 3)) * 2**20) / 2**20
    way = np.round(np.random.default_rng(21).normal(size=(200, 3)) * 2**20) / 2**20
    model = model_of(mesh)
    long = Found(model, place - far * way, place + far * way)
    short = Found(model, place - 16 * way, place + 16 * way)

    assert np.abs(long.distance - short.distance).max() <= 8e-15
    assert ((long.distance == 0.0) == (short.distance == 0.0)).all()


@given(
    start=st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    end=st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    corners=st.lists(st.tuples(*[st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-1.0, 1.0)] * 3), min_size=3),
)
def test_any_segment_and_any_triangles(start, end, corners):
    count = len(corners) // 3
    assert_right((np.array(corners), np.arange(3 * count).reshape(-1, 3)), start, end)


@pytest.mark.parametrize(
    "solid", [shapes.cube(2.0, (0, 0, 0)), shapes.sphere(), shapes.octahedron()], ids=["cube", "sphere", "8"]
)
def test_segment_out_of_a_closed_solid_never_slips_through_an_edge_or_a_corner(solid):
    vertices, faces = solid
    rng = np.random.default_rng(22)
    inside = rng.normal(size=(2000, 3)) * rng.choice([0.0, 0.1], (2000, 1))
    face = faces[rng.integers(0, len(faces), 2000)]
    share = rng.choice([0.0, 1.0, 0.5, 0.3], (2000, 1))
    aim = share * vertices[face[:, 0]] + (1.0 - share) * vertices[face[:, 1]]

    out, back = (
        Found(model_of(solid), inside, inside + 2 * (aim - inside)),
        Found(model_of(solid), inside + 4 * (aim - inside), inside),
    )

    assert (out.distance == 0.0).all() and (back.distance == 0.0).all()
    assert np.abs(out.fraction - 0.5).max() <= 1e-15 and np.abs(back.fraction - 0.75).max() <= 1e-15
    assert np.abs(out.on_solid - out.on_segment).max() <= 1e-15 * 4


def test_segment_inside_that_touches_nothing_tells_how_far_the_surface_is():
    found = assert_right(shapes.cube(), (0.25, 0.5, 0.5), (0.9, 0.5, 0.5))
    assert found.distance == pytest.approx([0.1]) and found.fraction == [1.0]


@pytest.mark.parametrize("count", [1, 2, 9])
@pytest.mark.parametrize("is_fused", [False, True])
def test_first_crossing_of_a_scene_is_the_first_of_its_parts(count, is_fused):
    meshes = [shapes.moved(shapes.torus(), 1.3 * np.arange(3) * k) for k in range(count)]
    rng = np.random.default_rng(23)
    starts, ends = rng.uniform(-3, 15, (2, 300, 3))

    found = Found(model_of(*meshes, is_fused=is_fused), starts, ends)

    first = np.full(300, np.inf)
    for each in meshes:
        alone = Found(model_of(each), starts, ends)
        first = np.minimum(first, np.where(alone.distance == 0.0, alone.fraction, np.inf))
    assert ((found.distance == 0.0) == np.isfinite(first)).all()
    hit = np.isfinite(first)
    assert np.abs(found.fraction[hit] - first[hit]).max(initial=0.0) <= 1e-14


def test_order_may_name_some_rows_only():
    found = Found(model_of(shapes.cube()), np.full((3, 3), 2.0), np.full((3, 3), 3.0), order=np.array([1]))

    assert (found.reals[[0, 2]] == 7.0).all() and (found.choices[[0, 2]] == 7).all()
    assert found.distance[1] == pytest.approx(3.0**0.5)


@pytest.mark.internals
def test_lowest_slot_wins_among_equals():
    """Copies of one face: in any tree, the first in leaf order is reported."""
    vertices, faces = TRIANGLE
    model = model_of((vertices, np.repeat(faces, 30, axis=0)))
    plan = np.zeros(1, PLAN)[0]
    found = Found(model, [(0.2, 0.2, 1.0), (0.2, 0.2, -1.0)], [(0.3, 0.3, 2.0), (0.2, 0.2, 1.0)])
    first = int(
        model.words.view(np.int32)[model.parts["slot_faces"][0] + LANES * model.parts["first_block"][0]]
    )

    assert (found.face == first).all() and found.distance.tolist() == [1.0, 0.0]
    make_plan(plan, np.zeros(1, PROBE)[0], 0.0, 0.0, 1.5, 0.1, 0.0, 1.0)
    witness = np.zeros(1, WITNESS)[0]
    _, fraction, slot = segment_in_block(model.reals, 0, plan, np.inf, np.inf, NO_SLOT, witness)
    assert (fraction, slot) == (np.inf, 0)
    # An equally near known slot is kept if lower, and replaced if higher.
    best_sq, _, _ = segment_in_block(model.reals, 1, plan, np.inf, np.inf, NO_SLOT, witness)
    assert segment_in_block(model.reals, 1, plan, best_sq, np.inf, 3, witness)[2] == 3
    assert segment_in_block(model.reals, 1, plan, best_sq, np.inf, 20, witness)[2] == 8
    assert segment_in_block(model.reals, 1, plan, 0.5 * best_sq, np.inf, 20, witness)[2] == 20
