"""Placement of a finger in front of a part, with the pose of its hand and its exact first contact.

This contact is the truth of a simulation with the engine, and the position of the real wall. It is found by
repeated exact distances along the finger's curve, not along the polyline of the tracker.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.message import PATH_CORNERS
from proximity.pose import Pose
from proximity.scene.scene import Scene

RETRACTION = 0.030  # m, from the contact to the drum's farthest position; assumed
MIN_FREE_PATH = 0.030  # m, free path of the finger before it touches; assumed
FARTHEST_OFF = 0.020  # m, from the intended to the actual touch, beyond which another part is touched
AS_ASKED = 1e-5  # m, of the same distance, within which no other attitude is tried
ROLLS = 24  # attitudes of the hand about the direction at the touch, evenly spaced
CONTACT_TOLERANCE = 1e-9  # m, at which the search for the touch ends
MAX_APPROACH_STEPS = 20_000  # of that search, as a finger that slides along a surface never reaches it


@dataclass(frozen=True, slots=True, eq=False)
class PlacedFinger:
    """A finger of a resting hand in front of a scene, and its first touch."""

    scene: Scene
    glove: Glove
    path: FingerPath
    world_from_hand: Pose
    contact_bend: float
    normal: np.ndarray  # (3,) unit, outward, of the surface there
    part: int  # row of the touched part

    @property
    def contact_position(self) -> float:
        """Position of the fingertip on its path when it touches, m."""
        return self.path.position(self.contact_bend)

    @property
    def retraction(self) -> float:
        """Distance from the touch to the drum's waiting position, m."""
        return self.path.retracted - self.contact_position

    @property
    def incidence(self) -> float:
        """Cosine between the finger's path and the surface's normal at the touch."""
        return -float(self.normal @ _direction(self.glove.finger, self.world_from_hand, self.contact_bend))

    def corners(self, count: int = PATH_CORNERS) -> np.ndarray:
        """Return the finger's path as a polyline for the tracker, (K, 3), m, scene's frame."""
        return self.glove.finger.path_world(self.world_from_hand, count)

    def point(self, bend: float) -> np.ndarray:
        """Return the centre of the fingertip, (3,), m, scene's frame."""
        return self.world_from_hand.point(self.glove.finger.point_hand(bend))


def place_finger(
    scene: Scene, at: Sequence[float] | None = None, *, glove: Glove | None = None
) -> PlacedFinger:
    """Return a finger that touches a part head-on, 30 mm before its drum's farthest position.

    The hand has the first attitude with a free path to the intended position. If there is none, it has the
    attitude whose touch is nearest to that position.
    """
    glove = glove or Glove()
    path, finger = FingerPath(glove), glove.finger
    bend = path.bend(path.retracted - RETRACTION)
    point, direction = _target(scene, _viewpoint(scene) if at is None else np.asarray(at, np.float64))
    center = point - finger.pad_radius * direction
    best, nearest = None, FARTHEST_OFF
    for turn in range(ROLLS):
        pose = _held(finger, bend, center, direction, 2.0 * math.pi * turn / ROLLS)
        touch = first_touch(scene, finger, pose)
        if not path.position(touch) > MIN_FREE_PATH:
            continue
        off = float(np.linalg.norm(pose.point(finger.point_hand(touch)) - center))
        if off < nearest - 1e-6:
            best, nearest = (pose, touch), off
        if off < AS_ASKED:
            break
    if best is None:
        reported = ", ".join(f"{1e3 * coordinate:g}" for coordinate in point)
        raise ArgumentError(
            f"({reported}) mm: no finger gets there without touching the part before, expected a position "
            f"with {1e3 * MIN_FREE_PATH:g} mm of free path before it"
        )
    return placed(scene, glove, *best)


def placed(scene: Scene, glove: Glove, world_from_hand: Pose, touch: float | None = None) -> PlacedFinger:
    """Return the finger of a hand at a pose, by default with its first touch."""
    bend = first_touch(scene, glove.finger, world_from_hand) if touch is None else touch
    if not 0.0 < bend < 1.0:
        raise ArgumentError("the finger touches no part between flat hand and fist, expected one that does")
    hit = scene.closest(world_from_hand.point(glove.finger.point_hand(bend)))
    normal = np.asarray(hit.gradient, np.float64)
    return PlacedFinger(scene, glove, FingerPath(glove), world_from_hand, bend, normal, int(hit.part))


def first_touch(scene: Scene, finger: Finger, world_from_hand: Pose) -> float:
    """Return the bend at the first touch of the pad, or nan if it never touches or always does.

    Notes
    -----
    Cost: one exact distance per step. No step is longer than the distance, so that no surface is skipped.
    """
    fastest = float(finger.speed(np.linspace(0.0, 1.0, 101)).max()) * 1.001
    bend = 0.0
    for _ in range(MAX_APPROACH_STEPS):
        point = world_from_hand.point(finger.point_hand(bend))
        distance = float(scene.signed_distance(point)) - finger.pad_radius
        if distance <= CONTACT_TOLERANCE:
            return bend if bend > 0.0 else math.nan
        bend += distance / fastest
        if bend >= 1.0:
            return math.nan
    return math.nan


def _viewpoint(scene: Scene) -> np.ndarray:
    """Return a point above the middle of all parts.

    Its height above the parts is their own height plus the length of a finger.
    """
    lower, upper = scene.bounds
    middle = 0.5 * (lower + upper)
    return np.array([middle[0], middle[1], upper[2] + (upper[2] - lower[2]) + 0.1])


def _target(scene: Scene, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface point nearest to *at*, and the unit direction to it."""
    if at.shape != (3,) or not np.isfinite(at).all():
        raise ArgumentError(f"the position is {at.tolist()!r}, expected three coordinates in metres")
    hit = scene.closest(at)
    gradient = np.asarray(hit.gradient, np.float64)
    return np.asarray(hit.point, np.float64), -gradient


def _held(finger: Finger, bend: float, center: np.ndarray, direction: np.ndarray, roll: float) -> Pose:
    """Return the pose of a hand whose fingertip is at *center* at a bend and moves along *direction*.

    *roll*: angle of the hand about that direction, rad.
    """
    rate = finger.point_rate(bend)
    tangent = np.array([*(rate / np.hypot(*rate)), 0.0])
    hand = np.stack([tangent, np.cross([0.0, 0.0, 1.0], tangent), [0.0, 0.0, 1.0]], axis=1)
    side = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    side /= np.linalg.norm(side)
    other = np.cross(direction, side)
    c, s = math.cos(roll), math.sin(roll)
    world = np.stack([direction, c * side + s * other, c * other - s * side], axis=1)
    rotation = world @ hand.T
    return Pose(rotation, center - rotation @ finger.point_hand(bend))


def _direction(finger: Finger, world_from_hand: Pose, bend: float) -> np.ndarray:
    """Return the direction in which the fingertip moves as the finger bends, unit, (3,), scene's frame."""
    rate = finger.point_rate(bend)
    return world_from_hand.direction(np.array([*(rate / np.hypot(*rate)), 0.0]))
