"""Models of plain meshes in the form that kernels use."""

import numpy as np
from part_arrays import part_arrays

from proximity.kernels.layout import ModelArrays
from proximity.mesh.bvh import LocalFrame, common_frame
from proximity.mesh.topology import build_topology, corners_of
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import assemble
from proximity.scene.solid_arrays import part_model


def arrays_of(model):
    """The arrays of a model, as passed between kernels."""
    return ModelArrays(model.reals, model.words, model.frames, model.parts)


def model_of_one(mesh, frame: LocalFrame | None = None):
    """A one-part model with the faces unchanged: no welding, removal or reorientation."""
    faces = np.ascontiguousarray(mesh[1], dtype=np.int32)
    vertices = np.ascontiguousarray(mesh[0], dtype=np.float64)
    return part_model(vertices, faces, np.full_like(faces, -1), frame)


def piece_of(mesh, frame: LocalFrame | None = None):
    """The arrays of the part of `model_of_one`."""
    return part_arrays(model_of_one(mesh, frame), 0)


def welded_model_of(vertices, faces):
    """A one-part model with welded corners and face adjacency."""
    mesh = TriangleMesh(vertices, faces)
    topology = build_topology(mesh)
    return part_model(corners_of(mesh, topology), topology.corner_ids, topology.neighbors)


def folded_faces_of(solid):
    """Faces of a solid near which the winding number decides the sign, in order."""
    piece = part_arrays(solid.snapshot(), 0)
    bits = np.unpackbits(piece.folded[:, None], axis=1, bitorder="little")
    return np.sort(piece.bvh.slot_faces.reshape(-1, 8)[bits == 1])


def model_of(*meshes, poses=None, frame=None, is_fused=False):
    """A model of meshes at poses, by default the identity.

    *is_fused*: use a common frame, so that they are traversed as one tree.
    """
    if is_fused:
        vertices = np.concatenate([vertices for vertices, _ in meshes])
        frame = common_frame(vertices.min(axis=0), vertices.max(axis=0))
    model = assemble([model_of_one(mesh, frame) for mesh in meshes], poses or [Pose()] * len(meshes))
    assert not is_fused or (model.parts["is_fused"][:-1] == 1).all()
    return model
