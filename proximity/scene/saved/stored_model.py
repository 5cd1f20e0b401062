"""The model in a compiled scene, validated before anything walks it.

Kernels check no bounds. So every number that says where something lies is compared with what is there, see
`kernels.scene.model_validation`. What follows from other numbers is not believed but written again, which
is less work than to compare it and leaves the same bits: boxes of parts, the scene's row, and the tree over
dynamic parts.
"""

from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.kernels import layout
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_GRID, NODE_STRIDE, ORIENTED_STRIDE
from proximity.kernels.scene import model_validation
from proximity.kernels.scene.placement import update_box
from proximity.kernels.sign.inside_grid import CELLS_PER_WORD
from proximity.kernels.sign.winding_number import MOMENT_STRIDE
from proximity.mesh.bvh import LARGEST_COORDINATE
from proximity.scene.model.part_trees import (
    NO_NODE,
    REGION_COPIES,
    STATIC_COPIES,
    PartTreesPlan,
    clear_first,
    dynamic_order,
    note_fused,
    rewrite_entries,
    write_moving,
)

MOST_PARTS = 2**layout.FOLDED_AT
SMALLEST_SCALE, LARGEST_SCALE = 2.0**-510, 2.0**510
"""Range of the scales of local frames, with a wide margin: squares stay within float64."""

_SENTENCES = {
    model_validation.BAD_BOX: "the boxes of node {0} are not finite, or lower corners are above upper ones",
    model_validation.BAD_CHILD_NODE: "child {0} of node {1} refers to node {2}, "
    "expected one of {nodes} nodes that lies behind it and that nothing else refers to",
    model_validation.BAD_CHILD_BLOCK: "child {0} of node {1} refers to block {2}, "
    "expected one of {blocks} blocks that nothing else refers to",
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
}


