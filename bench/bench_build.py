"""Making the structure that is searched, with pytest-benchmark: ``python -m pytest bench/bench_build.py``."""

import pytest

import cases
import rivals


@pytest.mark.parametrize("mesh_name", cases.MESHES)
@pytest.mark.parametrize("contender_name", [kind.name for kind in rivals.CONTENDERS])
def test_build(benchmark, built, load_case, contender_name, mesh_name):
    case = load_case(f"{mesh_name}/near", cases.FEW_COUNT)
    asked = built(contender_name, case)
    benchmark.group = f"build, {mesh_name}, {len(case.faces)} faces"
    benchmark.extra_info.update(version=asked.version)
    benchmark.pedantic(asked.builder(case.vertices, case.faces), rounds=5, warmup_rounds=1)
