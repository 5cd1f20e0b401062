"""Segments against a mesh, with pytest-benchmark: ``python -m pytest bench/bench_segments.py``.

None of the rivals measures from a segment; the tests' brute force says whether the answers are right.
"""

import numpy as np
import pytest
from agreement import TOLERANCE, oracle

import cases

MESHES = ("featuretype", "cycloidal", "plate", "sphere")
BATCH_COUNT = 500
PAIR_COUNT = 1_000_000  # queries times faces that the oracle looks at
LENGTH = 0.05  # of the diagonal: a finger's bone beside a part


@pytest.mark.parametrize("count", [cases.FEW_COUNT, BATCH_COUNT], ids=["five", "batch"])
@pytest.mark.parametrize("mesh_name", MESHES)
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
    """Other ends, `LENGTH` away in any direction."""
    way = np.random.default_rng(13).normal(size=case.points.shape)
    return case.points + LENGTH * case.diagonal * way / np.linalg.norm(way, axis=1)[:, None]
