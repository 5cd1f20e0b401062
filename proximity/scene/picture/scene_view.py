"""The view of a scene as an image. PyVista draws parts, points, connections and the plane of a slice.

Its renderer computes in single precision. Coordinates are therefore relative to the middle of the view, in
units of its size.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ArgumentError
from proximity.scene.picture.distance_field import DistanceColors, FieldSlice
from proximity.system.extras import needed

if TYPE_CHECKING:
    from proximity.scene.part import Part

TO_VIEWER = {
    "iso": (1.0, -0.85, 0.75),
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
"""Direction from the part to the viewer for each view, in the scene's frame; z is up."""
MARGIN = 0.10  # share of the image that is left free on each side
SMALLEST_EXTENT = 1e-9  # m; for a single point, which has no extent
SAMPLES = 2  # per side of a pixel
INK = "#17202a"
SHARP_EDGE = 25.0  # degrees between faces: an edge is drawn, and the surface is not shaded across it
LIGHTS = (  # direction to the light (right, up, to the viewer), and its brightness
    ((0.30, 0.55, 0.78), 0.70),
    ((-0.70, 0.10, 0.70), 0.30),
    ((0.0, 0.0, 1.0), 0.25),
)
SURFACE_LOOK = {"ambient": 0.20, "diffuse": 0.95, "specular": 0.12, "specular_power": 24.0}
SHINE_THROUGH = 0.30  # opacity of queries behind or inside a part
NEAREST_OFFSET = -66000.0  # offset in depth, in VTK's units for it
SHEET_OPACITY = 0.5
MAX_TUBES = 400  # connections; with more, only the points are drawn
POINT_RADIUS, END_RADIUS, TUBE_RADIUS = 0.0125, 0.0055, 0.0026  # of the image's height


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A parallel projection, given by the viewer's direction and the metres per pixel."""

    screen_from_scene: np.ndarray  # (3, 3), rows: right, up, to the viewer
    center: np.ndarray  # (3,) m, scene's frame, in the middle of the image
    meters_per_pixel: float
    size: tuple[int, int]  # width, height, pixels

    @classmethod
    def fitted(cls, view: str, points: np.ndarray, size: tuple[int, int]) -> "Camera":
        """Return the camera that shows all points, (N, 3) m, as large as possible."""
        return cls.turned(rotation_of(view), points, size)

    @classmethod
    def turned(cls, turn: np.ndarray, points: np.ndarray, size: tuple[int, int]) -> "Camera":
        """Return the camera with the rotation *turn* that shows all points as large as possible."""
        seen = points @ turn.T
        lower, upper = seen.min(axis=0), seen.max(axis=0)
        extent = np.maximum(upper - lower, SMALLEST_EXTENT)
        scale = float((extent[:2] / ((1 - 2 * MARGIN) * np.array(size))).max())
        return cls(turn, turn.T @ ((lower + upper) / 2), scale, size)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels of points, (..., 3) m, to the right and down from the upper left corner."""
        seen = (points - self.center) @ self.screen_from_scene[:2].T / self.meters_per_pixel
        pixels: np.ndarray = seen * [1.0, -1.0] + np.array(self.size) / 2
        return pixels

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return points, (..., 3) m, relative to the middle of the image, in units of its height."""
        turned: np.ndarray = (points - self.center) / (self.meters_per_pixel * self.size[1])
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class Connections:
    """Points, and the points of the parts that are nearest to them."""

    points: np.ndarray  # (N, 3) m, scene's frame
    closest: np.ndarray  # (N, 3) m
    signed_distance: np.ndarray  # (N,) m


def rotation_of(view: str) -> np.ndarray:
    """Return the rotation matrix of a view. Its rows point right, up and to the viewer."""
    if view not in TO_VIEWER:
        raise ArgumentError(f"no view {view!r}, expected one of {', '.join(TO_VIEWER)}")
    return rotation_towards(np.array(TO_VIEWER[view]))


