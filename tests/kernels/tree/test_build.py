"""The three steps of tree building: binary halving, subtree reinsertion, and the optimal 8-wide collapse."""

import itertools

import numpy as np
import pytest
import shapes

from proximity.kernels.layout import BOX_STRIDE, FACES_SHIFT, LANES, MAX_DEPTH, NODE_CHILDREN, NODE_STRIDE
from proximity.kernels.tree.binned_sah import LINK_COUNT, LINK_FIRST, LINK_LEFT, LINK_RIGHT, NO_CHILD, halve
from proximity.kernels.tree.builder import build_tree, face_boxes
from proximity.kernels.tree.collapse import widen_tree
from proximity.kernels.tree.reinsertion import improve


def records(lower, upper):
    boxes = np.zeros((len(lower), BOX_STRIDE), np.float32)
    boxes[:, :3], boxes[:, 4:7] = lower, -np.asarray(upper)
    return boxes


def random_boxes(rng, count, size=0.05):
    lower = rng.uniform(-1, 1, (count, 3))
    return records(lower, lower + rng.uniform(0, size, (count, 3)))


def half_areas(boxes):
    x, y, z = -(boxes[..., :3] + boxes[..., 4:7]).T.astype(np.float64)
    return (x * y + y * z + z * x).T


def halved(boxes, leaf_shift=FACES_SHIFT):
    """Boxes and links of the binary tree, the sorted face boxes, and their order."""
    moved, order = boxes.reshape(-1).copy(), np.arange(len(boxes), dtype=np.int32)
    nodes, links = halve(moved, order, leaf_shift)
    return nodes, links, moved.reshape(-1, BOX_STRIDE), order


def assert_binary_tree(nodes, links, faces):
    """Check that nodes are reached once and enclose their children, and that leaves split the faces."""
    boxes = nodes.reshape(-1, BOX_STRIDE)
    seen, used, waiting = np.zeros(len(links), int), np.zeros(len(faces), int), [0]
    while waiting:
        node = waiting.pop()
        seen[node] += 1
        left, right, first, count = links[node]
        if left == NO_CHILD:
            assert right == NO_CHILD
            used[first : first + count] += 1
            expected = faces[first : first + count].min(axis=0)
        else:
            waiting += [left, right]
            expected = np.minimum(boxes[left], boxes[right])
        np.testing.assert_array_equal(boxes[node], expected)
    assert (seen == 1).all() and (used == 1).all()


def cost(nodes, links):
    """Total surface of the inner nodes."""
    return half_areas(nodes.reshape(-1, BOX_STRIDE))[links[:, LINK_LEFT] != NO_CHILD].sum()


@pytest.mark.internals
@pytest.mark.parametrize("leaf_shift", [0, FACES_SHIFT])
@pytest.mark.parametrize("count", [1, 2, 8, 9, 17, 1000])
def test_halving_shares_out_the_faces(count, leaf_shift):
    boxes = random_boxes(np.random.default_rng(count), count)

    nodes, links, moved, order = halved(boxes, leaf_shift)

    assert_binary_tree(nodes, links, moved)
    np.testing.assert_array_equal(moved, boxes[order])
    leaves = links[links[:, LINK_LEFT] == NO_CHILD]
    assert leaves[:, LINK_COUNT].min() >= 1 and leaves[:, LINK_COUNT].max() <= 2**leaf_shift


@pytest.mark.internals
@pytest.mark.parametrize("axis", range(3))
def test_two_heaps_are_divided_between_them(axis):
    rng = np.random.default_rng(7)
    lower = rng.uniform(-0.1, 0.1, (300, 3))
    lower[rng.permutation(300)[:77], axis] += 0.8

    nodes, links, _, _ = halved(records(lower, lower + 0.01))

    sides = nodes.reshape(-1, BOX_STRIDE)[links[0, [LINK_LEFT, LINK_RIGHT]]]
    assert (-(sides[:, axis] + sides[:, 4 + axis]) < 0.3).all(), "no side spans both"
    assert sorted(_face_count(links, side) for side in links[0, [LINK_LEFT, LINK_RIGHT]]) == [77, 223]


def _face_count(links, node):
    if links[node, LINK_LEFT] == NO_CHILD:
        return links[node, LINK_COUNT]
    return sum(_face_count(links, child) for child in links[node, [LINK_LEFT, LINK_RIGHT]])


