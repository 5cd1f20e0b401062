"""Solids. A solid is one body with its faces, tree and sign method."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.checks import refuse_trimesh
from proximity.kernels.entries import signed_volume, surface_faces
from proximity.kernels.layout import UNUSED
from proximity.mesh.bvh import Bvh, LocalFrame
from proximity.mesh.topology import Topology, build_topology, corners_of
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import Model, assemble
from proximity.scene.queries.queries import Queries
from proximity.scene.sign import FLIPPED, SignMethod, choose_sign
from proximity.scene.solid_arrays import SolidArrays, part_model

if TYPE_CHECKING:
    from proximity.mesh.diagnosis import Diagnosis

DEFORMED = "; decided before the part was deformed, and not checked since"


class Solid(Queries):
    """One body that is ready for queries. It never changes: deforming a part makes another solid.

    ``mesh`` has vertices and faces. ``sign_method`` is the method that decides between inside and outside,
    and ``sign_reason`` is the reason for its choice.

    Parameters
    ----------
    vertices : (V, 3) float64, m
        Corners. Equal positions count as one corner; near ones do not.
    faces : (F, 3) integers
        Rows of *vertices*, counter-clockwise seen from outside. If they enclose a negative volume they are
        flipped, and `sign_reason` says so.
    name : str
        Name, for reports.
    frame : LocalFrame
        Frame shared with the other parts of a file, which then form one tree; see `mesh.bvh.common_frame`.

    Raises
    ------
    MeshError
        If the arrays cannot be used; the message names the first invalid entry.

    Notes
    -----
    Cost: 0.8 s for 300 k faces of even shape, 1.2 s for needles; 190 bytes a face.
    """

    mesh: TriangleMesh
    name: str
    sign_method: SignMethod
    sign_reason: str
    _arrays: SolidArrays

    def __init__(
        self, vertices: Any, faces: Any = None, *, name: str = "solid", frame: LocalFrame | None = None
    ) -> None:
        refuse_trimesh(vertices)
        self._begin(TriangleMesh(vertices, faces), None, name, frame)

    def _begin(
        self, mesh: TriangleMesh, topology: Topology | None, name: str, frame: LocalFrame | None
    ) -> None:
        """Build the tree of a mesh and choose its sign. *topology*: the topology of the mesh, if known."""
        if topology is None:
            topology = build_topology(mesh)
        is_turned = topology.is_balanced and signed_volume(mesh.vertices, mesh.faces) < 0.0
        if is_turned:
            mesh = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
            topology = build_topology(mesh)
        corners = corners_of(mesh, topology)
        model = part_model(corners, topology.corner_ids, topology.neighbors, frame)
        self.mesh = mesh
        self.name = name
        self._is_watertight = topology.is_watertight
        self.sign_method, self.sign_reason = choose_sign(model, topology)
        self._arrays = SolidArrays(model)
        if is_turned:
            self.sign_reason += FLIPPED

    @classmethod
    def _of_mesh(
        cls, mesh: TriangleMesh, topology: Topology | None, name: str, frame: LocalFrame | None
    ) -> "Solid":
        """Return the solid of a mesh, which shares the arrays of the mesh.

        The arguments are those of `_begin`.
        """
        solid = cls.__new__(cls)
        solid._begin(mesh, topology, name, frame)
        return solid

    @classmethod
    def _from_model(
        cls, model: Model, row: int, mesh: TriangleMesh, name: str, sign: tuple[SignMethod, str, bool]
    ) -> "Solid":
        """Return the solid of a part of a model, without building a tree.

        *sign*: sign method, its reason, and whether the mesh is watertight.
        """
        solid = cls.__new__(cls)
        solid.mesh, solid.name = mesh, name
        solid.sign_method, solid.sign_reason, solid._is_watertight = sign
        solid._arrays = SolidArrays.of_part(model, row)
        return solid

    def _for_scene(self) -> "Solid":
        """Return an equal solid, whose arrays a scene may replace."""
        solid = Solid.__new__(Solid)
        solid.__dict__.update(self.__dict__, _arrays=SolidArrays(self.snapshot()))
        return solid

    def _deformed(self, vertices: np.ndarray, model: Model, row: int) -> "Solid":
        """Return a solid with the same faces and other, validated vertices.

        Its arrays are in a scene's memory.
        """
        reason = self.sign_reason.removesuffix(DEFORMED) + DEFORMED
        sign = self.sign_method, reason, self._is_watertight
        solid = Solid._from_model(model, row, self.mesh.with_vertices(vertices), self.name, sign)
        solid.first_vertices = self.first_vertices
        return solid

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy, whose arrays are separate from those of the original."""
        return self.__dict__ | {"_arrays": assemble([self.snapshot()], [Pose()])}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _arrays=SolidArrays(state["_arrays"]))

    def snapshot(self) -> Model:
        """Return the arrays that queries read, at the identity pose.

        Notes
        -----
        Cost: none, except after a scene has deformed the part of this solid: then its tree is rebuilt once.
        """
        arrays = self._arrays
        return arrays.rebuilt(self.mesh) if arrays.is_overwritten else arrays.model

    @property
    def has_inside(self) -> bool:
        """Whether distances have a sign."""
        return self.sign_method is not SignMethod.NONE

    @property
    def is_watertight(self) -> bool:
        """Whether every edge has exactly two faces with opposite directions."""
        return self._is_watertight

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner, (3,) m, of the box around the faces."""
        row = self.snapshot().frames[0]
        return (
            row["own_lower"].copy(),
            row["own_upper"].copy(),
        )

    @cached_property
    def topology(self) -> Topology:
        """Connections between the faces. They are computed on first access."""
        return build_topology(self.mesh)

    @cached_property
    def diagnosis(self) -> "Diagnosis":
        """Diagnosis of the mesh, including the verdict of manifold3d."""
        from proximity.mesh.diagnosis import diagnose  # not needed by queries

        return diagnose(self.mesh)

    @property
    def bvh(self) -> Bvh:
        """The tree, for inspection. See `Bvh.check`."""
        return self.snapshot().bvh(0)

    @cached_property
    def first_vertices(self) -> np.ndarray:
        """Lowest vertex at the position of each vertex, (V,) int32, or -1 for a vertex without a face."""
        model = self._arrays.model
        part = model.parts[0]
        corner_of = model.words[part["faces"] :][: 3 * part["face_count"]].view(np.int32)
        corner = np.full(self.mesh.vertex_count, UNUSED, np.int32)
        corner[self.mesh.faces.ravel()] = corner_of
        used = np.flatnonzero(corner != UNUSED)
        first = np.empty(int(corner.max()) + 1, np.int32)
        first[corner[used[::-1]]] = used[::-1]  # the smallest vertex of each corner is written last
        assert (np.diff(first) > 0).all(), "corners are numbered in the order of their first vertices"
        return np.where(corner == UNUSED, np.int32(UNUSED), first[corner])

    @cached_property
    def surface_faces(self) -> np.ndarray:
        """First face of each surface whose faces are connected across edges, (S,) int32."""
        waiting, faces = np.empty((2, self.mesh.face_count), np.int32)
        return faces[: surface_faces(self.snapshot().packed, 0, waiting, faces)].copy()

    @property
    def memory_bytes(self) -> int:
        """Number of bytes of the mesh and the tree."""
        return self.snapshot().memory_bytes + self._mesh_bytes

    @property
    def _mesh_bytes(self) -> int:
        first_vertices = self.__dict__.get("first_vertices")
        known = 0 if first_vertices is None else first_vertices.nbytes
        return self.mesh.vertices.nbytes + self.mesh.faces.nbytes + known

    def __repr__(self) -> str:
        return f"Solid({self.name!r}, {self.mesh.face_count} faces, sign by {self.sign_method.value})"
