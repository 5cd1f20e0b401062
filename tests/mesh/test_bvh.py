"""The tree over triangles: valid for any input, and exact conversion to the local frame."""

from fractions import Fraction

import numpy as np
import pytest
import shapes
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from proximity.errors import MeshError
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    MAX_DEPTH,
    NO_FACE,
    NODE_CHILDREN,
    NODE_STRIDE,
    STACK_SIZE,
)
from proximity.mesh.bvh import Bvh, build_bvh, local_frame


def built(vertices, faces=None):
    """Return the checked tree over a mesh, or over triangles (F, 3, 3), in its local frame."""
    if faces is None:
        vertices, faces = vertices.reshape(-1, 3), np.arange(vertices.size // 3).reshape(-1, 3)
    vertices, faces = np.asarray(vertices, float), np.ascontiguousarray(faces, dtype=np.int32)
    frame = local_frame(vertices.min(axis=0), vertices.max(axis=0))
    local = np.ascontiguousarray(frame.of(vertices))
    bvh = build_bvh(local, faces)
    return bvh, bvh.check(local, faces), local, faces


def random_triangles(rng, count, size=0.1):
    return rng.uniform(-1, 1, (count, 1, 3)) + size * rng.uniform(-1, 1, (count, 3, 3))


@pytest.mark.parametrize("count", range(1, 21))
def test_few_faces_make_a_tree_that_holds_together(count):
    bvh, depth, _, _ = built(random_triangles(np.random.default_rng(count), count))

    assert depth <= 2
    assert -(-count // LANES) <= bvh.block_count <= count
    assert (bvh.slot_faces != NO_FACE).sum() == count


def test_one_face_is_a_root_with_one_leaf():
    bvh, depth, _, _ = built(np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float))

    assert (bvh.node_count, bvh.block_count, depth) == (1, 1, 1)
    assert bvh.slot_faces.tolist() == [0] + [NO_FACE] * 7
    block = bvh.blocks.reshape(9, LANES)
    assert np.isfinite(block[:, 0]).all() and np.isnan(block[:, 1:]).all()
    assert (bvh.nodes[1:8] == np.inf).all() and (bvh.nodes[25:32] == -np.inf).all()


def exponential_sizes(count):
    """Return triangles of sizes 1e-30 to 1, each at its size from the origin."""
    scale = 10.0 ** np.linspace(-30, 0, count)
    return scale[:, None, None] * np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1]]) * 0.9


def nested_around_a_point(count):
    """Return triangles whose boxes all contain the origin: no plane separates two."""
    return 0.9 ** np.arange(count)[:, None, None] * np.array([[-1, -1, -1], [1, 1, 1], [1, -1, 1]], float)


BUILDS = {
    "copies of one triangle": lambda rng: np.tile(rng.uniform(-1, 1, (1, 3, 3)), (10_000, 1, 1)),
    "one centroid, all sizes": lambda rng: nested_around_a_point(2000),
    "one point": lambda rng: np.zeros((500, 3, 3)),
    "two places": lambda rng: np.repeat(rng.uniform(-1, 1, (2, 3, 3)), [4999, 1], axis=0),
    "on a line": lambda rng: np.linspace(0, 1, 3000)[:, None, None] * np.ones((1, 3, 3)),
    "along a line, long": lambda rng: rng.random((900, 3, 1)) * np.ones((1, 1, 3)),
    "soup": lambda rng: random_triangles(rng, 20_000),
    "large soup": lambda rng: random_triangles(rng, 5000, size=2.0),
    "exponential sizes": lambda rng: exponential_sizes(5000),
    "exponential places": lambda rng: 2.0 ** -rng.uniform(0, 1000, (5000, 1, 3)) * np.ones((1, 3, 1)),
    "needles": lambda rng: np.concatenate([rng.uniform(-1, 1, (3000, 2, 3)), np.zeros((3000, 1, 3))], 1),
    "flat": lambda rng: random_triangles(rng, 3000) * [1, 1, 0],
    "clusters of clusters": lambda rng: sum(
        10.0**-k * rng.integers(-1, 2, (4000, 1, 3)) for k in range(8)
    ) + 1e-9 * rng.normal(size=(4000, 3, 3)),
}  # fmt: skip


