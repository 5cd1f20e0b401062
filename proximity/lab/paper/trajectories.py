"""Prescribed motions of a finger that presses on a wall and leaves it, in closed form.

The paper shows such curves without numbers. Those used here are assumed (docs/science/drum.md). The motion
into the wall is the polynomial of lowest degree that begins with the speed of the touch and stops at depth
with continuous acceleration. In general it is a quintic. For the duration used here, which is twice the depth
over the speed, its fifth-degree term vanishes.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of a finger at T instants."""

    position: np.ndarray  # (T,) m, positive into the wall
    velocity: np.ndarray  # (T,) m/s
    acceleration: np.ndarray  # (T,) m/s²


class Intent(Protocol):
    """Intended motion of a hand in a closed loop, as it would be without a wall. It touches at time 0."""

    @property
    def release_time(self) -> float:
        """End of the hold, s."""

    @property
    def loss_time(self) -> float:
        """End of the contact, s."""

    def lead(self, start_distance: float) -> float:
        """Return the time from the start of the motion to the touch, s.

        *start_distance*: maximum distance at the start, m.
        """

    def at(self, times: ArrayLike) -> Motion:
        """Return the intended motion of the hand."""

    def as_array(self) -> np.ndarray:
        """Return the numbers of the motion in the layout of the kernels."""


@dataclass(frozen=True, slots=True)
class Press:
    """A press that comes at constant speed, stops at a depth, holds it, and leaves at the same speed.

    A press that would leave before it has stopped raises an error.
    """

    speed: float = 0.1  # m/s, at touch and at loss; assumed
    depth: float = 0.004  # m, the pad's deflection in the paper
    touch_time: float = 0.050  # s; assumed
    release_time: float = 0.280  # s, start of leaving; assumed

    def __post_init__(self) -> None:
        positive("speed", self.speed, "metres a second")
        positive("depth", self.depth, "metres")
        not_negative("touch_time", self.touch_time, "seconds")
        not_negative("release_time", self.release_time, "seconds")
        # The tolerance is for the rounding of summed times.
        if self.release_time < self.stop_time * (1.0 - 1e-12):
            raise ArgumentError(
                f"release_time is {self.release_time:g} s, but the finger stops at {self.stop_time:g} s: "
                "expected a press that stops before it leaves"
            )

    @property
    def rise_time(self) -> float:
        """Time from touch to rest, and from release to loss, s."""
        return 2.0 * self.depth / self.speed

    @property
    def stop_time(self) -> float:
        """Time at which the finger rests at depth, s."""
        return self.touch_time + self.rise_time

    @property
    def loss_time(self) -> float:
        """Time at which the finger is back at the surface, s. The force has ended earlier."""
        return self.release_time + self.rise_time

    def deeper(self, penetration: float) -> "Press":
        """Return the same press on a soft wall, with the same speed and release but a greater depth."""
        return replace(self, depth=self.depth + not_negative("penetration", penetration, "metres"))

    def at(self, times: ArrayLike) -> Motion:
        """Return the motion of the finger."""
        times = np.asarray(times, np.float64)
        s = np.clip((times - self.touch_time) / self.rise_time, 0.0, 1.0)
        r = np.clip((times - self.release_time) / self.rise_time, 0.0, 1.0)
        before = np.minimum(times - self.touch_time, 0.0)
        after = np.maximum(times - self.loss_time, 0.0)
        position = self.depth * (2.0 * s - 2.0 * s**3 + s**4 - 2.0 * r**3 + r**4)
        velocity = self.speed * ((1.0 - s) ** 2 * (1.0 + 2.0 * s) - r**2 * (3.0 - 2.0 * r))
        acceleration = -6.0 * self.speed / self.rise_time * (s * (1.0 - s) + r * (1.0 - r))
        return Motion(position + self.speed * (before - after), velocity, acceleration)

    def lead(self, start_distance: float) -> float:
        """Return the time from a distance to the touch, s."""
        return start_distance / self.speed

    def as_array(self) -> np.ndarray:
        """Return the numbers of the press in the layout of the closed loop's kernels."""
        if self.touch_time != 0.0:
            raise ArgumentError(f"press touches at {self.touch_time:g} s, expected one that touches at 0")
        return np.array([self.speed, self.depth, self.release_time])
