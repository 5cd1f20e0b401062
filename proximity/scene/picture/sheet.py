"""The page of a picture: the parts, the map of the slice, colour bars, a scale and a legend."""

import io
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ArgumentError
from proximity.scene.picture.distance_field import SHOWN_AXES, DistanceColors, FieldSlice, load_matplotlib
from proximity.scene.picture.labels import draw_axes, draw_distances, draw_scale
from proximity.scene.picture.scene_view import INK, MAX_TUBES, Camera, Connections, draw_scene, load_pyvista
from proximity.system.whole_file import whole_file

if TYPE_CHECKING:
    from proximity.scene.scene import Scene

SMALLEST, LARGEST = 200, 4000  # pixels a side
DOTS_PER_INCH = 100
MUTED = "#5d6b7a"
PART_COLORS = (
    "#c4c7ca", "#e3b77f", "#98c5a4", "#d79a94", "#b7a6d3", "#8fc6cc", "#d9c97c", "#c3aa94", "#dba7c5",
    "#a8b39a",
)  # fmt: skip
NAMED_PARTS = 8
LABELLED_POINTS = 12
NAME_LENGTH = 28  # characters; longer names are cut
NO_INSIDE = "no inside is known"
HEAD, FOOT = 0.075, 0.085  # of the height


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Contents of a picture.

    ``scene`` computes every number. ``title`` is at the top. ``points`` (N, 3), m, are connected with the
    nearest points of the parts. ``cut`` has the axis that is perpendicular to a slice, and the position of
    the slice, m. ``unit`` is the name of the unit of lengths on the page, and ``metres`` is its length.
    ``view`` is one of `TO_VIEWER`, ``size`` is the width and height in pixels. ``reach``, m, has the ends of
    the colour bar of the points, the first below 0; the share of the points between them is written below it.
    """

    scene: "Scene"
    title: str
    points: np.ndarray | None = None
    cut: tuple[str, float] | None = None
    unit: str = "mm"
    metres: float = 1e-3
    view: str = "iso"
    size: tuple[int, int] = (1400, 800)
    reach: tuple[float, float] | None = None


def write_picture(picture: Picture, path: str | os.PathLike[str]) -> None:
    """Write a picture as a PNG file, atomically. An existing file is replaced."""
    content = draw(picture)
    with whole_file(path) as stream:
        stream.write(content)


def draw(picture: Picture) -> bytes:
    """Draw a picture and return the bytes of a PNG file."""
    width, height = picture.size
    if not all(SMALLEST <= side <= LARGEST for side in picture.size):
        raise ArgumentError(f"a picture of {width}x{height} pixels, expected {SMALLEST} to {LARGEST} a side")
    load_renderer()
    matplotlib = load_matplotlib()
    look = {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "font.size": float(np.clip(13 * min(height / 800, width / 1400), 4, 40)),
        "text.color": INK,
        "axes.edgecolor": MUTED,
        "axes.labelcolor": INK,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
    }
    with matplotlib.rc_context(look):
        figure = _figure(matplotlib, picture)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=DOTS_PER_INCH)
    return stream.getvalue()


def load_renderer() -> None:
    """Import PyVista and matplotlib, which takes a second. Raise an error that names a missing one."""
    load_pyvista()
    load_matplotlib()


def slice_box(size: tuple[int, int], field: FieldSlice) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of the map of a slice, as shares of the page.

    *field*: the contents of the map; it has the same scale in both directions.
    """
    left, bottom, width, height = 0.590, 0.16, 0.315, 0.70
    shape = (field.up[-1] - field.up[0]) / (field.right[-1] - field.right[0]) * size[0] / size[1]
    if shape * width > height:
        narrow = height / shape
        return left + (width - narrow) / 2, bottom, narrow, height
    low = shape * width
    return left, bottom + (height - low) / 2, width, low


