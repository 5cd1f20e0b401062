"""Images of triangles, drawn by VTK without a screen: colours and depths, nothing else.

VTK computes in single precision: it is given pixels around the middle of the image instead of metres.
"""

import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from proximity.errors import QueryError
from proximity.scene.picture.camera import Camera
from proximity.system.extras import needed

SHARP_EDGE = 25.0  # degrees between faces: an edge is drawn, and the surface is not shaded across it
EDGE_COLOR = (0.13, 0.18, 0.24)
LIGHTS = (  # towards the light: right, up, to the viewer; how bright
    ((0.30, 0.55, 0.78), 0.70),
    ((-0.70, 0.10, 0.70), 0.30),
    ((0.0, 0.0, 1.0), 0.25),
)
MODULES = (
    "vtkRenderingCore", "vtkRenderingOpenGL2", "vtkFiltersCore", "vtkCommonCore", "vtkCommonDataModel",
    "util.numpy_support",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Coloured triangles in the scene's frame."""

    vertices: np.ndarray  # (V, 3) float64, m
    faces: np.ndarray  # (F, 3) integers
    colors: np.ndarray  # (F, 3) float64, 0 to 1
    has_edges: bool = False  # whether sharp edges are drawn


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceImage:
    """What is seen, row by row from the top."""

    color: np.ndarray  # (H, W, 3) float32, 0 to 1; undefined where nothing is
    depth: np.ndarray  # (H, W) float32, pixels away from the viewer; inf where nothing is


def load_vtk() -> Any:
    """Return what is needed of VTK, as attributes of one object."""
    names: dict[str, Any] = {}
    with needed("pictures need", "picture", QueryError):
        for name in MODULES:
            names |= vars(import_module(f"vtkmodules.{name}"))
    names["vtkLogger"].SetStderrVerbosity(names["vtkLogger"].VERBOSITY_OFF)
    return type("Vtk", (), {name: value for name, value in names.items() if not name.startswith("__")})


def render(triangles: Triangles, camera: Camera, *, is_occluding: bool = False) -> SurfaceImage:
    """Return the image of triangles.

    *is_occluding*: darken corners and gaps, where little light from around arrives.
    """
    vtk = load_vtk()
    data = _poly_data(vtk, triangles, camera)
    depths = camera.pixels(triangles.vertices)[:, 2]
    near, far = float(depths.min()) - 2.0, float(depths.max()) + 2.0
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.AutomaticLightCreationOff()
    for direction, brightness in LIGHTS:
        renderer.AddLight(_light(vtk, direction, brightness))
    _aim(renderer.GetActiveCamera(), camera, near, far)
    for actor in _actors(vtk, data, triangles.has_edges):
        renderer.AddActor(actor)
    if is_occluding:
        renderer.SetPass(_occlusion(vtk, camera))
    window = _window(vtk, camera.size)
    window.AddRenderer(renderer)
    window.Render()
    color, depth = _read(vtk, window, "RGB"), _read(vtk, window, "ZBuffer")
    window.Finalize()
    is_empty = depth >= 1.0
    depth = (near + depth * (far - near)).astype(np.float32)
    depth[is_empty] = np.inf
    return SurfaceImage(color.astype(np.float32) / 255.0, depth)


def _poly_data(vtk: Any, triangles: Triangles, camera: Camera) -> Any:
    """The triangles with normals, split at sharp edges; coordinates in pixels: right, up, to the viewer."""
    pixels = camera.pixels(triangles.vertices) - [camera.size[0] / 2, camera.size[1] / 2, 0.0]
    data, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(vtk.numpy_to_vtk((pixels * [1.0, -1.0, -1.0]).astype(np.float32), deep=True))
    offsets = np.arange(0, 3 * len(triangles.faces) + 1, 3, dtype=np.int64)
    corners = np.ascontiguousarray(triangles.faces, dtype=np.int64).reshape(-1)
    cells.SetData(*(vtk.numpy_to_vtkIdTypeArray(ids, deep=True) for ids in (offsets, corners)))
    data.SetPoints(points)
    data.SetPolys(cells)
    colors = np.round(255 * triangles.colors).astype(np.uint8)
    data.GetCellData().SetScalars(vtk.numpy_to_vtk(colors, deep=True))
    return data


def _actors(vtk: Any, data: Any, has_edges: bool) -> list[Any]:
    normals = vtk.vtkPolyDataNormals()
    normals.SetInputData(data)
    normals.SetFeatureAngle(SHARP_EDGE)
    normals.ConsistencyOff()
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    surface = vtk.vtkActor()
    surface.SetMapper(mapper)
    looks = surface.GetProperty()
    looks.SetAmbient(0.20)
    looks.SetDiffuse(0.95)
    looks.SetSpecular(0.12)
    looks.SetSpecularPower(24.0)
    if not has_edges:
        return [surface]
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(data)
    edges.SetFeatureAngle(SHARP_EDGE)
    edges.ColoringOff()
    edges.NonManifoldEdgesOff()
    lines = vtk.vtkPolyDataMapper()
    lines.SetInputConnection(edges.GetOutputPort())
    lines.ScalarVisibilityOff()
    drawn = vtk.vtkActor()
    drawn.SetMapper(lines)
    drawn.GetProperty().SetColor(EDGE_COLOR)
    drawn.GetProperty().SetLineWidth(2.0)
    drawn.GetProperty().LightingOff()
    return [surface, drawn]


def _light(vtk: Any, direction: tuple[float, float, float], brightness: float) -> Any:
    light = vtk.vtkLight()
    light.SetLightTypeToSceneLight()
    light.SetPositional(False)
    light.SetPosition(direction)
    light.SetFocalPoint(0.0, 0.0, 0.0)
    light.SetIntensity(brightness)
    return light


def _aim(eye: Any, camera: Camera, near: float, far: float) -> None:
    eye.ParallelProjectionOn()
    eye.SetFocalPoint(0.0, 0.0, -near)  # straight ahead, also where all is behind the middle of the image
    eye.SetViewUp(0.0, 1.0, 0.0)
    # VTK wants the near plane in front of the viewer: the viewer stands one pixel before it.
    eye.SetPosition(0.0, 0.0, 1.0 - near)
    eye.SetParallelScale(camera.size[1] / 2)
    eye.SetClippingRange(1.0, 1.0 + far - near)


def _occlusion(vtk: Any, camera: Camera) -> Any:
    steps, occlusion = vtk.vtkRenderStepsPass(), vtk.vtkSSAOPass()
    occlusion.SetRadius(0.06 * min(camera.size))
    occlusion.SetBias(0.004 * min(camera.size))
    occlusion.SetKernelSize(32)
    occlusion.BlurOn()
    occlusion.SetDelegatePass(steps)
    return occlusion


def _window(vtk: Any, size: tuple[int, int]) -> Any:
    """A window that nobody sees."""
    # On Linux VTK would try an X server first. Its check of OSMesa says yes where there is none, and the
    # program ends with a segmentation fault (9.7, 2026-11-25): OSMesa is not tried.
    window = (vtk.vtkEGLRenderWindow if sys.platform == "linux" else vtk.vtkRenderWindow)()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(*size)
    if not window.SupportsOpenGL():
        raise QueryError(
            "pictures need OpenGL, and VTK found none: install libEGL and Mesa's drivers (Debian and Ubuntu: "
            "apt install libegl1 libgl1-mesa-dri)"
        )
    return window


def _read(vtk: Any, window: Any, kind: str) -> np.ndarray:
    """Colours (H, W, 3) or depths (H, W) of a window, from the top."""
    reader = vtk.vtkWindowToImageFilter()
    reader.SetInput(window)
    reader.ShouldRerenderOff()
    getattr(reader, f"SetInputBufferTypeTo{kind}")()
    reader.Update()
    width, height = window.GetSize()
    values = vtk.vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    shape = (height, width, 3) if kind == "RGB" else (height, width)
    return values.reshape(shape)[::-1]
