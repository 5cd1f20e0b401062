"""Labels over the view of the parts: distances, a scale, and the directions of the axes."""

from typing import Any

import numpy as np

from proximity.scene.picture.distance_field import load_matplotlib
from proximity.scene.picture.scene_view import INK, Camera, Connections

SCALE_SHARE = 0.22  # of the width; the scale is the longest round length below it
ROUND = (1.0, 2.0, 5.0, 10.0)
ARROW = 0.055  # of the height


def draw_distances(axes: Any, camera: Camera, connections: Connections, unit: str, metres: float) -> None:
    """Write the signed distance of each point next to it, on the side away from the part."""
    scale = text_size() / 13
    points, ends = camera.pixels(connections.points)[:, :2], camera.pixels(connections.closest)[:, :2]
    for point, end, distance in zip(points, ends, connections.signed_distance, strict=True):
        away = point - end
        length = np.hypot(*away)
        away = away / length if length > 2.0 else np.array([0.0, -1.0])
        # Text is wider than it is high; the gap is in points, y up.
        gap = np.array([44.0, -20.0]) * away * scale
        text = f"{distance / metres:.4g} {unit}".replace("-", "\N{MINUS SIGN}")
        axes.annotate(
            text, point, gap, textcoords="offset points", ha="center", va="center", weight="bold",
            path_effects=halo(),
        )  # fmt: skip


def draw_scale(axes: Any, camera: Camera, unit: str, metres: float) -> None:
    """Draw a bar whose length is a round number in the lower right corner of the view."""
    longest = SCALE_SHARE * camera.size[0] * camera.meters_per_pixel / metres
    power = 10.0 ** np.floor(np.log10(longest))
    length = power * max(value for value in ROUND if value * power <= longest * (1 + 1e-9))
    pixels = length * metres / camera.meters_per_pixel
    right, down = camera.size[0] * 0.97, camera.size[1] * 0.965
    tick = 0.008 * camera.size[1]
    style = {"color": INK, "linewidth": 1.8, "solid_capstyle": "butt"}
    axes.plot([right - pixels, right], [down, down], **style)
    for end in (right - pixels, right):
        axes.plot([end, end], [down - tick, down + tick], **style)
    axes.text(
        right - pixels / 2, down - 1.6 * tick, f"{length:g} {unit}", ha="center", va="bottom",
        path_effects=halo(),
    )  # fmt: skip


def draw_axes(axes: Any, camera: Camera) -> None:
    """Draw the directions of x, y and z in the lower left corner of the view."""
    length = ARROW * camera.size[1]
    corner = np.array([2.0 * length, camera.size[1] - 1.6 * length])
    for name, direction, color in zip(
        "xyz", camera.screen_from_scene.T, ("#b5342b", "#2c7d3f", "#2456a6"), strict=True
    ):
        flat = direction[:2] * [1.0, -1.0]
        if np.hypot(*flat) < 0.05:
            continue  # it points at the viewer
        tip = corner + length * flat
        axes.plot(*np.transpose([corner, tip]), color=color, linewidth=2.2, solid_capstyle="round")
        axes.text(
            *(corner + 1.32 * length * flat), name, color=color, ha="center", va="center", weight="bold",
            fontsize="small",
        )  # fmt: skip


def text_size() -> float:
    """Return the size of text on the page, in points."""
    return float(load_matplotlib().rcParams["font.size"])


def halo() -> list[Any]:
    """Return a white outline that keeps text readable on any background."""
    return [load_matplotlib().patheffects.withStroke(linewidth=3, foreground="white", alpha=0.85)]