def _figure(matplotlib: Any, picture: Picture) -> Any:
    field = None
    if picture.cut is not None:
        field = FieldSlice.of(picture.scene, *picture.cut, unit=picture.unit, metres=picture.metres)
    connections = None if picture.points is None else _connections(picture)
    none = np.zeros(0)
    colors = DistanceColors(none if field is None else field.signed_distance.reshape(-1), picture.metres)
    distances = none if connections is None else connections.signed_distance
    point_colors = DistanceColors(distances, picture.metres, is_even=True, reach=picture.reach)
    width, height = picture.size
    figure = matplotlib.figure.Figure(
        figsize=(width / DOTS_PER_INCH, height / DOTS_PER_INCH), facecolor="white"
    )
    share = 1.0 if field is None else 0.525
    camera = _draw_view(figure, picture, connections, field, (colors, point_colors), share)
    if field is not None:
        box = slice_box(picture.size, field)
        _draw_map(figure.add_axes(box), picture, field, colors)
        _draw_bar(figure, figure.add_axes((box[0] + box[2] + 0.013, box[1], 0.012, box[3])), picture, colors)
    if connections is not None:
        bar_box = (0.925, 0.20, 0.012, 0.60) if field is None else (0.03, 0.885, 0.30, 0.014)
        _draw_bar(
            figure, figure.add_axes(bar_box), picture, point_colors, distances, is_flat=field is not None
        )
    _draw_head(figure, picture)
    draw_scale(figure.axes[0], camera, picture.unit, picture.metres)
    draw_axes(figure.axes[0], camera)
    return figure


