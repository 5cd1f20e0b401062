"""Segments against a mesh, with pytest-benchmark: ``python -m pytest bench -k segments``.

No other library has segments; the brute force of the tests checks the answers.
"""

import numpy as np
import pytest

from benchmarks.queries import cases
from benchmarks.queries.agreement import TOLERANCE, oracle

BATCH_COUNT = 500
PAIR_COUNT = 1_000_000  # queries times faces that the oracle computes
LENGTH = 0.05  # of the diagonal: a finger's bone


@pytest.mark.parametrize("count", [cases.FINGERS, BATCH_COUNT], ids=["five", "batch"])
@pytest.mark.parametrize("mesh_name", cases.SUITE_MESHES)
def test_segments(timed, contender, load_case, mesh_name, count):
    case = load_case(f"{mesh_name}/near", count)
    scene = contender("proximity", mesh_name).engine
    starts, ends = case.points, segments_from(case)
    sample = slice(0, min(50, max(5, PAIR_COUNT // len(case.faces))))
    found = scene.closest_to_segments(starts[sample], ends[sample]).distance
    expected = oracle.segment_distance(case.vertices, case.faces, starts[sample], ends[sample]).distance
    assert np.abs(found - expected).max() <= TOLERANCE * case.diagonal
    group = f"segments, {case.name}, {len(case.faces):,} faces, {count} a call"
    timed("proximity", group, lambda: scene.closest_to_segments(starts, ends), count)


def segments_from(case):
    """Return ends of segments from the points of *case*, `LENGTH` long, in random directions."""
    directions = np.random.default_rng(13).normal(size=case.points.shape)
    return case.points + LENGTH * case.diagonal * directions / np.linalg.norm(directions, axis=1)[:, None]
