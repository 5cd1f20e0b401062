"""Assembly of the arrays that kernels read, from solids and scenes.

The arrays of a part are made once, numbered from zero. A model concatenates the arrays of its parts and
renumbers the references of trees. The solids of a scene's parts have views of the scene's arrays, not copies.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity import native
from proximity.kernels import layout
from proximity.kernels.entries import (
    begin_moving,
    copy_nodes,
    copy_part,
    finish_scene,
    plan_scene,
    update_box,
    write_part_row,
)
from proximity.kernels.entries import choose_frame as choose_scene_frame
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_STRIDE, ModelArrays
from proximity.mesh.bvh import Bvh, LocalFrame, local_frame
from proximity.mesh.part_memory import aligned_empty
from proximity.pose import ROUNDING, Pose

EXACT_ENOUGH = 2.0 * ROUNDING
"""Rotation error up to which a matrix is used unchanged.

Every `Pose` is below it, in any order of summation.
"""


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Model:
    """The parts of a scene with their poses, as four arrays.

    A reader of a scene's arrays must keep a reference to the model. Once the model is garbage-collected, some
    of its arrays are overwritten for a later model.
    """

    reals: np.ndarray  # float64
    words: np.ndarray  # float32
    frames: np.ndarray  # (P + 1,) FRAME
    parts: np.ndarray  # (P + 1,) PART
    packed: Any  # the four, as entry points take them
    epoch: int = 0  # of the scene: grows whenever part indices, faces or visibility change
    names: tuple[str, ...] = ()  # of the scene's parts, row by row
    whole: "Model | None" = None  # of one that ignores parts: the model that has them, and owns the memory

    def __reduce__(self) -> tuple[Any, ...]:
        return finished, (self.reals, self.words, self.frames, self.parts, self.epoch, self.names)

    @property
    def memory_bytes(self) -> int:
        """Number of bytes of all arrays."""
        return self.reals.nbytes + self.words.nbytes + self.frames.nbytes + self.parts.nbytes

    def part_alone(self, row: int) -> "Model":
        """Return a model of one part at the identity pose, which shares the memory of this model."""
        frames, parts = self.frames[[row, row]], self.parts[[row, row]]
        layout.columns_of(frames)[:, layout.field_at(layout.FRAME, "velocity") :] = 0.0
        parts["is_dynamic"] = parts["is_hidden"] = 0
        frames["rotation"], frames["translation"] = np.eye(3).reshape(-1), 0.0
        for each in (0, 1):
            update_box(frames, parts, each)
        return finished(self.reals, self.words, frames, parts)

    def ignoring(self, rows: Collection[int]) -> "Model":
        """Return a model that ignores the parts of these rows, in this model's memory."""
        if not rows:
            return self
        parts = self.parts.copy()
        parts["is_hidden"][[*rows, -1]] = 1  # in the last row: that there are such
        packed = native.packed(ModelArrays(self.reals, self.words, self.frames, parts))
        return Model(self.reals, self.words, self.frames, parts, packed, self.epoch, self.names, self)

    def folded_faces(self, row: int) -> np.ndarray:
        """Return the faces of a part near which the winding number gives the sign, (K,) int32."""
        part = self.parts[row]
        first, count = part["first_block"], part["block_count"]
        notes = self.words[part["block_notes"] + first :][:count].view(np.int32)
        slots = self.words[part["slot_faces"] + LANES * first :][: LANES * count].view(np.int32)
        marks = (notes >> layout.FOLDED_AT).astype(np.uint8)
        folded: np.ndarray = slots[np.unpackbits(marks, bitorder="little") == 1]
        return folded

    def bvh(self, row: int) -> Bvh:
        """Return a copy of a part's tree, with nodes and blocks numbered from zero."""
        part = self.parts[row]
        root, first_block, block_count = (int(part[name]) for name in ("root", "first_block", "block_count"))
        nodes = self.words[NODE_STRIDE * root :][: NODE_STRIDE * part["node_count"]].copy()
        table = nodes.reshape(-1, NODE_STRIDE)
        children = table.view(np.int32)[:, layout.NODE_CHILDREN : layout.NODE_CHILDREN + LANES]
        is_used = table[:, :LANES] <= table[:, 24 : 24 + LANES]
        children[is_used & (children >= 0)] -= root
        children[is_used & (children < 0)] += first_block
        blocks = self.reals[BLOCK_STRIDE * first_block :][: BLOCK_STRIDE * block_count]
        slots = self.words[part["slot_faces"] + LANES * first_block :][: LANES * block_count]
        return Bvh(nodes, blocks.copy(), slots.view(np.int32).copy())


def assemble(
    sources: list[Model],
    poses: list[Pose],
    *,
    dynamic: Collection[int] = (),
    hidden: Collection[int] = (),
    epoch: int = 0,
    names: tuple[str, ...] = (),
) -> Model:
    """Return a model of several parts at their poses, in new memory.

    *sources*: at least one model, each of one part. *dynamic*, *hidden*: rows of the parts that will move,
    and of the parts that queries ignore.
    """
    count = len(sources)
    parts, frames = np.zeros(count + 1, layout.PART), np.zeros(count + 1, layout.FRAME)
    for row, (source, pose) in enumerate(zip(sources, poses, strict=True)):
        write_part_row(source.packed, 0, frames, parts, row, pose.matrix, EXACT_ENOUGH)
    parts["is_dynamic"][list(dynamic)], parts["is_hidden"][list(hidden)] = 1, 1
    nodes = np.empty(NODE_STRIDE * int(parts["node_count"].sum()), np.float32)
    for row, source in enumerate(sources):
        copy_nodes(source.packed, 0, nodes, parts, row)
    static, entries, real_count, word_count = plan_scene(nodes, frames, parts)
    if not real_count:
        _refuse_frame(frames)
    model = finished(
        aligned_empty(real_count, np.float64),
        aligned_empty(word_count, np.float32),
        frames,
        parts,
        epoch,
        names,
    )
    for row, source in enumerate(sources):
        copy_part(source.packed, 0, model.packed, row)
    finish_scene(model.packed, nodes, static, entries)
    return model


def adopt(source: Model, pose: Pose, *, is_hidden: bool = False, name: str = "") -> Model:
    """Return a model of the part of *source* at another pose, and take over the memory of *source*."""
    frames, parts = source.frames.copy(), source.parts.copy()
    write_part_row(source.packed, 0, frames, parts, 0, pose.matrix, EXACT_ENOUGH)
    parts["is_hidden"][0] = is_hidden
    own = LocalFrame.read(frames[0])
    if not choose_scene_frame(frames, parts, own.centre, own.scale):
        _refuse_frame(frames)
    begin_moving(source.words, frames, parts)
    return finished(source.reals, source.words, frames, parts, 0, (name,))


def _refuse_frame(frames: np.ndarray) -> None:
    """Raise a `MeshError` that says that the parts are too far apart for one frame."""
    local_frame(frames["box_lower"][:-1].min(axis=0), frames["box_upper"][:-1].max(axis=0))


def finished(
    reals: np.ndarray,
    words: np.ndarray,
    frames: np.ndarray,
    parts: np.ndarray,
    epoch: int = 0,
    names: tuple[str, ...] = (),
) -> Model:
    """Return the model of arrays that are complete."""
    packed = native.packed(ModelArrays(reals, words, frames, parts))
    return Model(reals, words, frames, parts, packed, epoch, names)
