"""The contenders: us, and other libraries that answer the same questions.

Libraries are imported when their contender is made; `available` says which are missing and why.
"""

import importlib
from typing import Any, ClassVar

import numpy as np
from contender import Contender, Task, as_float32, as_is, inf_from
from rival_fcpw import Fcpw, FcpwContains
from rival_warp import Warp, WarpParity, WarpVotes, WarpWinding

EMBREE_MISS = 1e37


class Proximity(Contender):
    """This package; a scene made of arrays, in float64."""

    name = "proximity"
    package = "proximity"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("proximity")
        self.library.warm_up()

    @property
    def version(self) -> str:
        return self.library.__version__

    @property
    def memory_bytes(self) -> int | None:
        return self.engine.memory_bytes

    def builder(self, vertices, faces):
        return lambda: self.library.Scene.from_mesh(vertices, faces)

    def distance(self, points):
        ask = self.engine.distance
        return Task(lambda: ask(points), as_is)

    def signed_distance(self, points):
        ask = self.engine.signed_distance
        return Task(lambda: ask(points), as_is)

    def closest(self, points):
        ask = self.engine.closest
        return Task(lambda: ask(points), lambda hits: hits.point)

    def contains(self, points):
        ask = self.engine.contains
        return Task(lambda: ask(points), as_is)

    def cast(self, origins, directions):
        ask = self.engine.cast
        return Task(lambda: ask(origins, directions), lambda hits: hits.distance)


class ProximityLengths(Proximity):
    """Our rays asked for distances alone."""

    name = "proximity (distances)"
    questions = ("cast",)
    beside = name

    def cast(self, origins, directions):
        ask = self.engine.cast_distance
        return Task(lambda: ask(origins, directions), as_is)


class ProximityTree(Proximity):
    """Our tree alone, as the others build it: without welding, bodies, checks and sign."""

    name = "proximity (tree alone)"
    questions = ()
    memory_bytes = None

    def builder(self, vertices, faces):
        bvh = importlib.import_module("proximity.bvh")
        corners = bvh.local_frame(vertices.min(axis=0), vertices.max(axis=0)).of(vertices)
        rows = np.ascontiguousarray(faces, dtype=np.int32)
        return lambda: bvh.build_bvh(corners, rows)


