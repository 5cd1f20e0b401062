"""Cost of a position: the nodes and leaves that a tick visits for a finger there.

This counts work, not time, so that it is the same on every run and a search can maximise it. The work of
predicting a moving finger's contact is included.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from proximity.lab.certificate.subject import Subject
from proximity.message import ContactFlag

GROUP = 5
"""Fingers of a probe: a hand's, so that each has the whole budget of a tick."""
UNLIMITED = 2**31 - 1
"""A budget that is never spent."""
APPROACH_SPEED = 0.5
"""m/s, of a finger that moves."""
DIRECTION = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
"""Direction in which a moving finger comes: the same for all, so that each position has one cost."""
PERIOD_NS = 1_000_000
NOWHERE = -1.0
"""Worth of a position out of the working range: nothing is searched for there."""


class Manner(StrEnum):
    """Motion of a finger at a position."""

    COLD = "cold"  # the first tick: nothing is known of it
    STAYS = "stays"  # it was there at the tick before
    MOVES = "moves"  # it comes at 0.5 m/s


@dataclass(frozen=True, slots=True)
class Goal:
    """Quantity that the search maximises."""

    manner: Manner
    has_budget: bool  # as the ticks have it; otherwise what an exact answer costs

    def __str__(self) -> str:
        return f"{self.manner}, {'within the budget' if self.has_budget else 'exact'}"


GOALS = tuple(Goal(manner, has_budget) for has_budget in (True, False) for manner in Manner)


@dataclass(frozen=True, slots=True, eq=False)
class Costs:
    """Costs of K positions."""

    work: np.ndarray  # (K,) int64, nodes and leaves
    lower: np.ndarray  # (K,) m, of the signed distance
    upper: np.ndarray  # (K,) m
    is_in_range: np.ndarray  # (K,)

    @property
    def worth(self) -> np.ndarray:
        """Value that the search maximises, (K,): work; at equal work (a spent budget), wider bounds."""
        width = self.upper - self.lower
        size = np.abs(self.lower) + np.abs(self.upper)
        share = np.divide(width, size, out=np.zeros_like(width), where=size > 0.0)
        return np.where(self.is_in_range, self.work + 0.5 * np.minimum(share, 1.0), NOWHERE)


class Probe:
    """Tells what positions cost, a group at a time."""

    def __init__(self, subject: Subject, goal: Goal) -> None:
        budget = subject.budget if goal.has_budget else UNLIMITED
        self._tracker = subject.tracker(fingers=GROUP, budget=budget)
        self._manner = goal.manner
        self.steps = 0  # nodes and leaves visited so far, preparation included

    def costs(self, positions: np.ndarray) -> Costs:
        """Return what positions cost.

        *positions*: (K, 3) m.
        """
        count = len(positions)
        costs = Costs(np.zeros(count, np.int64), np.zeros(count), np.zeros(count), np.zeros(count, np.bool_))
        for first in range(0, count, GROUP):
            group = positions[first : first + GROUP]
            tips = np.full((GROUP, 3), np.nan)
            tips[: len(group)] = group
            rows, contacts = slice(first, first + len(group)), self._ticked(tips)[: len(group)]
            costs.work[rows] = contacts["work"]
            costs.lower[rows], costs.upper[rows] = contacts["lower"], contacts["upper"]
            costs.is_in_range[rows] = (contacts["flags"] & np.uint32(ContactFlag.IN_RANGE)) != 0
        return costs

    def _ticked(self, tips: np.ndarray) -> np.ndarray:
        tracker = self._tracker
        tracker.reset()
        if self._manner is not Manner.COLD:
            step = APPROACH_SPEED * 1e-9 * PERIOD_NS if self._manner is Manner.MOVES else 0.0
            self.steps += int(tracker.tick(tips - step * DIRECTION, 0, 0)["work"].sum())
        contacts = tracker.tick(tips, PERIOD_NS, PERIOD_NS)
        self.steps += int(contacts["work"].sum())
        return contacts
