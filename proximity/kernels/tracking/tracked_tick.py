"""One tick of a tracked part: its nearest connections to the other parts, with bounds.

Each pair of parts has a lower bound of its distance. A tick lowers it by the displacement of both parts, and
then searches only the pairs that may be nearer than the present result, the lowest bound first and each from
its last connection, as the coherent point search does.

A part whose surface crosses no other stays inside or outside until the surfaces meet. Containment is
therefore decided again only for pairs whose bound has reached 0.
"""

from math import sqrt

import numpy as np

from proximity.kernels.contact_record import (
    BOUNDED,
    EXACT,
    IN_RANGE,
    INSIDE,
    PART_CHANGED,
    PREDICTED,
    SKIPPED,
)
from proximity.kernels.geometry.frames import ROUNDED_DOWN, velocity_at
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import NO_FACE, NO_PART, NO_SLOT, ModelArrays
from proximity.kernels.pair.boxes import frames_between, gap_along
from proximity.kernels.pair.part_query import fill_connection, turn_normal
from proximity.kernels.pair.triangles import CROSSING
from proximity.kernels.pair.walk import nearest_from_frontier, nearest_of_parts
from proximity.kernels.scene.inside.containment import Surfaces, assign_surfaces
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.kernels.tracking.tracked_depth import comes_free, decide_inner_parts, fill_depth
from proximity.kernels.tracking.tracked_motion import STILL_ROUNDING, displacements, find_times, lower_of
from proximity.kernels.tracking.tracked_records import (
    CROSSING_PARTS,
    FRONTIER_ENTRIES,
    MAX_FRONTIERS,
    MIN_FRONTIERS,
    OTHER_INSIDE,
    OWN_INSIDE,
    HeldArrays,
)
from proximity.kernels.traverse.dual_first import OVERFLOW, Frontier
from proximity.native import entry, inlined, kernel
from proximity.native.simd import load_int

MAX_RECORDS = 16
"""Maximum number of connections of a tick."""
TICKS_AHEAD = 4
"""Least number of ticks like this one for which the search of a pair is to last; the largest is below twice
that."""
PAUSED_SEARCHES = 127
"""Searches without a frontier after it was too small, so that in 99 of 100 ticks none is filled in vain."""
SEARCH_TOLERANCE = 0.5
"""Share of the tolerance that a search uses: the rest is for the motion until the next one."""


@entry(ModelArrays, HeldArrays, "bool")
def follow_parts(model, held, is_moved):
    """Fill the records of a tick. *is_moved*: whether poses may have changed since the last one."""
    option = held.settings[0]
    _find_nearest(model, held, is_moved)
    if option.unsure:
        decide_inner_parts(model, held)
        _find_nearest(model, held, False)
    elif option.opening and not comes_free(model, held):
        option.free_time = 0.0
        for number in range(len(held.records)):
            held.records[number]["time_to_contact_lower"] = 0.0
    for number in range(len(held.records)):
        if held.records[number]["depth"] == np.inf:
            fill_depth(model, held, held.records[number])


@entry(ModelArrays, HeldArrays)
def adopt_rows(model, held):
    """Fill the pairs of a model that has other parts or faces than the last, and forget what was known."""
    option, own, parts = held.settings[0], held.own, model.parts
    group, at = len(own), 0
    for other in range(len(parts) - 1):
        is_own = False
        for k in range(group):
            is_own = is_own or own[k] == other
        for k in range(0 if is_own or parts[other].is_hidden else group):
            pair = held.pairs[at]
            _clear(pair)
            pair.own, pair.other, pair.lower, pair.upper, pair.is_unsure = own[k], other, -1.0, np.inf, 1
            pair.slots[0] = pair.slots[1] = NO_SLOT
            pair.frontier = -1
            at += 1
    option.group, option.next_frontier = group, 0
    option.frontier_count = min(max(len(held.pairs), MIN_FRONTIERS), MAX_FRONTIERS)
    option.frontier_length = FRONTIER_ENTRIES // option.frontier_count
    displacements(model.frames, held.before, held.moved)
    for part in range(len(held.moved)):
        held.moved[part] = 0.0
    for number in range(len(held.records)):
        held.records[number]["part"], held.records[number]["face"] = NO_PART, NO_FACE
    assign_surfaces(parts, Surfaces(held.faces, held.ranges))


@inlined
def _clear(pair):
    """Forget what was known of a pair."""
    pair.speed = pair.free_time = pair.depth = 0.0
    pair.normal[0] = pair.normal[1] = pair.normal[2] = 0.0
    pair.frontier_count = pair.is_resolved = pair.is_timed = pair.is_opening = pair.is_crossing = 0
    pair.is_touching = pair.is_inside = pair.is_undecided = 0


