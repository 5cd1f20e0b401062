"""Validation of the model in a compiled scene before any traversal, with messages for its faults.

Kernels check no bounds. So every stored position is compared with the lengths of the arrays, see
`kernels.scene.store`.
"""

import numpy as np

from proximity.errors import MeshFormatError
from proximity.kernels import layout
from proximity.kernels.scene.store import model_validation, opened_model
from proximity.kernels.thresholds import MAX_COORDINATE
from proximity.pose import ORTHONORMAL_TOLERANCE
from proximity.scene.model.scene_state import FARTHEST_MOVE, FASTEST_MOVE

SENTENCES = {
    model_validation.BAD_BOX: "the boxes of node {0} are not finite, or lower corners are above upper ones",
    model_validation.BAD_CHILD_NODE: "child {0} of node {1} refers to node {2}, "
    "expected one of {3} nodes that lies behind it and that nothing else refers to",
    model_validation.BAD_CHILD_BLOCK: "child {0} of node {1} refers to block {2}, "
    "expected one of {4} blocks that nothing else refers to",
    model_validation.TOO_DEEP: "node {0} lies on a level beyond {1}",
    model_validation.NOT_REACHED: "some node or block is reached from nowhere (seen at node {0})",
    model_validation.NOT_IN_A_ROW: "the blocks below node {0} have no numbers in a row",
    model_validation.BAD_NOTE: "block {0} is noted as another part's",
    model_validation.BAD_SLOT: "slot {0} holds face {1}, but there are {2}",
    model_validation.FACE_TWICE: "slot {0} holds face {1}, which another slot holds",
    model_validation.FACE_MISSING: "its slots hold {0} faces, but there are {1}",
    model_validation.BAD_TRIANGLE: "block {0} has coordinates that are not those of its slots' faces",
    model_validation.BAD_ORIENTED_BOX: "the oriented box of block {0} lies outside of the part's local frame",
    model_validation.BAD_CORNER_ID: "face {0} refers to corner {1}, but there are {2}",
    model_validation.BAD_NEIGHBOR: "face {0} has face {1} for a neighbour, but there are {2}",
    model_validation.BAD_CORNER: "corner {0} lies outside of the part's local frame",
    model_validation.BAD_NORMAL: "the normal of corner {0} is longer than 1, or not finite",
    model_validation.BAD_MOMENT: "the moments of node {0} are not finite",
    model_validation.BAD_CELL: "its sign grid has cells of no known state, from cell {0} on",
    model_validation.BAD_SCENE_CHILD: "child {0} of node {1} refers to {2}, where no still part is",
    model_validation.COVERED_TWICE: (
        "child {0} of node {1} in the tree over the parts contains what another does"
    ),
    model_validation.NOT_COVERED: "block {0} is missing in the tree over the parts",
    model_validation.BAD_VERTEX_ID: "face {0} of its mesh refers to vertex {1}, but there are {2}",
    model_validation.BAD_CORNER_ORDER: "vertex {0} of its mesh does not belong to corner {1}",
    model_validation.BAD_VERTEX: "vertex {0} of its mesh is not finite, or too far away",
    model_validation.BAD_LIST: "cell {0} of the grid over the parts has no list",
    model_validation.BAD_LISTED_PART: "cell {0} of the grid over the parts lists part {1}, but there are {2}",
    opened_model.BAD_PART_COUNT: "it has {0} parts, expected 1 to {1}",
    opened_model.BAD_TREE_COUNT: "there are {0} parts, but the trees of {1}",
    opened_model.BAD_NUMBER: (
        "the table of parts has a number that is below 0 or beyond the {0} numbers in the file"
    ),
    opened_model.BAD_FLAG: "a flag of a part is neither 0 nor 1",
    opened_model.BAD_SIGN: "a part has no known kind of sign",
    opened_model.EMPTY_PART: "a part has no nodes, blocks, faces or corners",
    opened_model.BAD_NODE_RUN: "the nodes of the parts do not follow each other",
    opened_model.BAD_BLOCK_RUN: "the blocks of the parts do not follow each other",
    opened_model.BAD_TABLE: "parts do not agree on where tables begin",
    opened_model.BAD_TREES_START: "the trees over the parts do not begin behind those of the parts",
    opened_model.BAD_FACE_COUNT: "the scene has {0} faces, but its parts do not",
    opened_model.BAD_CAPACITY: "there is a tree of {0} nodes over {1} parts",
    opened_model.BAD_EMPTY_NODE: "the empty node is not behind those of the part",
    opened_model.BAD_REGION: "the tree over moved parts is at none of its places",
    opened_model.BAD_ENTRIES: "the entries of the tree over parts are at none of their places",
    opened_model.BAD_STATIC_ROOT: "the tree over parts is at none of its places",
    opened_model.BAD_STATIC_SIZE: "the tree over parts has {0} nodes and {1} entries, "
    "but there is room for {2} nodes",
    opened_model.TOO_MANY_BLOCKS: "there are {0} blocks, more than can be numbered",
    opened_model.BAD_REALS: "parts have coordinates that lie in one another, or beyond the {0} in the file",
    opened_model.BAD_WORDS: "parts have words that lie in one another, or beyond the {0} in the file",
    opened_model.EMPTY_GRID: "a sign grid has no cells",
    opened_model.LARGE_GRID: "a grid has more than 2^31 cells",
    opened_model.BAD_FRAME_COUNT: "there are {0} frames for {1} parts",
    opened_model.NOT_FINITE: "column {0} of frame {1} is not finite",
    opened_model.BAD_SCALE: "a local frame is not scaled by a power of two that can be computed with",
    opened_model.FAR_FRAME: "a local frame lies too far away",
    opened_model.BAD_OWN_BOX: "the box of a part is none, or lies outside of its local frame",
    opened_model.BAD_RATE: "a grid has cells of no size",
    opened_model.BAD_POSE: "the pose of part {0} is no rigid transform, or leads too far away",
    opened_model.BAD_VELOCITY: "velocities of part {0} are not finite, or too fast",
    opened_model.BAD_SURFACE: "stiffness and damping of part {0} are those of no surface",
    opened_model.BAD_ORDER: "the tree over the parts that have moved does not have each of them once",
    opened_model.BEYOND_FRAME: "its parts reach beyond the scene's frame",
}
"""Message for each kind of fault.

{0} to {2} are numbers from the kernel; {3} and {4} are the counts of nodes and blocks of the part.
"""
MOVE_LIMITS = ORTHONORMAL_TOLERANCE, FARTHEST_MOVE, FASTEST_MOVE


