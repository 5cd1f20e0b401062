"""Methods that choose the level of each trial from the answers before it.

They are deterministic: fed with the same answers they choose the same levels, which is how a session goes on
after a crash.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from proximity.lab.experiment.design import Procedure
from proximity.system.extras import needed

DOWN, UP = 3, 1  # answers in a row until the level falls, and until it rises: 79.4 % right (Levitt 1971)
THRESHOLD_COUNT, WIDTHS, LAPSES = 30, (0.3, 0.6, 1.2), (0.0, 0.03, 0.06)
SIGMAS_OF_WIDTH = 2.0 * 1.6448536269514722  # from 5 to 95 % of a normal distribution


class Staircase:
    """Three right answers in a row make it harder, one that is wrong makes it easier."""

    def __init__(self, levels: Sequence[float]) -> None:
        self._levels, self._index, self._right, self._wrong = tuple(levels), len(levels) - 1, 0, 0

    def level(self) -> float:
        """Return the level of the next trial."""
        return self._levels[self._index]

    def update(self, is_right: bool) -> None:
        """Go on from the answer at that level."""
        self._right, self._wrong = (self._right + 1, 0) if is_right else (0, self._wrong + 1)
        step = (self._wrong == UP) - (self._right == DOWN)
        if step:
            self._index = min(max(self._index + step, 0), len(self._levels) - 1)
            self._right = self._wrong = 0


class QuestPlus:
    """The level that is expected to say most of threshold, width and lapses (Watson 2017), by `questplus`.

    *levels*: from which it chooses; thresholds are looked for in their range, in logarithms.
    """

    def __init__(self, levels: Sequence[float]) -> None:
        logs = np.log10(levels)
        self._levels = tuple(levels), logs
        with needed("experiments need", "experiment"):
            make = import_module("questplus").QuestPlus
        self._quest = make(
            stim_domain={"intensity": logs},
            param_domain={
                "mean": np.linspace(logs[0], logs[-1], THRESHOLD_COUNT),
                "sd": np.array(WIDTHS) / SIGMAS_OF_WIDTH,
                "lower_asymptote": [0.5],
                "lapse_rate": LAPSES,
            },
            outcome_domain={"response": ["right", "wrong"]},
            func="norm_cdf",
            stim_scale="linear",
        )
        self._chosen: dict[str, Any] = {}

    def level(self) -> float:
        """Return the level of the next trial."""
        self._chosen = self._chosen or self._quest.next_stim
        levels, logs = self._levels
        return levels[int(np.argmin(np.abs(logs - self._chosen["intensity"])))]

    def update(self, is_right: bool) -> None:
        """Go on from the answer at that level."""
        self.level()
        self._quest.update(stim=self._chosen, outcome={"response": "right" if is_right else "wrong"})
        self._chosen = {}


METHODS: dict[Procedure, Callable[[Sequence[float]], Staircase | QuestPlus]] = {
    Procedure.STAIRCASE: Staircase,
    Procedure.QUEST: QuestPlus,
}
"""What chooses levels, where the plan has not chosen them."""