@kernel
def _find_nearest(model, held, is_moved):
    """Fill the records of a tick, but for depths, and for what is inside other parts."""
    option = held.settings[0]
    option.work = 0
    if is_moved:
        _lower_bounds(model, held)
    for number in range(len(held.pairs)):
        held.pairs[number].is_resolved = held.pairs[number].is_timed = 0
    rows, uppers = stack_i64(MAX_RECORDS), stack_f64(MAX_RECORDS)
    _resolve(model, held, rows, uppers)
    option.unsure = 0
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        is_known = pair.lower > 0.0 or (pair.is_resolved and pair.is_touching)
        pair.is_undecided = 1 if pair.is_unsure and is_known else 0
        option.unsure += pair.is_undecided
    find_times(model, held)
    for number in range(len(held.records)):
        _fill_record(model, held, number, rows)


@kernel
def _lower_bounds(model, held):
    """Lower the bounds of all pairs by the displacement of their parts."""
    frames = model.frames
    displacements(frames, held.before, held.moved)
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        moved = held.moved[pair.own] + held.moved[pair.other]
        if moved == 0.0 and pair.lower >= 0.0:
            continue
        pair.lower -= moved
        pair.upper += moved
        pair.is_crossing = pair.is_touching = 0
        gap = _gap_between_boxes(frames[pair.own], frames[pair.other])
        if gap > pair.lower:
            pair.lower = gap
            if gap > 0.0:
                pair.is_inside = pair.is_unsure = 0
        if pair.lower <= 0.0:
            pair.lower, pair.is_inside, pair.is_unsure = 0.0, 0, 1


@inlined
def _gap_between_boxes(one, other):
    """Return a lower bound of the distance between the boxes of two parts, m."""
    total, size = 0.0, 0.0
    for k in range(3):
        gap = gap_along(one, other, k)
        size += abs(one.box_lower[k]) + abs(one.box_upper[k])
        if gap > 0.0:
            total += gap * gap
    return sqrt(total) * ROUNDED_DOWN - STILL_ROUNDING * size


@inlined
def _upper_of(pair):
    """Return the upper bound of the distance between parts: 0 if one is inside the other."""
    return 0.0 if pair.is_inside else pair.upper


@kernel
def _select(held, count, rows, uppers):
    """Fill the pairs of the nearest connections, at most one per other part, in ascending order.

    Return the upper bound of the last of *count*; inf if there are fewer.
    """
    group, found = held.settings[0].group, 0
    for begin in range(0, len(held.pairs), group):
        row = begin
        for number in range(begin + 1, begin + group):
            if _upper_of(held.pairs[number]) < _upper_of(held.pairs[row]):
                row = number
        upper = _upper_of(held.pairs[row])
        if upper == np.inf or (found == count and upper >= uppers[count - 1]):
            continue
        at = min(found, count - 1)
        while at > 0 and uppers[at - 1] > upper:
            uppers[at], rows[at] = uppers[at - 1], rows[at - 1]
            at -= 1
        uppers[at], rows[at] = upper, row
        found = min(found + 1, count)
    for at in range(found, count):
        rows[at], uppers[at] = -1, np.inf
    return uppers[count - 1]


@kernel
def _resolve(model, held, rows, uppers):
    """Search pairs, the lowest bound first, until no other can be among the nearest."""
    option, count = held.settings[0], len(held.records)
    share = 1.0 + option.tolerance
    while True:
        reach = min(_select(held, count, rows, uppers), option.working_range)
        lowest, chosen = np.inf, -1
        for number in range(len(held.pairs)):
            pair = held.pairs[number]
            lower = lower_of(pair)
            if not pair.is_resolved and lower < lowest and lower * share < min(_upper_of(pair), reach):
                lowest, chosen = lower, number
        if chosen < 0 or (option.budget > 0 and option.work >= option.budget):
            return
        # Search a little farther than needed now, so that pairs are not searched at every tick.
        pair = held.pairs[chosen]
        moved = held.moved[pair.own] + held.moved[pair.other]
        margin = moved * (TICKS_AHEAD + chosen % TICKS_AHEAD) if option.budget == 0 else 0.0
        _look_into(model, held, chosen, min(reach + margin, pair.upper))


