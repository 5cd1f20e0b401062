"""Storage of the trees over the parts of a scene, and the making of the static one.

Behind the nodes of the parts a scene has one empty node, `STATIC_COPIES` copies of a tree over the parts
that stand still, and `REGION_COPIES` copies of what changes when parts move: super node and dynamic tree.
What a query may still be reading is never written to: the next copy is. A scene of one part has the empty
node only.
"""

from dataclasses import dataclass

import numpy as np

from proximity.kernels import layout
from proximity.kernels.layout import LANES, NODE_STRIDE
from proximity.kernels.scene.dynamic_tree import DynamicParts, bring_up_to_date
from proximity.kernels.scene.static_tree import gather_entries, name_leaves, thin_out
from proximity.kernels.tree.builder import ENTRIES_SHIFT, build_tree
from proximity.kernels.tree.collapse import clear_node
from proximity.mesh.bvh import LocalFrame
from proximity.mesh.part_arrays import MOVING_MARGIN, common_frame
from proximity.native import packed

ENTRIES_PER_PART = 32
FEWEST_ENTRIES = 256
"""Entries to which large parts are opened in a scene's tree. On 118 touching parts of 43 k faces rays and
points take 0.97 of the time that they take with 16. With 64 they take as long, and a tree over 120 parts
takes 12 ms to make instead of 9."""
STATIC_COPIES = 3
REGION_COPIES = 8
SMALLEST_REACH = MOVING_MARGIN / 16.0
"""Parts that take up less of the scene's frame than this have boxes that are coarse."""
NO_NODE = -1
"""Root of a static tree over nothing."""


