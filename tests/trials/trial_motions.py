"""Motions for tracker trials: true finger positions, and the sensor's data and timing.

A finger's *course* is a formula: rest, a straight line and two oscillations, with known acceleration and
defined at any time. Some fingers add random walks, noise, jumps or recorded hands. Predictions are compared
only for fingers without these.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import shapes
from project import RECORDED_HANDS
from trial_cells import MESHES

from proximity.pose import Pose
from proximity.recording import read_recording

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
STYLES = ("rest", "smooth", "smooth", "sweep", "sweep", "walk", "jitter", "jumps", "approach")
LESS = 0.95
"""Fraction of the limits that motions use: time stamps rounded to nanoseconds add a little."""


@dataclass(eq=False)
class Motion:
    """Motion of N fingers over T ticks."""

    positions: np.ndarray  # (T, N, 3) m, as reported; nan if tracking is lost
    pose_ns: np.ndarray  # (T, N) int64
    now_ns: np.ndarray  # (T,) int64
    velocities: np.ndarray | None  # (T, N, 3) m/s, as reported
    course: "Course"
    is_exact: np.ndarray  # (N,) the reported data follows the course within the limits


@dataclass(eq=False)
class Course:
    """Courses of N fingers: centre + line t + the sum over k of swing_k sin(rate_k t + phase_k)."""

    centres: np.ndarray  # (N, 3) m
    lines: np.ndarray  # (N, 3) m/s
    swings: np.ndarray  # (N, 2, 3) m
    rates: np.ndarray  # (N, 2) rad/s
    phases: np.ndarray  # (N, 2)

    def position(self, fingers, seconds):
        """Positions (M, 3) of fingers (M,) at seconds (M,) since the start."""
        angles = self.rates[fingers] * seconds[:, None] + self.phases[fingers]
        swing = (self.swings[fingers] * np.sin(angles)[..., None]).sum(axis=1)
        return self.centres[fingers] + seconds[:, None] * self.lines[fingers] + swing

    def velocity(self, fingers, seconds):
        angles = self.rates[fingers] * seconds[:, None] + self.phases[fingers]
        pace = (self.rates[fingers] * np.cos(angles))[..., None]
        return self.lines[fingers] + (self.swings[fingers] * pace).sum(axis=1)


def directions(rng, *shape):
    found = rng.normal(size=(*shape, 3))
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def course_of(rng, styles, places, seconds, max_speed, max_acceleration):
    """Courses near *places* for a duration."""
    count = len(places)
    lines, swings = np.zeros((count, 3)), np.zeros((count, 2, 3))
    rates, phases = np.ones((count, 2)), rng.uniform(0.0, 2.0 * np.pi, (count, 2))
    speeds = LESS * np.minimum(10.0 ** rng.uniform(-2.0, 0.5, count), max_speed)
    for row in range(count):
        if styles[row] in ("smooth", "jitter", "jumps", "walk"):
            # Speed and acceleration of a swing are its size times rate and rate squared. Two swings share the
            # limits.
            rates[row] = np.minimum(10.0 ** rng.uniform(0.0, 2.0, 2), LESS * max_acceleration / speeds[row])
            swings[row] = directions(rng, 2) * (0.5 * speeds[row] / rates[row])[:, None]
        elif styles[row] == "sweep":
            lines[row] = directions(rng) * speeds[row]
        elif styles[row] == "approach":
            lines[row] = directions(rng) * 0.01
    # A finger in straight motion passes its position within the duration.
    centres = places - lines * (rng.uniform(0.0, 1.0, (count, 1)) * seconds)
    return Course(centres, lines, swings, rates, phases)


@cache
def recorded_hands(period):
    """Recorded hands, an array (T, 5, 3) each, centred; nan if the sensor lost them."""
    paths = [MESHES / "hand.csv", *(path for path in RECORDED_HANDS if path.is_file())]
    hands = []
    for path in paths:
        recording = read_recording(path).resampled(period)
        for hand in dict.fromkeys(hand for hand, _ in recording.fingers):
            columns = [row for row, (own, _) in enumerate(recording.fingers) if own == hand]
            places = recording.positions[:, columns]
            hands.append(places - np.nanmean(places, axis=(0, 1)))
    return hands


def clock(rng, tick_count, finger_count, period):
    """Times of the poses (T, N) by the sensor, and of the ticks (T,), ns."""
    way = rng.choice(["even", "even", "uneven", "stutter", "repeated", "backwards", "each"])
    steps = np.full(tick_count, round(period * NS))
    if way == "uneven":
        steps = np.round(rng.exponential(period * NS, tick_count)).astype(np.int64) + 1
    elif way == "stutter":
        steps[rng.random(tick_count) < 0.02] = rng.integers(1, NS // 2)
    elif way == "repeated":
        steps[rng.random(tick_count) < 0.3] = 0
    elif way == "backwards":
        steps[rng.random(tick_count) < 0.03] = -rng.integers(1, NS // 5)
    pose_ns = START_NS + np.cumsum(steps)[:, None] + np.zeros((1, finger_count), np.int64)
    if way == "each":
        # Each finger has its own sensor; some ticks bring no new pose.
        pose_ns = pose_ns - rng.integers(0, max(int(period * NS), 1), (tick_count, finger_count))
        is_slow = rng.random(finger_count) < 0.3
        pose_ns[:, is_slow] -= pose_ns[:, is_slow] % 8_500_000
    age_ns = int(rng.choice([0, 1_000_000, 9_000_000, 40_000_000]))
    return pose_ns, pose_ns.max(axis=1) + age_ns


def motion_of(rng, cell, tick_count, finger_count, *, period, max_speed, max_acceleration, is_replay=False):
    """Motion of a trial's fingers near the parts of a cell."""
    pose_ns, now_ns = clock(rng, tick_count, finger_count, period)
    seconds = 1e-9 * (pose_ns - START_NS)
    styles = rng.choice(STYLES, finger_count)
    places = cell.places(rng, finger_count)
    limits = max_speed, max_acceleration
    course = course_of(rng, styles, places, float(seconds.max() - seconds.min()), *limits)
    rows = np.tile(np.arange(finger_count), tick_count)
    shape = tick_count, finger_count, 3
    positions = course.position(rows, seconds.ravel()).reshape(shape)
    told = course.velocity(rows, seconds.ravel()).reshape(shape)
    is_exact = np.isin(styles, ["rest", "smooth", "sweep", "approach"])
    if is_replay:
        positions, is_exact = _replayed(rng, places, tick_count, period), np.zeros(finger_count, bool)
    _disturb(rng, styles, positions)
    if rng.random() < 0.5:
        _lose(rng, positions)
    velocities = None
    if rng.random() < 0.2:
        velocities = told
        if rng.random() < 0.5:
            # Some are unknown, some wrong.
            velocities[rng.random((tick_count, finger_count)) < 0.2] = np.nan
            is_wrong = rng.random(finger_count) < 0.3
            velocities[:, is_wrong] = rng.normal(size=(tick_count, int(is_wrong.sum()), 3))
            is_exact &= ~is_wrong
    return Motion(positions, pose_ns, now_ns, velocities, course, is_exact)


