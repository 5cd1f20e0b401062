"""Random trials of the tracker's guarantees: cell, fingers, settings and events follow from one seed.

The same seed reproduces a violation.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from trial_cells import HEAVY_CELLS, LIGHT_CELLS, History
from trial_judging import judge
from trial_log import Log
from trial_motions import START_NS, motion_of, paths_of

from proximity.errors import UnitsWarning
from proximity.kernels.tracking.motion import MAX_ACCELERATION, MAX_SPEED
from proximity.message import CONTACT
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET

warnings.simplefilter("ignore", UnitsWarning)  # cells use distant fingers and tiny parts

BUDGETS = (1, 2, 3, 5, 8, 16, 40, 100, 400, 2000, None, None)
WORKING_RANGES = (0.0, 1e-3, 0.02, 0.12, 0.12, 1.0, 10.0)
PERIODS = (0.001, 0.001, 0.00025, 0.004, 0.0085)  # s
MIN_TICKS = 12
JERKS = (1e-9, 1e-3, 0.1, 0.1, 300.0)  # m; large displacements make the scene rebuild its tree
EVENTS = ("none", "none", "coast", "coast", "told", "lie", "jerk", "come and go", "deform", "busy", "park")


@dataclass(frozen=True)
class Plan:
    """Printable description of a trial's random choices."""

    seed: int
    cell: str
    events: str
    fingers: int
    ticks: int
    settings: dict
    has_paths: bool
    is_replay: bool

    def __str__(self):
        told = ", ".join(f"{key}={value:g}" for key, value in self.settings.items() if np.isscalar(value))
        more = " with paths" * self.has_paths + " replayed" * self.is_replay
        return (
            f"trial {self.seed}: {self.cell}, events: {self.events}, {self.fingers} fingers{more}, "
            f"{self.ticks} ticks, {told}"
        )


def _settings(rng, finger_count):
    radius = rng.choice([0.0, 0.007, 0.007, 0.02, np.nan])
    return {
        "budget": BUDGETS[rng.integers(len(BUDGETS))],
        "working_range": float(rng.choice(WORKING_RANGES)),
        "tolerance": float(rng.choice([0.0, 0.0, 0.0, 0.05, 0.5])),
        "radius": rng.uniform(0.0, 0.02, finger_count) if np.isnan(radius) else float(radius),
        "latency": float(rng.choice([0.0, 0.001, 0.009, 0.05])),
        "horizon": float(rng.choice([0.25, 0.25, 0.02, 2.0])),
        "max_speed": float(rng.choice([MAX_SPEED, MAX_SPEED, 1.0, 10.0])),
        "max_acceleration": float(rng.choice([MAX_ACCELERATION, MAX_ACCELERATION, 20.0, 500.0])),
    }


class Events:
    """Changes of a cell's parts between ticks."""

    def __init__(self, rng, cell, kind, period):
        self.rng, self.cell, self.kind, self.period = rng, cell, kind, period
        count = len(cell.solids)
        share = rng.choice([0.1, 0.5, 1.0])
        self.movers = np.flatnonzero(rng.random(count) < share) if count > 1 else np.array([0])
        if kind in ("coast", "told", "lie", "busy"):
            self._set_off()
            cell.move(self.movers)

    def _set_off(self):
        """Draw new velocities, biased toward the parts' initial positions."""
        rng, cell, movers = self.rng, self.cell, self.movers
        home = cell.homes[movers] - cell.translations[movers]
        speeds = 10.0 ** rng.uniform(-3.0, 0.5, (len(movers), 1))
        cell.velocities[movers] = rng.normal(size=(len(movers), 3)) * speeds + home
        cell.spins[movers] = rng.normal(size=(len(movers), 3)) * 10.0 ** rng.uniform(
            -2.0, 1.0, (len(movers), 1)
        )
        is_straight = rng.random(len(movers)) < 0.4
        cell.spins[movers[is_straight]] = 0.0

    def step(self):
        """Apply one tick of changes."""
        rng, cell, kind = self.rng, self.cell, self.kind
        if kind in ("coast", "busy") and len(self.movers):
            cell.coast(self.movers, self.period)
            if rng.random() < 0.02:
                self._set_off()
            cell.move(self.movers)
        if kind == "lie" and len(self.movers):
            cell.translations[self.movers] += rng.normal(size=(len(self.movers), 3)) * 1e-3
            cell.move(self.movers)
        if kind == "jerk" and rng.random() < 0.1:
            number = int(rng.integers(len(cell.solids)))
            cell.translations[number] = cell.homes[number] + rng.normal(size=3) * rng.choice(
                [1e-9, 1e-3, 0.1]
            )
            cell.move([number])
        if kind == "park" and rng.random() < 0.1:
            number = int(rng.integers(len(cell.solids)))
            away = 600.0 if rng.random() < 0.5 else 0.0
            cell.translations[number] = cell.homes[number] + rng.normal(size=3) * 1e-2 + (0.0, 0.0, away)
            cell.move([number])
        if kind in ("deform", "busy") and rng.random() < 0.05:
            cell.deform(int(rng.integers(len(cell.solids))), rng)
        if kind in ("come and go", "busy") and rng.random() < 0.05:
            number = int(rng.integers(len(cell.solids)))
            (cell.toggle if rng.random() < 0.6 else cell.swap)(number)