@pytest.mark.internals
def test_what_no_plane_separates_is_halved_by_count():
    boxes = np.repeat(random_boxes(np.random.default_rng(7), 1), 64, axis=0)

    _, links, _, _ = halved(boxes)

    assert (links[links[:, LINK_LEFT] == NO_CHILD][:, LINK_COUNT] == LANES).all()


@pytest.mark.internals
def test_improving_keeps_the_tree_and_lessens_its_surface():
    rng = np.random.default_rng(7)
    boxes = random_boxes(rng, 3000, size=2.0 ** -rng.uniform(0, 8, (3000, 1)))  # some large, most small
    nodes, links, moved, _ = halved(boxes)
    before, leaves = cost(nodes, links), links[links[:, LINK_LEFT] == NO_CHILD].copy()

    improve(nodes, links)

    assert_binary_tree(nodes, links, moved)
    np.testing.assert_array_equal(links[links[:, LINK_LEFT] == NO_CHILD], leaves)
    assert cost(nodes, links) < 0.97 * before


@pytest.mark.internals
@pytest.mark.parametrize("seed", range(20))
def test_improving_never_adds_surface(seed):
    rng = np.random.default_rng(seed)
    nodes, links, _, _ = halved(random_boxes(rng, int(rng.integers(1, 200)), size=rng.uniform(0, 2)), 0)
    before = cost(nodes, links)

    improve(nodes, links)

    assert cost(nodes, links) <= before * (1 + 1e-5)


@pytest.mark.internals
def test_a_leaf_on_the_wrong_side_is_put_where_it_belongs():
    """Two clusters of four boxes; one box of each is in the other's leaf."""
    lower = np.zeros((8, 3))
    lower[:, 0] = [0.0, 0.1, 0.2, 5.3, 5.0, 5.1, 5.2, 0.3]
    moved = records(lower, lower + 0.05)
    links = np.full((15, 4), NO_CHILD, np.int32)
    nodes = np.zeros((15, BOX_STRIDE), np.float32)
    for leaf in range(8):
        links[7 + leaf, LINK_FIRST], links[7 + leaf, LINK_COUNT] = leaf, 1
        nodes[7 + leaf] = moved[leaf]
    for node in range(6, -1, -1):
        links[node, LINK_LEFT], links[node, LINK_RIGHT] = 2 * node + 1, 2 * node + 2
        nodes[node] = np.minimum(nodes[2 * node + 1], nodes[2 * node + 2])
    flat = nodes.reshape(-1)

    improve(flat, links)

    assert_binary_tree(flat, links, moved)
    widths = -(flat.reshape(-1, BOX_STRIDE)[:, 0] + flat.reshape(-1, BOX_STRIDE)[:, 4])
    assert (np.sort(widths)[-2:] > 5).tolist() == [False, True], "only the root spans both heaps"


def wide_nodes(nodes):
    """For each node the boxes (K, 2, 3) of its children and their references."""
    table = nodes.reshape(-1, NODE_STRIDE)
    references = table.view(np.int32)[:, NODE_CHILDREN : NODE_CHILDREN + LANES]
    for row, names in zip(table, references, strict=True):
        boxes = row[:48].reshape(2, 3, LANES).transpose(2, 0, 1)
        is_used = boxes[:, 0, 0] <= boxes[:, 1, 0]
        yield boxes[is_used], names[is_used]


def surface(nodes):
    """Total surface of the wide nodes, which `widen_tree` minimises."""
    total = 0.0
    for boxes, _ in wide_nodes(nodes):
        x, y, z = boxes[:, 1].max(axis=0).astype(np.float64) - boxes[:, 0].min(axis=0)
        total += x * y + y * z + z * x
    return total


def min_surface(nodes, links):
    """Minimum of that surface by trying all subsets of nodes to keep."""
    areas = half_areas(nodes.reshape(-1, BOX_STRIDE))
    inner = [node for node in range(1, len(links)) if links[node, LINK_LEFT] != NO_CHILD]

    def children(node, kept):
        found = []
        for below in links[node, [LINK_LEFT, LINK_RIGHT]]:
            found += (
                [below] if links[below, LINK_LEFT] == NO_CHILD or below in kept else children(below, kept)
            )
        return found

    choices = itertools.chain.from_iterable(
        itertools.combinations(inner, number) for number in range(len(inner) + 1)
    )
    return min(
        sum(areas[node] for node in (0, *kept))
        for kept in map(set, choices)
        if all(len(children(node, kept)) <= LANES for node in (0, *kept))
    )


