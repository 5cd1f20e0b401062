"""What a scene has at present: which parts, which of them are hidden, and how far they reach."""

from collections.abc import Sequence

import numpy as np

from proximity.kernels.layout import IS_HIDDEN, OWN_LOWER, OWN_UPPER
from proximity.scene import Scene


class Presence:
    """Parts of a scene as they were at one moment, whoever takes them out or hides them meanwhile.

    It holds until the scene has another epoch: places change without, but nothing that is kept here.

    Parameters
    ----------
    scene : Scene
        That is looked at.
    """

    epoch: int  # of the scene, when it was looked at

    def __init__(self, scene: Scene) -> None:
        model = scene._current()
        self.epoch = model.epoch
        self._rows = {name: row for row, name in enumerate(model.names)}
        count = len(self._rows)
        self._is_hidden = model.parts[:count, IS_HIDDEN] != 0
        corners = (
            model.frames[:count, OWN_LOWER : OWN_LOWER + 3],
            model.frames[:count, OWN_UPPER : OWN_UPPER + 3],
        )
        self._radii = np.linalg.norm(np.abs(corners).max(axis=0), axis=1)

    def __contains__(self, name: str) -> bool:
        return name in self._rows

    def is_hidden(self, names: Sequence[str]) -> np.ndarray:
        """Whether no question finds parts, (M,) bool.

        Parameters
        ----------
        names : sequence of str
            Of M parts that are there.
        """
        return self._is_hidden[self._rows_of(names)]

    def radii(self, names: Sequence[str]) -> np.ndarray:
        """How far from their origins points of parts are at most, m, (M,).

        Parameters
        ----------
        names : sequence of str
            Of M parts that are there.
        """
        return self._radii[self._rows_of(names)]

    def _rows_of(self, names: Sequence[str]) -> np.ndarray:
        return np.array([self._rows[name] for name in names], np.int64)
