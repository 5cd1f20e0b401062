"""Half-edges in order, against a sort by NumPy; what links connect, beside SciPy's answer."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from proximity.kernels.mesh.edges import connected, sorted_half_edges


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
