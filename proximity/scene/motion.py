"""Motions of a part: turns, slides, and paths through given poses."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np

from proximity.checks import as_float64, shown
from proximity.errors import ArgumentError
from proximity.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """A piece of a motion. The part turns evenly about an axis, which moves evenly along a line.

    ``start`` and ``end`` are positions, ``pose`` is scene from part at the start. ``centre`` is a point of
    the axis at the start and ``axis`` its unit direction, both in the scene's frame.
    """

    start: float
    end: float
    pose: Pose
    centre: np.ndarray  # (3,) m
    shift: np.ndarray  # (3,) m
    axis: np.ndarray  # (3,)
    angle: float  # rad

    def pose_at(self, position: float) -> Pose:
        """Return the pose, scene from part, at a position between start and end."""
        share = (position - self.start) / (self.end - self.start)
        turn = _turn(self.axis, share * self.angle)
        translation = self.centre + share * self.shift + turn @ (self.pose.translation - self.centre)
        return Pose(turn @ self.pose.rotation, translation)

    def path_length(self, points: np.ndarray) -> float:
        """Return an upper bound, m, of the length of the path of any point of the part.

        *points*: (V, 3), the corners of the part.
        """
        arms = points @ self.pose.rotation.T + (self.pose.translation - self.centre)
        radius = float(np.sqrt(np.max(np.sum(np.cross(arms, self.axis) ** 2, axis=1))))
        return float(np.linalg.norm(self.shift)) + abs(self.angle) * radius


class Motion:
    """The motion of a part for `Scene.clearance_along`. It is made by `hinge`, `slide` or `through`.

    Parameters
    ----------
    first, last : float
        Positions at which it begins and ends.
    spans : callable
        Takes the part's present pose and the middle of its box, (3,) m, part's frame. It returns the pieces
        of the motion.
    """

    def __init__(self, first: float, last: float, spans: Callable[[Pose, np.ndarray], list[Span]]) -> None:
        self.first: float = first
        self.last: float = last
        self.spans = spans

    @classmethod
    def hinge(cls, point: Any, axis: Any, start: float, end: float) -> "Motion":
        """Return a turn from the part's present pose about an axis.

        Parameters
        ----------
        point, axis : (3,) array-like, m, scene's frame
            A point of the axis and its direction, of any length. Angles are counter-clockwise as seen against
            the direction.
        start, end : rad
            Angles at which the motion begins and ends; 0 is the present pose.

        Raises
        ------
        ArgumentError
            If an argument is not finite, the axis has no length, or start and end are equal.
        """
        centre, direction = _point("point", point), unit_vector("axis", axis)
        first, last = _range(start, end)

        def spans(pose: Pose, _: np.ndarray) -> list[Span]:
            begin = Span(0.0, 1.0, pose, centre, np.zeros(3), direction, first).pose_at(1.0)
            return [Span(first, last, begin, centre, np.zeros(3), direction, last - first)]

        return cls(first, last, spans)

    @classmethod
    def slide(cls, direction: Any, start: float, end: float) -> "Motion":
        """Return a displacement from the part's present pose along a line.

        Parameters
        ----------
        direction : (3,) array-like, scene's frame
            Of any length.
        start, end : m
            Displacements at which the motion begins and ends; 0 is the present pose.

        Raises
        ------
        ArgumentError
            If an argument is not finite, the direction has no length, or start and end are equal.
        """
        along = unit_vector("direction", direction)
        first, last = _range(start, end)

        def spans(pose: Pose, _: np.ndarray) -> list[Span]:
            begin = Pose(pose.rotation, pose.translation + first * along)
            return [Span(first, last, begin, begin.translation, (last - first) * along, along, 0.0)]

        return cls(first, last, spans)

    @classmethod
    def through(cls, poses: Iterable[Pose], positions: Any = None) -> "Motion":
        """Return a motion through given poses.

        Between two poses, the middle of the part's box moves evenly along a line. The part turns evenly about
        one axis, by the smaller of the two possible angles.

        Parameters
        ----------
        poses : iterable of Pose
            Scene from part; at least two.
        positions : (K,) array-like
            Position of each pose, such as a time in s, in ascending order. Default: 0, 1, 2, …

        Raises
        ------
        ArgumentError
            If there are fewer than two poses, or positions are not ascending or are not one for each pose.
        """
        through = list(poses)
        if len(through) < 2 or not all(isinstance(pose, Pose) for pose in through):
            raise ArgumentError(f"poses are {shown(poses)}, expected two objects of type Pose or more")
        steps = np.arange(len(through), dtype=float)
        if positions is not None:
            steps = as_float64(positions, "positions", expected="a number for each pose")
        if steps.shape != (len(through),) or not np.isfinite(steps).all() or not (np.diff(steps) > 0.0).all():
            raise ArgumentError(
                f"positions are {shown(positions)}, expected {len(through)} ascending numbers"
            )

        def spans(_: Pose, middle: np.ndarray) -> list[Span]:
            found = []
            for k, (begin, finish) in enumerate(pairwise(through)):
                centre, other = (pose.rotation @ middle + pose.translation for pose in (begin, finish))
                axis, angle = _axis_and_angle(finish.rotation @ begin.rotation.T)
                found.append(Span(steps[k], steps[k + 1], begin, centre, other - centre, axis, angle))
            return found

        return cls(float(steps[0]), float(steps[-1]), spans)


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix for a turn about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: np.ndarray = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
    return turn


def _axis_and_angle(turn: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the unit axis of a rotation, and its angle from 0 to pi."""
    sine = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    cosine = 0.5 * (np.trace(turn) - 1.0)
    angle = float(np.arctan2(np.linalg.norm(sine), cosine))
    if angle == 0.0:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis = sine
    if cosine < 0.0:  # near a half turn the sine vanishes
        squares = 0.5 * (turn + turn.T) - cosine * np.eye(3)
        axis = squares[np.argmax(np.diagonal(squares))]
        axis = axis if axis @ sine >= 0.0 else -axis
    return axis / np.linalg.norm(axis), angle


def _point(name: str, given: Any) -> np.ndarray:
    point = as_float64(given, name, expected="three numbers")
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ArgumentError(f"{name} is {shown(given)}, expected three finite numbers")
    return point


def unit_vector(name: str, given: Any) -> np.ndarray:
    """Return a vector of three numbers, scaled to length 1; *name*: of the argument, for errors."""
    vector = _point(name, given)
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < inf:
        raise ArgumentError(f"{name} is {shown(given)}, expected three numbers, not all 0")
    return vector / length


def _range(start: float, end: float) -> tuple[float, float]:
    first, last = (
        float(as_float64(each, name, expected="a number")) for each, name in ((start, "start"), (end, "end"))
    )
    if not (np.isfinite([first, last]).all() and first != last):
        raise ArgumentError(
            f"the motion is from {shown(start)} to {shown(end)}, expected two finite numbers that differ"
        )
    return first, last
