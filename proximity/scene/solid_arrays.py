"""The arrays of a solid. A scene that has them may deform them, while the solid stays unchanged."""

import numpy as np

from proximity.kernels.entries import fill_part, plan_part, restore_sign
from proximity.kernels.layout import FRAME, NO_GRID, PART
from proximity.mesh.bvh import LocalFrame, local_frame
from proximity.mesh.part_memory import aligned_empty
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import Model, assemble, finished


def part_model(
    corners: np.ndarray, faces: np.ndarray, neighbors: np.ndarray, frame: LocalFrame | None = None
) -> Model:
    """Return a model of one part that has no sign yet.

    *corners*: (K, 3) m; *faces*: (F, 3), rows of *corners*; *neighbors*: (F, 3). *frame*: a frame to share
    with other parts. The part gets its own frame if none is given, or if the part is small in the given one.
    """
    shared = np.zeros(4) if frame is None else np.append(frame.centre, frame.scale)
    frames, parts = np.zeros(2, FRAME), np.zeros(2, PART)
    *tree, real_count, word_count = plan_part(corners, faces, shared, frames, parts)
    if not real_count:
        local_frame(corners.min(axis=0), corners.max(axis=0))  # raises
    reals, words = aligned_empty(real_count, np.float64), aligned_empty(word_count, np.float32)
    model = finished(reals, words, frames, parts)
    fill_part(model.packed, *tree, corners, faces, neighbors)
    return model


class SolidArrays:
    """The arrays of a solid, either in separate memory or in the memory of a scene."""

    __slots__ = ("is_overwritten", "model", "row")
    model: Model
    row: int  # of the part in the scene's memory
    is_overwritten: bool  # the scene has given the part another shape: call `rebuilt`

    def __init__(self, model: Model) -> None:
        self.model, self.row, self.is_overwritten = model, 0, False

    @classmethod
    def of_part(cls, scene: Model, row: int) -> "SolidArrays":
        """Return the arrays of a part in a scene's memory."""
        arrays = cls(scene.part_alone(row))
        arrays.row = row
        return arrays

    def move_to(self, scene: Model, row: int) -> None:
        """Replace the arrays by equal ones in the memory of a scene."""
        self.model, self.row, self.is_overwritten = scene.part_alone(row), row, False

    def leave_scene(self, mesh: TriangleMesh) -> None:
        """Replace the arrays by a copy, so that they do not keep the memory of the scene alive."""
        self.model = assemble([self.rebuilt(mesh) if self.is_overwritten else self.model], [Pose()])

    def rebuilt(self, mesh: TriangleMesh) -> Model:
        """Rebuild the arrays, which the scene has overwritten with another shape, and return them."""
        model = self.model
        part = model.parts[0]
        # Faces, neighbours and folded faces are the same for every shape of the part.
        faces, neighbors = (
            model.words[part[column] :][: 3 * part["face_count"]].view(np.int32).reshape(-1, 3).copy()
            for column in ("faces", "neighbors")
        )
        corners = np.empty((int(faces.max()) + 1, 3))
        corners[faces.ravel()] = mesh.vertices[mesh.faces.ravel()]
        rebuilt = part_model(corners, faces, neighbors, LocalFrame.read(model.frames[0]))
        restore_sign(rebuilt.packed, int(part["sign"]), part["grid"] != NO_GRID, model.folded_faces(0))
        # In this order: another thread must not take the old arrays for valid ones.
        self.model = rebuilt
        self.is_overwritten = False
        return self.model
