"""A recorded fingertip as the intent of a simulated hand: it comes as near to the surface.

A finger of the glove has one way. So what counts of a recorded motion is how far the fingertip is from the
parts, instant by instant: the finger of the simulation goes as far along its path.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.kernels.tracking.motion import MAX_SPEED
from proximity.lab.engine.finger_placement import PlacedFinger, place_finger
from proximity.lab.paper.trajectories import Motion
from proximity.lab.simulation import press_kernels
from proximity.recording import NANOSECONDS, Recording
from proximity.scene.scene import Scene

RESAMPLED_STEP = 0.001  # s, between two positions that are kept
LONGEST_RECORDING = 60.0  # s, of a recording
LONGEST_GAP = 0.050  # s without a sample: for longer, the finger is lost


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPress:
    """Intended position of a hand at even steps; it touches at 0. T instants."""

    begin: float  # s, of the first instant; before the touch
    step: float  # s
    positions: np.ndarray  # (T,) m, positive into the wall
    velocities: np.ndarray  # (T,) m/s
    is_seen: np.ndarray  # (T,) bool: the sensor had the finger
    finger: str  # whose motion it is
    outside: np.ndarray  # (3,) m, the last position before the touch, scene's frame

    @property
    def loss_time(self) -> float:
        """Time at which the recording ends, s."""
        return self.begin + self.step * (len(self.positions) - 1)

    @property
    def release_time(self) -> float:
        """The same: a recording does not say when the hand begins to leave."""
        return self.loss_time

    def lead(self, start_distance: float) -> float:
        """Return how long before the touch it begins, s."""
        return -self.begin

    def at(self, times: ArrayLike) -> Motion:
        """Return where the hand means to be."""
        own = self.begin + self.step * np.arange(len(self.positions))
        times = np.asarray(times, np.float64)
        is_within = (times > own[0]) & (times < own[-1])
        velocity = np.where(is_within, np.interp(times, own, self.velocities), 0.0)
        accelerations = np.gradient(self.velocities, self.step)
        acceleration = np.where(is_within, np.interp(times, own, accelerations), 0.0)
        return Motion(np.interp(times, own, self.positions), velocity, acceleration)

    def sees(self, time: float) -> bool:
        """Return whether the sensor had the finger at an instant."""
        row = round((time - self.begin) / self.step)
        return bool(self.is_seen[min(max(row, 0), len(self.is_seen) - 1)])

    def as_array(self) -> np.ndarray:
        """Return its numbers as the kernels read them."""
        head = np.zeros(press_kernels.PRESS_TABLE)
        head[press_kernels.PRESS_BEGIN], head[press_kernels.PRESS_STEP] = self.begin, self.step
        return np.concatenate([head, self.positions, self.velocities])


def recorded_press(scene: Scene, recording: Recording, radius: float, start_distance: float) -> RecordedPress:
    """Return the motion of the finger that touches first."""
    if recording.duration_s > LONGEST_RECORDING:
        raise ArgumentError(
            f"{recording.path}: {recording.duration_s:.0f} s are recorded, "
            f"expected at most {LONGEST_RECORDING:g} s"
        )
    motions = [_without_jumps(recording, column) for column in range(len(recording.fingers))]
    column, last = _first_touch(scene, recording.path, motions, radius)
    own, points = motions[column]
    curve = PchipInterpolator(own, np.maximum(radius - scene.signed_distance(points), -start_distance))
    touch = _crossing(curve, own[last - 1], own[last])
    instants = np.arange(own[0], own[-1], RESAMPLED_STEP)
    after = np.clip(np.searchsorted(own, instants, side="right"), 1, len(own) - 1)
    return RecordedPress(
        float(own[0] - touch),
        RESAMPLED_STEP,
        np.asarray(curve(instants)),
        np.asarray(curve(instants, 1)),
        own[after] - own[after - 1] <= LONGEST_GAP,
        recording.finger_name(column),
        points[last - 1],
    )


def recorded_hand(scene: Scene, recording: Recording) -> tuple[PlacedFinger, RecordedPress]:
    """Return the finger of a recorded hand that touches first, before it touches, and its motion."""
    glove = Glove()
    press = recorded_press(scene, recording, glove.finger.pad_radius, math.inf)
    finger = place_finger(scene, press.outside.tolist(), glove=glove)
    return finger, recorded_press(scene, recording, glove.finger.pad_radius, finger.contact_position)


def _without_jumps(recording: Recording, column: int) -> tuple[np.ndarray, np.ndarray]:
    """Times of a finger, s, and its positions, m; without tracking jumps."""
    rows = np.flatnonzero(recording.is_present[:, column])
    times = (recording.times_ns[rows] - recording.times_ns[0]) / NANOSECONDS
    points = recording.positions[rows, column]
    kept = [0] if len(rows) else []
    for i in range(1, len(rows)):
        elapsed = times[i] - times[kept[-1]]
        if elapsed > LONGEST_GAP or np.linalg.norm(points[i] - points[kept[-1]]) <= MAX_SPEED * elapsed:
            kept.append(i)
    return times[kept], points[kept]


def _first_touch(
    scene: Scene, path: str, motions: list[tuple[np.ndarray, np.ndarray]], radius: float
) -> tuple[int, int]:
    """Finger and sample of the first that touches and has one before it that does not."""
    best = (math.inf, -1, -1)  # s, finger, sample
    for column, (times, points) in enumerate(motions):
        is_in = scene.signed_distance(points) <= radius
        came = np.flatnonzero(is_in[1:] & ~is_in[:-1]) + 1
        if len(came):
            best = min(best, (float(times[came[0]]), column, int(came[0])))
    if best[1] < 0:
        raise ArgumentError(
            f"{path}: no finger approaches the parts from outside and touches them: move the recording to "
            "where one does"
        )
    return best[1], best[2]


def _crossing(curve: PchipInterpolator, outside: float, inside: float) -> float:
    """Time of touch between two instants."""
    for _ in range(60):
        middle = 0.5 * (outside + inside)
        if curve(middle) < 0.0:
            outside = middle
        else:
            inside = middle
    return inside