@kernel
def _look_into(model, held, number, reach):
    """Find the distance of a pair, from its last connection and its frontier, if it is below *reach*, m."""
    pair, option, slots = held.pairs[number], held.settings[0], stack_i64(2)
    turn, offset, turned, shifted = stack_f64(9), stack_f64(3), stack_f64(9), stack_f64(3)
    scale = model.frames[pair.own].scale
    frames_between(model.frames, pair.own, pair.other, turn, offset)
    slots[0], slots[1] = pair.slots[0], pair.slots[1]
    # The factor includes a connection of exactly that length.
    limit, tolerance = reach * reach * scale * scale * 1.0000001, SEARCH_TOLERANCE * option.tolerance
    budget = 0 if option.budget == 0 else max(option.budget - option.work, 1)
    best, lower_sq, steps, count = 0.0, 0.0, np.int64(0), np.int64(OVERFLOW)
    if pair.frontier_count < 0:
        pair.frontier_count += 1
    else:
        frontier = _frontier_of(held, number)
        for k in range(9):
            turned[k], pair.frontier_turn[k] = turn[k] - pair.frontier_turn[k], turn[k]
        for k in range(3):
            shifted[k], pair.frontier_offset[k] = offset[k] - pair.frontier_offset[k], offset[k]
        best, lower_sq, steps, count = nearest_from_frontier(
            model, pair.own, pair.other, (turn, offset), frontier, pair.frontier_count,
            (turned, shifted), limit, tolerance, budget, slots,
        )  # fmt: skip
        pair.frontier_count = count if count >= 0 else (-PAUSED_SEARCHES if budget == 0 else 0)
    option.work += steps
    if count == OVERFLOW:
        slots[0], slots[1] = pair.slots[0], pair.slots[1]
        budget = 0 if option.budget == 0 else max(budget - steps, 1)
        best, lower_sq, steps = nearest_of_parts(
            model, pair.own, pair.other, (turn, offset), limit, tolerance, budget, slots
        )
        option.work += steps
    pair.is_resolved, pair.is_crossing, pair.is_touching = 1, 1 if best == CROSSING else 0, 0
    if best == 0.0:
        pair.is_touching = 1 if budget == 0 or steps < budget else 0
    if slots[0] != NO_SLOT:
        pair.slots[0], pair.slots[1] = slots[0], slots[1]
        pair.upper = sqrt(max(best, 0.0)) / scale
    lower = sqrt(max(lower_sq, 0.0)) / scale
    pair.lower = max(pair.lower, min(lower, pair.upper))
    if best == CROSSING:
        pair.lower, pair.upper, pair.is_unsure, pair.is_inside = 0.0, 0.0, 1, 0


@kernel
def _frontier_of(held, number):
    """Return the pair's frontier, evicting another pair's if none is free."""
    pair, option = held.pairs[number], held.settings[0]
    if pair.frontier < 0:
        for row in range(len(held.pairs)):
            if held.pairs[row].frontier == option.next_frontier:
                held.pairs[row].frontier, held.pairs[row].frontier_count = -1, 0
        pair.frontier, pair.frontier_count = option.next_frontier, 0
        option.next_frontier = (option.next_frontier + 1) % option.frontier_count
    length = option.frontier_length
    return Frontier(held.limits, held.entries, held.sides, pair.frontier * length, length)


@kernel
def _lowest_of_rest(held, rows, count):
    """Return the lowest bound of all parts except those of the first *count* connections."""
    lowest = np.inf
    for number in range(len(held.pairs)):
        pair, is_known = held.pairs[number], False
        for k in range(count):
            is_known = is_known or (rows[k] >= 0 and held.pairs[rows[k]].other == pair.other)
        if not is_known:
            lowest = min(lowest, lower_of(pair))
    return lowest


