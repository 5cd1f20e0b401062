"""Splitting of faces into bodies: the order of the steps, and what was repaired."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from proximity.errors import MeshError
from proximity.mesh.cavities import enclosed_volumes, nest_shells
from proximity.mesh.connected_faces import Pieces, connect_faces, join_open_pieces
from proximity.mesh.degenerate_faces import find_useless_faces
from proximity.mesh.topology import EdgeRuns, Topology, merged_positions, topology_of
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.mesh.vertex_weld import weld_near


@dataclass(frozen=True, slots=True)
class Repairs:
    """Changes that made one body of the faces given."""

    merged_vertex_count: int = 0  # vertices fewer because equal positions share one
    welded_vertex_count: int = 0  # vertices fewer because near ones were pulled together to close the body
    weld_distance: float = 0.0  # m, how far the farthest of them moved
    dropped_sliver_count: int = 0  # faces without area
    dropped_duplicate_count: int = 0  # faces that another one equals
    turned_face_count: int = 0  # faces turned so that all run one way
    is_turned_inside_out: bool = False  # every face turned, as the body had a negative volume

    def describe(self) -> str:
        """Return what was done as one sentence for people; empty if nothing was."""
        deeds = []
        if self.merged_vertex_count:
            deeds.append(f"merged {_counted(self.merged_vertex_count, 'equal vertex', 'equal vertices')}")
        if self.welded_vertex_count:
            what = _counted(self.welded_vertex_count, "near vertex", "near vertices")
            deeds.append(f"welded {what} at most {self.weld_distance:.2g} m apart to close the body")
        if self.dropped_sliver_count:
            what = _counted(self.dropped_sliver_count, "face without area", "faces without area")
            deeds.append(f"dropped {what}")
        if self.dropped_duplicate_count:
            what = _counted(self.dropped_duplicate_count, "duplicate face", "duplicate faces")
            deeds.append(f"dropped {what}")
        if self.turned_face_count:
            what = _counted(self.turned_face_count, "face", "faces")
            deeds.append(f"turned {what} to match the orientation of the others")
        if self.is_turned_inside_out:
            deeds.append("flipped the body, which was inside out")
        sentence = ", ".join(deeds)
        return sentence and sentence[0].upper() + sentence[1:] + "."


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One body: its own mesh, and where the faces come from."""

    mesh: TriangleMesh  # only the vertices in use, one a position
    source_faces: np.ndarray  # (F,) int32, what each face is called where it comes from, read-only
    repairs: Repairs
    topology: Topology | None = None  # of the mesh, where splitting has found it


def split_bodies(vertices: Any, faces: Any, source_faces: Any = None) -> list[Body]:
    """Return the bodies that the faces make up, welded, cleaned and turned outside out.

    *vertices*: (V, 3) m; *faces*: (F, 3). *source_faces*: what each face is called where it comes from; by
    default its row. Returned: in the order of their first faces; within a body, faces keep the order given.

    Notes
    -----
    Faces are connected across edges. Where more than two meet, those of bodies that merely touch come
    apart: each wedge of material is one body's. Closed surfaces that vertex numbers keep apart stay apart,
    and so do closed surfaces that share only corners. Open or flat pieces that share a corner are one body:
    sides that were meshed without regard for each other enclose something only together.
    A surface of negative volume within a body is a cavity of it; elsewhere it is turned inside out. Surfaces
    with small holes count as closed ones there, sheets do not.
    Degenerate: a face without area is kept where dropping it would open the surface.
    Cost: 0.3 to 0.5 s for 300 k faces.
    """
    mesh = TriangleMesh(vertices, faces)
    names = _checked_source_faces(source_faces, mesh.face_count)
    stock = _Stock(mesh)
    stock.drop_useless_faces()
    pieces = stock.connected()
    if not pieces.is_closed.all():
        stock.weld(pieces)
        pieces = stock.connected()
    stock.is_turned[stock.rows] = pieces.is_turned
    positions, corners, labels = stock.unit_positions, stock.wound(stock.rows), pieces.labels
    volumes = enclosed_volumes(positions, corners, labels)
    is_closed = pieces.is_closed & (volumes != 0)
    if not is_closed.all():
        joined = join_open_pieces(stock.left(stock.corners), labels, ~is_closed[labels])
        first, shells = np.unique(joined, return_index=True, return_inverse=True)[1:]
        is_closed, labels = is_closed[labels[first]], shells
        volumes = enclosed_volumes(positions, corners, labels)
    body_of_shell, is_inside_out = nest_shells(positions, corners, labels, volumes, is_closed)
    stock.is_inside_out[stock.rows] = is_inside_out[labels]
    return _made_bodies(stock, _ranked_by_first(body_of_shell, labels), names)