@pytest.mark.internals
@pytest.mark.parametrize("seed", range(8))
def test_no_other_wide_tree_has_less_surface(seed):
    rng = np.random.default_rng(seed)
    nodes, links, _, order = halved(random_boxes(rng, int(rng.integers(9, 13)), size=0.5), 0)

    wide, _, _ = widen_tree(nodes, links, order)

    assert surface(wide) == pytest.approx(min_surface(nodes, links), rel=1e-5)


def depth_of(nodes):
    """Levels of a wide tree; checks that every node and leaf is reached once."""
    children = [names for _, names in wide_nodes(nodes)]
    levels, met, level = 0, [0], [0]
    while level:
        levels += 1
        below = [int(name) for node in level for name in children[node]]
        met += below
        level = [name for name in below if name >= 0]
    assert len(set(met)) == len(met)
    assert sum(name >= 0 for name in met) == len(children)
    return levels, sum(name < 0 for name in met)


@pytest.mark.internals
@pytest.mark.parametrize("count", [9, 100, 3000])
@pytest.mark.parametrize("side", [LINK_LEFT, LINK_RIGHT])
def test_a_chain_of_any_length_is_not_deep(count, side):
    """Every node of the binary tree has a leaf on one side: its depth is the number of leaves."""
    lower = np.zeros((count, 3))
    upper = 0.97 ** np.arange(count)[:, None] * np.ones(3) + 1e-3
    moved = records(lower, upper)
    links = np.full((2 * count - 1, 4), NO_CHILD, np.int32)
    nodes = np.zeros((2 * count - 1, BOX_STRIDE), np.float32)
    for leaf in range(count):
        at = 2 * leaf + 1 if leaf < count - 1 else 2 * leaf
        links[at, LINK_FIRST], links[at, LINK_COUNT] = leaf, 1
        nodes[at] = moved[leaf]
    for leaf in range(count - 2, -1, -1):
        at = 2 * leaf
        links[at, side], links[at, LINK_LEFT + LINK_RIGHT - side] = at + 1, at + 2
        nodes[at] = np.minimum(nodes[at + 1], nodes[at + 2])

    wide, order, leaf_first = widen_tree(nodes.reshape(-1), links, np.arange(count, dtype=np.int32))

    levels, leaf_count = depth_of(wide)
    assert levels <= MAX_DEPTH // 2 and leaf_count == count
    assert sorted(order) == list(range(count))
    np.testing.assert_array_equal(leaf_first, np.arange(count + 1))


@pytest.mark.internals
def test_the_thinnest_of_a_nodes_boxes_has_its_first_lane():
    """A traversal visits it first if several are equally near."""
    nodes, links, _, order = halved(random_boxes(np.random.default_rng(8), 5000))

    wide, _, _ = widen_tree(nodes, links, order)

    count = 0
    for boxes, _ in wide_nodes(wide):
        thickness = (boxes[:, 1] - boxes[:, 0]).min(axis=1)
        assert (np.diff(thickness) >= 0.0).all()
        count += 1
    assert count > 100


@pytest.mark.internals
def test_leaves_are_numbered_in_the_order_of_the_tree():
    """The leaves below a node are consecutive, as moments and slabs require."""
    nodes, links, _, order = halved(random_boxes(np.random.default_rng(7), 5000))
    improve(nodes, links)

    wide, new_order, leaf_first = widen_tree(nodes, links, order)

    children = [names for _, names in wide_nodes(wide)]
    leaves = {}  # by node: first leaf, and one past the last
    for node in range(len(children) - 1, -1, -1):
        assert all(below > node for below in children[node] if below >= 0)
        ends = sorted(leaves[name] if name >= 0 else (~name, ~name + 1) for name in children[node])
        assert all(end == start for (_, end), (start, _) in itertools.pairwise(ends))
        leaves[node] = ends[0][0], ends[-1][1]
    assert leaves[0] == (0, len(leaf_first) - 1)
    assert sorted(new_order) == list(range(5000)) and leaf_first[-1] == 5000
    assert np.diff(leaf_first).min() >= 1 and np.diff(leaf_first).max() <= LANES


def test_ordinary_mesh_fills_its_nodes():
    vertices, faces = shapes.torus(n=120, m=80)
    boxes = np.empty(BOX_STRIDE * len(faces), np.float32)
    face_boxes(vertices, faces.astype(np.int32), boxes)

    nodes, _, leaf_first = build_tree(boxes, FACES_SHIFT)

    lanes = [len(names) for _, names in wide_nodes(nodes)]
    assert np.mean(lanes) >= 5.0
    assert len(faces) / (len(leaf_first) - 1) >= 0.7 * LANES
