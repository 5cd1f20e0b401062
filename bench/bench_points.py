"""Points against a mesh, with pytest-benchmark: ``python -m pytest bench/bench_points.py``."""

import pytest

import cases
import rivals

CASE_NAMES = [f"{mesh}/{way}" for mesh in cases.MESHES for way in ("near", "scattered", "center", "path")]
QUESTIONS = ("distance", "signed_distance", "closest")
ABLE = [
    (kind.name, question)
    for kind in rivals.CONTENDERS
    for question in QUESTIONS
    if question in kind.questions
]


@pytest.mark.parametrize("case_name", CASE_NAMES)
@pytest.mark.parametrize(("contender_name", "question"), ABLE)
@pytest.mark.parametrize("query_count", [cases.FEW_COUNT, cases.BATCH_COUNT])
def test_points(run_case, contender_name, question, case_name, query_count):
    run_case(contender_name, case_name, question, query_count)