def check_parts(
    reals: np.ndarray, words: np.ndarray, frames: np.ndarray, parts: np.ndarray, names: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Check all but the scene's row; return, of each node, the first and the number of blocks below it."""
    _check_rows(parts, len(names), len(reals), len(words))
    _check_frames(frames, parts)
    node_count, block_count = (int(parts[:-1][field].sum()) for field in ("node_count", "block_count"))
    firsts, counts, levels = (np.empty(node_count, np.int32) for _ in range(3))
    fault = np.zeros(model_validation.FAULT_SIZE, np.int64)
    levels[:] = 0
    reached = np.zeros(block_count, np.uint8)
    kind = model_validation.fault_in_trees(words, parts, firsts, counts, levels, reached, fault)
    _raise_at(kind, fault, parts, names)
    seen = np.empty(parts["face_count"][:-1].max(), np.uint8)
    _raise_at(model_validation.fault_in_parts(reals, words, parts, seen, fault), fault, parts, names)
    return firsts, counts


def complete_model(
    words: np.ndarray,
    frames: np.ndarray,
    parts: np.ndarray,
    names: tuple[str, ...],
    below: tuple[np.ndarray, np.ndarray],
) -> None:
    """Check the trees over parts, and write again what follows from poses and from which parts are hidden.

    *words*, *frames*, *parts*: of a model of which `check_parts` has looked at the parts, with the poses that
    are true.
    """
    row, plan = parts[-1], PartTreesPlan.of(parts)
    for part in range(len(parts) - 1):
        update_box(frames, parts, part)
    frames[-1]["rotation"], frames[-1]["translation"] = np.eye(3).reshape(-1), 0.0
    row["is_turned"] = row["is_dynamic"] = row["is_hidden"] = 0
    note_fused(frames, parts)
    clear_first(words, parts)
    fault = np.zeros(model_validation.FAULT_SIZE, np.int64)
    if plan.capacity:
        levels = np.zeros(row["block_count"], np.int32)
        covered = np.zeros(parts["first_block"][-2] + parts["block_count"][-2], np.uint8)
        kind = model_validation.fault_in_static_tree(words, parts, *below, levels, covered, fault)
        _raise_at(kind, fault, parts, names)
        rewrite_entries(words, parts, plan.copies_of(parts)[1])
    _raise_at(model_validation.fault_in_lists(words, parts, fault), fault, parts, names)
    order = dynamic_order(words, parts)
    if order is None:
        raise MeshFormatError("the tree over the parts that have moved does not have each of them once")
    if not write_moving(words, frames, parts, int(row["super_node"]), order, 0) <= 1.0:
        raise MeshFormatError("its parts reach beyond the scene's frame")


def check_mesh(
    words: np.ndarray,
    parts: np.ndarray,
    part: int,
    vertices: np.ndarray,
    faces: np.ndarray,
    names: tuple[str, ...],
) -> None:
    """Check that a part's faces are those of a mesh.

    *words*, *parts*: of a model of which `check_parts` has looked at the parts. *vertices*: (V, 3) m;
    *faces*: (F, 3).
    """
    fault, corners = np.zeros(model_validation.FAULT_SIZE, np.int64), np.empty(len(vertices), np.int32)
    kind = model_validation.fault_in_mesh(
        words, parts, part, vertices, faces, LARGEST_COORDINATE, corners, fault
    )
    _raise_at(kind, fault, parts, names)


def _raise_at(kind: int, fault: np.ndarray, parts: np.ndarray, names: tuple[str, ...]) -> None:
    """Raise what a kernel has found."""
    if kind == model_validation.SOUND:
        return
    part, *numbers = fault.tolist()
    row = parts[part]
    where = "the trees over the parts" if part == len(names) else named(part, names)
    reported = _SENTENCES[int(kind)].format(*numbers, nodes=row["node_count"], blocks=row["block_count"])
    raise MeshFormatError(f"{where}: {reported}")


def named(part: int, names: tuple[str, ...]) -> str:
    """Return what a part is called in messages."""
    return f"part {part} {names[part]!r}"


# --- rows --------------------------------------------------------------------------------------------------


def _expect(is_right: Any, message: str) -> None:
    if not is_right:
        raise MeshFormatError(message)


def _check_rows(parts: np.ndarray, count: int, real_count: int, word_count: int) -> None:
    """Check where the arrays of all parts begin and end: each behind the one before, and within the array."""
    _expect(0 < count < MOST_PARTS, f"it has {count} parts, expected 1 to {MOST_PARTS - 1}")
    _expect(len(parts) == count + 1, f"there are {count} parts, but the trees of {len(parts) - 1}")
    # So sums and products below do not overflow; columns that may be -1 are looked at by themselves.
    copies = parts.copy()
    copies["grid"][copies["grid"] == NO_GRID] = 0
    copies[-1]["static_root"] = max(copies[-1]["static_root"], NO_NODE + 1)
    sizes = layout.columns_of(copies)
    _expect(((sizes >= 0) & (sizes <= max(real_count, word_count))).all(), "the table of parts has a number "
            f"that is below 0 or beyond the {max(real_count, word_count)} numbers in the file")  # fmt: skip
    rows = parts[:-1]
    _expect(
        (rows["is_dynamic"] <= 1).all() and (rows["is_hidden"] <= 1).all(),
        "a flag of a part is neither 0 nor 1",
    )
    _expect((rows["sign"] <= layout.SIGN_WINDING).all(), "a part has no known kind of sign")
    for size in ("node_count", "block_count", "face_count", "corner_count"):
        _expect((rows[size] > 0).all(), "a part has no nodes, blocks, faces or corners")
    for first, size, what in (("root", "node_count", "nodes"), ("first_block", "block_count", "blocks")):
        starts = np.cumsum(rows[size]) - rows[size]
        _expect((rows[first] == starts).all(), f"the {what} of the parts do not follow each other")
    for table in ("slot_faces", "moments", "block_boxes", "block_notes"):
        _expect((parts[table] == parts[table][0]).all(), "parts do not agree on where tables begin")
    _check_scene_row(parts)
    _check_part_runs(parts, real_count, word_count)


def _check_scene_row(parts: np.ndarray) -> None:
    """Check the scene's row."""
    row, plan, scene = parts[-1], PartTreesPlan.of(parts), len(parts) - 1
    _expect(row["first_node"] == parts["node_count"][:-1].sum(),
            "the trees over the parts do not begin behind those of the parts")  # fmt: skip
    _expect(row["face_count"] == parts["face_count"][:-1].sum(),
            f"the scene has {row['face_count']} faces, but its parts do not")  # fmt: skip
    _expect(
        (plan.capacity > 0) == (scene > 1), f"there is a tree of {plan.capacity} nodes over {scene} parts"
    )
    if not plan.capacity:
        _expect(row["super_node"] == plan.first_node, "the empty node is not behind those of the part")
        return
    regions = [plan.region(copy) for copy in range(REGION_COPIES)]
    _expect(row["super_node"] in regions, "the tree over moved parts is at none of its places")
    entries = [plan.entries_at(copy) for copy in range(STATIC_COPIES)]
    _expect(row["entries"] in entries, "the entries of the tree over parts are at none of their places")
    root, copy = row["static_root"], entries.index(row["entries"])
    _expect(root in (NO_NODE, plan.static_node(copy)), "the tree over parts is at none of its places")
    _expect((root == NO_NODE or row["static_node_count"] > 0)
            and row["static_node_count"] <= plan.capacity
            and row["entry_count"] <= LANES * plan.capacity,
            f"the tree over parts has {row['static_node_count']} nodes and "
            f"{row['entry_count']} entries, "
            f"but there is room for {plan.capacity} nodes")  # fmt: skip


def _check_part_runs(parts: np.ndarray, real_count: int, word_count: int) -> None:
    """Check that what the parts are made of lies one behind the other, as it is written."""
    rows, scene = parts[:-1], parts[-1]
    node_count, block_count = int(rows["node_count"].sum()), int(rows["block_count"].sum())
    _expect(block_count < layout.ENTRY, f"there are {block_count} blocks, more than can be numbered")
    coordinates = 3 * rows["corner_count"]
    _check_runs(
        np.r_[0, np.stack((rows["corners"], rows["corner_normals"]), axis=1).ravel()],
        np.r_[BLOCK_STRIDE * block_count, np.stack((coordinates, coordinates), axis=1).ravel()],
        real_count,
        "coordinates",
    )
    indices, grid_sizes = 3 * rows["face_count"], -(-_cells(rows) // CELLS_PER_WORD)
    has_grid = rows["grid"] != NO_GRID
    _expect((grid_sizes[has_grid] > 0).all(), "a sign grid has no cells")
    starts = np.stack((rows["faces"], rows["neighbors"], rows["grid"]), axis=1)
    starts[~has_grid, 2] = starts[~has_grid, 1] + indices[~has_grid]
    sizes = np.stack((indices, indices, np.where(has_grid, grid_sizes, 0)), axis=1)
    holder_cells = int(_cells(parts[-1:])[0])
    tail = [scene["block_notes"], scene["grid"]]
    _check_runs(
        np.r_[0, scene["slot_faces"], scene["moments"], scene["block_boxes"], starts.ravel(), tail],
        np.r_[
            NODE_STRIDE * (node_count + PartTreesPlan.of(parts).node_count),
            LANES * block_count,
            MOMENT_STRIDE * node_count,
            ORIENTED_STRIDE * block_count,
            sizes.ravel(),
            block_count,
            holder_cells + 1 if holder_cells else 0,
        ],
        word_count,
        "words",
    )


def _check_runs(starts: np.ndarray, sizes: np.ndarray, count: int, what: str) -> None:
    ends = starts + sizes
    _expect((starts[1:] >= ends[:-1]).all() and ends[-1] <= count,
            f"parts have {what} that lie in one another, or beyond the {count} in the file")  # fmt: skip


def _cells(rows: np.ndarray) -> np.ndarray:
    """Cells of grids, (K,) int64."""
    counts = np.stack((rows["grid_x"], rows["grid_y"], rows["grid_z"]), axis=1)
    _expect((counts.astype(np.float64).prod(axis=1) < 2.0**31).all(), "a grid has more than 2^31 cells")
    return counts.prod(axis=1)


def _check_frames(frames: np.ndarray, parts: np.ndarray) -> None:
    """Check local frames, the boxes in them, and where grids lie."""
    _expect(len(frames) == len(parts), f"there are {len(frames)} frames for {len(parts) - 1} parts")
    bad = np.argwhere(~np.isfinite(layout.columns_of(frames)))
    _expect(not len(bad), f"column {bad[0, 1]} of frame {bad[0, 0]} is not finite" if len(bad) else "")
    centres, scales = frames["centre"], frames["scale"]
    is_power = (np.frexp(scales)[0] == 0.5) & (scales >= SMALLEST_SCALE) & (scales <= LARGEST_SCALE)
    _expect(is_power.all(), "a local frame is not scaled by a power of two that can be computed with")
    _expect((np.abs(centres) <= 2.0 * LARGEST_COORDINATE).all(), "a local frame lies too far away")
    lower = frames["own_lower"][:-1]
    upper = frames["own_upper"][:-1]
    with np.errstate(over="ignore"):
        reach = np.abs((np.stack((lower, upper)) - centres[:-1]) * scales[:-1, None]).max()
    is_box = (lower <= upper).all() and reach <= model_validation.LARGEST_LOCAL
    _expect(is_box, "the box of a part is none, or lies outside of its local frame")
    has_grid = _cells(parts) > 0
    has_grid[:-1] &= parts["grid"][:-1] != NO_GRID
    _expect((frames["grid_rate"][has_grid] > 0.0).all(), "a grid has cells of no size")