@kernel
def _fill_record(model, held, number, rows):
    """Fill a record with the connection of its pair; without one, with the bound of the other parts."""
    record, row = held.records[number], rows[number]
    option, last_part = held.settings[0], record["part"]
    record["pose_ns"], record["age_ns"] = option.pose_ns, option.now_ns - option.pose_ns
    record["work"] = option.work
    record["predicted_ns"] = max(option.now_ns + np.int64(1e9 * option.latency), option.pose_ns)
    if row < 0:
        _fill_unknown(record, _lowest_of_rest(held, rows, number), option)
        return
    pair, ends = held.pairs[row], stack_f64(6)
    if pair.slots[0] == NO_SLOT:  # one part is inside the other, and their surfaces beyond the range
        _look_into(model, held, row, np.inf)
    lower = _lowest_of_rest(held, rows, 0) if number == 0 else lower_of(pair)
    length = fill_connection(model, pair.own, pair.other, pair.is_crossing != 0, pair.slots, ends)
    pair.upper = length
    upper = _upper_of(pair)
    lower = min(lower, upper)
    record["distance"], record["lower"], record["upper"] = upper, lower, upper
    own_end = 3 if pair.is_inside == OTHER_INSIDE else 0
    other_end = 0 if pair.is_inside == OWN_INSIDE else 3
    for k in range(3):
        record["point_on_own"][k], record["point_on_part"][k] = ends[own_end + k], ends[other_end + k]
        record["normal"][k] = (ends[k] - ends[3 + k]) / length if length > 0.0 else 0.0
    is_touching = (pair.is_touching or length == 0.0) and not pair.is_crossing
    if is_touching:
        turn, offset = stack_f64(9), stack_f64(3)
        frames_between(model.frames, pair.own, pair.other, turn, offset)
        turn_normal(model, pair.own, (turn, offset), pair.slots, record["normal"])
    if not pair.is_crossing and not pair.is_inside and (is_touching or not pair.is_unsure):
        for k in range(3):  # inside, the nearest surface points give the opposite direction
            pair.normal[k] = record["normal"][k]
    record["part"], record["own_part"] = pair.other, pair.own
    record["own_face"], record["face"] = NO_FACE, NO_FACE
    if not pair.is_inside:
        record["own_face"] = load_int(model.words, model.parts[pair.own].slot_faces + pair.slots[0])
        record["face"] = load_int(model.words, model.parts[pair.other].slot_faces + pair.slots[1])
    record["depth"], record["depth_lower"] = 0.0, 0.0
    if pair.is_inside or (pair.lower == 0.0 and not pair.is_touching):
        record["depth"] = np.inf
    record["flags"] = (
        (EXACT if lower >= upper * ROUNDED_DOWN else BOUNDED)
        | (0 if pair.is_resolved else SKIPPED)
        | (INSIDE if pair.is_inside else 0)
        | (CROSSING_PARTS if pair.is_crossing else 0)
        | (IN_RANGE if upper <= option.working_range else 0)
        | (PART_CHANGED if last_part != pair.other else 0)
        | (PREDICTED if option.is_predicted else 0)
    )
    _predict(model, record, pair, option)
    if number == 0:
        record["time_to_contact_lower"] = option.free_time


@kernel
def _predict(model, record, pair, option):
    """Fill the distance at the time when the result is used, and the time to contact."""
    if not option.is_predicted:
        _fill_no_prediction(record)
        return
    x, y, z = record["point_on_own"][0], record["point_on_own"][1], record["point_on_own"][2]
    own = velocity_at(model.frames[pair.own], x, y, z)
    x, y, z = record["point_on_part"][0], record["point_on_part"][1], record["point_on_part"][2]
    other = velocity_at(model.frames[pair.other], x, y, z)
    normal = record["normal"][0], record["normal"][1], record["normal"][2]
    speed = dot(*normal, other[0] - own[0], other[1] - own[1], other[2] - own[2])
    ahead = 1e-9 * (record["predicted_ns"] - record["pose_ns"])
    distance = record["distance"]
    record["approach_speed"] = speed
    record["predicted_distance"] = max(distance - speed * ahead, 0.0)
    record["predicted_lower"] = max(record["lower"] - pair.speed * ahead, 0.0)
    record["predicted_upper"] = record["upper"] + pair.speed * ahead
    free_time = pair.free_time
    expected = free_time
    if pair.is_timed == 0 and free_time > 0.0:
        expected = max(distance / speed, free_time) if speed > 0.0 and distance > 0.0 else np.inf
    record["time_to_contact"] = expected if expected <= option.horizon else np.inf
    record["time_to_contact_lower"] = free_time


@inlined
def _fill_no_prediction(record):
    """Fill the predictions of unknown velocities."""
    record["approach_speed"], record["predicted_distance"] = np.nan, np.nan
    record["predicted_lower"], record["predicted_upper"] = 0.0, np.inf
    record["time_to_contact"], record["time_to_contact_lower"] = np.nan, 0.0


@kernel
def _fill_unknown(record, lowest, option):
    """Fill a record without a connection: no surface is nearer than *lowest*, m."""
    record["distance"], record["lower"], record["upper"] = np.inf, min(lowest, option.working_range), np.inf
    for k in range(3):
        record["point_on_own"][k], record["point_on_part"][k], record["normal"][k] = np.nan, np.nan, 0.0
    record["part"], record["own_part"] = NO_PART, NO_PART
    record["face"], record["own_face"], record["flags"] = NO_FACE, NO_FACE, BOUNDED
    record["depth"], record["depth_lower"] = 0.0, 0.0
    _fill_no_prediction(record)
    record["time_to_contact_lower"] = option.free_time
