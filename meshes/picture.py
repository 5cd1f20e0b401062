"""Draw the README's picture: ``python meshes/picture.py`` writes bracket.png beside this script.

Every number in it comes from the package: the bracket is made of rays that `cast` has answered, the slice is
`signed_distance` on a grid, and points, ray and segment are drawn with what the queries say of them. Needs
matplotlib, which the package itself does not ask for. Lengths here are in millimetres, as in the file;
`_metres` is where they meet the package. Screen: mm to the right, up, and to the viewer.
"""

import io
from pathlib import Path

import matplotlib.patheffects
import numpy as np
from matplotlib.colors import ListedColormap, TwoSlopeNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import proximity

FOLDER = Path(__file__).resolve().parent
SLICE_HEIGHT = 27.0
VIEW, FIELD = (-17, 79, -34, 58), (-14, 40, -10, 50)  # left, right, low, high
POINTS = np.array([[26.0, -14.0, 22.0], [65.0, 36.0, 15.0], [12.0, 13.0, 59.0], [44.0, 23.0, 14.0]])
RAY_ORIGIN, RAY_DIRECTION = np.array([48.0, 46.0, 50.0]), np.array([-36.0, -24.0, -14.0])
SEGMENT = np.array([[44.0, -24.0, 8.0], [80.0, 0.0, 8.0]])
INK, POINT_COLOR, RAY_COLOR, SEGMENT_COLOR = "#17202a", "#b5165b", "#d96c00", "#00796b"
TO_LIGHT = np.array([0.50, -0.32, 0.80]) / np.linalg.norm([0.50, -0.32, 0.80])
HALO = [matplotlib.patheffects.withStroke(linewidth=4, foreground="white")]


def screen_from_part() -> np.ndarray:
    """Rotation (3, 3) with the rows right, up, to the viewer."""
    back = np.array([1.0, -0.85, 0.75]) / np.linalg.norm([1.0, -0.85, 0.75])
    right = np.cross([0.0, 0.0, 1.0], back) / np.hypot(back[0], back[1])
    return np.array([right, np.cross(back, right), back])


def rendered(scene: proximity.Scene, width: int, height: int) -> np.ndarray:
    """Image (height, width, 3) of the part from 2 × 2 rays a pixel; white where they hit nothing."""
    turn, (left, right, low, high) = screen_from_part(), VIEW
    x, y = np.meshgrid(np.linspace(left, right, 2 * width), np.linspace(high, low, 2 * height))
    hits = scene.cast(_metres(np.stack([x, y, np.full_like(x, 200.0)], axis=-1) @ turn), -turn[2])
    is_hit = np.isfinite(hits.distance)
    normals = np.where(is_hit[..., None], hits.normal, 0.0)
    starts = np.where(is_hit[..., None], hits.point + 1e-6 * normals, 1.0)
    is_shaded = np.isfinite(scene.cast(starts, TO_LIGHT).distance)
    colors = (0.66 + 0.36 * (normals @ TO_LIGHT) - 0.10 * is_shaded)[..., None] * [0.80, 0.87, 0.94]
    colors[_outlines(np.where(is_hit, hits.distance, 1.0), normals)] *= 0.4
    colors[abs(hits.point[..., 2] - _metres(SLICE_HEIGHT)) < _metres(0.25)] = to_rgb(INK)
    image = np.where(is_hit[..., None], np.clip(colors, 0, 1), 1.0)
    return image.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))


def _outlines(depth, normals):
    """Where the depth jumps by 3 mm or the surface bends by more than 30 degrees."""
    found = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        bends = (normals * np.roll(normals, 1, axis)).sum(axis=-1) < np.cos(np.pi / 6)
        found |= (bends & (depth < 1.0)) | (abs(depth - np.roll(depth, 1, axis)) > _metres(3.0))
    return found


