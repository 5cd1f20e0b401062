"""The tree of one part as data, with its local frame and a consistency check.

See `kernels.layout` for the layout of the arrays.
"""

from dataclasses import dataclass

import numpy as np

from proximity.errors import MeshError
from proximity.kernels.entries import build_tree, face_boxes, fill_blocks, frame_of_box
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    BOX_STRIDE,
    FACES_SHIFT,
    LANES,
    MAX_DEPTH,
    NO_FACE,
    NODE_CHILDREN,
    NODE_STRIDE,
)
from proximity.kernels.thresholds import MAX_COORDINATE, MOVING_MARGIN, SMALLEST_SIZE


@dataclass(frozen=True, slots=True, eq=False)
class LocalFrame:
    """A frame in which a part is within [-1, 1].

    A point is translated by *centre* and scaled by *scale*. Neither step rounds: the centre is zero or has
    few bits, and the scale is a power of two.
    """

    centre: np.ndarray  # (3,) m
    scale: float  # local units a metre

    def of(self, points: np.ndarray) -> np.ndarray:
        """Return *points* (..., 3), m, in this frame."""
        return np.asarray((points - self.centre) * self.scale)

    @classmethod
    def read(cls, row: np.ndarray) -> "LocalFrame":
        """Return a copy of the local frame in a row of a model's frames."""
        return cls(row["centre"].copy(), float(row["scale"]))

    def write(self, row: np.ndarray) -> None:
        """Write the frame into a row of a model's frames."""
        row["centre"], row["scale"] = self.centre, self.scale


def local_frame(lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return the local frame of a box.

    *lower*, *upper*: (3,) m.
    """
    largest = float(np.maximum(np.abs(lower), np.abs(upper)).max())
    extent = float((upper - lower).max())
    if largest > MAX_COORDINATE or 0.0 < extent < SMALLEST_SIZE:
        raise MeshError(
            f"the part reaches to {largest:.3g} m and is {extent:.3g} m long; coordinates up to "
            f"{MAX_COORDINATE:g} m and sizes from {SMALLEST_SIZE:g} m can be computed with"
        )
    centre = np.empty(3)
    corners = (np.ascontiguousarray(corner, np.float64) for corner in (lower, upper))
    return LocalFrame(centre, frame_of_box(*corners, centre))


def common_frame(lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return a frame for all parts of a scene, with a margin for their motion.

    *lower*, *upper*: (3,) m.
    """
    frame = local_frame(lower, upper)
    return LocalFrame(frame.centre, frame.scale * MOVING_MARGIN)


@dataclass(frozen=True, slots=True, eq=False)
class Bvh:
    """An eight-wide tree over triangles, in their local frame."""

    nodes: np.ndarray  # (M * NODE_STRIDE,) float32
    blocks: np.ndarray  # (B * BLOCK_STRIDE,) float64
    slot_faces: np.ndarray  # (B * LANES,) int32, NO_FACE in unused lanes

    @property
    def node_count(self) -> int:
        """Number of inner nodes."""
        return len(self.nodes) // NODE_STRIDE

    @property
    def block_count(self) -> int:
        """Number of leaves."""
        return len(self.blocks) // BLOCK_STRIDE

    def check(self, corners: np.ndarray, faces: np.ndarray) -> int:
        """Assert that the tree is consistent, and return its depth.

        Every face is in exactly one slot, every box contains its subtree, every node and leaf is reached
        once, and the depth is within the traversal stack.

        *corners*: (K, 3); *faces*: (F, 3).
        """
        used = self.slot_faces[self.slot_faces != NO_FACE]
        assert np.array_equal(np.sort(used), np.arange(len(faces))), "every face lies in exactly one slot"
        nodes = self.nodes.reshape(-1, NODE_STRIDE)
        lower = nodes[:, :24].reshape(-1, 3, LANES)
        upper = nodes[:, 24:48].reshape(-1, 3, LANES)
        children = self.nodes.view(np.int32).reshape(-1, NODE_STRIDE)[
            :, NODE_CHILDREN : NODE_CHILDREN + LANES
        ]
        seen_nodes, seen_blocks = np.zeros(self.node_count, int), np.zeros(self.block_count, int)
        deepest = 0
        waiting = [(0, np.full(3, -np.inf), np.full(3, np.inf), 1)]
        while waiting:
            node, low, high, depth = waiting.pop()
            deepest = max(deepest, depth)
            seen_nodes[node] += 1
            for lane in np.flatnonzero(lower[node, 0] <= upper[node, 0]):
                box_low, box_high = lower[node, :, lane], upper[node, :, lane]
                assert (box_low >= low).all() and (box_high <= high).all(), (
                    "a child's box lies in its parent's"
                )
                child = children[node, lane]
                if child >= 0:
                    waiting.append((child, box_low, box_high, depth + 1))
                    continue
                seen_blocks[~child] += 1
                held = self.slot_faces[LANES * ~child : LANES * ~child + LANES]
                points = corners[faces[held[held != NO_FACE]]].reshape(-1, 3)
                assert (points >= box_low).all() and (points <= box_high).all(), (
                    "a leaf's box holds its faces"
                )
        assert (seen_nodes == 1).all() and (seen_blocks == 1).all(), "every node and leaf is reached once"
        assert deepest <= MAX_DEPTH, "the depth is within the stack"
        return deepest


def build_bvh(corners: np.ndarray, faces: np.ndarray) -> Bvh:
    """Return the tree over triangles.

    *corners*: (K, 3); *faces*: (F, 3).

    Notes
    -----
    Degenerate: any input gives a tree of bounded depth; runs that no plane separates are split in half.
    Cost: O(F log F); 0.15 s for 300 k faces.
    Source: see `kernels.tree.builder`.
    """
    boxes = np.empty(BOX_STRIDE * len(faces), np.float32)
    face_boxes(corners, faces, boxes)
    nodes, order, block_first = build_tree(boxes, FACES_SHIFT)
    block_count = len(block_first) - 1
    blocks = np.empty(block_count * BLOCK_STRIDE)
    slot_faces = np.empty(block_count * LANES, np.int32)
    fill_blocks(corners, faces, order, block_first, blocks, slot_faces)
    return Bvh(nodes, blocks, slot_faces)
