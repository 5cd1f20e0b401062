"""Assembly of solids and scenes into the arrays that kernels take.

A part's arrays are made once, numbered from zero. A model puts those of its parts together and renumbers
tree references; the solids of a scene's parts look at the scene's arrays and keep none of their own.
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
"""Error of a rotation up to which it is taken as it is: that of a `Pose` always, in whatever order summed."""


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
    whole: "Model | None" = None  # of one that ignores parts: the model that has them, and owns the memory

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
        """Return the faces of a part over which the winding number tells the side, (K,) int32."""
        part = self.parts[row]
        first, count = part["first_block"], part["block_count"]
        notes = self.words[part["block_notes"] + first :][:count].view(np.int32)
        slots = self.words[part["slot_faces"] + LANES * first :][: LANES * count].view(np.int32)
        marks = (notes >> layout.FOLDED_AT).astype(np.uint8)
        folded: np.ndarray = slots[np.unpackbits(marks, bitorder="little") == 1]
        return folded

    def bvh(self, row: int) -> Bvh:
        """Return a copy of a part's tree, numbered from zero."""
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
    """Return the model of parts at poses, in new memory.

    *sources*: at least one; models of one part alone. *dynamic*, *hidden*: rows of parts that are going to
    move, and of those that no query finds.
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
    """Return the model of the part of *source* at a pose, in the memory of *source*, which it takes over."""
    frames, parts = source.frames.copy(), source.parts.copy()
    write_part_row(source.packed, 0, frames, parts, 0, pose.matrix, EXACT_ENOUGH)
    parts["is_hidden"][0] = is_hidden
    own = LocalFrame.read(frames[0])
    if not choose_scene_frame(frames, parts, own.centre, own.scale):
        _refuse_frame(frames)
    begin_moving(source.words, frames, parts)
    return finished(source.reals, source.words, frames, parts, 0, (name,))


def _refuse_frame(frames: np.ndarray) -> None:
    """Raise a `MeshError`: the parts are too far apart for any frame."""
    local_frame(frames["box_lower"][:-1].min(axis=0), frames["box_upper"][:-1].max(axis=0))


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
