"""Verify times and positions of contact by sphere marching.

A sphere at clearance d can move by d, so that thin walls are not stepped over. A contact found within
rounding is at most `INSTANT` too early; grazing incidence amplifies rounding in time.
"""

import numpy as np

INSTANT = 1e-9  # s, and m on a path
MARCH = 150  # steps; the rest is sampled in steps of equal length
REST = 40


def march(log, rows, place, rate, limits, *, to_touch=True):
    """Stage of the first contact of each sphere, up to *limits*; inf without contact.

    *place* maps rows and stages to points (M, 3) and the seconds for the parts' poses. *rate* (M,): upper
    bound of the approach in metres per unit of stage. *to_touch*: see `History`.
    """
    stages, first = np.zeros(len(rows)), np.full(len(rows), np.inf)
    left = np.arange(len(rows))
    for step in range(MARCH + REST):
        left = left[stages[left] <= limits[left]]
        if not len(left):
            break
        points, seconds = place(left, stages[left])
        gap = log.gap(rows[left], points, seconds, to_touch=to_touch)
        touches = gap <= log.room(gap + log.radii[rows[left]], points)
        first[left[touches]] = stages[left[touches]]
        left, gap = left[~touches], gap[~touches]
        with np.errstate(divide="ignore"):
            step_length = gap / rate[left]
        if step >= MARCH:
            step_length = np.maximum(step_length, limits[left] / REST)
        # Include the end point.
        ends = (stages[left] < limits[left]) & (stages[left] + step_length > limits[left])
        stages[left] = np.where(ends & (step >= MARCH), limits[left], stages[left] + step_length)
    return first


def _is_along_path(log):
    return log.has("ON_PATH", "PREDICTED") & (log.records["bend_rate"] > 0.0)


def judge_times(log, tally, rng):
    """Check that the sphere is free of contact up to the lower bound of the time to contact."""
    told = log.records
    lower = told["time_to_contact_lower"]
    tally.demand("the time to contact is not below its bound", log, told["time_to_contact"] >= lower)
    tally.demand("the bound of the time is a time", log, (lower >= 0.0) & np.isfinite(lower))
    rows = np.flatnonzero((lower > 0.0) & ~_is_along_path(log))
    velocities = told["velocity"][rows].copy()
    unknown = ~log.has("PREDICTED")[rows]
    # An unknown velocity is any direction at maximum speed.
    ways = rng.normal(size=(int(unknown.sum()), 3))
    velocities[unknown] = log.max_speed * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    speeds = np.linalg.norm(velocities, axis=1)

    def place(at, seconds):
        return log.positions[rows[at]] + seconds[:, None] * velocities[at], seconds

    rate = speeds + log.history.fastest(log.ticks[rows])
    _look_at_times(log, tally, "along the velocity", rows, place, rate, lower[rows])


def _look_at_times(log, tally, how, rows, place, rate, limits):
    first = march(log, rows, place, rate, limits)
    early = limits - first  # -inf without contact
    with np.errstate(divide="ignore"):
        # A displacement below rounding cannot be resolved.
        slack = INSTANT + 1e-12 * limits + log.room(log.radii)[rows] / rate
    tally.look(f"free until the time to contact, {how}", log, early, slack, rows)
    points, seconds = place(np.arange(len(rows)), limits)
    gap = log.gap(rows, points, seconds)
    tally.look(f"free at that time, {how}", log, -gap, log.room(gap + log.radii[rows], points), rows)


def _interpolate(xs, ys, x):
    """Interpolate each row linearly, clamped at the ends; return values and slopes.

    *xs*, *ys*: (M, K); *x*: (M,).
    """
    k = np.clip((xs[:, 1:-1] <= x[:, None]).sum(axis=1), 0, xs.shape[1] - 2)
    every = np.arange(len(x))
    x0, x1, y0, y1 = xs[every, k], xs[every, k + 1], ys[every, k], ys[every, k + 1]
    has_length = x1 > x0
    span = np.where(has_length, x1 - x0, 1.0)
    share = np.where(has_length, np.clip((x - x0) / span, 0.0, 1.0), 0.0)
    return y0 + share * (y1 - y0), np.where(has_length, (y1 - y0) / span, 0.0)


