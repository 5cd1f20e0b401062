"""Overlap of two parts: the volume that is inside both."""

from typing import Any, NamedTuple

import numpy as np

from proximity.errors import MeshError
from proximity.mesh.diagnosis import manifold_solid
from proximity.mesh.topology import corners_of
from proximity.scene.part import Part
from proximity.scene.queries.html_table import html_table
from proximity.scene.scene import Scene

TOUCHING_THICKNESS = 1e-6
"""Largest mean thickness of a common volume that counts as touching.

It is relative to the longest side of the box around both parts. STEP files are rounded to single precision,
6e-8, so parts that touch may overlap slightly.
"""


class Overlap(NamedTuple):
    """The common volume of two parts, in the scene's frame.

    ``volume`` is in m³. ``lower`` and ``upper``, (3,) m, are the corners of the box around it.
    """

    volume: float
    lower: np.ndarray
    upper: np.ndarray

    def _repr_html_(self) -> str:
        return html_table("Overlap", self._fields, [self])


def overlap(scene: Scene, first: str, second: str) -> Overlap | None:
    """Return the common volume of two parts of a scene, or None if there is none. The parts may be hidden.

    Parameters
    ----------
    scene : Scene
        The scene of the parts; their present poses are used.
    first, second : str
        Names of the parts.

    Returns
    -------
    Overlap or None
        Exact for the triangles, up to rounding. None for parts that only touch: the mean thickness of a
        common volume must exceed 1e-6 of the longest side of the box around both parts.

    Raises
    ------
    SceneError
        If a part does not exist.
    MeshError
        If a part is not a closed solid for manifold3d.

    Notes
    -----
    Degenerate: curved surfaces that touch overlap where their triangles differ.
    Cost: 1 s for 300 k faces, once for each part, and again for each pair of parts whose boxes meet.
    Source: the intersection is computed by manifold3d.
    """
    parts = scene.part(first), scene.part(second)
    for part in parts:
        _require_solid(part)
    points = [part.pose.point(corners_of(part.solid.mesh, part.solid.topology)) for part in parts]
    lowers, uppers = (np.array([end(each, axis=0) for each in points]) for end in (np.min, np.max))
    if (lowers.max(axis=0) >= uppers.min(axis=0)).any():
        return None
    lower, upper = lowers.min(axis=0), uppers.max(axis=0)
    middle = lower + 0.5 * (upper - lower)  # keeps precision far from the origin
    common = _solid(parts[0], points[0] - middle) ^ _solid(parts[1], points[1] - middle)
    volume, area = common.volume(), common.surface_area()
    if not 2.0 * volume > TOUCHING_THICKNESS * float((upper - lower).max()) * area:
        return None
    box = np.array(common.bounding_box()).reshape(2, 3) + middle
    return Overlap(volume, box[0], box[1])


def _require_solid(part: Part) -> None:
    diagnosis = part.solid.diagnosis
    if not diagnosis.is_solid_by_manifold:
        raise MeshError(
            f"part {part.name!r} is not a closed solid for manifold3d ({diagnosis.manifold_status}), "
            "expected two parts that are: `proximity check` shows what is open"
        )


def _solid(part: Part, points: np.ndarray) -> Any:
    return manifold_solid(points, part.solid.topology.corner_ids)
