"""The arrays of one part, in its local frame and numbered from zero."""

from dataclasses import dataclass, field, replace

import numpy as np

from proximity.kernels import layout
from proximity.kernels.entries import (
    add_corner_normals,
    build_grid,
    fill_blocks,
    fill_moments,
    fill_oriented_boxes,
    fill_slabs,
    folded_faces,
    passing_faces,
    thin_faces,
)
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    CELLS_PER_WORD,
    LANES,
    MOMENT_STRIDE,
    NODE_STRIDE,
    ORIENTED_STRIDE,
)
from proximity.kernels.thresholds import CONTACT_DEPTH, MOVING_MARGIN, OBLIQUE
from proximity.mesh.bvh import Bvh, LocalFrame, build_nodes, local_frame
from proximity.mesh.part_memory import (
    REAL_CORNERS,
    REAL_NORMALS,
    WORD_BOXES,
    WORD_FACES,
    WORD_GRID,
    WORD_MOMENTS,
    WORD_NEIGHBORS,
    WORD_SLOT_FACES,
    PartMemory,
    joined,
)

CELLS_PER_FACE = 64
FEWEST_CELLS = 512
LARGEST_GRID = 2**18
"""Cells of a sign grid; two bits each."""
SMALLEST_SHARE = 2.0**-8
"""A part that is smaller than this share of its file gets a frame of its own, for tight boxes."""
NO_GRID_CELLS = np.zeros(0, np.uint32)
NO_FOLDED = np.zeros(0, np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class PartArrays:
    """One part in its local frame, numbered from zero."""

    frame: LocalFrame
    bvh: Bvh
    moments: np.ndarray  # (M * MOMENT_STRIDE,) float32
    boxes: np.ndarray  # (B * ORIENTED_STRIDE,) float32, of blocks
    is_oblique: bool
    faces: np.ndarray  # (F, 3) int32, rows of corners
    neighbors: np.ndarray  # (F, 3) int32
    corners: np.ndarray  # (K, 3) float64, local
    normals: np.ndarray  # (K, 3) float64, unit
    lower: np.ndarray  # (3,) m, box
    upper: np.ndarray  # (3,) m
    sign: int = layout.SIGN_NONE
    grid: np.ndarray = field(default_factory=lambda: NO_GRID_CELLS)  # uint32, packed states
    grid_counts: tuple[int, int, int] = (0, 0, 0)
    grid_lower: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grid_rate: float = 0.0
    folded: np.ndarray = field(default_factory=lambda: NO_FOLDED)  # (blocks,) uint8
    memory: PartMemory | None = None  # where the arrays are, if they are where a model has them

    @property
    def size(self) -> float:
        """Longest side of the part's box in its local frame."""
        return float((self.upper - self.lower).max() * self.frame.scale)


def part_arrays(
    corners: np.ndarray, faces: np.ndarray, neighbors: np.ndarray, frame: LocalFrame | None = None
) -> PartArrays:
    """Return the arrays of one part, with no sign chosen yet.

    *corners*: (K, 3) m; *faces*: (F, 3); *neighbors*: (F, 3). *frame*: to share with other parts; one of its
    own where not given, or where that would be coarse.
    """
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    if frame is None or float((upper - lower).max()) * frame.scale < SMALLEST_SHARE:
        frame = local_frame(lower, upper)
    local = np.ascontiguousarray(frame.of(corners))
    nodes, order, block_first = build_nodes(local, faces)
    node_count, block_count = len(nodes) // NODE_STRIDE, len(block_first) - 1
    grid_words = -(
        -int(np.prod(_sign_grid(frame.of(lower), frame.of(upper), len(faces))[1])) // CELLS_PER_WORD
    )
    memory = PartMemory.of_size(node_count, block_count, len(local), len(faces), grid_words)
    bvh = Bvh(
        memory.word(0, nodes.size),
        memory.real(0, BLOCK_STRIDE * block_count),
        memory.word(WORD_SLOT_FACES, LANES * block_count, np.int32),
    )
    bvh.nodes[:] = nodes
    fill_blocks(local, faces, order, block_first, bvh.blocks, bvh.slot_faces)
    kept, kept_faces, kept_neighbors = (
        memory.real(REAL_CORNERS, local.size).reshape(-1, 3),
        memory.word(WORD_FACES, faces.size, np.int32).reshape(-1, 3),
        memory.word(WORD_NEIGHBORS, faces.size, np.int32).reshape(-1, 3),
    )
    kept[:], kept_faces[:], kept_neighbors[:] = local, faces, neighbors
    normals = memory.real(REAL_NORMALS, local.size).reshape(-1, 3)
    normals[:] = 0.0
    add_corner_normals(kept, kept_faces, normals)
    moments = memory.word(WORD_MOMENTS, MOMENT_STRIDE * node_count)
    fill_moments(bvh.nodes, bvh.blocks, node_count, moments)
    fill_slabs(bvh.nodes, bvh.blocks, 0, node_count, moments, 0)
    boxes = memory.word(WORD_BOXES, ORIENTED_STRIDE * block_count)
    is_oblique = fill_oriented_boxes(bvh.blocks, boxes) <= OBLIQUE
    return PartArrays(
        frame,
        bvh,
        moments,
        boxes,
        is_oblique,
        kept_faces,
        kept_neighbors,
        kept,
        normals,
        lower,
        upper,
        memory=memory,
    )


def moments_of(bvh: Bvh) -> np.ndarray:
    """Return what the winding number needs of a tree, (M * MOMENT_STRIDE,) float32."""
    moments = np.empty(bvh.node_count * MOMENT_STRIDE, np.float32)
    fill_moments(bvh.nodes, bvh.blocks, bvh.node_count, moments)
    return moments


def common_frame(lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return a frame for parts that go together, with space for them to move.

    *lower*, *upper*: (3,) m.
    """
    frame = local_frame(lower, upper)
    return LocalFrame(frame.centre, frame.scale * MOVING_MARGIN)


def with_sign(piece: PartArrays, sign: int, *, has_grid: bool) -> PartArrays:
    """Return a part's arrays with its kind of sign and what that needs: folded faces, a sign grid."""
    piece = replace(piece, sign=sign)
    if not has_grid and sign != layout.SIGN_PSEUDONORMAL:
        return piece
    tree = _tree(piece)
    if sign == layout.SIGN_PSEUDONORMAL:
        folded = folded_faces(piece.corners, piece.faces, piece.neighbors, piece.bvh.slot_faces, *tree)
        piece = replace(piece, folded=folded | beside_thin_faces(piece))
    if has_grid:
        lower, upper = piece.frame.of(piece.lower), piece.frame.of(piece.upper)
        rate, counts = _sign_grid(lower, upper, len(piece.faces))
        grid = build_grid(piece.corners, piece.faces, lower, rate, *counts, *tree)
        if piece.memory is not None:
            kept = piece.memory.word(WORD_GRID, len(grid), np.uint32)
            kept[:], grid = grid, kept
        piece = replace(
            piece, grid=grid, grid_counts=counts, grid_lower=tuple(lower.tolist()), grid_rate=rate
        )
    return piece


def _sign_grid(lower: np.ndarray, upper: np.ndarray, face_count: int) -> tuple[float, tuple[int, int, int]]:
    """Cells a unit, and how many along each axis, of the sign grid of a part with that local box."""
    wanted = min(max(CELLS_PER_FACE * face_count, FEWEST_CELLS), LARGEST_GRID)
    return grid_size(upper - lower, wanted)


def beside_thin_faces(piece: PartArrays) -> np.ndarray:
    """Return which slots have faces as thin as a line, or with a corner of one, a bit each: (blocks,) uint8.

    The normal of such a face is rounding, and so are the pseudo-normals of its edges and corners: there the
    winding number tells the side. With such faces tessellation closes a surface where sides that were meshed
    apart meet.
    """
    slot_faces = piece.bvh.slot_faces
    is_thin = thin_faces(piece.corners, piece.faces, CONTACT_DEPTH * piece.size)
    if not is_thin.any():
        return np.zeros(piece.bvh.block_count, np.uint8)
    is_corner_of_thin = np.zeros(len(piece.corners), dtype=bool)
    is_corner_of_thin[piece.faces[is_thin]] = True
    is_beside = is_corner_of_thin[piece.faces].any(axis=1)
    return np.packbits((slot_faces >= 0) & is_beside[slot_faces], bitorder="little")


def with_passing_faces(piece: PartArrays) -> PartArrays:
    """Return a part's arrays where self-intersecting faces count as folded.

    See `kernels.ray.self_intersections`.
    """
    passing = passing_faces(piece.corners, piece.faces, piece.neighbors, piece.bvh.slot_faces, *_tree(piece))
    return replace(piece, folded=piece.folded | passing)


def with_folded_faces(piece: PartArrays, faces: np.ndarray) -> PartArrays:
    """Return a part's arrays where these faces, and no others, count as folded.

    *faces*: rows of its faces, as found in another tree over them.
    """
    if not len(piece.folded):
        return piece
    return replace(piece, folded=np.packbits(np.isin(piece.bvh.slot_faces, faces), bitorder="little"))


def _tree(piece: PartArrays) -> tuple[np.ndarray, np.ndarray, int, int]:
    """A part's tree as kernels take it: blocks, nodes and moments, where these two begin."""
    if piece.memory is not None:
        return piece.bvh.blocks, piece.memory.words, 0, piece.memory.word_starts[WORD_MOMENTS]
    words, starts = joined([[piece.bvh.nodes], [piece.moments]], np.float32)
    return piece.bvh.blocks, words, 0, starts[1]


def grid_size(extent: np.ndarray, wanted: int) -> tuple[float, tuple[int, int, int]]:
    """Return cells a unit of length, and how many along each axis, of a grid over a box.

    *extent*: (3,).
    """
    shape = np.maximum(extent, extent.max() / 64.0)
    if not shape.prod() > 0.0:
        return 1.0, (1, 1, 1)
    rate = float((wanted / shape.prod()) ** (1.0 / 3.0))
    nx, ny, nz = (int(number) for number in np.floor(extent * rate) + 1)
    return rate, (nx, ny, nz)
