"""Agreement of the contenders' answers, compared before timing; differences are counted and shown.

The brute force of the tests judges on a sample. A contender in float64 that agrees with it entirely then
judges the others on all queries. Tolerances allow for float32, in which most of the others compute.

Inside several parts ours is the depth in the part in which the point is deepest, the others' the distance to
the nearest face of any part: there ours may be the larger.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.queries.cases import Case, hands_of, part_of
from benchmarks.rivals.interface import Contender, Task
from benchmarks.support.project import project_module

oracle = project_module("tests/support", "oracle")

TOLERANCE = 1e-5  # of the diagonal: about a hundred roundings of float32
SAMPLE_COUNT = 1000
PAIR_COUNT = 20_000_000  # queries times faces that the oracle computes
OURS = "proximity"
BASES = (OURS, "libigl", "embreex")  # float64 before float32


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of one contender's answers with another's."""

    judge: str
    checked_count: int
    off_count: int  # lengths, or hit and miss, that differ by more than the tolerance
    wrong_sign_count: int  # if the surface is farther than the tolerance
    largest_error: float  # of a length, in diagonals


def compare(case: Case, answers: np.ndarray, expected: np.ndarray, judge: str, name: str = "") -> Agreement:
    """Count the differences of *name* from *judge*, over the length of the shorter array."""
    count = min(len(answers), len(expected))
    answers, expected = answers[:count], expected[:count]
    tolerance = TOLERANCE * case.diagonal
    with np.errstate(invalid="ignore"):
        errors = abs(abs(answers) - abs(expected))
    errors[np.isinf(answers) & np.isinf(expected)] = 0.0
    if OURS in (name, judge):
        ours, others = (answers, expected) if name == OURS else (expected, answers)
        errors[(others < 0.0) & (ours < others)] = 0.0
    errors[np.isnan(errors)] = np.inf
    is_wrong = (np.sign(answers) != np.sign(expected)) & (abs(expected) > tolerance)
    finite = errors[np.isfinite(errors)]
    return Agreement(
        judge,
        count,
        int((errors > tolerance).sum()),
        int(is_wrong.sum()),
        float(finite.max(initial=0.0) / case.diagonal),
    )


def check_all(
    case: Case,
    question: str,
    contenders: list[Contender],
    *,
    by_fives: bool = False,
    pair_count: int = PAIR_COUNT,
) -> dict[str, Agreement]:
    """Compare the answers of all contenders to *question* of *case*, in one call or five at a time.

    *pair_count*: approximate number of query-face pairs for the oracle.
    """
    hands = hands_of(case) if by_fives else [case]
    case = part_of(case, np.arange(sum(len(hand.points) for hand in hands))) if by_fives else case
    answers = {}
    for each in contenders:
        found = np.concatenate([ask(each, hand, question).answer() for hand in hands])
        answers[each.name] = _lengths(case, found)
    expected = ask_oracle(case, question, pair_count)
    found = {name: compare(case, answer, expected, "oracle", name) for name, answer in answers.items()}
    base = next((name for name in BASES if name in found), None)
    if base is None or found[base].off_count or found[base].wrong_sign_count:
        return found  # no other may judge
    others = {name: answer for name, answer in answers.items() if name != base}
    return found | {name: compare(case, answer, answers[base], base, name) for name, answer in others.items()}


def ask(contender: Contender, case: Case, question: str) -> Task:
    """Prepare *question* for one contender, for its queries of *case*."""
    limit = slice(None, contender.query_limit)
    rays = () if case.directions is None else (case.directions[limit],)
    return getattr(contender, question)(case.points[limit], *rays)


def answers_of(contender: Contender, case: Case, question: str) -> np.ndarray:
    """Return one contender's answers; lengths, for `compare`."""
    return _lengths(case, ask(contender, case, question).answer())


def _lengths(case, answer):
    """Return answers as lengths: closest points by distance, as ties are arbitrary, and inside as a sign."""
    if answer.dtype == bool:
        return _signs(case, answer)
    return answer if answer.ndim == 1 else np.linalg.norm(case.points[: len(answer)] - answer, axis=1)


def _signs(case, is_inside):
    return np.where(is_inside, -case.diagonal, case.diagonal)


def ask_oracle(case: Case, question: str, pair_count: int = PAIR_COUNT) -> np.ndarray:
    """Return the answers of the tests' brute force to the first queries."""
    count = min(SAMPLE_COUNT, max(10, pair_count // len(case.faces)), len(case.points))
    points = case.points[:count]
    if case.directions is not None:
        return oracle.ray(case.vertices, case.faces, points, case.directions[:count]).distance
    if question == "contains":
        return _signs(case, oracle.winding_number(case.vertices, case.faces, points) > 0.5)
    distances = oracle.closest(case.vertices, case.faces, points).distance
    if question != "signed_distance":
        return distances
    # An open sheet among the bodies adds less than half a turn to either side.
    is_inside = oracle.winding_number(case.vertices, case.faces, points) > 0.5
    return np.where(is_inside, -distances, distances)
