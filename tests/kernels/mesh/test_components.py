"""What links connect, beside SciPy's answer."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from proximity.kernels.mesh.components import connected


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
