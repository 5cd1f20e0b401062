"""The nearest pairs of a scene's parts.

A heap orders the pairs by the distance of their boxes. Their connections are computed until that distance
exceeds those of the pairs that were found.
"""

from math import sqrt

from proximity.kernels.answers import CLEARANCE_ANSWER, PairSearchArrays
from proximity.kernels.geometry.frames import ROUNDED_DOWN
from proximity.kernels.layout import ModelArrays
from proximity.kernels.pair.boxes import gap_along
from proximity.kernels.pair.part_query import complete_pair, connect_pair
from proximity.kernels.scene.inside.containment import Surfaces, assign_surfaces, surfaces_of_pair
from proximity.kernels.stack_arrays import stack_arrays_of
from proximity.native import entry, inlined, kernel

PAIRS_A_CALL = 64
"""Number of pairs for each call, after which Python can handle an interrupt."""
WIDER = 1.0 + 2.0**-40
MIN_LIMIT = 1e-12  # m
"""A search finds only shorter distances: these two make it find one that equals the limit, 0 included."""

stack_answers, _ = stack_arrays_of(CLEARANCE_ANSWER)


@entry(ModelArrays, PairSearchArrays)
def list_pairs(model, arrays):
    """Fill the heap with the pairs whose boxes are within the limit."""
    search, frames, parts = arrays.search[0], model.frames, model.parts
    search.waiting = search.found = 0
    assign_surfaces(parts, Surfaces(arrays.faces, arrays.ranges))
    if len(arrays.answers) == 0:
        return
    count = len(parts) - 1
    for first in range(count):
        begin, end = first + 1, count
        if search.only >= 0 and first != search.only:
            begin, end = max(begin, search.only), search.only + 1
        for second in range(begin, end):
            is_seen = (first == search.only or not parts[first].is_hidden) and (
                second == search.only or not parts[second].is_hidden
            )
            if not is_seen:
                continue
            total = 0.0
            for k in range(3):
                gap = max(gap_along(frames[first], frames[second], k), 0.0)
                total += gap * gap
            gap = sqrt(total) * ROUNDED_DOWN
            if gap <= search.limit:
                arrays.gaps[search.waiting], arrays.numbers[search.waiting] = gap, first * count + second
                search.waiting += 1
    for at in range(search.waiting // 2 - 1, -1, -1):
        _sift_down(arrays, at, arrays.gaps[at], arrays.numbers[at])


@kernel
def _sift_down(arrays, at, gap, number):
    """Insert a pair into the heap at *at* or below."""
    gaps, numbers, count = arrays.gaps, arrays.numbers, arrays.search[0].waiting
    while 2 * at + 1 < count:
        child = 2 * at + 1
        if child + 1 < count and _is_before(gaps[child + 1], numbers[child + 1], gaps[child], numbers[child]):
            child += 1
        if not _is_before(gaps[child], numbers[child], gap, number):
            break
        gaps[at], numbers[at] = gaps[child], numbers[child]
        at = child
    gaps[at], numbers[at] = gap, number


@inlined
def _is_before(length, number, other_length, other_number):
    return length < other_length or (length == other_length and number < other_number)


@entry(ModelArrays, PairSearchArrays, "-> bool")
def connect_pairs(model, arrays):
    """Compute the connections of the next pairs; return whether more pairs may be within the limit.

    The rows are sorted by distance and then by part numbers.
    """
    search, count = arrays.search[0], len(model.parts) - 1
    answer, surfaces = stack_answers(1)[0], Surfaces(arrays.faces, arrays.ranges)
    for _ in range(PAIRS_A_CALL):
        if search.waiting == 0 or arrays.gaps[0] > search.limit:
            return False
        number = arrays.numbers[0]
        search.waiting -= 1
        _sift_down(arrays, 0, arrays.gaps[search.waiting], arrays.numbers[search.waiting])
        first, second = number // count, number % count
        connect_pair(model, first, second, max(search.limit * WIDER, MIN_LIMIT), 0.0, 0, answer)
        if answer.may_be_inside:
            faces, other_faces = surfaces_of_pair(model, first, second, surfaces)
            complete_pair(model, first, second, faces, other_faces, answer)
        if answer.distance <= search.limit:
            _keep(arrays, number, count, answer)
    return True


@kernel
def _keep(arrays, number, count, answer):
    """Insert a pair into the sorted rows; drop the farthest one if all rows are filled."""
    search, pairs, answers = arrays.search[0], arrays.pairs, arrays.answers
    at, distance = search.found, answer.distance
    while at > 0 and _is_before(
        distance, number, answers[at - 1].distance, pairs[at - 1, 0] * count + pairs[at - 1, 1]
    ):
        at -= 1
    if at == len(answers):
        return
    search.found = min(search.found + 1, len(answers))
    for row in range(search.found - 1, at, -1):
        answers[row], pairs[row, 0], pairs[row, 1] = answers[row - 1], pairs[row - 1, 0], pairs[row - 1, 1]
    answers[at], pairs[at, 0], pairs[at, 1] = answer, number // count, number % count
    if search.found == len(answers):
        search.limit = min(search.limit, answers[search.found - 1].distance)
