"""Random trials of `PartTracker` with coincident features: one solid of cubes slides along another.

Shared volume, distance and separation displacement are computed exactly from the cubes. Positions within 1e-9
of a coincidence may be judged either way.
"""

import warnings
from dataclasses import dataclass, field

import numpy as np
from polycubes import TURNS, distance, free_from, overlap, polycube
from trial_cells import rotations_of
from trial_log import Tally

from proximity import ConnectionFlag, PartTracker, Pose, Scene, Solid, UnitsWarning

warnings.simplefilter("ignore", UnitsWarning)

NEAR = 1e-9
"""Distance from a coincidence that may be rounding, in cubes."""
STEPS = (1.0, 0.5, 0.25, 0.1, 1e-3, 1e-6)
"""Displacements per tick, in cubes; moves of whole cubes are composed of them."""
SHARING = int(ConnectionFlag.CROSSING | ConnectionFlag.INSIDE)


@dataclass(eq=False)
class FlushLog:
    """Records and offsets (in cubes) of the tracked part at each tick."""

    plan: str
    ticks: list = field(default_factory=list)
    offsets: list = field(default_factory=list)
    records: list = field(default_factory=list)

    def describe(self, row):
        """Format a row as text."""
        record = self.records[row]
        told = ", ".join(
            f"{name} {record[name]!s}" for name in ("flags", "distance", "depth_lower", "depth", "normal")
        )
        return f"tick {self.ticks[row]} at {self.offsets[row].tolist()}: {told}"


def run_flush_trial(seed, ticks):
    """Run a trial of *ticks* ticks; return its plan and the tally of its checks."""
    rng = np.random.default_rng([seed, ticks, 1])
    first, second = polycube(rng), polycube(rng)
    turn = TURNS[rng.integers(len(TURNS))].astype(float)
    size = float(rng.choice([1e-3, 0.05, 1.0])) * np.linalg.norm(turn[0])
    turn /= np.linalg.norm(turn[0])
    quaternion = rng.normal(size=4) if rng.random() < 0.5 else np.eye(4)[0]
    rotation = rotations_of(quaternion / np.linalg.norm(quaternion))
    place = size * rng.normal(size=3) * rng.choice([0.0, 1.0, 1000.0])
    scene = Scene(
        [
            Solid(size * mesh[0] @ turn.T, mesh[1], name=name)
            for name, mesh in (("a", first.mesh), ("b", second.mesh))
        ]
    )
    scene.move("b", Pose(rotation, place))
    settings = {
        "tolerance": float(rng.choice([0.0, 0.05, 0.5])),
        "budget": [None, None, 30, 300][rng.integers(4)],
    }
    tracker, tally = PartTracker(scene, "a", **settings), Tally()
    log = FlushLog(
        f"flush trial {seed}: {len(first.cells)} and {len(second.cells)} cubes, size {size:g}, {settings}"
    )
    offset, to_scene = rng.integers(-4, 5, 3).astype(float), size * rotation @ turn
    step, left = np.zeros(3), 0
    for tick in range(ticks):
        if left == 0:
            offset, length = np.round(2.0 * offset) / 2.0, float(rng.choice(STEPS))
            step = length * rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]
            step *= -np.sign(offset @ step) if np.abs(offset).max() > 3.0 and offset @ step else 1.0
            left = max(int(rng.integers(1, 3) / length), 1) if length >= 1e-3 else 20
        offset, left = offset + step, left - 1
        now = 10**12 + 10**6 * tick
        record = tracker.tick(Pose(rotation, place + to_scene @ offset), now, now)[0]
        log.ticks.append(tick)
        log.offsets.append(offset.copy())
        log.records.append(record.copy())
    room = 1e-13 * (np.abs(place).max() + 20.0 * size)
    _judge(log, tally, first, second, to_scene / size, size, room, settings["budget"])
    tally.broken = [f"{log.plan}\n    {broken}" for broken in tally.broken]
    return log.plan, tally


def _judge(log, tally, first, second, turn, size, room, budget):
    """Compare all records with the values computed from the cubes."""
    records = np.array(log.records)
    sharing = np.array([overlap(first, second, offset, -NEAR) for offset in log.offsets])
    clear = np.array([overlap(first, second, offset, NEAR) for offset in log.offsets])
    apart = size * np.array([distance(first, second, offset) for offset in log.offsets])
    is_told = (records["flags"] & SHARING) != 0
    if budget is None:
        rows = np.flatnonzero(clear)
        tally.demand("flush: shared volume is told", log, is_told[rows], rows)
    rows = np.flatnonzero(~sharing)
    tally.demand("flush: no volume is told that is not shared", log, ~is_told[rows], rows)
    tally.look("flush: lower <= true", log, records["lower"] - apart, room)
    tally.look("flush: true <= upper", log, apart - records["upper"], room)
    rows = np.flatnonzero(clear)
    tally.demand("flush: a part driven in is deep", log, records["depth"][rows] > 0.0, rows)
    ways = records["normal"][rows] @ turn
    ways[np.abs(ways) < NEAR] = 0.0
    true = [free_from(first, second, log.offsets[row], way) for row, way in zip(rows, ways, strict=True)]
    true, allowed = size * np.array(true), room + NEAR * size
    tally.look("flush: lower depth <= true way out", log, records["depth_lower"][rows] - true, allowed, rows)
    tally.look("flush: true way out <= depth", log, true - records["depth"][rows], allowed, rows)
