"""Solids and scenes as the arrays that kernels take; see `kernels.layout`.

A part's arrays are made once, numbered from zero. A model puts those of its parts together and renumbers
tree references; a solid that has gone into a scene looks at the scene's arrays and keeps none of its own.
"""

from dataclasses import dataclass

import numpy as np

from proximity.bvh import Bvh, LocalFrame
from proximity.kernels import layout
from proximity.kernels.build import build_tree
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    FRAME_COLUMNS,
    LANES,
    NO_GRID,
    NODE_STRIDE,
    PART_COLUMNS,
)
from proximity.kernels.memory import make_table
from proximity.kernels.top import gather_entries, open_leaves, scene_box
from proximity.kernels.winding import MOMENT_STRIDE
from proximity.part_arrays import ROOM_TO_MOVE, PartArrays, common_frame, joined
from proximity.pose import Pose

ENTRIES_PER_PART = 64
FEWEST_ENTRIES = 256
"""How far large parts are opened in a scene's tree. On 118 touching parts of 43 k faces rays take 0.9 of the
time that they take with 16, points the same; more gains nothing."""
SPARE = 1.25
"""Room for the tree over parts, as a multiple of what it takes at first: parts that move may need more."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Parts with poses as four arrays, and their address."""

    reals: np.ndarray  # float64
    words: np.ndarray  # float32
    frames: np.ndarray  # (P + 1, FRAME_COLUMNS) float64
    parts: np.ndarray  # (P + 1, PART_COLUMNS) int64
    table: np.ndarray  # int64, see `memory`
    handle: int  # address of the table; valid as long as this model lives

    @property
    def memory_bytes(self) -> int:
        """Bytes of all arrays."""
        return self.reals.nbytes + self.words.nbytes + self.frames.nbytes + self.parts.nbytes

    def part_alone(self, row: int) -> "Model":
        """Return a model of one part at the identity pose, in this model's memory.

        Parameters
        ----------
        row : int
            Of the part.
        """
        frames, parts = self.frames[[row, row]], self.parts[[row, row]]
        # The body alone neither moves nor hides, whatever the part does.
        frames[:, layout.VELOCITY : layout.SURFACE] = 0.0
        parts[:, [layout.IS_LOOSE, layout.IS_HIDDEN]] = 0
        lower, upper = self.frames[row, _OWN_LOWER], self.frames[row, _OWN_UPPER]
        frame = LocalFrame(frames[0, _CENTRE].copy(), float(frames[0, layout.SCALE]))
        _place(frames, parts, 0, Pose(), frame, lower, upper)
        return _finished(self.reals, self.words, frames, parts)

    def part_arrays(self, row: int) -> PartArrays:
        """Return copies of a part's arrays, numbered from zero.

        Parameters
        ----------
        row : int
            Of the part.
        """
        part, frame = self.parts[row], self.frames[row]
        nodes = self.words[NODE_STRIDE * part[layout.ROOT] :][: NODE_STRIDE * part[layout.NODE_COUNT]]
        nodes = _renumbered(nodes, -int(part[layout.ROOT]), -int(part[layout.FIRST_BLOCK]))
        blocks = self.reals[BLOCK_STRIDE * part[layout.FIRST_BLOCK] :]
        blocks = blocks[: BLOCK_STRIDE * part[layout.BLOCK_COUNT]].copy()
        slots = self.words[part[layout.SLOT_FACES] + LANES * part[layout.FIRST_BLOCK] :]
        slots = slots[: LANES * part[layout.BLOCK_COUNT]].view(np.int32).copy()
        moments = self.words[part[layout.MOMENTS] + MOMENT_STRIDE * part[layout.ROOT] :]
        face_numbers, corner_numbers = 3 * part[layout.FACE_COUNT], 3 * part[layout.CORNER_COUNT]
        has_grid = part[layout.GRID] != NO_GRID
        counts = (int(part[layout.GRID_X]), int(part[layout.GRID_Y]), int(part[layout.GRID_Z]))
        grid_words = -(-int(np.prod(counts)) // 16) if has_grid else 0
        grid_at = int(part[layout.GRID]) if has_grid else 0
        return PartArrays(
            frame=LocalFrame(frame[_CENTRE].copy(), float(frame[layout.SCALE])),
            bvh=Bvh(nodes, blocks, slots),
            moments=moments[: MOMENT_STRIDE * part[layout.NODE_COUNT]].copy(),
            faces=self.words[part[layout.FACES] :][:face_numbers].view(np.int32).reshape(-1, 3).copy(),
            neighbors=self.words[part[layout.NEIGHBORS] :][:face_numbers]
            .view(np.int32)
            .reshape(-1, 3)
            .copy(),
            corners=self.reals[part[layout.CORNERS] :][:corner_numbers].reshape(-1, 3).copy(),
            normals=self.reals[part[layout.CORNER_NORMALS] :][:corner_numbers].reshape(-1, 3).copy(),
            lower=frame[_OWN_LOWER].copy(),
            upper=frame[_OWN_UPPER].copy(),
            sign=int(part[layout.SIGN]),
            grid=self.words[grid_at : grid_at + grid_words].view(np.uint32).copy(),
            grid_counts=counts,
            grid_lower=tuple(frame[layout.GRID_LOWER : layout.GRID_LOWER + 3]),
            grid_rate=float(frame[layout.GRID_RATE]),
        )

    def moved(self, poses: dict[int, Pose]) -> "Model":
        """Return a model with some parts elsewhere; only the tree over parts is made anew, in place.

        Parameters
        ----------
        poses : dict of int to Pose
            New ``world_from_part`` by row.
        """
        frames, parts = self.frames.copy(), self.parts.copy()
        for row, pose in poses.items():
            frame = LocalFrame(frames[row, _CENTRE].copy(), float(frames[row, layout.SCALE]))
            _place(
                frames,
                parts,
                row,
                pose,
                frame,
                frames[row, _OWN_LOWER].copy(),
                frames[row, _OWN_UPPER].copy(),
            )
        scene = len(parts) - 1
        kept = LocalFrame(frames[scene, _CENTRE].copy(), float(frames[scene, layout.SCALE]))
        model = _with_top(self.reals, self.words, frames, parts, kept)
        if model is not None:
            return model
        rotations = frames[:scene, layout.ROTATION : layout.ROTATION + 9].reshape(-1, 3, 3)
        everywhere = [Pose(*pose) for pose in zip(rotations, frames[:scene, _TRANSLATION], strict=True)]
        return assemble([self.part_arrays(row) for row in range(scene)], everywhere)


def restored(reals: np.ndarray, words: np.ndarray, frames: np.ndarray, parts: np.ndarray) -> Model:
    """Return the model of arrays that were a model's before, say in a file; they are not copied.

    Parameters
    ----------
    reals, words, frames, parts : arrays
        As in `Model`; C-ordered, writeable, the first two beginning on a cache line.
    """
    return _finished(reals, words, frames, parts)


def assemble(pieces: list[PartArrays], poses: list[Pose]) -> Model:
    """Return the model of parts at poses.

    Parameters
    ----------
    pieces : list of PartArrays
        At least one.
    poses : list of Pose
        ``world_from_part``, one a part.
    """
    count = len(pieces)
    if count == 1:
        return _needed(_assembled(pieces, poses, 0))
    # How much room the tree over parts takes is known when it is made: once with plenty, then with enough.
    draft = _needed(_assembled(pieces, poses, LANES * count + 2 * _entry_target(count)))
    return _needed(_assembled(pieces, poses, int(SPARE * draft.parts[count, layout.BLOCK_COUNT]) + LANES))


def _needed(model: "Model | None") -> Model:
    assert model is not None, "the tree over parts has its room"
    return model


def _assembled(pieces: list[PartArrays], poses: list[Pose], room: int) -> "Model | None":
    """The model of parts at poses, with room for so many nodes over them; None where that is too little."""
    count = len(pieces)
    parts = np.zeros((count + 1, PART_COLUMNS), np.int64)
    frames = np.zeros((count + 1, FRAME_COLUMNS))
    node_ends = np.cumsum([0] + [piece.bvh.node_count for piece in pieces])
    block_ends = np.cumsum([0] + [piece.bvh.block_count for piece in pieces])
    nodes = [
        _renumbered(piece.bvh.nodes, int(node), int(block))
        for piece, node, block in zip(pieces, node_ends, block_ends, strict=False)
    ]
    reals, real_starts = joined(
        [_together([piece.bvh.blocks for piece in pieces], np.float64)]
        + [array for piece in pieces for array in (piece.corners, piece.normals)],
        np.float64,
    )
    words, word_starts = joined(
        [
            _together([*nodes, np.zeros(room * NODE_STRIDE, np.float32)], np.float32),
            _together([piece.bvh.slot_faces for piece in pieces], np.int32),
            _together([piece.moments for piece in pieces], np.float32),
        ]
        + [array for piece in pieces for array in (piece.faces, piece.neighbors, piece.grid)]
        + [np.zeros(_list_room(count, room), np.float32)],
        np.float32,
    )
    for row, (piece, pose) in enumerate(zip(pieces, poses, strict=True)):
        part = parts[row]
        part[layout.ROOT], part[layout.NODE_COUNT] = node_ends[row], piece.bvh.node_count
        part[layout.FIRST_BLOCK], part[layout.BLOCK_COUNT] = block_ends[row], piece.bvh.block_count
        part[[layout.CORNERS, layout.CORNER_NORMALS]] = real_starts[1 + 2 * row : 3 + 2 * row]
        part[[layout.FACES, layout.NEIGHBORS, layout.GRID]] = word_starts[3 + 3 * row : 6 + 3 * row]
        part[layout.CORNER_COUNT], part[layout.FACE_COUNT] = len(piece.corners), len(piece.faces)
        part[layout.SIGN] = piece.sign
        part[[layout.GRID_X, layout.GRID_Y, layout.GRID_Z]] = piece.grid_counts
        if not len(piece.grid):
            part[layout.GRID] = NO_GRID
        frames[row, layout.GRID_LOWER : layout.GRID_LOWER + 3] = piece.grid_lower
        frames[row, layout.GRID_RATE] = piece.grid_rate
        _place(frames, parts, row, pose, piece.frame, piece.lower, piece.upper)
    parts[:, layout.SLOT_FACES], parts[:, layout.MOMENTS] = word_starts[1], word_starts[2]
    parts[count, layout.ROOT], parts[count, layout.NODE_COUNT] = node_ends[-1], room
    parts[count, layout.GRID] = word_starts[-1]
    return _with_top(reals, words, frames, parts, _wanted_frame(pieces))


# --- arrays ----------------------------------------------------------------------------------------------

_CENTRE = slice(layout.CENTRE, layout.CENTRE + 3)
_TRANSLATION = slice(layout.TRANSLATION, layout.TRANSLATION + 3)
_BOX_LOWER = slice(layout.BOX_LOWER, layout.BOX_LOWER + 3)
_BOX_UPPER = slice(layout.BOX_UPPER, layout.BOX_UPPER + 3)
_OWN_LOWER = slice(layout.OWN_LOWER, layout.OWN_LOWER + 3)
_OWN_UPPER = slice(layout.OWN_UPPER, layout.OWN_UPPER + 3)


def _together(pieces: list[np.ndarray], dtype: type) -> np.ndarray:
    """*pieces* end to end."""
    return np.concatenate(pieces) if len(pieces) > 1 else np.asarray(pieces[0], dtype=dtype)


def _renumbered(nodes: np.ndarray, node_shift: int, block_shift: int) -> np.ndarray:
    """A copy of *nodes* whose references count from elsewhere."""
    nodes = nodes.copy()
    table = nodes.reshape(-1, NODE_STRIDE)
    children = table.view(np.int32)[:, layout.CHILDREN : layout.CHILDREN + LANES]
    is_used = table[:, :LANES] <= table[:, 24 : 24 + LANES]
    children[is_used & (children >= 0)] += node_shift
    children[is_used & (children < 0)] -= block_shift
    return nodes


def _finished(reals: np.ndarray, words: np.ndarray, frames: np.ndarray, parts: np.ndarray) -> Model:
    """A model of arrays that are complete."""
    table = make_table(reals, words, frames, parts)
    return Model(reals, words, frames, parts, table, int(table.ctypes.data))


# --- placing ---------------------------------------------------------------------------------------------


def _place(
    frames: np.ndarray,
    parts: np.ndarray,
    row: int,
    pose: Pose,
    frame: LocalFrame,
    lower: np.ndarray,
    upper: np.ndarray,
) -> None:
    """Write a row's pose, frame and box; *lower*, *upper*: the box in the part's frame, m."""
    frames[row, layout.ROTATION : layout.ROTATION + 9] = pose.rotation.reshape(-1)
    frames[row, _TRANSLATION] = pose.translation
    frames[row, _CENTRE], frames[row, layout.SCALE] = frame.centre, frame.scale
    frames[row, _OWN_LOWER], frames[row, _OWN_UPPER] = lower, upper
    parts[row, layout.IS_TURNED] = not np.array_equal(pose.rotation, np.eye(3))
    # Around the middle, so that a part far from its own origin keeps a tight box.
    middle, half = pose.point(0.5 * lower + 0.5 * upper), np.abs(pose.rotation) @ (0.5 * upper - 0.5 * lower)
    frames[row, _BOX_LOWER] = lower if pose.is_identity else middle - half
    frames[row, _BOX_UPPER] = upper if pose.is_identity else middle + half


def _wanted_frame(pieces: list[PartArrays]) -> LocalFrame:
    """The frame of the largest part: if others share it, they can be walked as one tree."""
    largest = max(pieces, key=lambda piece: float((piece.upper - piece.lower).max()))
    return largest.frame


def _fits(frame: LocalFrame, lower: np.ndarray, upper: np.ndarray) -> bool:
    reach = np.maximum(np.abs(frame.of(lower)), np.abs(frame.of(upper))).max()
    return bool(ROOM_TO_MOVE / 16.0 <= reach <= 1.0)


def _entry_target(part_count: int) -> int:
    return max(FEWEST_ENTRIES, ENTRIES_PER_PART * part_count)


def _list_room(part_count: int, room: int) -> int:
    """Words to keep free for the parts' boxes and the entries."""
    return -(-part_count // LANES) * NODE_STRIDE + 2 * LANES * room


def _with_top(
    reals: np.ndarray, words: np.ndarray, frames: np.ndarray, parts: np.ndarray, wanted: LocalFrame
) -> Model | None:
    """Finish a model: the scene's row, the boxes of parts, and the tree over them, within *words*.

    None where *words* have no room for that tree.
    """
    scene = len(parts) - 1
    lower, upper = frames[:scene, _BOX_LOWER].min(axis=0), frames[:scene, _BOX_UPPER].max(axis=0)
    if scene == 1:
        # The only part's frame is the scene's: nothing is converted.
        frame = LocalFrame(frames[0, _CENTRE] + frames[0, _TRANSLATION], float(frames[0, layout.SCALE]))
    else:
        frame = wanted if _fits(wanted, lower, upper) else common_frame(lower, upper)
    _place(frames, parts, scene, Pose(), frame, lower, upper)
    parts[scene, layout.FACE_COUNT] = parts[:scene, layout.FACE_COUNT].sum()
    is_still = (
        frames[:scene, layout.ROTATION : layout.CENTRE] == frames[scene, layout.ROTATION : layout.CENTRE]
    )
    is_alike = (
        frames[:scene, layout.CENTRE : layout.SCALE + 1] == frames[scene, layout.CENTRE : layout.SCALE + 1]
    )
    parts[:scene, layout.IS_FUSED] = is_still.all(axis=1) & is_alike.all(axis=1)
    parts[scene, layout.IS_FUSED] = scene == 1 or parts[:scene, layout.IS_FUSED].all()
    if scene > 1 and not _write_top(words, frames, parts):
        return None
    return _finished(reals, words, frames, parts)


def _write_top(words: np.ndarray, frames: np.ndarray, parts: np.ndarray) -> bool:
    scene = len(parts) - 1
    first_node, boxes_at = int(parts[scene, layout.ROOT]), int(parts[scene, layout.GRID])
    groups = _part_boxes(frames, scene)
    words[boxes_at : boxes_at + groups.size] = groups.reshape(-1)
    boxes, references = gather_entries(words, frames, parts, _entry_target(scene))
    nodes, order, block_first = build_tree(
        np.ascontiguousarray(boxes[:, :3]), np.ascontiguousarray(boxes[:, 3:])
    )
    nodes = open_leaves(nodes, order, block_first, boxes, references, parts, first_node)
    entries_at = boxes_at + groups.size
    has_room = (
        nodes.size <= NODE_STRIDE * parts[scene, layout.NODE_COUNT]
        and entries_at + references.size <= words.size
    )
    if has_room:
        words[NODE_STRIDE * first_node :][: nodes.size] = nodes
        words[entries_at : entries_at + references.size] = references[order].reshape(-1).view(np.float32)
    parts[scene, layout.FACES] = entries_at
    parts[scene, layout.BLOCK_COUNT] = nodes.size // NODE_STRIDE
    return has_room


def _part_boxes(frames: np.ndarray, scene: int) -> np.ndarray:
    """The parts' boxes in the scene's scaled frame, eight to a node."""
    groups = np.zeros((-(-scene // LANES), NODE_STRIDE), np.float32)
    groups[:, :24], groups[:, 24:48] = np.inf, -np.inf
    box = np.empty(6, np.float32)
    centre, scale = frames[scene, _CENTRE], frames[scene, layout.SCALE]
    for part in range(scene):
        low, high = (frames[part, _BOX_LOWER] - centre) * scale, (frames[part, _BOX_UPPER] - centre) * scale
        scene_box(frames, scene, scene, low, high, box)
        groups[part // LANES, part % LANES : 48 : LANES] = box
    return groups
