"""The parts of a scene at present: which are hidden, and how far they reach."""

from collections.abc import KeysView, Sequence

import numpy as np

from proximity.scene.scene import Scene


class Presence:
    """Parts of a scene as they were at one moment, whoever takes them out or hides them meanwhile.

    It holds until the scene has another epoch: places change without, but nothing that is kept here.
    """

    epoch: int  # of the scene, when it was looked at

    def __init__(self, scene: Scene) -> None:
        model = scene.snapshot()
        self.epoch = model.epoch
        self._rows = {name: row for row, name in enumerate(model.names)}
        count = len(self._rows)
        self._is_hidden = model.parts["is_hidden"][:count] != 0
        corners = (
            model.frames["own_lower"][:count],
            model.frames["own_upper"][:count],
        )
        self._radii = np.linalg.norm(np.abs(corners).max(axis=0), axis=1)

    @property
    def names(self) -> KeysView[str]:
        """Names of the parts."""
        return self._rows.keys()

    def reach(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Whether no question finds parts, (M,) bool, and how far from their origins they reach, m, (M,)."""
        rows = np.array([self._rows[name] for name in names], np.int64)
        return self._is_hidden[rows], self._radii[rows]