def draw_queries(axes, scene: proximity.Scene) -> None:
    """Points with their closest points, a ray with its hit, a segment with its shortest connection."""
    _line(axes, SEGMENT, color=SEGMENT_COLOR, linewidth=5, solid_capstyle="round")
    segment_hit = scene.closest_to_segments(*_metres(SEGMENT))
    connections = [(point, 1e3 * scene.closest(_metres(point)).point, POINT_COLOR) for point in POINTS]
    connections += [
        (RAY_ORIGIN, 1e3 * scene.cast(_metres(RAY_ORIGIN), RAY_DIRECTION).point, RAY_COLOR),
        (1e3 * segment_hit.point_on_segment, 1e3 * segment_hit.point_on_solid, SEGMENT_COLOR),
    ]
    for start, end, color in connections:
        _line(axes, [start, end], color=color, linewidth=2.5, path_effects=HALO)
        _line(axes, [start], marker="o", color=color, markersize=11, markeredgecolor="white")
        _line(axes, [end], marker="o", color="white", markersize=9, markeredgecolor=color, markeredgewidth=2)
        place, away = (screen_from_part() @ np.transpose([start, start - end]))[:2].T
        away *= [32, 16] / np.linalg.norm(away)  # points: half a label is wider than high
        style = {"color": color, "weight": "bold", "path_effects": HALO, "ha": "center", "va": "center"}
        text = f"{np.linalg.norm(end - start):.1f} mm"
        axes.annotate(text, place, away + 12 * np.sign(away), textcoords="offset points", **style)
    corner = np.array([-4.0, -7.0, -25.0])
    for name, way in zip(["x", "y", "z  (10 mm)"], 10 * np.eye(3), strict=True):
        _line(axes, [corner, corner + way], color=INK, linewidth=2)
        axes.text(*(screen_from_part() @ (corner + 1.35 * way))[:2], name, ha="center", va="center")


def _line(axes, points, **style):
    axes.plot(*(screen_from_part() @ np.transpose(points))[:2], **style)


def _metres(lengths):
    return 1e-3 * np.asarray(lengths)


def draw_field(axes, bar_axes, scene: proximity.Scene) -> None:
    """Signed distance at one height: colours, a line every 2 mm, the surface bold."""
    x, y = np.linspace(*FIELD[:2], 541), np.linspace(*FIELD[2:], 601)
    points = np.stack(np.broadcast_arrays(*np.meshgrid(x, y), SLICE_HEIGHT), axis=-1)
    distance = 1e3 * scene.signed_distance(_metres(points))
    colors = ListedColormap(matplotlib.colormaps["RdBu"](TwoSlopeNorm(0, -4, 24)(np.linspace(-4, 24, 561))))
    image = axes.imshow(distance, extent=FIELD, origin="lower", cmap=colors, vmin=-4, vmax=24)
    # Walls are 4 mm thick: a line at exactly -2 would follow their middle as rounding has it.
    lines = [-2.02, *range(2, 25, 2)]
    axes.contour(x, y, distance, lines, colors=INK, linewidths=0.6, linestyles="-")
    axes.contour(x, y, distance, [0], colors=INK, linewidths=3)
    axes.set(xlabel="x, mm", ylabel="y, mm", title=f"signed distance at z = {SLICE_HEIGHT:g} mm")
    bar = axes.figure.colorbar(image, cax=bar_axes, ticks=range(-4, 25, 2))
    bar.ax.axhline(0, color=INK, linewidth=3)
    bar.set_label("mm, negative inside")


def main() -> None:
    scene = proximity.load(FOLDER / "bracket.stl")
    matplotlib.rcParams.update({"font.size": 14, "text.color": INK, "axes.titlesize": 16})
    figure = Figure(figsize=(14, 7), dpi=100, facecolor="white")
    view = figure.add_axes((0.0, 10 / 700, 720 / 1400, 690 / 700))
    view.imshow(rendered(scene, 720, 690), extent=VIEW, interpolation="none")
    draw_queries(view, scene)
    view.set_axis_off()
    view.set(xlim=VIEW[:2], ylim=VIEW[2:])
    draw_field(figure.add_axes((0.586, 0.19, 0.32, 0.71)), figure.add_axes((0.921, 0.19, 0.014, 0.71)), scene)
    texts = ["point: closest", "ray: cast", "segment: closest_to_segments", "slice: signed_distance"]
    colors = [POINT_COLOR, RAY_COLOR, SEGMENT_COLOR, INK]
    keys = [Line2D([], [], color=color, marker="o", markersize=9, linewidth=2.5) for color in colors]
    keys[-1].set_marker("")
    figure.legend(keys, texts, loc="lower center", ncols=4, frameon=False, prop={"family": "monospace"})
    content = io.BytesIO()
    figure.savefig(content)
    # No alpha, and tones a multiple of 3: nobody sees it, and the file is a quarter smaller.
    picture = Image.open(content).convert("RGB").point(lambda tone: 3 * round(tone / 3))
    picture.save(FOLDER / "bracket.png", optimize=True)


if __name__ == "__main__":
    main()
