"""Check every guarantee of every record of a trial against references without a budget.

There are three: a second scene at the same poses, queried without a tracker (`Log.true`); the parts one by
one (`History.signed_distance`), which also covers other times; and, for a few rows, the oracle.
"""

import numpy as np
from trial_contacts import judge_paths, judge_times
from trial_log import DISTANCE_ROUNDING, Log, Tally

import oracle

ORACLE_POINTS = 4  # per trial
MAX_FOR_ORACLE = 100_000  # faces per part
UNCLEAR = 0.1  # in turns: twice the error of the engine's winding numbers


def judge(log):
    """Check all guarantees of a trial."""
    tally, rng = Tally(), np.random.default_rng(len(log.ticks))
    _judge_tracked(log, tally)
    log = _only(log, log.has("TRACKED"))
    _judge_truth(log, tally, rng)
    _judge_distances(log, tally)
    _judge_points(log, tally, rng)
    _judge_predictions(log, tally)
    judge_times(log, tally, rng)
    if log.paths is not None:
        judge_paths(log, tally)
    return tally


def _only(log, rows):
    values = {name: getattr(log, name) for name in log.__dataclass_fields__}
    for name, value in values.items():
        if isinstance(value, np.ndarray) and name != "path_bends":
            values[name] = value[rows]
    return Log(**values)


def _judge_tracked(log, tally):
    is_place = np.isfinite(log.positions).all(axis=1)
    tally.demand("tracked where there is a position", log, log.has("TRACKED") == is_place)
    lost = log.records[~is_place]
    is_silent = (
        (lost["lower"] == -np.inf) & (lost["upper"] == np.inf) & (lost["time_to_contact_lower"] == 0.0)
    )
    tally.demand("nothing is said of lost fingers", log, is_silent, ~is_place)


def _judge_truth(log, tally, rng):
    """Compare the second scene with the parts one by one and, for a few rows, with the oracle."""
    if not len(log.ticks):
        return
    by_parts = log.history.signed_distance(log.positions, log.ticks)
    with np.errstate(invalid="ignore"):
        off = np.abs(by_parts - log.true)
    off[np.isinf(log.true)] = 0.0
    for row in np.flatnonzero(off > log.room(log.true)):
        if _is_on_a_lid(log, row):
            off[row] = abs(abs(by_parts[row]) - abs(log.true[row]))
    tally.look("truth, part by part", log, off, log.room(log.true))
    rows = rng.choice(len(log.ticks), min(ORACLE_POINTS, len(log.ticks)), replace=False)
    by_oracle = np.array([_by_oracle(log, row) for row in rows])
    is_clear = np.isfinite(by_oracle) & (np.abs(by_oracle) > 1e-9)
    rows, by_oracle = rows[is_clear], by_oracle[is_clear]
    tally.look(
        "truth, by the oracle", log, np.abs(by_oracle - log.true[rows]), log.room(log.true)[rows], rows
    )


def _is_on_a_lid(log, row):
    """Test whether the point is near the lid of a hole, where a refitted tree may give another sign."""
    history, tick = log.history, log.ticks[row]
    for number in np.flatnonzero(history.is_seen[tick]):
        shape = history.shapes[tick, number]
        if history.has_holes[shape]:
            own = history.own_points(number, log.positions[[row]], log.ticks[[row]], np.zeros(1))
            mesh = history.solids[shape].mesh
            if abs(oracle.winding_number(mesh.vertices, mesh.faces, own)[0] - 0.5) < UNCLEAR:
                return True
    return False


def _by_oracle(log, row):
    """Signed distance by the oracle; nan if slow to compute or if the sign is ambiguous."""
    history, tick, best = log.history, log.ticks[row], np.inf
    seen = np.flatnonzero(history.is_seen[tick])
    spans = history.spans[history.shapes[tick, seen]]
    away = np.linalg.norm(log.positions[row] - history.translations[tick, seen], axis=1) - spans
    for nearest in np.argsort(away):
        number, solid = seen[nearest], history.solids[history.shapes[tick, seen[nearest]]]
        if away[nearest] > best:
            break
        if solid.mesh.face_count > MAX_FOR_ORACLE:
            return np.nan
        own = history.own_points(number, log.positions[[row]], log.ticks[[row]], np.zeros(1))
        vertices, faces = solid.mesh.vertices, solid.mesh.faces
        distance = float(oracle.closest(vertices, faces, own).distance[0])
        if solid.has_inside:
            turns = float(oracle.winding_number(vertices, faces, own)[0])
            if abs(turns - 0.5) < UNCLEAR:
                return np.nan
            distance = -distance if turns > 0.5 else distance
        best = min(best, distance)
    return best