def _replayed(rng, places, tick_count, period):
    """Recorded hands moved to *places* and rotated, five fingers each."""
    hands = recorded_hands(period)
    positions = np.empty((tick_count, len(places), 3))
    for first in range(0, len(places), 5):
        hand = hands[rng.integers(len(hands))]
        start = rng.integers(max(len(hand) - tick_count, 1))
        rows = np.minimum(start + np.arange(tick_count), len(hand) - 1)
        turn = Pose(shapes.rotation(int(rng.integers(2**31))))
        columns = np.arange(first, min(first + 5, len(places)))
        positions[:, columns] = turn.point(hand[rows][:, columns - first]) + places[first]
    return positions


def _disturb(rng, styles, positions):
    """Add walks, noise and jumps."""
    tick_count = len(positions)
    for row in range(positions.shape[1]):
        if styles[row] == "walk":
            steps = rng.normal(size=(tick_count, 3)) * 10.0 ** rng.uniform(-6.0, -2.0)
            positions[:, row] += np.cumsum(steps, axis=0)
        elif styles[row] == "jitter":
            positions[:, row] += rng.normal(size=(tick_count, 3)) * 10.0 ** rng.uniform(-6.0, -2.5)
        elif styles[row] == "jumps":
            is_jump = rng.random(tick_count) < 0.05
            jumps = np.where(is_jump[:, None], rng.normal(size=(tick_count, 3)) * 0.1, 0.0)
            # Half of the jumps are outliers of a single pose.
            positions[:, row] += np.cumsum(jumps, axis=0) if rng.random() < 0.5 else jumps


