"""Rays against a mesh, with pytest-benchmark: ``python -m pytest bench -k rays``."""

import pytest

from benchmarks.queries import cases
from benchmarks.rivals import registry

BATCH_COUNT = 1000
ABLE = [kind.name for kind in registry.CONTENDERS if "cast" in kind.questions]


@pytest.mark.parametrize("name", ABLE)
@pytest.mark.parametrize("count", [cases.FINGERS, BATCH_COUNT], ids=["five", "batch"])
@pytest.mark.parametrize("mesh_name", cases.SUITE_MESHES)
def test_rays(ask_case, mesh_name, count, name):
    ask_case("rays", "cast", f"{mesh_name}/rays", count, name)
