"""Building of the search structure, with pytest-benchmark: ``python -m pytest bench -k build``."""

import pytest

from benchmarks.queries import cases
from benchmarks.rivals import registry
from benchmarks.rivals.interface import Contender

NAMES = [kind.name for kind in registry.CONTENDERS if kind.__base__ is Contender or not kind.questions]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("mesh_name", cases.SUITE_MESHES)
def test_build(timed, contender, load_case, mesh_name, name):
    case = load_case(f"{mesh_name}/near", cases.FINGERS)
    asked = contender(name, mesh_name)
    run = asked.builder(case.vertices, case.faces)
    timed(f"{name} {asked.version}", f"build, {mesh_name}, {len(case.faces):,} faces", run)
