"""Points against a mesh, with pytest-benchmark: ``python -m pytest bench -k points``.

``-k five``: calls of five, as for a hand; ``-k contains``, ``-k "signed_distance and near"``, ….
"""

import itertools

import pytest

from benchmarks.queries import cases
from benchmarks.rivals import registry

NEAR = [f"{mesh}/near" for mesh in cases.SUITE_MESHES]
CASE_NAMES = [*NEAR, "plate/scattered", "plate/path", "sphere/center"]
TOUCHING_BODIES = "cycloidal/near"  # ours is the closest point of the body that contains the point
WORST = "sphere/center"  # all faces are equally far: only for calls of five, and not for slow contenders
BUILDS_EVERY_CALL, SMALL = "libigl (normals)", NEAR[:2]
QUESTIONS = {
    "distance": "points, unsigned",
    "signed_distance": "points, signed",
    "closest": "points, closest",
    "contains": "points, inside or not",
}
BATCH_COUNT = 1000


def _rows():
    rows = itertools.product(QUESTIONS, CASE_NAMES, (cases.FINGERS, BATCH_COUNT), registry.CONTENDERS)
    for question, case_name, count, kind in rows:
        if question in kind.questions and not _is_left_out(question, case_name, count, kind):
            words = "five" if count == cases.FINGERS else "batch"
            name = f"{question}-{case_name}-{words}-{kind.name}"
            yield pytest.param(question, case_name, count, kind.name, id=name)


def _is_left_out(question, case_name, count, kind):
    if case_name == WORST and (count == BATCH_COUNT or kind.query_limit):
        return True
    if kind.name == BUILDS_EVERY_CALL and case_name not in SMALL:
        return True
    return question == "closest" and case_name == TOUCHING_BODIES


@pytest.mark.parametrize(("question", "case_name", "count", "name"), list(_rows()))
def test_points(ask_case, question, case_name, count, name):
    ask_case(QUESTIONS[question], question, case_name, count, name)
