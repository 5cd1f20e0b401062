"""Making the structure that is searched, with pytest-benchmark: ``python -m pytest bench/bench_build.py``."""

import pytest
from contender import Contender

import cases
import rivals

MESHES = ("featuretype", "cycloidal", "plate", "sphere")
NAMES = [kind.name for kind in rivals.CONTENDERS if kind.__base__ is Contender or not kind.questions]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("mesh_name", MESHES)
def test_build(timed, contender, load_case, mesh_name, name):
    case = load_case(f"{mesh_name}/near", cases.FEW_COUNT)
    asked = contender(name, mesh_name)
    run = asked.builder(case.vertices, case.faces)
    timed(f"{name} {asked.version}", f"build, {mesh_name}, {len(case.faces):,} faces", run)
