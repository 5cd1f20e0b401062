"""Layout of the arrays that kernels share: strides, columns and special values.

A *model* is four arrays, for one solid or a scene of hundreds:

- ``reals`` (float64): all leaf blocks, then corners and corner normals of every part;
- ``words`` (float32, its bits often int32): all tree nodes and the other arrays of the trees over parts
  (`proximity.scene.model.part_trees`), then faces of slots, moments, faces, neighbours and sign grids;
- ``frames`` (`FRAME`, a row for each part and one for the scene): pose and scale;
- ``parts`` (`PART`, likewise): offsets of the part's arrays in the first two, and its properties.

Kernels that Python calls take the model as one number, the address of a table of the four (see `memory`):
passing an array costs a twentieth of a microsecond.

Coordinates in ``reals`` and ``words`` are in the part's *local* frame: centred near zero and scaled by a
power of two to fit [-1, 1], both without rounding. Float32 boxes therefore stay tight wherever the part is,
and squares neither overflow nor underflow.

**Node**: `NODE_STRIDE` words: the lower x of its eight children, lower y, lower z, upper x, upper y, upper z,
then eight child references as int32. An unused lane has lower = +inf, upper = -inf, and is never entered. A
non-negative reference is a node; a negative one is leaf ``~reference``: a block or, from `ENTRY` on and only
in the scene's tree, an *entry*: a subtree of a part, as (part, reference).

**Block**: `BLOCK_STRIDE` reals: the x of corner a of its eight triangles, then y, z, then corners b and c. An
unused lane is NaN: every comparison with it fails. A triangle's position in leaf order is its slot, ``8 *
block + lane``; slots never leave the kernels. Nodes, blocks and slots are numbered through the whole model,
in the order of parts.
"""

from typing import NamedTuple

import numpy as np

from proximity.native import bundle, record
from proximity.native.signature import LANES

ALL_LANES = 2**LANES - 1
"""Mask of all lanes."""
NODE_STRIDE = 64
NODE_UPPER = 24
NODE_CHILDREN = 48
"""Offsets in a node of the upper corners and of the child references; accessors are in `nodes`."""
NODE_PARTS = 56
"""Offset of the part numbers, int32, in nodes of the dynamic tree whose children are parts."""
BLOCK_STRIDE = 72
CORNER_STRIDE = 24
"""Offset from a corner of a triangle to the next."""
ORIENTED_STRIDE = 16
"""Words of a block's oriented box, see `tree.oriented_box`: one cache line."""
BOX_STRIDE = 8
"""Numbers of a packed box, see `tree.binned_sah`."""
MOMENT_STRIDE = 112
MOMENT_CENTRE = 0
MOMENT_AREA_NORMAL = 24
MOMENT_FAR_SQ = 48
MOMENT_SPREAD = 56
MOMENT_SLAB_LEAST = 96
MOMENT_SLAB_LARGEST = 104
"""Words of a node's moments (see `sign.winding_number` and `tree.normal_slab`) and their offsets: points, the
squared distance from which a child is far, the five numbers of its spread, the two of its slab."""
FACES_SHIFT = 3
ENTRIES_SHIFT = 0
"""Base-2 logarithm of a leaf's size: eight faces, as in a block, or one entry."""
NO_FACE = -1
NO_PART = -1
NO_ROW = -1
UNUSED = -1
"""Leader of a vertex that no face uses."""
IN_MILLIMETRES = -2
"""Returned by queries instead of `NO_ROW` if all distances suggest points in millimetres."""

NO_SLOT = -1
"""No triangle yet; one exactly at the bound is accepted."""
MAX_DEPTH = 48
"""Maximum levels of inner nodes; the builder splits by count when other splits would not end in time."""
STACK_SIZE = MAX_DEPTH * (LANES - 1) + 2 * LANES
"""Each level leaves at most seven waiting children; a store writes a full vector past the end."""
STACKS_SIZE = 4 * STACK_SIZE
"""float32 of two stacks of squared distances and references, one for the scene's tree, one for a part's."""

ENTRY = 2**29
"""First number of an entry among leaves."""
STATIC_COPIES = 3
REGION_COPIES = 8
"""Copies of the tree over static parts, and of the data that changes when parts move."""
NEVER = -1
"""Version of a copy that has not been written yet."""

