"""The description of a picture: what is drawn, from where, how large."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from proximity.scene.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What to draw.

    ``scene`` is asked for every number. ``title`` stands above. ``points`` (N, 3), m, are joined with the
    nearest points of the parts. ``cut`` is the axis that a slice lies across, and where, m. ``unit`` is the
    word for lengths on the page, ``metres`` how many metres it has. ``view`` is one of `camera.TO_VIEWER`,
    ``size`` the width and height in pixels.
    """

    scene: "Scene"
    title: str
    points: np.ndarray | None = None
    cut: tuple[str, float] | None = None
    unit: str = "mm"
    metres: float = 1e-3
    view: str = "iso"
    size: tuple[int, int] = (1400, 800)
