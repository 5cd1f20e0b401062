"""Assembly of solids and scenes into the arrays that kernels take.

A part's arrays are made once, numbered from zero. A model puts those of its parts together and renumbers
tree references; the solids of a scene's parts look at the scene's arrays and keep none of their own.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from proximity import native
from proximity.kernels import layout
from proximity.kernels.entries import begin_moving, copy_offsets, static_tree, update_box, write_static
from proximity.kernels.entries import choose_frame as choose_scene_frame
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    MOMENT_STRIDE,
    NO_GRID,
    NODE_STRIDE,
    ORIENTED_STRIDE,
    REGION_COPIES,
    ModelArrays,
)
from proximity.mesh.bvh import Bvh, LocalFrame, local_frame
from proximity.mesh.part_arrays import PartArrays
from proximity.mesh.part_memory import WORD_NOTES, PartMemory, joined
from proximity.pose import Pose
from proximity.scene.model.part_grid import occupancy

SPARE = 1.25
"""Space for the static tree, as a multiple of what it takes at first: other parts opened may need more."""
_ARRAYS = "moments", "boxes", "faces", "neighbors", "corners", "normals", "grid"
"""Of `PartArrays`, beside those of the tree."""


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Model:
    """Parts with poses as four arrays.

    Whoever looks at the arrays of a scene's model must keep the model itself: once nobody has it, some of
    them are written anew for a later one.
    """

    reals: np.ndarray  # float64
    words: np.ndarray  # float32
    frames: np.ndarray  # (P + 1,) FRAME
    parts: np.ndarray  # (P + 1,) PART
    packed: Any  # the four, as entry points take them
    epoch: int = 0  # of the scene: grows whenever part indices, faces or what is hidden change
    names: tuple[str, ...] = ()  # of the scene's parts, row by row

    def __reduce__(self) -> tuple[Any, ...]:
        return finished, (self.reals, self.words, self.frames, self.parts, self.epoch, self.names)

    @property
    def memory_bytes(self) -> int:
        """Bytes of all arrays."""
        return self.reals.nbytes + self.words.nbytes + self.frames.nbytes + self.parts.nbytes

    def part_alone(self, row: int) -> "Model":
        """Return a model of one part at the identity pose, in this model's memory."""
        frames, parts = self.frames[[row, row]], self.parts[[row, row]]
        layout.columns_of(frames)[:, layout.field_at(layout.FRAME, "velocity") :] = 0.0
        parts["is_dynamic"] = parts["is_hidden"] = 0
        for each in (0, 1):
            _write_pose(frames, parts, each, Pose())
        return finished(self.reals, self.words, frames, parts)

    def folded_faces(self, row: int) -> np.ndarray:
        """Return the faces of a part over which the winding number tells the side, (K,) int32."""
        part = self.parts[row]
        first, count = part["first_block"], part["block_count"]
        notes = self.words[part["block_notes"] + first :][:count].view(np.int32)
        slots = self.words[part["slot_faces"] + LANES * first :][: LANES * count].view(np.int32)
        marks = (notes >> layout.FOLDED_AT).astype(np.uint8)
        folded: np.ndarray = slots[np.unpackbits(marks, bitorder="little") == 1]
        return folded

    def part_arrays(self, row: int) -> PartArrays:
        """Return copies of a part's arrays, numbered from zero."""
        views = self.part_views(row)
        bvh = Bvh(views.bvh.nodes.copy(), views.bvh.blocks.copy(), views.bvh.slot_faces.copy())
        copies = {name: getattr(views, name).copy() for name in _ARRAYS}
        return replace(views, bvh=bvh, **copies)

    def part_views(self, row: int) -> PartArrays:
        """Return a part's arrays, numbered from zero, in this model's memory as far as may be."""
        part, frame = self.parts[row], self.frames[row]
        node_count, block_count = int(part["node_count"]), int(part["block_count"])
        root, first_block = int(part["root"]), int(part["first_block"])
        nodes = self.words[NODE_STRIDE * root :][: NODE_STRIDE * node_count]
        if root or first_block:
            nodes = _renumbered(nodes, -root, -first_block)
        blocks = self.reals[BLOCK_STRIDE * first_block :][: BLOCK_STRIDE * block_count]
        slots = self.words[part["slot_faces"] + LANES * first_block :][: LANES * block_count]
        notes = self.words[part["block_notes"] + first_block :][:block_count].view(np.int32)
        moments = self.words[part["moments"] + MOMENT_STRIDE * root :][: MOMENT_STRIDE * node_count]
        boxes = self.words[part["block_boxes"] + ORIENTED_STRIDE * first_block :]
        face_numbers, corner_numbers = 3 * part["face_count"], 3 * part["corner_count"]
        faces, neighbors = (
            self.words[part[column] :][:face_numbers].view(np.int32).reshape(-1, 3)
            for column in ("faces", "neighbors")
        )
        corners, normals = (
            self.reals[part[column] :][:corner_numbers].reshape(-1, 3)
            for column in ("corners", "corner_normals")
        )
        has_grid = part["grid"] != NO_GRID
        counts = (int(part["grid_x"]), int(part["grid_y"]), int(part["grid_z"]))
        grid_words = -(-int(np.prod(counts)) // 16) if has_grid else 0
        grid_at = int(part["grid"]) if has_grid else 0
        return PartArrays(
            frame=LocalFrame.read(frame),
            bvh=Bvh(nodes, blocks, slots.view(np.int32)),
            moments=moments,
            boxes=boxes[: ORIENTED_STRIDE * block_count],
            is_oblique=bool(part["is_oblique"]),
            faces=faces,
            neighbors=neighbors,
            corners=corners,
            normals=normals,
            lower=frame["own_lower"].copy(),
            upper=frame["own_upper"].copy(),
            sign=int(part["sign"]),
            grid=self.words[grid_at : grid_at + grid_words].view(np.uint32),
            grid_counts=counts,
            grid_lower=tuple(frame["grid_lower"]),
            grid_rate=float(frame["grid_rate"]),
            folded=(notes >> layout.FOLDED_AT).astype(np.uint8),
        )

    def part_for_adoption(self) -> PartArrays:
        """Return the arrays of the only part, for another model that is to have this one's memory."""
        part, scene = self.parts
        of_words = "slot_faces", "moments", "block_boxes", "faces", "neighbors", "grid", "block_notes"
        word_starts = [0, *(int(part[field]) for field in of_words), int(scene["grid"])]
        real_starts = [0, int(part["corners"]), int(part["corner_normals"])]
        return replace(
            self.part_views(0), memory=PartMemory(self.reals, self.words, real_starts, word_starts)
        )


def assemble(
    pieces: list[PartArrays],
    poses: list[Pose],
    *,
    dynamic: Collection[int] = (),
    hidden: Collection[int] = (),
    epoch: int = 0,
    names: tuple[str, ...] = (),
) -> Model:
    """Return the model of parts at poses.

    *pieces*: at least one. What is in memory for a model is not copied, if it is the only one: the model has
    that memory. *dynamic*, *hidden*: rows of parts that are going to move, and of those that no question
    finds.
    """
    count = len(pieces)
    parts, frames = np.zeros(count + 1, layout.PART), np.zeros(count + 1, layout.FRAME)
    parts["is_dynamic"][list(dynamic)], parts["is_hidden"][list(hidden)] = 1, 1
    node_ends = np.cumsum([0] + [piece.bvh.node_count for piece in pieces])
    block_ends = np.cumsum([0] + [piece.bvh.block_count for piece in pieces])
    nodes = (
        pieces[0].bvh.nodes
        if count == 1
        else np.concatenate(
            [
                _renumbered(piece.bvh.nodes, int(node), int(block))
                for piece, node, block in zip(pieces, node_ends, block_ends, strict=False)
            ]
        )
    )
    for row, (piece, pose) in enumerate(zip(pieces, poses, strict=True)):
        frames["own_lower"][row] = piece.lower
        frames["own_upper"][row] = piece.upper
        piece.frame.write(frames[row])
        part = parts[row]
        part["root"], part["node_count"] = node_ends[row], piece.bvh.node_count
        part["first_block"], part["block_count"] = block_ends[row], piece.bvh.block_count
        parts["sign"][row], parts["is_oblique"][row] = piece.sign, piece.is_oblique
        _write_grid(frames, parts, row, piece.grid_counts, piece.grid_lower, piece.grid_rate)
        _write_pose(frames, parts, row, pose)
    oblique = sum(piece.bvh.block_count for piece in pieces if piece.is_oblique)
    parts["is_oblique"][count] = 2 * oblique >= block_ends[-1]
    choose_frame(frames, parts, _wanted_frame(pieces))
    static, entries = static_tree(nodes, frames, parts, int(node_ends[-1]) + 1)
    parts["first_node"][count] = node_ends[-1]
    if count > 1:
        parts["static_capacity"][count] = int(SPARE * _nodes_at_most(nodes, frames, parts, static)) + LANES
    tree_nodes = max(1, copy_offsets(parts, REGION_COPIES)[2] - int(node_ends[-1]))
    reals, words = _filled(pieces, frames, parts, nodes, tree_nodes)
    assert write_static(words, parts, 0, static, entries), "the tree over parts fits its workspace"
    begin_moving(words, frames, parts)
    return finished(reals, words, frames, parts, epoch, names)


def _nodes_at_most(nodes: np.ndarray, frames: np.ndarray, parts: np.ndarray, static: np.ndarray) -> int:
    """Nodes of the static tree, now or once parts that are dynamic or hidden stand there as well."""
    if parts["is_dynamic"].any() or parts["is_hidden"].any():
        parts = parts.copy()
        parts["is_dynamic"] = parts["is_hidden"] = 0
        everything, _ = static_tree(nodes, frames, parts, 0)
        return max(len(static), len(everything)) // NODE_STRIDE
    return len(static) // NODE_STRIDE


def _filled(
    pieces: list[PartArrays], frames: np.ndarray, parts: np.ndarray, nodes: np.ndarray, tree_nodes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Put the parts' arrays together, with space for *tree_nodes* over them, and note where they are."""
    count, memory = len(pieces), pieces[0].memory
    containing = occupancy(pieces, frames, parts)
    if count == 1 and memory is not None:
        reals, real_starts, words, word_starts = (
            memory.reals,
            memory.real_starts,
            memory.words,
            memory.word_starts,
        )
        memory.word(WORD_NOTES, pieces[0].bvh.block_count, np.int32)[:] = _notes_on_blocks(pieces)
    else:
        reals, real_starts = joined(
            [[piece.bvh.blocks for piece in pieces]]
            + [[array] for piece in pieces for array in (piece.corners, piece.normals)],
            np.float64,
        )
        words, word_starts = joined(
            [
                [nodes, np.zeros(tree_nodes * NODE_STRIDE, np.float32)],
                [piece.bvh.slot_faces for piece in pieces],
                [piece.moments for piece in pieces],
                [piece.boxes for piece in pieces],
            ]
            + [[array] for piece in pieces for array in (piece.faces, piece.neighbors, piece.grid)]
            + [[_notes_on_blocks(pieces)], [containing.words]],
            np.float32,
        )
    for row, piece in enumerate(pieces):
        part = parts[row]
        part["corners"], part["corner_normals"] = real_starts[1 + 2 * row : 3 + 2 * row]
        part["faces"], part["neighbors"], part["grid"] = word_starts[4 + 3 * row : 7 + 3 * row]
        part["corner_count"], part["face_count"] = len(piece.corners), len(piece.faces)
        if not len(piece.grid):
            part["grid"] = NO_GRID
    parts["slot_faces"], parts["moments"], parts["block_boxes"] = word_starts[1:4]
    parts["face_count"][count] = parts["face_count"][:count].sum()
    parts["block_notes"], parts["grid"][count] = word_starts[-2:]
    _write_grid(frames, parts, count, containing.counts, containing.lower, containing.rate)
    return reals, words


def finished(
    reals: np.ndarray,
    words: np.ndarray,
    frames: np.ndarray,
    parts: np.ndarray,
    epoch: int = 0,
    names: tuple[str, ...] = (),
) -> Model:
    """Return a model of arrays that are complete."""
    packed = native.packed(ModelArrays(reals, words, frames, parts))
    return Model(reals, words, frames, parts, packed, epoch, names)


def dynamic_rows(parts: np.ndarray) -> np.ndarray:
    """Return the rows of the parts that are dynamic, (L,) int64.

    *parts*: (P + 1,) PART.
    """
    return np.flatnonzero(parts["is_dynamic"][:-1])


def choose_frame(frames: np.ndarray, parts: np.ndarray, wanted: LocalFrame) -> None:
    """Give the scene's row a frame that all parts fit; a `MeshError` where none does.

    *wanted*: taken if it fits: parts that share it can be walked as one tree.
    """
    if not choose_scene_frame(frames, parts, wanted.centre, wanted.scale):
        local_frame(
            frames["box_lower"][:-1].min(axis=0), frames["box_upper"][:-1].max(axis=0)
        )  # which raises


# --- arrays ----------------------------------------------------------------------------------------------


def _notes_on_blocks(pieces: list[PartArrays]) -> np.ndarray:
    """Notes on blocks: the part of each, and which of its faces are folded over."""
    notes = [np.full(piece.bvh.block_count, row, np.int32) for row, piece in enumerate(pieces)]
    for own, piece in zip(notes, pieces, strict=True):
        if len(piece.folded):
            own |= piece.folded.astype(np.int32) << layout.FOLDED_AT
    return np.concatenate(notes)


def _renumbered(nodes: np.ndarray, node_shift: int, block_shift: int) -> np.ndarray:
    """A copy of *nodes* whose references count from elsewhere."""
    nodes = nodes.copy()
    table = nodes.reshape(-1, NODE_STRIDE)
    children = table.view(np.int32)[:, layout.NODE_CHILDREN : layout.NODE_CHILDREN + LANES]
    is_used = table[:, :LANES] <= table[:, 24 : 24 + LANES]
    children[is_used & (children >= 0)] += node_shift
    children[is_used & (children < 0)] -= block_shift
    return nodes


def _write_grid(
    frames: np.ndarray, parts: np.ndarray, row: int, counts: tuple[int, int, int], lower: Any, rate: float
) -> None:
    """Write what a row's grid is like: of a part its sign grid, of the scene that over it."""
    part = parts[row]
    part["grid_x"], part["grid_y"], part["grid_z"] = counts
    frames["grid_lower"][row] = lower
    frames["grid_rate"][row] = rate


def _write_pose(frames: np.ndarray, parts: np.ndarray, row: int, pose: Pose) -> None:
    """Write a row's pose, and the box that follows from it."""
    frames["rotation"][row] = pose.rotation.reshape(-1)
    frames["translation"][row] = pose.translation
    update_box(frames, parts, row)


def _wanted_frame(pieces: list[PartArrays]) -> LocalFrame:
    """The frame of the largest part: if others share it, they can be walked as one tree."""
    largest = max(pieces, key=lambda piece: float((piece.upper - piece.lower).max()))
    return largest.frame