class Open3D(Contender):
    """Open3D's RaycastingScene (Embree inside); float32. Sign from the parity of one ray."""

    name = "Open3D"
    package = "open3d-cpu"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("open3d")

    def _tensor(self, array):
        return self.library.core.Tensor(np.ascontiguousarray(array))

    def builder(self, vertices, faces):
        positions, triangles = self._tensor(as_float32(vertices)), self._tensor(faces.astype(np.uint32))
        probe = self._tensor(np.zeros((1, 3), dtype=np.float32))

        def build():
            scene = self.library.t.geometry.RaycastingScene(nthreads=1)
            scene.add_triangles(positions, triangles)
            scene.compute_distance(probe, nthreads=1)  # the first question builds the tree
            return scene

        return build

    def distance(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(lambda: scene.compute_distance(queries, nthreads=1), _from_tensor)

    def signed_distance(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(lambda: scene.compute_signed_distance(queries, nthreads=1), _from_tensor)

    def closest(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        find = scene.compute_closest_points
        return Task(lambda: find(queries, nthreads=1), lambda found: _from_tensor(found["points"]))

    def contains(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(
            lambda: scene.compute_occupancy(queries, nthreads=1), lambda found: _from_tensor(found) > 0.5
        )

    def cast(self, origins, directions):
        rays, scene = self._tensor(as_float32(np.hstack([origins, directions]))), self.engine
        return Task(lambda: scene.cast_rays(rays, nthreads=1), lambda hits: _from_tensor(hits["t_hit"]))


def _from_tensor(tensor):
    return tensor.numpy().astype(np.float64)


class Libigl(Contender):
    """libigl: its tree, and its fast winding number for the sign; float64."""

    name = "libigl"
    package = "libigl"
    questions = ("distance", "signed_distance", "closest", "contains")
    query_limit = 2000

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("igl")
        self.mesh: tuple[np.ndarray, ...] = ()
        self.winding: Any = None

    def builder(self, vertices, faces):
        self.mesh = (np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int64))
        self.winding = None

        def build():
            tree = self.library.AABB()
            tree.init(*self.mesh)
            return tree

        return build

    def distance(self, points):
        return Task(lambda: self.engine.squared_distance(*self.mesh, points), lambda found: np.sqrt(found[0]))

    def closest(self, points):
        return Task(lambda: self.engine.squared_distance(*self.mesh, points), lambda found: found[2])

    def contains(self, points):
        self._make_winding()
        return Task(lambda: self.winding.winding_number(points, 2.0) > 0.5, as_is)

    def signed_distance(self, points):
        self._make_winding()

        def run():
            distance_sq = self.engine.squared_distance(*self.mesh, points)[0]
            return np.where(self.winding.winding_number(points, 2.0) > 0.5, -1.0, 1.0) * np.sqrt(distance_sq)

        return Task(run, as_is)

    def _make_winding(self):
        if self.winding is None:
            self.winding = self.library.FastWindingNumberBVH()
            self.winding.init(*self.mesh, 2)


class LibiglNormals(Libigl):
    """libigl's signed_distance by pseudo-normals, which builds its tree anew in every call."""

    name = "libigl (normals)"
    questions = ("signed_distance",)

    def signed_distance(self, points):
        method = self.library.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        return Task(lambda: self.library.signed_distance(points, *self.mesh, method), lambda found: found[0])


# --------------------------------------------------------------------------------------------- trimesh


class Trimesh(Contender):
    """trimesh with rtree; float64."""

    name = "trimesh"
    package = "trimesh"
    questions = ("distance", "signed_distance", "closest", "contains")
    query_limit = 200

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("trimesh")
        importlib.import_module("rtree")

    def builder(self, vertices, faces):
        def build():
            mesh = self.library.Trimesh(vertices, faces, process=False)
            _ = mesh.triangles_tree
            return mesh

        return build

    def distance(self, points):
        return self._find(points, 1)

    def closest(self, points):
        return self._find(points, 0)

    def _find(self, points, column):
        closest_point = self.library.proximity.closest_point
        return Task(lambda: closest_point(self.engine, points), lambda found: found[column])

    def contains(self, points):
        return Task(lambda: self.engine.contains(points), as_is)

    def signed_distance(self, points):
        inside_positive = self.library.proximity.signed_distance
        return Task(lambda: inside_positive(self.engine, points), lambda found: -found)


# --------------------------------------------------------------------------------------------- embreex


class Embreex(Contender):
    """Embree through embreex's own scene, asked for distances alone; float32, Embree's default flags."""

    name = "embreex"
    package = "embreex"
    questions = ("cast",)
    beside = ProximityLengths.name
    arguments: ClassVar[dict[str, Any]] = {"query": "DISTANCE"}

    def __init__(self) -> None:
        super().__init__()
        self.scenes = importlib.import_module("embreex.rtcore_scene")
        self.meshes = importlib.import_module("embreex.mesh_construction")

    def builder(self, vertices, faces):
        positions, triangles = as_float32(vertices), np.ascontiguousarray(faces, dtype=np.int32)
        probe = np.ones((1, 3), dtype=np.float32)

        def build():
            scene = self.scenes.EmbreeScene()
            self.meshes.TriangleMesh(scene, positions, triangles)
            scene.run(probe, probe)  # the first question builds the tree
            return scene

        return build

    def cast(self, origins, directions):
        starts, ways = as_float32(origins), as_float32(directions)
        run, arguments = self.engine.run, self.arguments
        return Task(lambda: run(starts, ways, **arguments), self._read)

    @staticmethod
    def _read(lengths):
        return inf_from(lengths, EMBREE_MISS).astype(np.float64)


class EmbreexAll(Embreex):
    """embreex, asked for what our `cast` gives as well: distance, face, barycentric and normal."""

    name = "embreex (all outputs)"
    beside = Proximity.name
    arguments: ClassVar[dict[str, Any]] = {"output": True}

    @staticmethod
    def _read(hits):
        return np.where(hits["primID"] >= 0, hits["tfar"], np.inf).astype(np.float64)


RIVALS: tuple[type[Contender], ...] = (
    Fcpw,
    FcpwContains,
    Open3D,
    Warp,
    WarpVotes,
    WarpParity,
    WarpWinding,
    Libigl,
    LibiglNormals,
    Trimesh,
    Embreex,
    EmbreexAll,
)
CONTENDERS: tuple[type[Contender], ...] = (Proximity, ProximityLengths, ProximityTree, *RIVALS)


def available(kinds: tuple[type[Contender], ...] = CONTENDERS) -> tuple[list[Contender], dict[str, str]]:
    """Return those that can be imported, and by name the reason why the other rivals cannot."""
    found, missing = [], {}
    for kind in kinds:
        try:
            found.append(kind())
        except (ImportError, OSError) as reason:
            if issubclass(kind, Proximity):
                raise
            missing[kind.name] = f"{type(reason).__name__}: {reason}"
    return found, missing
