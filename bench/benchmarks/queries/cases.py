"""Cases by names like ``plate/near``: a mesh, and a pattern of queries around it.

Seeds are fixed, so that every run and every contender gets the same numbers. Coordinates are those of the
files (no unit is converted): distances have the unit of the mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.support.project import SHARED_PARTS, project_module

BATCH_COUNT = 20_000
FINGERS = 5  # of a hand: points in a small call
HAND_COUNT = 20  # small calls, used in turn
NEAR_SPREAD = 0.02  # standard deviation of the distance to the surface, of the diagonal
SCATTER_SIZE = 1.5  # of the box
PATH_STEP = 2e-4  # of the diagonal, in one tick: 0.2 m/s at 1 kHz around a part of one metre

Mesh = tuple[np.ndarray, np.ndarray]


class MissingMeshError(Exception):
    """The mesh of a case is not on this machine."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A mesh with queries around it."""

    name: str  # mesh/pattern
    vertices: np.ndarray  # (V, 3) float64, equal positions welded
    faces: np.ndarray  # (F, 3) int64
    points: np.ndarray  # (N, 3) float64, query points, or origins of rays
    directions: np.ndarray | None = None  # (N, 3) unit, of rays

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the box around the mesh."""
        return diagonal(self.vertices)

    def __str__(self) -> str:
        kind = "points" if self.directions is None else "rays"
        return f"{self.name}: {len(self.faces)} faces, {len(self.points)} {kind}"


def make_case(name: str, query_count: int = BATCH_COUNT) -> Case:
    """Return the case *name* (``mesh/pattern``) with *query_count* queries.

    Raises
    ------
    MissingMeshError
        If the mesh is not on this machine; the message says what is missing.
    KeyError
        If the mesh or the pattern is unknown.
    """
    mesh_name, _, pattern = name.partition("/")
    vertices, faces = load_mesh(mesh_name)
    rng = np.random.default_rng(20_251)
    points, directions = PATTERNS[pattern](vertices, faces, query_count, rng)
    return Case(name, vertices, faces, points, directions)


def part_of(case: Case, rows: np.ndarray) -> Case:
    """Return *case* with only the queries of *rows*, modulo their number."""
    rows = rows % len(case.points)
    directions = None if case.directions is None else case.directions[rows]
    return Case(case.name, case.vertices, case.faces, case.points[rows], directions)


def hands_of(case: Case) -> list[Case]:
    """Return the first queries of *case*, five in each of the cases returned."""
    rows = np.arange(FINGERS * HAND_COUNT).reshape(HAND_COUNT, FINGERS)
    return [part_of(case, each) for each in rows]


@cache
def load_mesh(name: str) -> Mesh:
    """Return the mesh *name*, equal positions welded, arrays read-only."""
    vertices, faces = MESHES[name]()
    vertices, ids = np.unique(np.asarray(vertices, dtype=np.float64) + 0.0, axis=0, return_inverse=True)
    faces = np.ascontiguousarray(ids.reshape(-1)[np.asarray(faces)], dtype=np.int64)
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def _shared(file_name: str) -> Callable[[], Mesh]:
    return lambda: _read(
        SHARED_PARTS / file_name, f"{file_name} is not here (shared/data/cad beside the project)"
    )


def _read(path: Path, missing: str) -> Mesh:
    if not path.is_file():
        raise MissingMeshError(missing)
    mesh = trimesh.load_mesh(path, process=False)
    return mesh.vertices, mesh.faces


def _sphere(subdivision_count: int) -> Callable[[], Mesh]:
    return lambda: project_module("tests/support", "shapes").sphere(1.0, subdivision_count)


def _plate() -> Mesh:
    return project_module("meshes", "make").plate(*PLATE)


SUITE_MESHES = ("featuretype", "cycloidal", "plate", "sphere")  # of the pytest-benchmark suites
PLATE = (784, 96)  # holes, sides of a hole: 304,204 faces
MESHES: dict[str, Callable[[], Mesh]] = {
    "featuretype": _shared("featuretype.STL"),
    "cycloidal": _shared("cycloidal.ply"),
    "plate": _plate,
    "sphere": _sphere(6),
    "globe": _sphere(8),  # 1,310,720 faces
    "ball": _sphere(2),  # the smallest, for the smoke test
}


def add_file(path: Path) -> str:
    """Add a mesh file to `MESHES`, and return its name there: that of the file up to the first dot."""
    name = path.name.partition(".")[0]
    MESHES[name] = lambda: _read(path, f"{path} is not here")
    return name


def _near(vertices, faces, count, rng):
    """Return points on the surface, moved along the normal."""
    points, normals = on_surface(vertices, faces, count, rng)
    height = rng.normal(0.0, NEAR_SPREAD * diagonal(vertices), count)
    return points + (height / np.linalg.norm(normals, axis=1))[:, None] * normals, None


def on_surface(vertices, faces, count, rng):
    """Return points on faces drawn by area, and normals of twice the areas there; (count, 3) each."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    double_areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(faces), count, p=double_areas / double_areas.sum())
    root, share = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - root, root * (1.0 - share), root * share])[..., None]
    return weights[0] * a[chosen] + weights[1] * b[chosen] + weights[2] * c[chosen], normals[chosen]


def _scattered(vertices, _, count, rng):
    """Return points anywhere in a box somewhat larger than the part's."""
    return _in_box(vertices, count, rng, SCATTER_SIZE), None


def _center(vertices, _, count, rng):
    """Return points at the middle: the worst case for a ball, equally far from all faces."""
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return middle + rng.normal(0.0, 1e-6 * diagonal(vertices), (count, 3)), None


def _path(vertices, faces, count, rng):
    """Return a random walk near the surface: every point is close to the previous one."""
    (start,), _ = _near(vertices, faces, 1, rng)
    heading = rng.normal(size=(count, 3)).cumsum(axis=0)
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    steps = PATH_STEP * diagonal(vertices) * heading
    reach = np.ptp(vertices, axis=0)
    # Reflected at the walls of the scatter box, so that the walk does not leave it.
    lower = vertices.min(axis=0) - 0.25 * reach
    period = 2.0 * SCATTER_SIZE * reach
    folded = np.mod(start + steps.cumsum(axis=0) - lower, period)
    return lower + np.minimum(folded, period - folded), None


def _rays(vertices, _, count, rng):
    """Return rays from a sphere around the part toward points in its box."""
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    outward = rng.normal(size=(count, 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    origins = middle + diagonal(vertices) * outward
    directions = _in_box(vertices, count, rng, 1.0) - origins
    return origins, directions / np.linalg.norm(directions, axis=1)[:, None]


def _in_box(vertices, count, rng, size):
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    return 0.5 * (lower + upper) + size * (upper - lower) * rng.uniform(-0.5, 0.5, (count, 3))


def diagonal(vertices):
    """Length of the diagonal of the box around a mesh."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


PATTERNS = {"near": _near, "scattered": _scattered, "center": _center, "path": _path, "rays": _rays}
