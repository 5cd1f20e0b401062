"""Faces connected across edges.

Across an edge of two faces the connection is plain. At an edge of more, bodies touch: pieces that already
have as many faces running one way along it as the other are whole there and need nothing; what is left is
paired round the edge, each face with the one across its wedge of material. Bodies that touch and together
have a negative volume are inside out: their material is on the other side.
"""

from dataclasses import dataclass, replace

import numpy as np

from proximity.kernels.entries import connected
from proximity.mesh.cavities import enclosed_volumes
from proximity.mesh.topology import EdgeRuns, edge_runs

POSITION_ROUNDING = 2.0**-22
"""Positions in files are mostly float32: faces that lie on each other differ by some of its rounding.
Relative to the largest coordinate; seen from an edge it makes an angle that tells nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """K faces in P connected pieces."""

    labels: np.ndarray  # (K,) int, 0 .. P - 1
    is_turned: np.ndarray  # (K,) bool, runs against most faces of its piece
    has_open_edge: np.ndarray  # (K, 3) bool, edge k found no partner
    is_closed: np.ndarray  # (P,) bool, no open edge, and two sides

    def with_replaced(self, is_replaced: np.ndarray, others: "Pieces") -> "Pieces":
        """These pieces, but those of the faces *is_replaced* (whole pieces of them) as *others* have them."""
        labels = self.labels + len(others.is_closed)
        labels[is_replaced] = others.labels
        is_turned, has_open_edge = self.is_turned.copy(), self.has_open_edge.copy()
        is_turned[is_replaced], has_open_edge[is_replaced] = others.is_turned, others.has_open_edge
        is_closed = np.concatenate([others.is_closed, self.is_closed])
        in_use, labels = np.unique(labels, return_inverse=True)
        return Pieces(labels, is_turned, has_open_edge, is_closed[in_use])


def connect_faces(corners: np.ndarray, unit_positions: np.ndarray, edges: EdgeRuns | None = None) -> Pieces:
    """Return the pieces that (K, 3) *corners* make.

    *unit_positions* are those of the corners, scaled to coordinates of at most 1. No face may have two equal
    corners. *edges*: of the faces, if somebody has them.
    """
    if edges is None:
        edges = edge_runs(corners)
    is_pair = edges.counts == 2
    first = edges.starts[is_pair]
    one, other = edges.order[first] // 3, edges.order[first + 1] // 3
    labels, is_turned, is_twisted = _components(len(corners), one, other, edges.forward_counts[is_pair] != 1)

    is_open = np.zeros(corners.size, dtype=bool)
    is_open[edges.order[edges.starts[edges.counts == 1]]] = True
    if (edges.counts > 2).any():
        contested = _contested_half_edges(edges, labels, is_turned, is_twisted)
        wound = np.where(is_turned[:, None], corners[:, ::-1], corners)
        is_inside_out = _is_inside_out(edges, labels, unit_positions, wound)
        contested = replace(
            contested, is_forward=contested.is_forward ^ is_inside_out[contested.half_edges // 3]
        )
        one, other, is_crossed = _paired_around_edges(contested, corners, unit_positions)
        is_open[contested.half_edges] = True
        is_open[one] = is_open[other] = False
        piece_labels, is_piece_turned, is_joint_twisted = _components(
            len(is_twisted), labels[one // 3], labels[other // 3], is_crossed
        )
        is_joint_twisted[piece_labels[is_twisted]] = True
        labels, is_turned, is_twisted = (
            piece_labels[labels],
            is_turned ^ is_piece_turned[labels],
            is_joint_twisted,
        )
    is_turned = _minority(labels, is_turned) & ~is_twisted[labels]
    is_closed = ~is_twisted
    is_closed[labels[np.flatnonzero(is_open) // 3]] = False
    return Pieces(labels, is_turned, is_open.reshape(-1, 3), is_closed)


def join_open_pieces(corners: np.ndarray, labels: np.ndarray, is_open: np.ndarray) -> np.ndarray:
    """Return *labels* (K,) with those made one that share a corner of faces *is_open* (K,).

    Those are the faces that are part of no shell with a volume. Sides that were meshed without regard for
    each other fit nowhere and enclose something together; a sheet with two sides falls into flat pieces.
    """
    if not is_open.any():
        return labels
    label_count = int(labels.max()) + 1
    piece, corner = np.repeat(labels[is_open], 3), corners[is_open].ravel()
    joined = linked_components(label_count + int(corner.max()) + 1, piece, label_count + corner)
    together: np.ndarray = joined[labels]
    return together


def linked_components(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Labels (count,) of what the links *one* to *other* connect."""
    labels: np.ndarray = connected(
        count, np.ascontiguousarray(one, dtype=np.int64), np.ascontiguousarray(other, dtype=np.int64)
    )
    return labels