def _checked_source_faces(source_faces: Any, face_count: int) -> np.ndarray:
    if source_faces is None:
        return np.arange(face_count, dtype=np.int32)
    array = np.asarray(source_faces)
    if array.shape != (face_count,) or array.dtype.kind not in "iu":
        raise MeshError(
            f"source_faces have shape {array.shape} and dtype {array.dtype}, "
            f"expected integers of shape ({face_count},)"
        )
    return array.astype(np.int32)


class _Stock:
    """The faces given, and what the steps so far have made of them."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        self.merged, positions = merged_positions(mesh.vertices, mesh.faces)
        self.corners = self.merged  # (F, 3) rows of positions, after welding
        self.positions = positions + 0.0  # nowhere -0.0
        # Scaled by a power of two, exactly: products of three coordinates stay far from over- and underflow.
        self.exponent = -int(np.frexp(np.abs(self.positions).max())[1])
        self.unit_positions = np.ldexp(self.positions, self.exponent)
        self.is_sliver = np.zeros(mesh.face_count, dtype=bool)
        self.is_duplicate = np.zeros(mesh.face_count, dtype=bool)
        self.is_turned = np.zeros(mesh.face_count, dtype=bool)  # to match the orientation of the others
        self.is_inside_out = np.zeros(mesh.face_count, dtype=bool)  # turned (once more) with all others
        self.rows = np.arange(mesh.face_count)  # faces that are left
        self.edges: EdgeRuns | None = None  # of all faces, where all are left as they were given

    def drop_useless_faces(self) -> None:
        self.is_sliver, self.is_duplicate, self.edges = find_useless_faces(self.corners, self.unit_positions)
        self.rows = np.flatnonzero(~(self.is_sliver | self.is_duplicate))
        if len(self.rows) == 0:
            raise MeshError(
                f"none of the {self.mesh.face_count} faces has an area, expected at least one that has"
            )

    def left(self, rows: np.ndarray) -> np.ndarray:
        """Those of (F, ...) *rows* whose faces are left."""
        return rows if len(self.rows) == len(rows) else rows[self.rows]

    def connected(self) -> Pieces:
        """The pieces: closed ones that vertex numbers show, and of the others what positions show."""
        given, corners = self.left(self.mesh.faces), self.left(self.corners)
        vertex_count = _distinct_count(given)
        if given is corners or vertex_count in (_distinct_count(corners), 3 * len(given)):
            return connect_faces(corners, self.unit_positions, self.edges)
        numbered = connect_faces(given, np.ldexp(self.mesh.vertices, self.exponent))
        is_certain = numbered.is_closed[numbered.labels]
        if is_certain.all():
            return numbered
        left = connect_faces(corners[~is_certain], self.unit_positions)
        return numbered.with_replaced(~is_certain, left)

    def weld(self, pieces: Pieces) -> None:
        welded, is_collapsed = weld_near(self.corners[self.rows], self.unit_positions, pieces)
        self.corners, self.edges = self.corners.copy(), None
        self.corners[self.rows] = welded
        self.is_sliver[self.rows[is_collapsed]] = True
        self.rows = self.rows[~is_collapsed]

    def wound(self, rows: np.ndarray) -> np.ndarray:
        """Corners of faces, turned as decided: (K, 3); not to be written to."""
        is_turned = (self.is_turned ^ self.is_inside_out)[rows]
        if len(rows) == len(self.corners) and not is_turned.any():  # all rows, in order
            return self.corners
        corners = self.corners[rows]
        corners[is_turned] = corners[is_turned][:, [0, 2, 1]]
        return corners

    def repairs(self, rows: np.ndarray) -> Repairs:
        """Changes to the faces *rows* of one body, apart from the faces that it lost."""
        tables = self.mesh.faces, self.merged, self.corners  # mostly one and the same
        counts = {id(ids): _distinct_count(ids[rows]) for ids in {id(ids): ids for ids in tables}.values()}
        given_count, merged_count, corner_count = (counts[id(ids)] for ids in tables)
        return Repairs(
            merged_vertex_count=given_count - merged_count,
            welded_vertex_count=merged_count - corner_count,
            weld_distance=self._farthest_move(rows),
            turned_face_count=int(self.is_turned[rows].sum()),
            is_turned_inside_out=bool(self.is_inside_out[rows].any()),
        )

    def _farthest_move(self, rows: np.ndarray) -> float:
        """Largest distance that welding moved a corner of the faces *rows*, m."""
        if self.corners is self.merged:
            return 0.0
        before, after = self.merged[rows], self.corners[rows]
        is_moved = before != after
        moves = self.unit_positions[after[is_moved]] - self.unit_positions[before[is_moved]]
        return float(np.ldexp(np.linalg.norm(moves, axis=1).max(initial=0.0), -self.exponent))


def _ranked_by_first(body_of_shell: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """The bodies of faces by their shells, numbered in the order in which they come."""
    if len(body_of_shell) == 1:
        return np.zeros(len(labels), dtype=np.int64)
    first, inverse = np.unique(body_of_shell[labels], return_index=True, return_inverse=True)[1:]
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    ranked: np.ndarray = rank[inverse]
    return ranked


def _made_bodies(stock: _Stock, labels: np.ndarray, names: np.ndarray) -> list[Body]:
    """The bodies that *labels* of the faces left say."""
    sliver_counts = _lost_counts(stock, labels, stock.is_sliver)
    duplicate_counts = _lost_counts(stock, labels, stock.is_duplicate)
    bodies: list[Body] = []
    for rows in _rows_of_bodies(stock.rows, labels):
        mesh, topology = _mesh_of_body(stock, rows)
        source_faces = names[rows]
        source_faces.flags.writeable = False
        repairs = replace(
            stock.repairs(rows),
            dropped_sliver_count=int(sliver_counts[len(bodies)]),
            dropped_duplicate_count=int(duplicate_counts[len(bodies)]),
        )
        bodies.append(Body(mesh, source_faces, repairs, topology))
    return bodies


def _rows_of_bodies(rows: np.ndarray, labels: np.ndarray) -> list[np.ndarray]:
    """Those of the *rows* that have each of the labels, in order."""
    counts = np.bincount(labels)
    if len(counts) == 1:
        return [rows]
    return np.split(rows[np.argsort(labels, kind="stable")], np.cumsum(counts)[:-1])


def _mesh_of_body(stock: _Stock, rows: np.ndarray) -> tuple[TriangleMesh, Topology | None]:
    """The mesh of the faces *rows*, and how they meet, if that is known already."""
    corners = stock.wound(rows)
    used, faces = _renumbered(corners)
    mesh = TriangleMesh.of_own(stock.positions[used], np.ascontiguousarray(faces, dtype=np.int32))
    edges = stock.edges if corners is stock.corners else None
    return mesh, None if edges is None else topology_of(mesh.faces, edges)


def _lost_counts(stock: _Stock, labels: np.ndarray, is_lost: np.ndarray) -> np.ndarray:
    """Number of lost faces of each body: a face counts for the body with most of its corners."""
    body_count = int(labels.max()) + 1
    if not is_lost.any():
        return np.zeros(body_count, np.int64)
    corner = stock.corners[is_lost].ravel().astype(np.int64)
    held = np.unique(stock.corners[stock.rows] * np.int64(body_count) + labels[:, None])  # corner, body
    start, end = np.searchsorted(held, (corner * body_count, (corner + 1) * body_count))
    counts = end - start
    position = np.arange(counts.sum()) + np.repeat(start - (np.cumsum(counts) - counts), counts)
    face = np.repeat(np.arange(len(corner)) // 3, counts)
    pair, shared_count = np.unique(face * body_count + held[position] % body_count, return_counts=True)
    face, body = np.divmod(pair, body_count)
    order = np.lexsort((body, -shared_count, face))
    found, best = np.unique(face[order], return_index=True)
    owner = np.zeros(len(corner) // 3, dtype=np.int64)
    owner[found] = body[order[best]]
    return np.bincount(owner, minlength=body_count)


def _distinct_count(ids: np.ndarray) -> int:
    return int(_is_in_use(ids).sum()) if _is_dense(ids) else len(np.unique(ids))


def _renumbered(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct *ids*, rising, and the position of each of *ids* among them."""
    if not _is_dense(ids):
        used, inverse = np.unique(ids, return_inverse=True)
        return used, inverse.reshape(ids.shape)
    is_used, lowest = _is_in_use(ids), ids.min()
    if is_used.all():
        return np.arange(lowest, lowest + len(is_used)), ids - lowest if lowest else ids
    return np.flatnonzero(is_used) + lowest, (np.cumsum(is_used, dtype=np.int32) - np.int32(1))[ids - lowest]


def _is_dense(ids: np.ndarray) -> bool:
    """Whether a table over the range of *ids* is cheaper than sorting them."""
    return int(ids.max()) - int(ids.min()) < 8 * ids.size


def _is_in_use(ids: np.ndarray) -> np.ndarray:
    lowest = ids.min()
    is_used = np.zeros(int(ids.max()) - int(lowest) + 1, dtype=bool)
    is_used[(ids - lowest if lowest else ids).ravel()] = True
    return is_used


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
