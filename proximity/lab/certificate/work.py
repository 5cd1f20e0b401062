"""Cost of a position, which is the number of nodes and leaves that a tick visits for a finger there.

This is work and not time, so that it is the same on every run and a search can maximise it. It includes the
work of predicting a moving finger's contact.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from proximity.lab.certificate.subject import Subject
from proximity.message import ContactFlag

GROUP = 5
"""Number of fingers of a probe. It is that of a hand, so that each finger has the whole budget of a tick."""
UNLIMITED = 2**31 - 1
"""A budget that is never exhausted."""
APPROACH_SPEED = 0.5
"""Speed of a moving finger, m/s."""
DIRECTION = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
"""Direction of a moving finger, which is the same for all, so that each position has one cost."""
PERIOD_NS = 1_000_000
NOWHERE = -1.0
"""Worth of a position outside of the working range, which costs no search."""


class StartMode(StrEnum):
    """Motion of a finger before the tick at a position."""

    COLD = "cold"  # the first tick, without history
    STAYS = "stays"  # it was there one tick earlier
    MOVES = "moves"  # it approaches at 0.5 m/s


@dataclass(frozen=True, slots=True)
class SearchGoal:
    """Quantity that the search maximises."""

    mode: StartMode
    has_budget: bool  # that of the ticks; otherwise the cost of an exact answer

    def __str__(self) -> str:
        return f"{self.mode}, {'within the budget' if self.has_budget else 'exact'}"


GOALS = tuple(SearchGoal(mode, has_budget) for has_budget in (True, False) for mode in StartMode)


class Probe:
    """Tracker that measures the work of positions, a group of fingers at a time."""

    def __init__(self, subject: Subject, goal: SearchGoal) -> None:
        budget = subject.budget if goal.has_budget else UNLIMITED
        self._tracker = subject.tracker(fingers=GROUP, budget=budget)
        self._mode = goal.mode
        self.steps = 0  # nodes and leaves visited, preparation included

    def contacts(self, positions: np.ndarray) -> np.ndarray:
        """Return the contacts of fingers at positions (K, 3), m, with the work of each, (K,)."""
        found = []
        for first in range(0, len(positions), GROUP):
            group = positions[first : first + GROUP]
            tips = np.full((GROUP, 3), np.nan)
            tips[: len(group)] = group
            found.append(self._tick(tips)[: len(group)].copy())
        return np.concatenate(found)

    def _tick(self, tips: np.ndarray) -> np.ndarray:
        self._tracker.reset()
        if self._mode is not StartMode.COLD:
            step = APPROACH_SPEED * 1e-9 * PERIOD_NS if self._mode is StartMode.MOVES else 0.0
            self.steps += int(self._tracker.tick(tips - step * DIRECTION, 0, 0)["work"].sum())
        contacts = self._tracker.tick(tips, PERIOD_NS, PERIOD_NS)
        self.steps += int(contacts["work"].sum())
        return contacts


def in_range(contacts: np.ndarray) -> np.ndarray:
    """Return which fingers are in the working range, (K,) bool."""
    return np.asarray((contacts["flags"] & np.uint32(ContactFlag.IN_RANGE)) != 0)


def worth(contacts: np.ndarray) -> np.ndarray:
    """Return the quantity to maximise, (K,).

    It is the work and, at the equal work of an exhausted budget, the width of the distance bounds.
    """
    lower, upper = contacts["lower"], contacts["upper"]
    size = np.abs(lower) + np.abs(upper)
    share = np.divide(upper - lower, size, out=np.zeros_like(lower), where=size > 0.0)
    return np.where(in_range(contacts), contacts["work"] + 0.5 * np.minimum(share, 1.0), NOWHERE)