def complete_model(
    reals: np.ndarray, words: np.ndarray, frames: np.ndarray, parts: np.ndarray, names: tuple[str, ...]
) -> None:
    """Validate a model, and recompute all values that depend on poses and visibility.

    *frames*, *parts*: the tables, with the final poses, velocities, surfaces and visibility.
    """
    fault, columns = np.zeros(model_validation.FAULT_SIZE, np.int64), layout.columns_of(parts)
    kind = opened_model.complete_model(reals, words, frames, parts, columns, len(names), *MOVE_LIMITS, fault)
    _raise_at(kind, fault, parts, names)


def check_mesh(
    words: np.ndarray,
    parts: np.ndarray,
    part: int,
    vertices: np.ndarray,
    faces: np.ndarray,
    names: tuple[str, ...],
) -> None:
    """Check that the faces of a part are the faces of a mesh.

    *words*, *parts*: arrays of a model that `complete_model` has validated. *vertices*: (V, 3) m; *faces*:
    (F, 3).
    """
    fault, corners = np.zeros(model_validation.FAULT_SIZE, np.int64), np.empty(len(vertices), np.int32)
    kind = model_validation.fault_in_mesh(words, parts, part, vertices, faces, MAX_COORDINATE, corners, fault)
    _raise_at(kind, fault, parts, names)


def _raise_at(kind: int, fault: np.ndarray, parts: np.ndarray, names: tuple[str, ...]) -> None:
    """Raise an error with the message of a kernel's fault, unless there is none."""
    if kind == model_validation.SOUND:
        return
    part, *numbers = fault.tolist()
    row = parts[part]
    reported = SENTENCES[int(kind)].format(*numbers, row["node_count"], row["block_count"])
    if part == layout.NO_PART:
        raise MeshFormatError(reported)
    where = "the trees over the parts" if part == len(names) else named(part, names)
    raise MeshFormatError(f"{where}: {reported}")


def named(part: int, names: tuple[str, ...]) -> str:
    """Return the name of a part as used in messages."""
    return f"part {part} {names[part]!r}"