def rotation_towards(to_viewer: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of the view with a direction to the viewer, (3,)."""
    back = to_viewer / np.linalg.norm(to_viewer)
    # In views from above and below, y points up in the image.
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 1.0 else np.array([0.0, np.sign(back[2]), 0.0])
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    return np.array([right, np.cross(back, right), back])


def load_pyvista() -> Any:
    """Import PyVista, configured to draw without a screen, and return it."""
    if sys.platform == "linux":
        # VTK would try an X server first. Its check reports OSMesa where there is none, which ends in a
        # segmentation fault (9.7, 2026-11-25): only EGL is tried.
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    with needed("pictures need", "picture"):
        import pyvista
        from vtkmodules.vtkCommonCore import vtkLogger
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    return pyvista


def draw_scene(
    parts: "Sequence[Part]",
    tints: Sequence[str],
    connections: Connections | None,
    field: FieldSlice | None,
    camera: Camera,
    colors: tuple[DistanceColors, DistanceColors],
) -> np.ndarray:
    """Return an image, (H, W, 3) uint8, of parts, connections and the plane of a slice.

    *tints*: colours of the parts. *colors*: colour map of *field*, and colour map of the points.
    """
    plotter = new_plotter(camera)
    _add_parts(plotter, parts, tints, camera)
    if field is not None:
        _add_sheet(plotter, field, camera, colors[0])
    if connections is not None and len(connections.points):
        _add_queries(plotter, connections, camera, colors[1])
    return rendered(plotter, camera)


def new_plotter(camera: Camera) -> Any:
    """Return a plotter with lights, without a screen."""
    pyvista = load_pyvista()
    width, height = camera.size
    plotter = pyvista.Plotter(
        off_screen=True, window_size=(SAMPLES * width, SAMPLES * height), lighting="none"
    )
    if not plotter.render_window.SupportsOpenGL():
        raise ArgumentError(
            "pictures need OpenGL, and VTK found none: install libEGL and Mesa's drivers (Debian and Ubuntu: "
            "apt install libegl1 libgl1-mesa-dri)"
        )
    plotter.set_background("white")  # a gradient would darken outlines in front of it
    for direction, brightness in LIGHTS:
        plotter.add_light(
            pyvista.Light(position=camera.screen_from_scene.T @ direction, intensity=brightness)
        )
    return plotter


def rendered(plotter: Any, camera: Camera) -> np.ndarray:
    """Draw and close a plotter; return the image, (H, W, 3) uint8."""
    width, height = camera.size
    _aim(plotter, camera)
    plotter.enable_ssao(radius=0.06, bias=0.004, kernel_size=32)
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return image.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3)).astype(np.uint8)


def _aim(plotter: Any, camera: Camera) -> None:
    _, up, back = camera.screen_from_scene
    plotter.camera_position = [tuple(2.0 * back), (0.0, 0.0, 0.0), tuple(up)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5
    plotter.reset_camera_clipping_range()


def _add_parts(plotter: Any, parts: "Sequence[Part]", tints: Sequence[str], camera: Camera) -> None:
    """Draw the faces of parts, with sharp edges and outlines."""
    pyvista = load_pyvista()
    meshes = [part.solid.mesh for part in parts]
    vertices = [
        camera.heights(part.pose.point(mesh.vertices)) for part, mesh in zip(parts, meshes, strict=True)
    ]
    first = np.cumsum([0, *(len(rows) for rows in vertices)])
    surface = pyvista.PolyData.from_regular_faces(
        np.concatenate(vertices),
        np.concatenate([mesh.faces + row for mesh, row in zip(meshes, first, strict=False)]),
    )
    colors = np.array([pyvista.Color(tint).int_rgb for tint in tints], np.uint8)
    surface.cell_data["colors"] = np.repeat(colors, [mesh.face_count for mesh in meshes], axis=0)
    plotter.add_mesh(
        surface, scalars="colors", rgb=True, smooth_shading=True, split_sharp_edges=True,
        feature_angle=SHARP_EDGE, silhouette={"color": INK, "line_width": 2.0}, **SURFACE_LOOK,
    )  # fmt: skip
    edges = surface.extract_feature_edges(SHARP_EDGE, non_manifold_edges=False)
    if edges.n_cells:
        plotter.add_mesh(edges, color=INK, line_width=2.0, lighting=False)


def _add_sheet(plotter: Any, field: FieldSlice, camera: Camera, colors: DistanceColors) -> None:
    """Draw the colours and iso-distance lines of a plane, and the line in which it cuts the surface."""
    sheet = load_pyvista().StructuredGrid(*np.moveaxis(camera.heights(field.points)[..., None, :], -1, 0))
    sheet["colors"] = np.swapaxes(colors(field.signed_distance), 0, 1).reshape(-1, 3)
    sheet["distance"] = field.signed_distance.T.reshape(-1)  # in column order, as the points
    look = {"lighting": False, "show_scalar_bar": False}
    plotter.add_mesh(sheet, scalars="colors", rgb=True, opacity=SHEET_OPACITY, **look)
    levels = np.arange(colors.levels[0] * colors.metres, colors.levels[-1] * colors.metres, colors.step)
    for at, line_width, opacity in ((levels, 1.0, 0.5), ([0.0], 4.0, 1.0)):
        lines = sheet.contour(list(at), scalars="distance")
        if lines.n_cells:
            plotter.add_mesh(lines, color=INK, line_width=line_width, opacity=opacity, **look)


def _add_queries(plotter: Any, connections: Connections, camera: Camera, colors: DistanceColors) -> None:
    """Draw points, connections and their ends. Those behind the surface shine through."""
    pyvista = load_pyvista()
    count = len(connections.points)
    size = min(1.0, max(0.25, (60 / count) ** 0.5))
    points, ends = camera.heights(connections.points), camera.heights(connections.closest)
    marks = _balls(points, size * POINT_RADIUS, 24 if count <= 100 else 8)
    tints = np.round(255 * colors(connections.signed_distance)).astype(np.uint8)
    marks["colors"] = np.repeat(tints, marks.n_points // count, axis=0)
    shapes = [(marks, {"scalars": "colors", "rgb": True})]
    if count <= MAX_TUBES:
        lines = pyvista.line_segments_from_points(np.stack([points, ends], axis=1).reshape(-1, 3))
        tubes = lines.tube(radius=size * TUBE_RADIUS, n_sides=12)
        shapes += [(shape, {"color": INK}) for shape in (tubes, _balls(ends, size * END_RADIUS, 16))]
    for shape, color in shapes:
        if not shape.n_cells:
            continue
        plotter.add_mesh(shape, smooth_shading=True, **color, **SURFACE_LOOK)
        shining = plotter.add_mesh(shape, smooth_shading=True, opacity=SHINE_THROUGH, **color, **SURFACE_LOOK)
        shining.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        shining.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, NEAREST_OFFSET)


def _balls(centers: np.ndarray, radius: float, detail: int) -> Any:
    """Return balls around points, in the order of the points."""
    pyvista = load_pyvista()
    ball = pyvista.Sphere(radius=radius, theta_resolution=detail, phi_resolution=detail)
    faces = ball.regular_faces + ball.n_points * np.arange(len(centers))[:, None, None]
    return pyvista.PolyData.from_regular_faces(
        (centers[:, None] + ball.points).reshape(-1, 3), faces.reshape(-1, 3)
    )