@pytest.mark.parametrize("name", BUILDS)
def test_tree_holds_together_and_is_not_deep(name):
    triangles = BUILDS[name](np.random.default_rng(7))

    bvh, depth, _, _ = built(triangles)

    assert depth <= MAX_DEPTH // 2
    if name == "copies of one triangle":
        # No plane separates them: eight children a node, leaves of eight, at least log8(10000 / 8) levels.
        assert depth <= 5
        assert 10_000 / LANES <= bvh.block_count <= 2 * 10_000 / LANES
    # Leaves are filled well enough for eight lanes to be efficient.
    assert bvh.block_count <= len(triangles)
    assert bvh.node_count <= bvh.block_count


@pytest.mark.parametrize(
    "mesh", [shapes.grid(40, 30), shapes.sphere(1.0, 4), shapes.torus(n=60, m=40), shapes.cube()]
)
def test_ordinary_mesh_fills_its_leaves(mesh):
    bvh, depth, _, faces = built(*mesh)

    assert depth <= 6
    assert len(faces) / (LANES * bvh.block_count) >= 0.5


def test_garbage_bits_make_a_tree():
    rng = np.random.default_rng(7)
    vertices = rng.integers(0, 2**64, (3000, 3), dtype=np.uint64).view(np.float64)
    vertices = vertices[(np.abs(vertices) < 1e140).all(axis=1)]  # finite, and accepted by `local_frame`
    faces = rng.integers(0, len(vertices), (5000, 3))

    with np.errstate(under="ignore"):
        built(vertices, faces)


def test_faces_of_one_vertex_and_repeated_corners_are_kept():
    rng = np.random.default_rng(7)

    built(rng.uniform(-1, 1, (50, 3)), rng.integers(0, 50, (2000, 3)) // 7 * 7)


def test_same_faces_give_the_same_bits():
    triangles = random_triangles(np.random.default_rng(7), 5000)

    first, second = built(triangles)[0], built(triangles.copy())[0]

    for name in ("nodes", "blocks", "slot_faces"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@given(
    npst.arrays(
        np.float64, st.tuples(st.integers(1, 60), st.just(3), st.just(3)), elements=st.floats(-1e100, 1e100)
    )
)
@example(np.zeros((9, 3, 3)))
@example(np.full((20, 3, 3), 5e-324))
@example(np.full((1, 3, 3), -1e150))
def test_any_triangles_make_a_tree(triangles):
    extent = float((triangles.max(axis=(0, 1)) - triangles.min(axis=(0, 1))).max())
    assume(extent == 0.0 or extent >= 1e-140)

    with np.errstate(under="ignore"):
        built(triangles)


def test_blocks_hold_the_corners_of_their_faces():
    bvh, _, local, faces = built(*shapes.torus())
    slots = np.flatnonzero(bvh.slot_faces != NO_FACE)
    blocks = bvh.blocks.reshape(-1, 9, LANES)

    held = blocks[slots // LANES, :, slots % LANES].reshape(-1, 3, 3)

    np.testing.assert_array_equal(held, local[faces[bvh.slot_faces[slots]]])


def test_stack_is_enough_for_the_deepest_tree():
    # Each level leaves at most seven children, and a store writes eight numbers from the top on.
    assert STACK_SIZE >= (LANES - 1) * MAX_DEPTH + LANES


def spoilt(change):
    bvh, _, local, faces = built(random_triangles(np.random.default_rng(7), 200))
    nodes, slot_faces = bvh.nodes.copy(), bvh.slot_faces.copy()
    change(nodes, slot_faces)
    return Bvh(nodes, bvh.blocks, slot_faces), local, faces


def _lose_a_face(nodes, slot_faces):
    slot_faces[np.flatnonzero(slot_faces != NO_FACE)[3]] = NO_FACE


def _shrink_a_leaf(nodes, slot_faces):
    children = nodes.view(np.int32).reshape(-1, NODE_STRIDE)[:, NODE_CHILDREN : NODE_CHILDREN + LANES]
    node, lane = np.argwhere((children < 0) & (nodes.reshape(-1, NODE_STRIDE)[:, :LANES] < np.inf))[0]
    nodes[NODE_STRIDE * node + lane] += 1e-3


def _widen_a_child(nodes, slot_faces):
    nodes[NODE_STRIDE + 24] = 7.0


def _reach_a_leaf_twice(nodes, slot_faces):
    children = nodes.view(np.int32).reshape(-1, NODE_STRIDE)[:, NODE_CHILDREN : NODE_CHILDREN + LANES]
    node, lane = np.argwhere(children < 0)[0]
    children[node, lane] = ~(~children[node, lane] + 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_lose_a_face, "every face lies in exactly one slot"),
        (_shrink_a_leaf, "a leaf's box holds its faces"),
        (_widen_a_child, "a child's box lies in its parent's"),
        (_reach_a_leaf_twice, "every node and leaf is reached once|a leaf's box holds its faces"),
    ],
)
def test_check_finds_a_spoilt_tree(change, message):
    bvh, local, faces = spoilt(change)

    with pytest.raises(AssertionError, match=message):
        bvh.check(local, faces)


def assert_frame_is_exact(points):
    frame = local_frame(points.min(axis=0), points.max(axis=0))
    local = frame.of(points)
    scale = Fraction(frame.scale)
    assert np.frexp(frame.scale)[0] == 0.5, "a power of two"
    for axis in range(3):
        centre = Fraction(float(frame.centre[axis]))
        for found, point in zip(local[:, axis].tolist(), points[:, axis].tolist(), strict=True):
            assert Fraction(found) == (Fraction(point) - centre) * scale
    return local


PLACES = {
    "at the origin": (0.0, 0.0, 0.0), "beside the origin": (0.7, -0.7, 0.1), "1 m away": (1.0, -1.0, 1.0),
    "10 km away": (1e4, -1e4, 1e4), "10 km away along x": (1e4, 0.0, 0.0),
    "at odd places": (12345.678901, -0.3333333, 9.87654321e5),
}  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 0.3, 1.0, 47.0, 1e5, 1e60])
def test_moving_to_the_local_frame_does_not_round(place, size):
    rng = np.random.default_rng(7)
    points = np.array(PLACES[place]) + size * rng.uniform(-1, 1, (40, 3)) * [1.0, 0.3, 1e-3]

    local = assert_frame_is_exact(points)

    assert (np.abs(local) <= 1.0).all()


