"""The arrays of a solid, which a scene may hold and deform while the solid never changes."""

import numpy as np

from proximity.kernels.layout import NO_GRID
from proximity.mesh.bvh import LocalFrame
from proximity.mesh.part_arrays import part_arrays, with_folded_faces, with_sign
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import Model, assemble, model_of_piece


class SolidArrays:
    """The arrays of a solid: in memory of its own, or in that of a scene."""

    __slots__ = ("is_overwritten", "model", "row")
    model: Model
    row: int  # of the part in the scene's memory
    is_overwritten: bool  # the scene has given the part another shape: `rebuilt` is to be asked

    def __init__(self, model: Model) -> None:
        self.model, self.row, self.is_overwritten = model, 0, False

    @classmethod
    def of_part(cls, scene: Model, row: int) -> "SolidArrays":
        """Return those of a part in a scene's memory."""
        arrays = cls(scene.part_alone(row))
        arrays.row = row
        return arrays

    def move_to(self, scene: Model, row: int) -> None:
        """Look at equal arrays of a part in a scene's memory from now on, and let those before go."""
        self.model, self.row, self.is_overwritten = scene.part_alone(row), row, False

    def leave_scene(self, mesh: TriangleMesh) -> None:
        """Look at a copy, which does not hold on to the memory of the scene."""
        self.model = assemble([self.rebuilt(mesh) if self.is_overwritten else self.model], [Pose()])

    def rebuilt(self, mesh: TriangleMesh) -> Model:
        """Return the arrays made anew, after the scene has written another shape over them."""
        model = self.model
        part = model.parts[0]
        # Faces, neighbours and folded faces stay where they are, whatever shape the scene gives the part.
        faces, neighbors = (
            model.words[part[column] :][: 3 * part["face_count"]].view(np.int32).reshape(-1, 3).copy()
            for column in ("faces", "neighbors")
        )
        corners = np.empty((int(faces.max()) + 1, 3))
        corners[faces.ravel()] = mesh.vertices[mesh.faces.ravel()]
        piece = part_arrays(corners, faces, neighbors, LocalFrame.read(model.frames[0]))
        piece = with_sign(piece, int(part["sign"]), has_grid=bool(part["grid"] != NO_GRID))
        # In this order: another thread may look, and must not find the old arrays to be right.
        self.model = model_of_piece(with_folded_faces(piece, model.folded_faces(0)))
        self.is_overwritten = False
        return self.model