class _Ways:
    """Paths of the fingers that have one, parametrised by arc length from the finger."""

    def __init__(self, log):
        self.rows = np.flatnonzero(log.has("ON_PATH"))
        self.told, self.paths = log.records[self.rows], log.paths[self.rows]
        steps = np.linalg.norm(np.diff(self.paths, axis=1), axis=2)
        self.stages = np.concatenate([np.zeros((len(self.rows), 1)), np.cumsum(steps, axis=1)], axis=1)
        self.bends = np.broadcast_to(log.path_bends, self.stages.shape)
        self.begin, _ = _interpolate(self.bends, self.stages, self.told["bend"])

    def length_to(self, bends):
        """Arc length from the fingers to the given bends."""
        return _interpolate(self.bends, self.stages, bends)[0] - self.begin

    def place(self, at, gone):
        """Positions of the rows *at* after an arc length."""
        stages = self.stages[at]
        stage = np.minimum(self.begin[at] + gone, stages[:, -1])
        return np.stack(
            [_interpolate(stages, self.paths[at, :, axis], stage)[0] for axis in range(3)], axis=1
        )


def judge_paths(log, tally):
    """Check that the contact on a path is within its stated error, and so is the time along it."""
    ways = _Ways(log)
    bend, error = ways.told["contact_bend"], ways.told["contact_bend_error"]
    none = np.isnan(bend)
    known = np.flatnonzero(none | np.isfinite(error))
    limits = ways.length_to(np.where(none, ways.bends[:, -1], bend - np.where(none, 0.0, error)))[known]
    first = _march_on_paths(log, ways, known, limits)
    early = limits - first  # -inf without contact
    tally.look("free until the contact on the path", log, early, INSTANT, ways.rows[known])
    found = log.has("CONTACT_FOUND")[ways.rows]
    tally.demand("a contact found has an error", log, np.isfinite(error[found]), ways.rows[found])
    sure = np.flatnonzero(~none & np.isfinite(error))
    limits = np.maximum(ways.length_to(bend + error)[sure], 0.0) + INSTANT
    first = _march_on_paths(log, ways, sure, limits, to_touch=False)  # being inside is contact as well
    tally.demand("a contact that has an error is one", log, np.isfinite(first), ways.rows[sure])
    _judge_path_times(log, tally, ways)


def _march_on_paths(log, ways, which, limits, *, to_touch=True):
    """Run `march` with the parts fixed at their poses of the tick."""

    def place(at, gone):
        return ways.place(which[at], gone), np.zeros(len(at))

    return march(log, ways.rows[which], place, np.ones(len(which)), limits, to_touch=to_touch)


def _judge_path_times(log, tally, ways):
    """Check times along paths, except at corners, where the tracker's choice of side is not observable."""
    _, slope = _interpolate(ways.stages, ways.bends, ways.begin)
    off = np.abs(ways.stages[:, 1:-1] - ways.begin[:, None]).min(axis=1, initial=np.inf)
    lower = ways.told["time_to_contact_lower"]
    is_meant = _is_along_path(log)[ways.rows] & (lower > 0.0) & (slope > 0.0)
    timed = np.flatnonzero(is_meant & (off > 1e-9 * ways.stages[:, -1]))
    speeds = ways.told["bend_rate"][timed] / slope[timed]

    def place(at, seconds):
        return ways.place(timed[at], speeds[at] * seconds), seconds

    rate = speeds + log.history.fastest(log.ticks[ways.rows[timed]])
    _look_at_times(log, tally, "along the path", ways.rows[timed], place, rate, lower[timed])