SCENE_FIELDS = {
    "static_capacity": "node_count",  # maximum node count of a static tree
    "first_node": "first_block",  # of the trees over parts
    "static_node_count": "block_count",
    "entries": "faces",  # in words: part and reference of each entry
    "static_root": "neighbors",  # of the static tree, or -1
    "entry_count": "corner_count",  # of the static tree; those of dynamic parts follow
    "all_fused": "is_fused",  # 1 if every part is fused, or there is only one
}
"""Fields with another meaning in the scene's row, the last one."""
PART = record(
    "Part",
    SCENE_FIELDS,
    root="i8",  # first node; the scene's: root of the trees over parts, see `dynamic_tree`
    node_count="i8",  # nodes of the part, from its root on
    first_block="i8",
    block_count="i8",
    slot_faces="i8",  # in words: face of each slot, or NO_FACE; the same in all rows
    moments="i8",  # in words: see `winding_number`; the same in all rows
    faces="i8",  # in words: three corners a face
    neighbors="i8",  # in words: face across each edge
    corners="i8",  # in reals: local coordinates, three a corner
    corner_normals="i8",  # in reals: angle-weighted pseudo-normal, three a corner
    corner_count="i8",
    face_count="i8",  # of the scene: of all parts
    grid="i8",  # in words: see `inside_grid`, or NO_GRID; of the scene: see `part_grid`
    grid_x="i8",  # cells along x, y, z of the row's grid; of the scene: 0 without a grid
    grid_y="i8",
    grid_z="i8",
    sign="i8",  # how inside is decided: one of `SIGN_…`
    is_turned="i8",  # 0 if the part's rotation is the identity
    is_fused="i8",  # 1 if the part's local frame is the scene's, and the part at the identity pose
    is_dynamic="i8",  # 1 if the part has moved separately: it is one entry in the tree over parts
    is_hidden="i8",  # 1 if queries skip it; of the scene: see `traverse.ignored_parts`
    super_node="i8",  # of the scene: node above the static and the dynamic tree, see `dynamic_tree`
    dynamic_count="i8",  # of the scene: parts that are dynamic
    block_boxes="i8",  # in words: oriented box of each block; the same in all rows
    is_oblique="i8",  # 1 if they are worth testing, see `oriented_box`; of the scene: for its fused parts
    block_notes="i8",  # in words: part of each block, and bits from `FOLDED_AT` on; the same in all rows
)
"""A row of ``parts``."""

FOLDED_AT = 23
"""First of the eight bits of a block's note that mark its folded faces; the bits below hold the part."""

NO_GRID = -1
CELL_OUTSIDE = 0
CELL_INSIDE = 1
CELL_CROSSED = 2
CELL_UNKNOWN = 3
CELLS_PER_WORD = 16
"""States of a grid cell, see `sign.inside_grid`."""
SIGN_NONE = 0
SIGN_PSEUDONORMAL = 1
SIGN_WINDING = 2
REASON_NO_AREA = 0
REASON_AGREES = 1
REASON_DISAGREES = 2
REASON_MANY_FACES = 3
REASON_SMALL_HOLES = 4
REASON_OPEN = 5
"""Reasons for a part's sign, see `part.sign_choice`."""

FRAME = record(
    "Frame",
    rotation="(9,)f8",  # row by row: scene from part
    translation="(3,)f8",  # scene from part
    centre="(3,)f8",  # of the local frame, in the part's frame
    scale="f8",  # local units a metre, a power of two
    grid_lower="(3,)f8",  # corner of the row's grid: of a part, local; of the scene, m
    grid_rate="f8",  # cells a local unit; of the scene: a metre
    box_lower="(3,)f8",  # of the part's faces, in the scene's frame
    box_upper="(3,)f8",
    own_lower="(3,)f8",  # of the part's faces, in its own frame, m
    own_upper="(3,)f8",
    velocity="(3,)f8",  # of the part's origin, scene's frame, m/s
    angular_velocity="(3,)f8",  # rad/s, about the part's origin
    surface="f8",  # one of `contact_record.SURFACE_…`
    stiffness="f8",  # N/m
    damping="f8",  # N s/m
    unused="(7,)f8",
)
"""A row of ``frames``: only float64, so that vectors of eight may be read across fields."""
FRAME_COLUMNS = FRAME.itemsize // 8
PART_COLUMNS = PART.itemsize // 8


def columns_of(rows):
    """View rows of ``frames`` or ``parts`` as columns of numbers, in the same memory."""
    return rows.view(np.float64 if rows.dtype == FRAME else np.int64).reshape(len(rows), -1)


def field_at(layout, field):
    """Return the offset of a field in a row of numbers of eight bytes."""
    return layout.fields[field][1] // 8


# --- features of a closest point ---
FEATURE_NONE = -1
FEATURE_FACE = 0
FEATURE_EDGE = 1
FEATURE_VERTEX = 2

# --- file name and header of a compiled scene ---
EXTENSION = ".prox"
MAGIC = b"\x93PROX\r\n\x1a"
"""Not valid text, and corrupted by programs that treat it as text."""


class ModelArrays(NamedTuple):
    """A solid or a scene of hundreds: the first argument of most kernels."""

    reals: np.ndarray  # (R,) float64
    words: np.ndarray  # (W,) float32
    frames: np.ndarray  # (P + 1,) FRAME
    parts: np.ndarray  # (P + 1,) PART


bundle(ModelArrays, reals="float64[:]", words="float32[:]", frames="Frame[:]", parts="Part[:]")


class DynamicParts(NamedTuple):
    """Parts that move separately, and their order along the space-filling curve."""

    rows: np.ndarray  # (L,) int64, of the parts
    order: np.ndarray  # (L,) int64, positions in *rows*, in curve order
    keys: np.ndarray  # (L,) int64, scratch: position of each along the curve


bundle(DynamicParts, rows="int64[:]", order="int64[:]", keys="int64[:]")