@given(
    npst.arrays(np.float64, (4, 3), elements=st.floats(-1e3, 1e3, allow_subnormal=False)),
    npst.arrays(np.float64, (3,), elements=st.floats(-1e7, 1e7, allow_subnormal=False)),
    st.integers(-60, 60),
)
def test_moving_never_rounds_for_any_part_anywhere(points, place, power):
    points = points * 2.0**power + place
    extent = (points.max(axis=0) - points.min(axis=0)).max()
    assume(extent == 0.0 or extent > 1e-140)
    assume((np.abs(points[points != 0.0]) > 1e-250).all())

    local = assert_frame_is_exact(points)

    assert (np.abs(local) <= 1.0).all()


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 1e60])
def test_part_fills_its_local_frame_wherever_it_is(size):
    for place in (0.0, 1.0, 1e3, 1e6):
        points = place * size + size * np.array([[-1.0, -1, -1], [1, 1, 1]])
        frame = local_frame(points[0], points[1])
        local = frame.of(points)

        assert np.abs(local).max() <= 1.0
        assert (local[1] - local[0]).min() >= 0.25


@pytest.mark.parametrize("value", [0.0, 5e-324, -3e-310, 1e-160, 2.5, 1e150])
def test_part_without_extent_is_moved_to_zero(value):
    point = np.full(3, value)

    frame = local_frame(point, point)

    assert frame.of(point).tolist() == [0.0, 0.0, 0.0]
    assert frame.scale == 1.0


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (
            2e150,
            r"reaches to 2e\+150 m and is 2e\+150 m long; coordinates up to 1e\+150 m and sizes from 1e-1",
        ),
        (1e-151, r"reaches to 1e-151 m and is 1e-151 m long"),
    ],
)
def test_part_that_is_too_large_or_too_small_is_refused_with_the_limits(size, words):
    with pytest.raises(MeshError, match=words):
        local_frame(np.zeros(3), np.array([1.0 if size > 1.0 else 0.0, size, 0.0]))
    local_frame(np.full(3, -1e150), np.full(3, 1e150))  # the limits themselves are accepted
    local_frame(np.zeros(3), np.array([1e-150, 0.0, 0.0]))


def test_block_and_node_counts_are_those_of_the_arrays():
    bvh = Bvh(np.zeros(3 * NODE_STRIDE, np.float32), np.zeros(2 * BLOCK_STRIDE), np.zeros(16, np.int32))

    assert (bvh.node_count, bvh.block_count) == (3, 2)