def _connections(picture: Picture) -> Connections:
    points = np.asarray(picture.points, dtype=np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    hit = picture.scene.closest(points)
    return Connections(points, hit.point, hit.signed_distance)


def _draw_view(
    figure: Any,
    picture: Picture,
    connections: Connections | None,
    field: FieldSlice | None,
    colors: tuple[DistanceColors, DistanceColors],
    share: float,
) -> Camera:
    """Draw the parts, the points and the slice on the left of the page. Return the camera."""
    parts = [part for part in picture.scene.parts if not part.is_hidden]
    if not parts:
        raise ArgumentError("all parts of the scene are hidden: nothing can be drawn")
    tints = [PART_COLORS[number % len(PART_COLORS)] for number in range(len(parts))]
    seen = [part.pose.point(part.solid.mesh.vertices) for part in parts]
    if field is not None:
        seen.append(field.points[:: len(field.up) - 1, :: len(field.right) - 1].reshape(-1, 3))
    if connections is not None:
        seen.append(connections.points)
    size = round(share * picture.size[0]), round((1 - HEAD - FOOT) * picture.size[1])
    camera = Camera.fitted(picture.view, np.concatenate(seen), size)
    view = figure.add_axes((0.0, FOOT, size[0] / picture.size[0], size[1] / picture.size[1]))
    image = draw_scene(parts, tints, connections, field, camera, colors)
    view.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none", aspect="auto")
    view.set_axis_off()
    if connections is not None and len(connections.points) <= LABELLED_POINTS:
        draw_distances(view, camera, connections, picture.unit, picture.metres)
    _draw_legend(figure, [part.name for part in parts], tints, connections)
    return camera


def _draw_legend(figure: Any, names: list[str], tints: list[str], connections: Connections | None) -> None:
    matplotlib = load_matplotlib()
    shown = names[: NAMED_PARTS - 1] if len(names) > NAMED_PARTS else names
    keys = [
        matplotlib.patches.Patch(facecolor=tint, edgecolor=INK, linewidth=0.8) for tint in tints[: len(shown)]
    ]
    texts = [name if len(name) <= NAME_LENGTH else name[: NAME_LENGTH - 1] + "…" for name in shown]
    if len(shown) < len(names):
        keys.append(matplotlib.patches.Patch(facecolor="none", edgecolor="none"))
        texts.append(f"and {len(names) - len(shown)} parts more")
    if connections is not None:
        style = {"color": INK, "marker": "o", "markerfacecolor": "white"}
        is_joined = len(connections.points) <= MAX_TUBES
        keys.append(matplotlib.lines.Line2D([], [], linewidth=2.0 if is_joined else 0.0, **style))
        texts.append("point and its shortest connection" if is_joined else "point")
    figure.legend(
        keys, texts, loc="lower left", bbox_to_anchor=(0.012, 0.008), ncols=min(len(keys), 5), frameon=False,
        handlelength=1.4, columnspacing=1.4, borderaxespad=0.0,
    )  # fmt: skip


def _draw_map(axes: Any, picture: Picture, field: FieldSlice, colors: DistanceColors) -> None:
    """Draw the signed distance in a plane as colours and iso lines. The line at the surface is bold."""
    right, up = field.right / picture.metres, field.up / picture.metres
    distance = field.signed_distance / picture.metres
    extent = (right[0], right[-1], up[0], up[-1])
    axes.imshow(
        distance, extent=extent, origin="lower", cmap=colors.map, norm=colors.norm, interpolation="bilinear",
        aspect="auto",
    )  # fmt: skip
    step = colors.step / picture.metres
    fine = np.arange(colors.levels[0], colors.levels[-1] + step / 2, step)
    lines = axes.contour(
        right,
        up,
        distance,
        fine[np.abs(fine) > step / 4],
        colors=INK,
        linewidths=0.6,
        linestyles="-",
        alpha=0.75,
    )
    labelled = [level for level in lines.levels if round(level / step) % 2 == 0]
    axes.clabel(lines, labelled, fmt="%g", fontsize="x-small")
    if distance.min() < 0.0 < distance.max():
        axes.contour(right, up, distance, [0.0], colors=INK, linewidths=2.2)
    names = ["xyz"[row] for row in SHOWN_AXES[field.axis]]
    axes.set(xlabel=f"{names[0]}, {picture.unit}", ylabel=f"{names[1]}, {picture.unit}")
    position = f"{field.position / picture.metres:.10g}"
    what = "Signed distance" if _has_inside(picture) else f"Distance ({NO_INSIDE})"
    axes.set_title(f"{what} at {field.axis} = {position} {picture.unit}", fontsize="medium")


def _draw_bar(
    figure: Any,
    axes: Any,
    picture: Picture,
    colors: DistanceColors,
    distances: np.ndarray | None = None,
    *,
    is_flat: bool = False,
) -> None:
    """Draw a colour bar. It belongs to the points if their *distances*, m, are given, otherwise to the slice.

    *is_flat*: the bar is horizontal, because the map of a slice is next to it.
    """
    matplotlib = load_matplotlib()
    mappable = matplotlib.cm.ScalarMappable(colors.norm, colors.map)
    every = 2 if is_flat else 1  # keeps the tick at zero
    ticks = colors.levels[np.argmin(np.abs(colors.levels)) % every :: every]
    bar = figure.colorbar(
        mappable, cax=axes, ticks=ticks, orientation="horizontal" if is_flat else "vertical"
    )
    (bar.ax.axvline if is_flat else bar.ax.axhline)(0.0, color=INK, linewidth=2.2)
    bar.outline.set_linewidth(0.8)
    words = f"{picture.unit}, {'negative inside' if _has_inside(picture) else NO_INSIDE}"
    if distances is not None and picture.reach is not None and len(distances):
        low, high = (f"{end:g}".replace("-", "\N{MINUS SIGN}") for end in colors.levels[[0, -1]])
        ends = f"±{high}" if -colors.levels[0] == colors.levels[-1] else f"{low} to {high}"
        tenths = np.floor(1e3 * colors.share(distances))  # rounded down, so that 100 % are all points
        words += f"\n{tenths / 10:.1f} % within {ends} {picture.unit}"
    bar.set_label(f"points: {words}" if is_flat else words)
    if distances is not None and not is_flat:
        bar.ax.yaxis.set_label_position("left")  # on the right it would be cut off


def _has_inside(picture: Picture) -> bool:
    """Whether any distance on the page has a sign."""
    return any(part.solid.has_inside for part in picture.scene.parts if not part.is_hidden)


def _draw_head(figure: Any, picture: Picture) -> None:
    lower, upper = picture.scene.bounds
    sides = " × ".join(f"{side:.4g}" for side in (upper - lower) / picture.metres)
    parts = picture.scene.parts
    faces = f"{sum(part.solid.mesh.face_count for part in parts):,}".replace(",", " ")
    counted = "1 part" if len(parts) == 1 else f"{len(parts)} parts"
    upper_edge = 1 - 0.025
    title = figure.text(0.012, upper_edge, picture.title, fontsize="x-large", weight="bold", va="top")
    figure.text(
        0.988,
        upper_edge,
        f"{sides} {picture.unit}  ·  {counted}  ·  {faces} faces",
        color=MUTED,
        va="top",
        ha="right",
    )
    title.set_in_layout(False)
