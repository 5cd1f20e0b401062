"""One body: its faces, how they hang together, its tree, and how inside is told."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from proximity.arrays import refuse_trimesh
from proximity.errors import MeshError
from proximity.kernels import layout
from proximity.kernels.layout import NO_GRID
from proximity.kernels.mesh.faces import signed_volume
from proximity.mesh.diagnosis import Diagnosis, diagnose
from proximity.mesh.topology import Topology, build_topology
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.model.assembly import Model, Shelf, assemble
from proximity.model.bvh import Bvh, LocalFrame
from proximity.model.part_arrays import PartArrays, part_arrays, with_folds, with_sign
from proximity.pose import Pose
from proximity.scene.queries import Queries
from proximity.scene.sign import SignMethod, choose_sign

DEFORMED = "; told when the part was made, and not looked at since it has been deformed"


@dataclass(frozen=True, slots=True, eq=False)
class _Remains:
    """What is kept of a solid whose arrays a scene has deformed: with the mesh, enough to make it anew."""

    frame: LocalFrame
    sign: int
    has_grid: bool
    faces: np.ndarray  # (F, 3) int32, rows of corners; in the scene's memory, where they stay
    neighbors: np.ndarray  # (F, 3) int32, likewise
    folded: np.ndarray  # int32, faces over which the winding number tells the side


class Solid(Queries):
    """One body from arrays, ready to be asked; it never changes, also where a scene deforms its part.

    ``mesh`` holds vertices and faces; ``sign_method`` says how inside is told, and ``sign_reason`` why so.

    Parameters
    ----------
    vertices : (V, 3) float64, m
        Corners. Equal positions count as one corner; near ones do not.
    faces : (F, 3) integers
        Rows of *vertices*, counter-clockwise seen from outside. Where they enclose a negative volume they
        are turned, and `sign_reason` says so.
    name : str
        For reports.
    frame : LocalFrame
        Shared with the other parts of a file, which can then be asked as one tree; see `model.common_frame`.

    Raises
    ------
    MeshError
        If the arrays cannot be used; the message names the first offender.

    Notes
    -----
    Cost: for 300 k faces 0.8 s where they are even and 1.2 s where they are needles; 180 bytes a face.
    """

    mesh: TriangleMesh
    name: str
    sign_method: SignMethod
    sign_reason: str
    _stage: Shelf  # the arrays; None where they must be made first
    _source: tuple[Model, int] | None  # of what to make them: a part of a scene's model,
    _remains: _Remains | None  # or what is left after a scene has deformed it
    _leaders: np.ndarray | None  # see `deforming`

    def __init__(
        self, vertices: Any, faces: Any = None, *, name: str = "solid", frame: LocalFrame | None = None
    ) -> None:
        refuse_trimesh(vertices, MeshError)
        mesh = TriangleMesh(vertices, faces)
        topology = build_topology(mesh)
        is_turned = topology.is_balanced and signed_volume(mesh.vertices, mesh.faces) < 0.0
        if is_turned:
            mesh = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
            topology = build_topology(mesh)
        corners = np.empty((int(topology.corner_ids.max()) + 1, 3))
        corners[topology.corner_ids.ravel()] = mesh.vertices[mesh.faces.ravel()]
        piece = part_arrays(corners, topology.corner_ids, topology.neighbors, frame)
        self.mesh = mesh
        self.name = name
        self._is_watertight = topology.is_watertight
        piece, self.sign_method, self.sign_reason = choose_sign(piece, topology)
        self._stage = Shelf(assemble([piece], [Pose()]))
        self._source, self._remains, self._leaders = None, None, None
        if is_turned:
            self.sign_reason += "; all faces were turned, since they ran clockwise seen from outside"

    @classmethod
    def _from_model(
        cls, model: Model, row: int, mesh: TriangleMesh, name: str, sign: tuple[SignMethod, str, bool]
    ) -> "Solid":
        """The body of a part of a model, without making anything anew; *sign*: method, reason, watertight."""
        solid = cls.__new__(cls)
        solid.mesh, solid.name = mesh, name
        solid.sign_method, solid.sign_reason, solid._is_watertight = sign
        solid._stage, solid._source = Shelf(None), (model, row)
        solid._remains, solid._leaders = None, None
        return solid

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of: arrays of its own, wherever these lie."""
        own = Shelf(assemble([self._model.part_arrays(0)], [Pose()]))
        return self.__dict__ | {"_stage": own, "_source": None, "_remains": None}

    @property
    def has_inside(self) -> bool:
        """Whether distances have a sign."""
        return self.sign_method is not SignMethod.NONE

    @property
    def is_watertight(self) -> bool:
        """Whether every edge has exactly two faces, running opposite ways."""
        return self._is_watertight

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner of the box around the faces, m, (3,) each."""
        row = self._model.frames[0]
        return (
            row[layout.OWN_LOWER : layout.OWN_LOWER + 3].copy(),
            row[layout.OWN_UPPER : layout.OWN_UPPER + 3].copy(),
        )

    @cached_property
    def topology(self) -> Topology:
        """How the faces meet; computed anew when first asked for."""
        return build_topology(self.mesh)

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """What there is to know about the mesh, with manifold3d's opinion."""
        return diagnose(self.mesh)

    @property
    def bvh(self) -> Bvh:
        """The tree, for inspection; see `Bvh.check`."""
        return self._model.part_arrays(0).bvh

    @property
    def memory_bytes(self) -> int:
        """Bytes held by the mesh and the tree."""
        return self._model.memory_bytes + self._mesh_bytes

    @property
    def _mesh_bytes(self) -> int:
        leaders = 0 if self._leaders is None else self._leaders.nbytes
        return self.mesh.vertices.nbytes + self.mesh.faces.nbytes + leaders

    @property
    def _model(self) -> Model:
        """The arrays, made now where they came out of a file, or where a scene has deformed them."""
        # Whoever else may be making them sets them before he lets go of what they are made of.
        source, remains = self._source, self._remains
        model = self._stage.current
        if model is None and source is not None:
            whole, row = source
            model = self._stage.current = whole.part_alone(row)
            self._source = None
        if model is None:
            assert remains is not None, "a solid has arrays, or what they are made of"
            model = self._stage.current = assemble([_made_anew(self.mesh, remains)], [Pose()])
        return model

    def _brought_up_to_date(self) -> Model:
        return self._model

    def _share(self, model: Model) -> None:
        """Take over equal arrays that lie in a scene's memory, and let the own ones go."""
        self._stage.current, self._source = model, None

    def _let_go(self, model: Model, row: int, frame: np.ndarray) -> None:
        """Look away from a row of a scene's *model* that has another shape now; *frame*: that row before."""
        part = model.parts[row]
        mine, at = (self._stage.current, 0) if self._source is None else self._source
        if mine is None or mine.reals is not model.reals or mine.parts[at, layout.ROOT] != part[layout.ROOT]:
            return
        faces, neighbors = (
            model.words[part[column] :][: 3 * part[layout.FACE_COUNT]].view(np.int32).reshape(-1, 3)
            for column in (layout.FACES, layout.NEIGHBORS)
        )
        self._remains = _Remains(
            LocalFrame.read(frame),
            int(part[layout.SIGN]),
            bool(part[layout.GRID] != NO_GRID),
            faces,
            neighbors,
            model.folded_faces(row),
        )
        self._stage.current, self._source = None, None

    def _deformed(self, vertices: np.ndarray, model: Model) -> "Solid":
        """The same faces over other vertices, checked already; *model* has their arrays."""
        solid = Solid.__new__(Solid)
        solid.mesh = self.mesh.with_vertices(vertices)
        solid.name, solid.sign_method = self.name, self.sign_method
        solid.sign_reason = self.sign_reason.removesuffix(DEFORMED) + DEFORMED
        solid._is_watertight, solid._leaders = self._is_watertight, self._leaders
        solid._stage, solid._source, solid._remains = Shelf(model), None, None
        return solid

    def __repr__(self) -> str:
        return f"Solid({self.name!r}, {self.mesh.face_count} faces, sign by {self.sign_method.value})"


def _made_anew(mesh: TriangleMesh, remains: _Remains) -> PartArrays:
    """The arrays of a solid that had been let go; its sign is told as before."""
    corners = np.empty((int(remains.faces.max()) + 1, 3))
    corners[remains.faces.ravel()] = mesh.vertices[mesh.faces.ravel()]
    faces, neighbors = remains.faces.copy(), remains.neighbors.copy()
    piece = part_arrays(corners, faces, neighbors, remains.frame)
    return with_folds(with_sign(piece, remains.sign, has_grid=remains.has_grid), remains.folded)