def _judge_distances(log, tally):
    told, true = log.records, log.true - log.radii
    room = log.room(np.where(np.isinf(true), 0.0, np.abs(true) + log.radii))
    with np.errstate(invalid="ignore"):
        above, below = told["lower"] - true, true - told["upper"]
        off = np.abs(told["signed_distance"] - true)
    nothing = np.isinf(true)  # all parts are hidden
    below[nothing & (told["upper"] == np.inf)] = off[nothing & (told["signed_distance"] == np.inf)] = 0.0
    above[nothing & (told["lower"] == np.inf)] = 0.0
    bounded = log.has("BOUNDED") | log.has("SKIPPED")
    tally.look("lower <= true, exact", log, above[~bounded], room[~bounded], ~bounded)
    tally.look("true <= upper, exact", log, below[~bounded], room[~bounded], ~bounded)
    for name in ("BOUNDED", "SKIPPED"):
        rows = log.has(name)
        tally.look(f"lower <= true, {name.lower()}", log, above[rows], room[rows], rows)
        tally.look(f"true <= upper, {name.lower()}", log, below[rows], room[rows], rows)
    exact = log.has("EXACT")
    tally.look("exact is exact", log, off[exact], room[exact], exact)
    same = (told["lower"] == told["upper"]) & (told["lower"] == told["signed_distance"])
    tally.demand("exact: both bounds are the distance", log, same[exact], exact)
    ways = exact.astype(int) + log.has("BOUNDED") + log.has("SKIPPED")
    tally.demand("exact, bounded or skipped: one of them", log, ways == 1)
    within = (told["lower"] <= told["signed_distance"]) & (told["signed_distance"] <= told["upper"])
    tally.demand("the distance lies between its bounds", log, within)
    clear = np.abs(log.true) > room
    tally.demand("inside", log, (log.has("INSIDE") == (log.true < 0.0))[clear], clear)
    # Bounds closer than the allowance are accepted, whichever accuracy was requested.
    share = np.maximum(log.tolerance, log.adaptive_tolerance)
    near = np.isfinite(true) & (told["upper"] <= (1.0 + share) * told["lower"] + room)
    skipped = log.has("SKIPPED") & ~near & ~log.crowd_is_spent()
    tally.look("skipped is out of range", log, (log.working_range - true)[skipped], room[skipped], skipped)
    meant = exact & (np.abs(true - log.working_range) > room)
    tally.demand("in range", log, (log.has("IN_RANGE") == (true <= log.working_range))[meant], meant)
    numbers = log.history.numbers[log.ticks, told["part"]]
    shapes = log.history.shapes[log.ticks, numbers]
    found = told["part"] >= 0
    tally.demand("the part is there", log, (numbers >= 0)[found], found)
    tally.demand("signed", log, (log.has("SIGNED") == log.history.has_inside[shapes])[found], found)


def _judge_points(log, tally, rng):
    """Check that points lie on the reported part and face, at the reported distance along the normal."""
    told = log.records
    rows = np.flatnonzero((told["part"] >= 0) & ~log.has("INSIDE", "BOUNDED"))
    told, radii = told[rows], log.radii[rows]
    reach = told["signed_distance"] + radii
    room = log.room(log.true)[rows] + DISTANCE_ROUNDING * np.abs(reach)
    arm = log.positions[rows] - told["point_on_part"]
    length = np.linalg.norm(arm, axis=1)
    tally.look("the point is at the distance", log, np.abs(length - np.abs(reach)), room, rows)
    tally.look("the normal is a unit", log, np.abs(np.linalg.norm(told["normal"], axis=1) - 1.0), 1e-14, rows)
    tip = np.linalg.norm(
        log.positions[rows] - radii[:, None] * told["normal"] - told["point_on_finger"], axis=1
    )
    tally.look("the finger's point is on it", log, tip, room, rows)
    far = length > 1e4 * room
    along = np.linalg.norm(arm - reach[:, None] * told["normal"], axis=1)
    # The error of a direction is inverse to its length; at the point's distance it is within the room.
    tally.look("the normal goes to the point", log, along[far], 4.0 * room[far], rows[far])
    numbers = log.history.numbers[log.ticks[rows], told["part"]]
    kinds = np.stack([numbers, log.history.shapes[log.ticks[rows], numbers]], axis=1)
    off = np.empty(len(rows))
    for number, shape in np.unique(kinds, axis=0):
        at = np.flatnonzero((kinds == [number, shape]).all(axis=1))
        solid = log.history.solids[shape]
        own = log.history.own_points(
            number, told["point_on_part"][at], log.ticks[rows[at]], np.zeros(len(at))
        )
        off[at] = solid.distance(own)
        for one in rng.choice(len(at), min(2, len(at)), replace=False):
            corners = solid.mesh.vertices[solid.mesh.faces[told["face"][at[one]]]]
            distance = oracle.closest(corners, np.array([[0, 1, 2]]), own[one]).distance
            tally.look("the point is on its face", log, distance, room[at[one]], rows[at[one : one + 1]])
    tally.look("the point is on its part", log, off, room, rows)


def _judge_predictions(log, tally):
    """Check predictions of fingers with a known course, among parts of constant velocity."""
    rows = np.flatnonzero(log.is_exact)
    told = log.records[rows]
    ahead = 1e-9 * np.maximum(told["predicted_ns"] - told["pose_ns"], 0)
    points = log.course.position(log.fingers[rows], 1e-9 * (told["pose_ns"] - log.start_ns) + ahead)
    true = log.history.signed_distance(points, log.ticks[rows], ahead) - log.radii[rows]
    keep = np.isfinite(true)
    rows, told, true = rows[keep], told[keep], true[keep]
    # The course sums sines of large angles: its error is up to 1e-12 m.
    room = log.room(np.abs(true) + log.radii[rows], points[keep]) + 1e-12
    tally.look("predicted lower <= true", log, told["predicted_lower"] - true, room, rows)
    tally.look("true <= predicted upper", log, true - told["predicted_upper"], room, rows)
    is_within = (told["predicted_lower"] <= told["predicted_distance"]) & (
        told["predicted_distance"] <= told["predicted_upper"]
    )
    tally.demand("the predicted distance lies between its bounds", log, is_within, rows)
