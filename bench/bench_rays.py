"""Rays against a mesh, with pytest-benchmark: ``python -m pytest bench/bench_rays.py``."""

import pytest

import cases
import rivals

ABLE = [kind.name for kind in rivals.CONTENDERS if "cast" in kind.questions]


@pytest.mark.parametrize("mesh_name", cases.MESHES)
@pytest.mark.parametrize("contender_name", ABLE)
@pytest.mark.parametrize("query_count", [cases.FEW_COUNT, cases.BATCH_COUNT])
def test_rays(run_case, contender_name, mesh_name, query_count):
    run_case(contender_name, f"{mesh_name}/rays", "cast", query_count)