def _lose(rng, positions):
    """Lose tracking at random: short and long gaps, single coordinates, infinities."""
    tick_count, finger_count, _ = positions.shape
    for row in np.flatnonzero(rng.random(finger_count) < 0.5):
        is_lost = np.zeros(tick_count, bool)
        for start in np.flatnonzero(rng.random(tick_count) < 0.02):
            is_lost[start : start + rng.integers(1, 1 + 10 ** rng.integers(1, 3))] = True
        positions[is_lost, row] = rng.choice([np.nan, np.inf])
        if rng.random() < 0.1:
            positions[is_lost, row] = [0.0, np.nan, 0.0]


@dataclass(eq=False)
class Paths:
    """Paths of bending fingers: N polylines, fixed in the scene or moving with the finger."""

    corners: np.ndarray  # (N, K, 3) m, or offsets from the finger; nan in the first corner without a path
    bends: np.ndarray | None  # (K,)
    goes_along: bool
    way: str  # fingers with reported bends: "not", "some" or "all"

    @property
    def known_bends(self):
        """Bends (K,) of the corners, given or default."""
        return np.linspace(0.0, 1.0, self.corners.shape[1]) if self.bends is None else self.bends

    def told_bends(self, rng):
        """Bends (N,) of the fingers, anywhere on their paths and beyond; None if not reported."""
        if self.way == "not":
            return None
        low, high = self.known_bends[[0, -1]]
        told = rng.uniform(low - 0.1, high + 0.1, len(self.corners))
        if self.way == "some":
            told[rng.random(len(told)) < 0.5] = np.nan
        return told

    def at(self, positions):
        """Corners (N, K, 3) for fingers at *positions* (N, 3)."""
        return self.corners + positions[:, None, :] if self.goes_along else self.corners


def paths_of(rng, cell, finger_count, positions):
    """Paths to points near the parts, and a mask of fingers moved onto theirs; changes *positions*."""
    corner_count = int(rng.choice([2, 3, 8, 20]))
    goes_along = bool(rng.random() < 0.5)
    is_put = np.zeros(finger_count, bool)
    targets = cell.places(rng, finger_count)
    starts = targets + directions(rng, finger_count) * 10.0 ** rng.uniform(-2.5, -0.3, (finger_count, 1))
    if goes_along:
        starts = np.where(np.isfinite(positions[0]), positions[0], 0.0)
    # A curved path to the target and beyond it.
    shares = np.linspace(0.0, 1.3, corner_count)[:, None]
    if corner_count > 2 and rng.random() < 0.2:
        shares[rng.integers(1, corner_count)] = shares[0]  # a repeated corner
        shares.sort(axis=0)
    reach = (targets - starts)[:, None, :]
    bulge = np.linalg.norm(reach, axis=2, keepdims=True) * directions(rng, finger_count, 1)
    corners = shares * reach + 0.3 * np.sin(2.0 * shares) * bulge
    if goes_along:
        corners += rng.normal(size=(finger_count, 1, 3)) * rng.choice([0.0, 0.0, 1e-4, 3e-3])
    else:
        corners += starts[:, None, :]
        is_put = _follow(rng, corners, positions)
    bends = None if rng.random() < 0.5 else np.cumsum(rng.uniform(0.01, 1.0, corner_count)) - 0.5
    corners[rng.random(finger_count) < 0.1, 0] = np.nan
    return Paths(corners, bends, goes_along, str(rng.choice(["not", "not", "some", "all"]))), is_put


def _follow(rng, corners, positions):
    """Move most fingers to and fro along their path, at a small offset."""
    tick_count, finger_count, _ = positions.shape
    shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, rng.uniform(1.0, 9.0), tick_count))
    at = shares * (corners.shape[1] - 1)
    first = np.minimum(at.astype(int), corners.shape[1] - 2)
    part = (at - first)[:, None, None]
    on_path = (1.0 - part) * corners[:, first].swapaxes(0, 1) + part * corners[:, first + 1].swapaxes(0, 1)
    on_path += directions(rng, finger_count) * rng.choice([0.0, 1e-6, 1e-3])
    is_put = (rng.random(finger_count) < 0.8) & np.isfinite(positions).all(axis=(0, 2))
    positions[:, is_put] = on_path[:, is_put]
    return is_put
