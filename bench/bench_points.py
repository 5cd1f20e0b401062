"""Points against a mesh, with pytest-benchmark: ``python -m pytest bench/bench_points.py``.

``-k five``: calls of five, as a hand asks; ``-k contains``, ``-k "signed_distance and near"``, ….
"""

import pytest

import cases
import rivals

NEAR = [f"{mesh}/near" for mesh in ("featuretype", "cycloidal", "plate", "sphere")]
CASE_NAMES = [*NEAR, "plate/scattered", "plate/path", "sphere/center"]
APART = (
    "cycloidal/near"  # bodies that touch: there ours is the closest point of the body that holds the point
)
WORST = "sphere/center"  # all faces are equally far: for calls of five, and not for who takes seconds
QUESTIONS = {
    "distance": "points, unsigned",
    "signed_distance": "points, signed",
    "closest": "points, closest",
    "contains": "points, inside or not",
}
BATCH_COUNT = 1000


def _rows():
    for question in QUESTIONS:
        for case_name in CASE_NAMES:
            for count in (cases.FEW_COUNT, BATCH_COUNT):
                for kind in rivals.CONTENDERS:
                    is_too_much = case_name == WORST and (count == BATCH_COUNT or kind.query_limit)
                    is_other = question == "closest" and case_name == APART
                    if question in kind.questions and not (is_too_much or is_other):
                        words = "five" if count == cases.FEW_COUNT else "batch"
                        yield pytest.param(
                            question,
                            case_name,
                            count,
                            kind.name,
                            id=f"{question}-{case_name}-{words}-{kind.name}",
                        )


@pytest.mark.parametrize(("question", "case_name", "count", "name"), list(_rows()))
def test_points(ask_case, question, case_name, count, name):
    ask_case(QUESTIONS[question], question, case_name, count, name)