def _components(
    count: int, one: np.ndarray, other: np.ndarray, is_crossed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Connect nodes by links, of which the crossed ones say "runs the other way".

    Returns labels (count,), whether a node runs against the reference of its component (count,), and for
    each component whether it is twisted: has no two sides, as a Moebius strip.
    """
    if not is_crossed.any():
        labels = linked_components(count, one, other)
        return labels, np.zeros(count, dtype=bool), np.zeros(labels.max() + 1, dtype=bool)
    # Each node twice, as it is and turned: a crossed link joins the one to the other's turned twin.
    far, far_turned = other + count * is_crossed, other + count * ~is_crossed
    both = linked_components(2 * count, np.concatenate([one, one + count]), np.concatenate([far, far_turned]))
    as_is, turned = both[:count], both[count:]
    labels = np.unique(np.minimum(as_is, turned), return_inverse=True)[1]
    is_twisted = np.zeros(labels.max() + 1, dtype=bool)
    is_twisted[labels[as_is == turned]] = True
    return labels, as_is > turned, is_twisted


def _minority(labels: np.ndarray, is_turned: np.ndarray) -> np.ndarray:
    """*is_turned*, or its opposite in each piece where most faces are turned."""
    if not is_turned.any():
        return is_turned
    is_mostly_turned = 2 * np.bincount(labels, weights=is_turned) > np.bincount(labels)
    return is_turned ^ is_mostly_turned[labels]


@dataclass(frozen=True, slots=True, eq=False)
class _Contested:
    """Half-edges, sorted by edge, that need a partner at an edge of more than two faces."""

    half_edges: np.ndarray  # (M,)
    edge: np.ndarray  # (M,) rising
    is_forward: np.ndarray  # (M,) after turning


def _contested_half_edges(
    edges: EdgeRuns, labels: np.ndarray, is_turned: np.ndarray, is_twisted: np.ndarray
) -> _Contested:
    is_many = np.repeat(edges.counts > 2, edges.counts)
    half_edges = edges.order[is_many]
    edge = np.repeat(np.arange(len(edges.counts)), edges.counts)[is_many]
    piece = labels[half_edges // 3]
    is_forward = edges.is_forward[is_many] ^ is_turned[half_edges // 3]
    # A piece is whole at an edge that it runs along as often one way as the other.
    meeting = np.unique(edge * len(is_twisted) + piece, return_inverse=True)[1]
    balance = np.bincount(meeting, weights=np.where(is_forward, 1.0, -1.0))
    is_even = np.bincount(meeting) % 2 == 0
    is_whole = np.where(is_twisted[piece], is_even[meeting], balance[meeting] == 0)
    return _Contested(half_edges[~is_whole], edge[~is_whole], is_forward[~is_whole])


def _is_inside_out(
    edges: EdgeRuns, labels: np.ndarray, unit_positions: np.ndarray, corners: np.ndarray
) -> np.ndarray:
    """Whether each of the (K, 3) *corners* is of bodies that touch, of negative volume together."""
    is_many = edges.counts > 2
    counts = edges.counts[is_many]
    piece = labels[edges.order[np.repeat(is_many, edges.counts)] // 3]
    first = np.repeat(labels[edges.order[edges.starts[is_many]] // 3], counts)
    touching = linked_components(int(labels.max()) + 1, first, piece)[labels]
    is_inside_out: np.ndarray = enclosed_volumes(unit_positions, corners, touching)[touching] < 0
    return is_inside_out


def _paired_around_edges(
    contested: _Contested, corners: np.ndarray, unit_positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of half-edges, each across one wedge of material, and whether the two run the same way."""
    edge = np.unique(contested.edge, return_inverse=True)[1]
    total = np.bincount(edge)
    forward_total = np.bincount(edge, weights=contested.is_forward)

    # Two are left: they can only belong together, even if one is turned.
    is_couple = ((total == 2) & (forward_total != 1))[edge]
    couples = contested.half_edges[is_couple].reshape(-1, 2)

    is_even = (2 * forward_total == total)[edge]
    half_edges, is_forward = contested.half_edges[is_even], contested.is_forward[is_even]
    edge = np.unique(edge[is_even], return_inverse=True)[1]
    order = _order_around_edges(half_edges, edge, is_forward, corners, unit_positions)
    entering, leaving = _matched_wedges(edge, is_forward[order])
    one = np.concatenate([couples[:, 0], half_edges[order[entering]]])
    other = np.concatenate([couples[:, 1], half_edges[order[leaving]]])
    return one, other, np.arange(len(one)) < len(couples)


def _order_around_edges(
    half_edges: np.ndarray,
    edge: np.ndarray,
    is_forward: np.ndarray,
    corners: np.ndarray,
    unit_positions: np.ndarray,
) -> np.ndarray:
    """Sort half-edges by edge and then by angle about it, counter-clockwise along its lower to higher corner.

    Seen so, a forward face has its material before it and a backward face behind it. Of faces at one angle
    the forward ones come first: the material of the one ends where that of the other begins.
    """
    if len(half_edges) == 0:
        return half_edges
    starts = np.flatnonzero(np.concatenate(([True], edge[1:] != edge[:-1])))
    angle, noise = _angles(half_edges, starts[edge], corners, unit_positions)
    order = np.lexsort((angle, edge))
    # Cut each circle open where it is widest, so that no cluster of equal angles is cut.
    angle, noise = angle[order], np.maximum.reduceat(noise, starts)[edge]
    ends = np.append(starts[1:], len(edge)) - 1
    gap = np.diff(angle, prepend=0.0)
    gap[starts] = angle[starts] + 2 * np.pi - angle[ends]
    is_widest = gap == np.maximum.reduceat(gap, starts)[edge]
    first = np.maximum.reduceat(np.where(is_widest, np.arange(len(edge)), 0), starts)
    rank = (np.arange(len(edge)) - first[edge]) % (ends - starts + 1)[edge]
    order, gap = order[np.lexsort((rank, edge))], gap[np.lexsort((rank, edge))]
    cluster = np.cumsum(gap > noise)
    # Bodies that overlap with their sides in one plane leave it open which face is whose. Files list a body's
    # faces together: nesting those of one end in the file is the best guess.
    nested = np.where(is_forward[order], -half_edges[order], half_edges[order])
    return order[np.lexsort((nested, ~is_forward[order], cluster, edge))]


def _angles(
    half_edges: np.ndarray, reference: np.ndarray, corners: np.ndarray, unit_positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angle of each face about its edge, from the face of half-edge *reference*, and its rounding."""
    face, k = np.divmod(half_edges, 3)
    start, end = corners[face, k], corners[face, (k + 1) % 3]
    foot = unit_positions[np.minimum(start, end)]
    axis = _unit(unit_positions[np.maximum(start, end)] - foot)
    arm = unit_positions[corners[face, (k + 2) % 3]] - foot
    arm -= _dot(arm, axis)[:, None] * axis
    height = np.sqrt(_dot(arm, arm))
    base = arm[reference]
    angle = np.arctan2(_dot(np.cross(base, arm), axis), _dot(base, arm)) % (2 * np.pi)
    return angle, POSITION_ROUNDING / np.maximum(height, POSITION_ROUNDING)


def _matched_wedges(edge: np.ndarray, is_forward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Match faces round each edge as brackets: material begins at a backward face, ends at a forward one.

    Every edge has as many of the one as of the other. Returns positions of backward and of forward faces.
    """
    if len(edge) == 0:
        return edge, edge
    level = np.cumsum(np.where(is_forward, -1, 1))
    depth = level + is_forward  # of the wedge that begins or ends here; levels end at 0 at each edge
    order = np.lexsort((depth, edge))
    starts = np.flatnonzero(
        np.concatenate(
            ([True], (edge[order][1:] != edge[order][:-1]) | (depth[order][1:] != depth[order][:-1]))
        )
    )
    counts = np.diff(starts, append=len(order))
    # Within one depth the two kinds alternate; each backward face takes the next, the last one the first.
    group = np.repeat(np.arange(len(starts)), counts)
    following = (np.arange(len(order)) - starts[group] + 1) % counts[group] + starts[group]
    is_backward = ~is_forward[order]
    return order[is_backward], order[following[is_backward]]


def _dot(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    products: np.ndarray = np.einsum("ij,ij->i", one, other)
    return products


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.sqrt(_dot(vectors, vectors))
    unit: np.ndarray = vectors / np.where(lengths > 0, lengths, 1.0)[:, None]
    return unit
