"""Save a page that plays the motion of a part, with the curve of its distance and the shortest connection."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from proximity.scene.motion import Motion, Span
from proximity.scene.motion_clearance import MotionClearance
from proximity.scene.scene import Scene
from proximity.web.page_content import shown_contents
from proximity.web.page_process import PageSettings, page_settings, page_welcome
from proximity.web.saved_page import save_page


def write_motion_page(
    path: Path,
    scene: Scene,
    motion: Motion,
    found: MotionClearance,
    *,
    title: str,
    others: Iterable[str] | None,
    unit: str,
    scale: float,
) -> int:
    """Write one file with a page that plays a measured motion. Return its size in bytes.

    *others*: names of the parts measured to, or None for all. *unit*: of positions, "degrees", "mm" or
    "position", which has the size *scale*.
    """
    settings = PageSettings((title,), first_input="none")
    welcome = page_welcome(title, settings, page_settings((), settings), scene)
    values = {
        "others": None if others is None else list(others),
        "unit": unit,
        "scale": scale,
        **_curve(found),
        "spans": [_span(span) for span in _spans(scene, motion, found.nearest.first)],
    }
    return save_page(path, shown_contents(scene, {**welcome, "motion": values}))


def _curve(found: MotionClearance) -> dict[str, Any]:
    """Return the distances of a motion for the page, m."""
    return {
        "part": found.nearest.first,
        "nearest": found.nearest.second,
        **{name: getattr(found, name) for name in ("position", "distance", "lower", "first_touch")},
        **{name: getattr(found, name).tolist() for name in ("positions", "distances", "bounds")},
    }


def _spans(scene: Scene, motion: Motion, name: str) -> list[Span]:
    part = scene.part(name)
    corners = part.solid.mesh.vertices
    return motion.spans(part.pose, 0.5 * (corners.min(axis=0) + corners.max(axis=0)))


def _span(span: Span) -> dict[str, Any]:
    vectors = {name: np.asarray(getattr(span, name)).tolist() for name in ("centre", "shift", "axis")}
    pose = span.pose.matrix.reshape(-1).tolist()
    return {"start": span.start, "end": span.end, "angle": span.angle, "pose": pose, **vectors}
