"""Models of plain meshes, as kernels take them."""

import numpy as np

from proximity.kernels.layout import ModelArrays
from proximity.mesh.bvh import LocalFrame
from proximity.mesh.part_arrays import common_frame, part_arrays
from proximity.mesh.topology import build_topology
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import assemble, model_of_piece


def arrays_of(model):
    """The arrays of a model, as kernels pass them on."""
    return ModelArrays(model.reals, model.words, model.frames, model.parts)


def piece_of(mesh, frame: LocalFrame | None = None):
    """The arrays of one part, its faces as they are: nothing is welded, dropped or turned."""
    faces = np.ascontiguousarray(mesh[1], dtype=np.int32)
    return part_arrays(np.asarray(mesh[0], dtype=np.float64), faces, np.full_like(faces, -1), frame)


def welded_piece_of(vertices, faces):
    """The arrays of one part whose corners at one place are one, and whose faces know their neighbours."""
    topology = build_topology(TriangleMesh(vertices, faces))
    corners = np.empty((int(topology.corner_ids.max()) + 1, 3))
    corners[topology.corner_ids.ravel()] = vertices[faces.ravel()]
    return part_arrays(corners, topology.corner_ids, topology.neighbors)


def welded_model_of(vertices, faces):
    """The model of one such part, as it lies."""
    return model_of_piece(welded_piece_of(vertices, faces))


def folded_faces_of(solid):
    """The faces of a solid near which the winding number decides, in order."""
    piece = solid.snapshot().part_arrays(0)
    bits = np.unpackbits(piece.folded[:, None], axis=1, bitorder="little")
    return np.sort(piece.bvh.slot_faces.reshape(-1, 8)[bits == 1])


def model_of(*meshes, poses=None, frame=None, is_fused=False):
    """The model of meshes at poses, as they lie where none are given.

    *is_fused*: in one frame, so that they are walked as one tree.
    """
    if is_fused:
        vertices = np.concatenate([vertices for vertices, _ in meshes])
        frame = common_frame(vertices.min(axis=0), vertices.max(axis=0))
    model = assemble([model_of_piece(piece_of(mesh, frame)) for mesh in meshes], poses or [Pose()] * len(meshes))
    assert not is_fused or (model.parts["is_fused"][:-1] == 1).all()
    return model
