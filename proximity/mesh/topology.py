"""Edges of a mesh and the faces that meet there, from positions alone.

Corners at exactly equal positions count as one corner, whatever numbers the vertices have; near ones do
not (pulling those together is the work of `body_split`, where it is reported). Nothing here changes a mesh.
See `kernels.mesh.edges`.
"""

from dataclasses import dataclass

import numpy as np

from proximity.kernels.entries import face_topology, merged_faces, open_edge_middles
from proximity.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, slots=True, eq=False)
class Topology:
    """Connections between the faces of a mesh; the arrays are read-only."""

    corner_ids: np.ndarray  # (F, 3) int32, 0 .. corner_count - 1, one number a position
    neighbors: np.ndarray  # (F, 3) int32, face across edge k, or as `kernels.mesh.edges` says
    edge_count: int  # pairs of corners that at least one face runs along
    boundary_edge_count: int  # edges of one face, or between equal corners
    nonmanifold_edge_count: int  # edges of more than two faces
    misoriented_edge_count: int  # edges of two faces that run along it the same way
    is_watertight: bool  # every edge has exactly two faces, running opposite ways
    is_balanced: bool  # every edge is run as often one way as the other: the winding number is whole


def build_topology(mesh: TriangleMesh) -> Topology:
    """Return how the faces of *mesh* meet.

    Notes
    -----
    Degenerate: a face with two equal corners makes the mesh not watertight, but leaves it balanced.
    Cost: O(V log V + F); 0.1 s for 300 k faces.
    """
    return topology_of(merged_faces(mesh.vertices, mesh.faces)[0])


def topology_of(corner_ids: np.ndarray) -> Topology:
    """Return how faces meet, whose corners are numbered by position.

    *corner_ids*: (F, 3) int32, C-ordered.
    """
    neighbors, counts = face_topology(corner_ids)
    corner_ids.flags.writeable = neighbors.flags.writeable = False
    edges, boundary, nonmanifold, misoriented, unbalanced = counts.tolist()
    return Topology(
        corner_ids=corner_ids,
        neighbors=neighbors,
        edge_count=edges,
        boundary_edge_count=boundary,
        nonmanifold_edge_count=nonmanifold,
        misoriented_edge_count=misoriented,
        is_watertight=boundary + nonmanifold + misoriented == 0,
        is_balanced=unbalanced == 0,
    )


def corners_of(mesh: TriangleMesh, topology: Topology) -> np.ndarray:
    """Return the positions that faces of a mesh have, one row each, (K, 3) float64."""
    count = int(topology.corner_ids.max()) + 1
    if count == mesh.vertex_count:  # each vertex is in use, and has a position of its own
        return mesh.vertices
    corners = np.empty((count, 3))
    corners[topology.corner_ids.ravel()] = mesh.vertices[mesh.faces.ravel()]
    return corners


def open_edges(mesh: TriangleMesh) -> np.ndarray:
    """Return the middles of the edges of a body that are not closed, (E, 3) float64, m.

    Notes
    -----
    Vertices that a weld may pull together count as one: where it did not close the body, the seams that it
    would have closed are not what is open. At a closed edge as many faces run one way as the other.
    """
    middles: np.ndarray = open_edge_middles(mesh.vertices, mesh.faces)
    return middles