def _tracker(cell, **given):
    return Tracker(cell.scene, **given)


def run_trial(seed, finger_ticks, *, is_heavy=False, make_tracker=_tracker):
    """Run a trial of about *finger_ticks* finger ticks; return its plan and the tally of its checks."""
    plan, log = log_of_trial(seed, finger_ticks, is_heavy=is_heavy, make_tracker=make_tracker)
    tally = judge(log)
    tally.broken = [f"{plan}\n    {broken}" for broken in tally.broken]
    return plan, tally


def log_of_trial(seed, finger_ticks, *, is_heavy=False, make_tracker=_tracker):
    """Run a trial without judging it; return its plan and log."""
    rng = np.random.default_rng([seed, finger_ticks, is_heavy])
    make = (HEAVY_CELLS if is_heavy else LIGHT_CELLS)[seed % len(HEAVY_CELLS if is_heavy else LIGHT_CELLS)]
    cell = make(rng)
    if rng.random() < 0.05:
        cell.translations += 1000.0
        cell.homes += 1000.0
        cell.move(range(len(cell.solids)))
    counts = [5, 5, 10, 30, 200, 2000]
    finger_count = int(rng.choice([count for count in counts if MIN_TICKS * count <= finger_ticks]))
    tick_count = max(finger_ticks // finger_count, MIN_TICKS)
    settings = _settings(rng, finger_count)
    period = float(rng.choice(PERIODS))
    kind = str(rng.choice(EVENTS))
    is_replay, has_paths = bool(rng.random() < 0.25), bool(rng.random() < 0.3)
    limits = {name: settings[name] for name in ("max_speed", "max_acceleration")}
    motion = motion_of(rng, cell, tick_count, finger_count, period=period, is_replay=is_replay, **limits)
    paths = None
    if has_paths:
        paths, is_put = paths_of(rng, cell, finger_count, motion.positions)
        motion.is_exact &= ~is_put
    events = Events(rng, cell, kind, period)
    given = {name: value for name, value in settings.items() if value is not None}
    tracker = make_tracker(cell, fingers=finger_count, **given)
    log = _tick_through(rng, cell, events, tracker, motion, paths)
    log.radii = np.broadcast_to(settings["radius"], finger_count)[log.fingers]
    log.tolerance = settings["tolerance"]
    log.budget = settings["budget"] or DEFAULT_BUDGET
    log.working_range, log.max_speed = settings["working_range"], settings["max_speed"]
    plan = Plan(
        seed, make.__name__, kind, finger_count, tick_count, given | {"period": period}, has_paths, is_replay
    )
    return plan, log


class Truth:
    """Signed distances of a cell's second scene, computed in one batch for all ticks between two changes."""

    def __init__(self, cell, positions):
        self.cell, self.positions = cell, positions
        self.true = np.empty(positions.shape[:2])
        self.asked = self.tick = 0
        cell.before_change = self.ask

    def ask(self):
        """Compute the distances of the ticks since the last call."""
        points = self.positions[self.asked : self.tick]
        if len(points):
            self.true[self.asked : self.tick] = self.cell.twin.signed_distance(points)
            self.asked = self.tick


def _tick_through(rng, cell, events, tracker, motion, paths):
    """Run all ticks; return their log."""
    tick_count, finger_count, _ = motion.positions.shape
    history, truth = History(cell, tick_count), Truth(cell, motion.positions)
    records = np.empty((tick_count, finger_count), CONTACT)
    corners = None if paths is None else np.empty((tick_count, *paths.corners.shape))
    adaptive_tolerance = np.empty(tick_count)
    for tick in range(tick_count):
        if tick:
            for _ in range(rng.choice([1, 1, 1, 1, 3])):
                events.step()
            if rng.random() < 0.005:
                tracker.reset()
        history.note(tick)
        more = {}
        if motion.velocities is not None:
            more["velocities"] = motion.velocities[tick]
        if paths is not None:
            corners[tick] = paths.at(motion.positions[tick])
            more |= {"paths": corners[tick], "path_bends": paths.bends, "bends": paths.told_bends(rng)}
        pose_ns, now_ns = motion.pose_ns[tick], int(motion.now_ns[tick])
        adaptive_tolerance[tick] = tracker._settings["adaptive_tolerance"].item()
        records[tick] = tracker.tick(motion.positions[tick], pose_ns, now_ns, **more)
        truth.tick = tick + 1
    truth.ask()
    fingers = np.tile(np.arange(finger_count), tick_count)
    return Log(
        history=history,
        course=motion.course,
        ticks=np.repeat(np.arange(tick_count), finger_count),
        fingers=fingers,
        positions=motion.positions.reshape(-1, 3),
        records=records.ravel(),
        true=truth.true.ravel(),
        adaptive_tolerance=np.repeat(adaptive_tolerance, finger_count),
        is_exact=motion.is_exact[fingers],
        start_ns=START_NS,
        paths=None if paths is None else corners.reshape(-1, *corners.shape[2:]),
        path_bends=None if paths is None else paths.known_bends,
    )
