"""The part with its queries and the plane of a slice, as one image."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from proximity.scene.picture import surface_image
from proximity.scene.picture.camera import Camera
from proximity.scene.picture.distance_colors import DistanceColors
from proximity.scene.picture.field_slice import AXES, FieldSlice
from proximity.scene.picture.glyphs import merged, sphere, tube
from proximity.scene.picture.surface_image import SurfaceImage, Triangles

if TYPE_CHECKING:
    from proximity.scene.part import Part

SAMPLES = 2  # a side of a pixel
BACKGROUND = np.array([1.0, 1.0, 1.0]), np.array([0.905, 0.93, 0.955])
"""Colours above and below."""
INK = np.array([0.09, 0.125, 0.165])
SHINE_THROUGH = 0.30  # of queries behind or inside a part
SHEET_OPACITY = 0.5
OUTLINE_JUMP = 0.012  # of the image's height: a step in depth is drawn as an outline
MAX_TUBES = 400  # connections; more would be a tangle, and only the points are drawn
POINT_RADIUS, END_RADIUS, TUBE_RADIUS = 0.0125, 0.0055, 0.0026  # of the image's height


@dataclass(frozen=True, slots=True, eq=False)
class Connections:
    """Points with the nearest points of the parts."""

    points: np.ndarray  # (N, 3) m, scene's frame
    closest: np.ndarray  # (N, 3) m
    signed_distance: np.ndarray  # (N,) m


def triangles_of(parts: "Sequence[Part]", colors: np.ndarray) -> Triangles:
    """Return the faces of parts in the scene's frame.

    *colors*: (P, 3).
    """
    pieces = [
        Triangles(
            part.pose.point(part.solid.mesh.vertices),
            part.solid.mesh.faces,
            np.broadcast_to(color, (part.solid.mesh.face_count, 3)),
        )
        for part, color in zip(parts, colors, strict=True)
    ]
    whole = merged(pieces)
    return Triangles(whole.vertices, whole.faces, whole.colors, has_edges=True)


def draw_scene(
    surface: Triangles,
    connections: Connections | None,
    field: FieldSlice | None,
    camera: Camera,
    colors: DistanceColors,
) -> np.ndarray:
    """Return the image, (H, W, 3) float64, 0 to 1.

    *field*: shown as a sheet of its colours, if any.
    """
    fine = camera.resized(SAMPLES)
    image = surface_image.render(surface, fine, is_occluding=True)
    color = np.where(np.isfinite(image.depth)[..., None], image.color, _background(fine.size))
    color[_outlines(image.depth, fine)] *= 0.35
    if field is not None:
        _lay_sheet(color, image.depth, field, fine, colors)
    if connections is not None and len(connections.points):
        _lay_queries(color, image, connections, fine, colors)
    width, height = camera.size
    averaged: np.ndarray = color.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3))
    return np.clip(averaged, 0.0, 1.0)


def _background(size: tuple[int, int]) -> np.ndarray:
    down = np.linspace(0.0, 1.0, size[1])[:, None, None]
    shaded = (1 - down) * BACKGROUND[0] + down * BACKGROUND[1]
    return np.broadcast_to(shaded, (size[1], size[0], 3)).astype(np.float32)


def _outlines(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """Where the surface ends before something farther away."""
    step = OUTLINE_JUMP * camera.size[1]
    found = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            for shift in (1, -1):
                found |= np.roll(depth, shift, axis) - depth > step
    return found


def _lay_sheet(
    color: np.ndarray, depth: np.ndarray, field: FieldSlice, camera: Camera, colors: DistanceColors
) -> None:
    """Lay the plane's colours and iso lines over what is behind it, and a line where it cuts the surface."""
    starts, away = camera.rays()
    across = AXES.index(field.axis)
    if abs(away[across]) < 0.05:
        return  # seen from the side
    lengths = (field.position - starts[..., across]) / away[across]
    values = field.at(starts + lengths[..., None] * away)
    with np.errstate(invalid="ignore"):
        is_seen = np.isfinite(values) & (lengths / camera.meters_per_pixel < depth)
    color[is_seen] = SHEET_OPACITY * colors(values[is_seen]) + (1 - SHEET_OPACITY) * color[is_seen]
    color[is_seen & _level_changes(values, colors.step)] *= 0.72
    color[is_seen & _level_changes(values, np.inf)] = INK


def _level_changes(values: np.ndarray, step: float) -> np.ndarray:
    """Where neighbouring pixels lie on both sides of a multiple of *step*, or, with inf, of zero."""
    bands = values > 0.0 if np.isinf(step) else np.floor(np.nan_to_num(values) / step)
    found = np.zeros(values.shape, dtype=bool)
    for axis in (0, 1):
        for shift in (1, -1):
            found |= bands != np.roll(bands, shift, axis)
    return found


def _lay_queries(
    color: np.ndarray, surface: SurfaceImage, connections: Connections, camera: Camera, colors: DistanceColors
) -> None:
    """Draw points, connections and their ends; those behind the surface shine through."""
    glyphs = _glyphs(connections, camera, colors)
    queries = surface_image.render(glyphs, camera)
    is_query = np.isfinite(queries.depth)
    is_visible = is_query & (queries.depth <= surface.depth)
    is_behind = is_query & ~is_visible
    color[is_behind] = SHINE_THROUGH * queries.color[is_behind] + (1 - SHINE_THROUGH) * color[is_behind]
    color[is_visible] = queries.color[is_visible]
    edge = _outlines(np.where(is_visible, queries.depth, np.float32(np.inf)), camera) & is_visible
    color[edge] *= 0.45


def _glyphs(connections: Connections, camera: Camera, colors: DistanceColors) -> Triangles:
    unit = camera.size[1] * camera.meters_per_pixel
    count = len(connections.points)
    tints = colors(connections.signed_distance)
    size = min(1.0, max(0.25, (60 / count) ** 0.5)) if count else 1.0
    detail = 2 if count <= 100 else 1 if count <= 3000 else 0
    pieces = [
        sphere(point, size * POINT_RADIUS * unit, tint, detail)
        for point, tint in zip(connections.points, tints, strict=True)
    ]
    if count <= MAX_TUBES:
        for point, end in zip(connections.points, connections.closest, strict=True):
            pieces += [
                tube(point, end, size * TUBE_RADIUS * unit, INK),
                sphere(end, size * END_RADIUS * unit, INK, 1),
            ]
    return merged(pieces)
