"""One body: its faces, how they hang together, its tree, and how inside is told."""

from functools import cached_property
from typing import Any

import numpy as np

from proximity.bvh import Bvh, LocalFrame
from proximity.diagnosis import Diagnosis, diagnose
from proximity.kernels import layout
from proximity.mesh import TriangleMesh
from proximity.model import Model, assemble
from proximity.part_arrays import part_arrays
from proximity.pose import Pose
from proximity.queries import Queries
from proximity.sign import SignMethod, choose_sign
from proximity.topology import Topology, build_topology


class Solid(Queries):
    """One body from arrays, ready to be asked; it never changes.

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
    Cost: about 0.6 s and 250 bytes a face for 300 k faces.
    """

    mesh: TriangleMesh
    name: str
    sign_method: SignMethod
    sign_reason: str
    _source: tuple[Model, int]  # only of `_from_model`: whose part it is, and which

    def __init__(
        self, vertices: Any, faces: Any, *, name: str = "solid", frame: LocalFrame | None = None
    ) -> None:
        mesh = TriangleMesh(vertices, faces)
        topology = build_topology(mesh)
        is_turned = topology.is_balanced and _volume(mesh) < 0.0
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
        self._model = assemble([piece], [Pose()])
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
        solid._source = (model, row)
        return solid

    @cached_property
    def _model(self) -> Model:
        """Of this body alone; made when first asked for where it came out of a file, with many others."""
        model, row = self._source
        return model.part_alone(row)

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
        return self._model.memory_bytes + self.mesh.vertices.nbytes + self.mesh.faces.nbytes

    def _current(self) -> Model:
        return self._model

    def _share(self, model: Model) -> None:
        """Take over equal arrays that lie in a scene's memory, and let the own ones go."""
        self._model = model

    def __repr__(self) -> str:
        return f"Solid({self.name!r}, {self.mesh.face_count} faces, sign by {self.sign_method.value})"


def _volume(mesh: TriangleMesh) -> float:
    """Enclosed volume, m³, from the divergence theorem about the middle of the box."""
    used = mesh.vertices[mesh.faces]
    middle = 0.5 * used.min(axis=(0, 1)) + 0.5 * used.max(axis=(0, 1))
    size = float(np.abs(used - middle).max()) or 1.0
    a, b, c = np.moveaxis((used - middle) / size, 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())
