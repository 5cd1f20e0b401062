"""Rays against a mesh, with pytest-benchmark: ``python -m pytest bench/bench_rays.py``."""

import pytest

import cases
import rivals

MESHES = ("featuretype", "cycloidal", "plate", "sphere")
BATCH_COUNT = 1000
ABLE = [kind.name for kind in rivals.CONTENDERS if "cast" in kind.questions]


@pytest.mark.parametrize("name", ABLE)
@pytest.mark.parametrize("count", [cases.FEW_COUNT, BATCH_COUNT], ids=["five", "batch"])
@pytest.mark.parametrize("mesh_name", MESHES)
def test_rays(ask_case, mesh_name, count, name):
    ask_case("rays", "cast", f"{mesh_name}/rays", count, name)