@dataclass(frozen=True, slots=True)
class PartTreesPlan:
    """Which nodes, and which words, are for the trees over parts."""

    part_count: int
    first_node: int  # an empty one
    capacity: int  # nodes of a static tree; 0 for a scene of one part

    @classmethod
    def of(cls, parts: np.ndarray) -> "PartTreesPlan":
        """Return the plan that a model was made by; the scene's row has it.

        *parts*: (P + 1,) PART.
        """
        row = parts[-1]
        return cls(len(parts) - 1, int(row["first_node"]), int(row["static_capacity"]))

    def copies_of(self, parts: np.ndarray) -> tuple[int, int]:
        """Return which copy of what moves a model uses, and which of the static tree.

        *parts*: (P + 1,) PART.
        """
        if not self.capacity:
            return 0, 0
        row = parts[-1]
        moving = int(row["super_node"] - self.region(0)) // self._region_nodes
        return moving, int(row["entries"] - self.entries_at(0)) // (NODE_STRIDE * self._static_nodes)

    @property
    def entry_capacity(self) -> int:
        """Entries of a static tree and of the dynamic parts."""
        return LANES * self.capacity + self.part_count

    @property
    def node_count(self) -> int:
        """Nodes in all."""
        if not self.capacity:
            return 1
        return 1 + STATIC_COPIES * self._static_nodes + REGION_COPIES * self._region_nodes

    @property
    def _static_nodes(self) -> int:
        return self.capacity + -(-2 * self.entry_capacity // NODE_STRIDE)

    @property
    def _region_nodes(self) -> int:
        """A super node, and the levels below it if all parts are dynamic."""
        total, count = 1, self.part_count
        while count >= LANES:
            count = -(-count // LANES)
            total += count
        return total

    def static_node(self, copy: int) -> int:
        """Return the root of a copy of the static tree."""
        return self.first_node + 1 + copy * self._static_nodes

    def entries_at(self, copy: int) -> int:
        """Return the first word of its entries."""
        return NODE_STRIDE * (self.static_node(copy) + self.capacity)

    def region(self, copy: int) -> int:
        """Return the super node of a copy of what moves."""
        if not self.capacity:
            return self.first_node
        return self.static_node(STATIC_COPIES) + copy * self._region_nodes


def dynamic_rows(parts: np.ndarray) -> np.ndarray:
    """Return the rows of the parts that are dynamic, (L,) int64.

    *parts*: (P + 1,) PART.
    """
    return np.flatnonzero(parts["is_dynamic"][:-1])


def choose_frame(frames: np.ndarray, parts: np.ndarray, wanted: LocalFrame) -> None:
    """Give the scene's row a frame that all parts fit, and say which parts are in that frame themselves.

    *wanted*: taken if it fits: parts that share it can be walked as one tree. Otherwise one with space to
    move.
    """
    scene = len(parts) - 1
    frame = wanted
    if scene > 1:
        lower, upper = (
            frames["box_lower"][:scene].min(axis=0),
            frames["box_upper"][:scene].max(axis=0),
        )
        reach = np.maximum(np.abs(wanted.of(lower)), np.abs(wanted.of(upper))).max()
        frame = wanted if SMALLEST_REACH <= reach <= 1.0 else common_frame(lower, upper)
    frames[scene]["rotation"], frames[scene]["translation"] = np.eye(3).reshape(-1), 0.0
    frame.write(frames[scene])
    note_fused(frames, parts)


def note_fused(frames: np.ndarray, parts: np.ndarray) -> None:
    """Say which parts are in the scene's frame themselves, and whether all are."""
    scene = len(parts) - 1
    numbers = layout.columns_of(frames)[:, : layout.field_at(layout.FRAME, "scale") + 1]
    is_alike = numbers[:scene] == numbers[scene]
    is_still = parts["is_dynamic"][:scene] == 0
    parts["is_fused"][:scene] = is_alike.all(axis=1) & is_still
    parts["all_fused"][scene] = scene == 1 or parts["is_fused"][:scene].all()


def static_tree(
    words: np.ndarray, frames: np.ndarray, parts: np.ndarray, first_node: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the tree over parts that are neither dynamic nor hidden.

    *words*: (W,) float32.
    """
    scene = len(parts) - 1
    nothing = np.zeros(0, np.float32), np.zeros((0, 2), np.int32)
    if scene == 1:
        return nothing
    still_count = int(((parts["is_dynamic"] | parts["is_hidden"])[:scene] == 0).sum())
    if not still_count:
        return nothing
    target = max(FEWEST_ENTRIES, ENTRIES_PER_PART * still_count)
    boxes, references = gather_entries(words, frames, parts, target)
    nodes, order, _ = build_tree(boxes, ENTRIES_SHIFT)
    references = references[order]
    name_leaves(nodes, references, parts, first_node)
    return nodes, references


def write_static(
    words: np.ndarray, parts: np.ndarray, copy: int, nodes: np.ndarray, entries: np.ndarray
) -> bool:
    """Write a copy of a static tree; whether it fits. The only part of a scene needs none.

    *words*, *parts*: of the model; the scene's row of *parts* is reported.
    """
    plan = PartTreesPlan.of(parts)
    if not plan.capacity:
        return True
    if len(nodes) > NODE_STRIDE * plan.capacity or len(entries) > LANES * plan.capacity:
        return False
    words[NODE_STRIDE * plan.static_node(copy) :][: len(nodes)] = nodes
    row = parts[-1]
    row["entry_count"], row["static_node_count"] = (
        len(entries),
        len(nodes) // NODE_STRIDE,
    )
    row["static_root"] = plan.static_node(copy) if len(nodes) else NO_NODE
    _write_entries(words, parts, copy, entries.reshape(-1).view(np.float32))
    return True


def thin_static(words: np.ndarray, parts: np.ndarray, copy: int) -> None:
    """Write another copy of the static tree, without the parts that have become dynamic or hidden.

    *words*, *parts*: of the model; the scene's row of *parts* is reported.
    """
    row, target = parts[-1], PartTreesPlan.of(parts).static_node(copy)
    entries_at, root = row["entries"], row["static_root"]
    entries = words[entries_at : entries_at + 2 * row["entry_count"]]
    if root != NO_NODE:
        is_left = thin_out(words, parts, root, row["static_node_count"], target, entries_at)
        row["static_root"] = target if is_left else NO_NODE
    row["all_fused"] = parts["is_fused"][:-1].all()
    _write_entries(words, parts, copy, entries)


def _write_entries(words: np.ndarray, parts: np.ndarray, copy: int, entries: np.ndarray) -> None:
    """Write the entries of a static tree, and behind them those of dynamic parts, which stand whole."""
    at, dynamic = PartTreesPlan.of(parts).entries_at(copy), dynamic_rows(parts)
    whole = np.stack((dynamic, parts["root"][dynamic]), axis=1).astype(np.int32)
    words[at : at + len(entries)] = entries
    words[at + len(entries) :][: whole.size] = whole.reshape(-1).view(np.float32)
    parts["entries"][-1] = at


def write_moving(
    words: np.ndarray, frames: np.ndarray, parts: np.ndarray, region: int, order: np.ndarray, steps: int
) -> float:
    """Write what follows from where parts are: boxes, the scene's row, the dynamic tree; how far they reach.

    *order*: positions of the dynamic parts in `dynamic_rows`, along the curve.
    """
    rows = dynamic_rows(parts)
    versions, boxes = np.zeros(len(parts), np.int64), np.zeros((len(parts) - 1, 6), np.float32)
    dynamic, never = DynamicParts(rows, order, np.empty(len(rows), np.int64)), -1
    reach = bring_up_to_date(
        words, frames, parts, versions, never, boxes, packed(dynamic), steps, region, never, frames, parts
    )
    return float(reach)


def dynamic_order(words: np.ndarray, parts: np.ndarray) -> np.ndarray | None:
    """Return the dynamic parts' positions along the curve, (L,) int64; None where not each of them has
    one.
    """
    dynamic, region = dynamic_rows(parts), int(parts["super_node"][-1])
    positions = np.arange(len(dynamic))
    if not PartTreesPlan.of(parts).capacity:
        return positions
    # Fewer than eight are in the super node, beside the static tree.
    node, lane = (
        (region, positions + 1)
        if len(dynamic) < LANES
        else (region + 1 + positions // LANES, positions % LANES)
    )
    listed = words[NODE_STRIDE * node + layout.NODE_PARTS + lane].view(np.int32)
    return np.searchsorted(dynamic, listed) if np.array_equal(np.sort(listed), dynamic) else None


def rewrite_entries(words: np.ndarray, parts: np.ndarray, copy: int) -> None:
    """Write the entries of dynamic parts anew, behind those of the static tree, which stay."""
    at = PartTreesPlan.of(parts).entries_at(copy)
    _write_entries(words, parts, copy, words[at : at + 2 * parts["entry_count"][-1]])


def clear_first(words: np.ndarray, parts: np.ndarray) -> None:
    """Make the first of the nodes for trees over parts the empty one."""
    clear_node(words, PartTreesPlan.of(parts).first_node)
