"""Pictures of parts whose surface is coloured by its thickness, from two opposite sides."""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.scene.picture.distance_field import load_matplotlib
from proximity.scene.picture.labels import draw_axes, draw_scale, halo
from proximity.scene.picture.scene_view import (
    INK,
    SHARP_EDGE,
    SURFACE_LOOK,
    TO_VIEWER,
    Camera,
    load_pyvista,
    new_plotter,
    rendered,
    rotation_towards,
)
from proximity.scene.walls.thin_walls import SINGLE_ROUNDING

if TYPE_CHECKING:
    from proximity.scene.scene import Scene
    from proximity.scene.walls.thin_walls import ThinWalls

SIZE = (700, 560)
"""Pixels of each of the two views."""
MAP, NO_WALL = "RdYlBu", (0.78, 0.78, 0.78)
LOOK = {**SURFACE_LOOK, "ambient": 0.5, "diffuse": 0.6}  # brighter: the colours are to be read
COLORS = 768
THICKEST = 3.0
"""The thickness at the end of the colour bar, as a multiple of the limit."""
DOTS_PER_INCH = 100
BAR = 0.09  # of the width


def draw_thickness(
    scene: "Scene", walls: "Sequence[ThinWalls]", limit: float, *, unit: str, metres: float
) -> bytes:
    """Return a PNG file of parts, coloured by thickness: red below *limit*, m, and blue above it.

    *scene*: the scene of the parts, where hidden positions are detected. *unit*: name of the unit of lengths,
    which is *metres* long. The thinnest positions are numbered over all parts, in the order of *walls*.
    """
    matplotlib = load_matplotlib()
    multiple = THICKEST * (np.arange(COLORS) + 0.5) / COLORS  # of the limit
    share = np.where(multiple < 1.0, 0.4 * multiple, 0.5 + 0.5 * (multiple - 1.0) / (THICKEST - 1.0))
    colors = matplotlib.colors.ListedColormap(matplotlib.colormaps[MAP](share))
    norm = matplotlib.colors.Normalize(0.0, THICKEST * limit / metres)
    points = np.concatenate([each.points for each in walls])
    with matplotlib.rc_context({"font.family": "sans-serif", "font.size": 11.0, "text.color": INK}):
        width, height = 2 * SIZE[0] / (1.0 - BAR) / DOTS_PER_INCH, SIZE[1] / DOTS_PER_INCH
        figure = matplotlib.figure.Figure(figsize=(width, height), facecolor="white")
        for side in (0, 1):
            to_viewer = np.array(TO_VIEWER["iso"]) * (1.0 - 2.0 * side)
            axes = figure.add_axes((0.5 * side * (1.0 - BAR), 0.0, 0.5 * (1.0 - BAR), 1.0))
            _draw_view(axes, scene, walls, points, to_viewer, lambda each: colors(norm(each / metres)))
            draw_axes(axes, camera := _camera(to_viewer, walls))
            if side:
                draw_scale(axes, camera, unit, metres)
        bar = figure.colorbar(
            matplotlib.cm.ScalarMappable(norm, colors), cax=figure.add_axes((1.0 - 0.8 * BAR, 0.1, 0.014,
            0.8)), ticks=np.array([0.0, 0.5, 1.0, 2.0, THICKEST]) * limit / metres, extend="max",
        )  # fmt: skip
        bar.set_label(f"thickness, {unit}; grey: no wall")
        bar.ax.axhline(limit / metres, color=INK, linewidth=2.2)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=DOTS_PER_INCH)
    return stream.getvalue()


def _camera(to_viewer: np.ndarray, walls: "Sequence[ThinWalls]") -> Camera:
    seen = np.concatenate([each.samples.reshape(-1, 3) for each in walls])
    return Camera.turned(rotation_towards(to_viewer), seen, SIZE)


def _draw_view(
    axes: Any,
    scene: "Scene",
    walls: "Sequence[ThinWalls]",
    points: np.ndarray,
    to_viewer: np.ndarray,
    colors_of: Any,
) -> None:
    """Draw the samples of parts in their colours, and the numbers of the positions that are visible."""
    pyvista, camera = load_pyvista(), _camera(to_viewer, walls)
    corners = camera.heights(np.concatenate([each.samples for each in walls]).reshape(-1, 3))
    surface = pyvista.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3))
    # As decided: a wall that is thinner than the limit by rounding keeps it.
    thickness = np.concatenate(
        [each.sample_thickness + SINGLE_ROUNDING * np.ptp(each.samples, axis=(0, 1)).max() for each in walls]
    )
    tints = colors_of(np.where(np.isfinite(thickness), thickness, 0.0))[:, :3]
    tints[~np.isfinite(thickness)] = NO_WALL
    surface.cell_data["colors"] = np.round(255 * tints).astype(np.uint8)
    plotter = new_plotter(camera)
    plotter.add_mesh(surface, scalars="colors", rgb=True, **LOOK)
    for each in walls:
        mesh, pose = scene.part(each.part).solid.mesh, scene.part(each.part).pose
        part = pyvista.PolyData.from_regular_faces(camera.heights(pose.point(mesh.vertices)), mesh.faces)
        edges = part.extract_feature_edges(SHARP_EDGE, non_manifold_edges=False)
        if edges.n_cells:
            plotter.add_mesh(edges, color=INK, line_width=2.0, lighting=False)
    axes.imshow(rendered(plotter, camera), extent=(0, SIZE[0], SIZE[1], 0), interpolation="none")
    axes.set_axis_off()
    if not len(points):
        return
    step = to_viewer / np.linalg.norm(to_viewer)
    off = points + 1e-6 * camera.meters_per_pixel * SIZE[0] * step
    drawn = {each.part for each in walls}
    others = [part.name for part in scene.parts if part.name not in drawn]
    is_visible = np.isinf(scene.cast_distance(off, np.broadcast_to(step, off.shape), ignore=others))
    for number in np.flatnonzero(is_visible).tolist():
        right, down = camera.pixels(points[number])
        axes.plot(right, down, "o", color=INK, markersize=4)
        axes.annotate(
            str(number + 1),
            (right, down),
            (7, 5),
            textcoords="offset points",
            weight="bold",
            path_effects=halo(),
        )
