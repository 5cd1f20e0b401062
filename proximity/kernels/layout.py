"""Layout of the arrays that kernels share: strides, columns and special values.

A *model* is four arrays, whether it holds one solid or a scene of hundreds:

- ``reals`` (float64): first all leaf blocks, then corners and corner normals of every part;
- ``words`` (float32, its bits often int32): first all tree nodes and what else the trees over parts are made
  of (`proximity.scene.model.part_trees`), then faces of slots, moments, faces, neighbours and sign grids;
- ``frames`` (`FRAME`, a row a part, and one for the scene): where the part is, how it is scaled;
- ``parts`` (`PART`, likewise): where in the first two its arrays start, and what kind of part it is.

Kernels that Python calls take the model as one number, the address of a table of the four (see `memory`):
an argument that is an array costs a twentieth of a microsecond.

Coordinates in ``reals`` and ``words`` are those of the part's *local* frame: moved so that its middle is
near zero and scaled by a power of two so that it fits [-1, 1], both without rounding. So float32 boxes stay
tight wherever the part is, and squares neither overflow nor vanish.

**Node**: `NODE_STRIDE` words: the lower x of its eight children, lower y, lower z, upper x, upper y, upper z,
then eight child references as int32. An unused lane has lower = +inf, upper = -inf: nothing enters it. A
reference that is not negative is a node; a negative one is leaf ``~reference``: a block or, from `ENTRY` on
and in the scene's tree only, an *entry*: a subtree of a part, as (part, reference).

**Block**: `BLOCK_STRIDE` reals: the x of corner a of its eight triangles, then y, z, then corners b and c.
An unused lane is NaN: every comparison with it fails. A triangle's position in leaf order is its slot,
``8 * block + lane``; slots never leave the kernels. Nodes, blocks and slots are numbered through the whole
model, so that of two slots the lower is of the lower part.
"""

from typing import NamedTuple

import numpy as np

from proximity.native import bundle, record
from proximity.native.signature import LANES

ALL_LANES = 2**LANES - 1
"""Bits of all lanes."""
NODE_STRIDE = 64
NODE_UPPER = 24
NODE_CHILDREN = 48
"""Offset of the upper corners in a node, and of the child references; `nodes` reads all of them."""
NODE_PARTS = 56
"""Offset of the part numbers, int32, in those nodes of the dynamic tree that have parts for children."""
BLOCK_STRIDE = 72
CORNER_STRIDE = 24
"""From a corner of a triangle to the next one."""
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
"""Words of a node's moments, see `sign.winding_number` and `tree.normal_slab`, and their offsets: points, the
squared distance from which a child is far, the five numbers of its spread, the two of its slab."""
FACES_SHIFT = 3
ENTRIES_SHIFT = 0
"""A leaf takes two to the power of that: eight faces, as many as a block, or one entry."""
NO_FACE = -1
NO_PART = -1
NO_ROW = -1
UNUSED = -1
"""Leader of a vertex that no face uses."""
IN_MILLIMETRES = -2
"""Answered by queries instead of `NO_ROW`: all points are as far away as such in millimetres."""

NO_SLOT = -1
"""No triangle yet: one that is as near as the bound is taken."""
MAX_DEPTH = 48
"""Levels of inner nodes at most; the builder halves by count where nothing else ends in time."""
STACK_SIZE = MAX_DEPTH * (LANES - 1) + 2 * LANES
"""Each level leaves at most seven children waiting; a store writes a whole vector beyond."""
STACKS_SIZE = 4 * STACK_SIZE
"""float32 of two stacks, of squared distances and references: one for the scene's tree, one for a part's."""

ENTRY = 2**29
"""First number of an entry among leaves."""
STATIC_COPIES = 3
REGION_COPIES = 8
"""Copies of the tree over the parts that stand still, and of what changes when parts move."""
NEVER = -1
"""Version of a copy that has nothing yet."""

SCENE_FIELDS = {
    "static_capacity": "node_count",  # nodes that a static tree may have
    "first_node": "first_block",  # of the trees over parts
    "static_node_count": "block_count",
    "entries": "faces",  # in words: part and reference of each entry
    "static_root": "neighbors",  # of the static tree, or -1
    "entry_count": "corner_count",  # of the static tree; those of dynamic parts follow
    "all_fused": "is_fused",  # 1 where every part is fused, or there is only one
}
"""Names of fields of a part that mean something else in the scene's row, the last one."""
PART = record(
    "Part",
    SCENE_FIELDS,
    root="i8",  # node to start from; the scene has one as well: of the trees over parts, see `dynamic_tree`
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
    grid="i8",  # in words: see `inside_grid`, NO_GRID where there is none; of the scene: see `part_grid`
    grid_x="i8",  # cells along x, y, z of the row's grid; of the scene: 0 where there is none
    grid_y="i8",
    grid_z="i8",
    sign="i8",  # how inside is decided: one of the three below
    is_turned="i8",  # 0 where the part's rotation is the identity
    is_fused="i8",  # 1 where the part's local frame is the scene's, and the part at the identity pose
    is_dynamic="i8",  # 1 where the part has moved by itself: it stands whole in the tree over parts
    is_hidden="i8",  # 1 where no question finds it; of the scene: see `traverse.ignored_parts`
    super_node="i8",  # of the scene: the dynamic tree is behind it
    dynamic_count="i8",  # of the scene: parts that are dynamic
    block_boxes="i8",  # in words: oriented box of each block; the same in all rows
    is_oblique="i8",  # 1 where they are worth a look, see `oriented_box`; of the scene: for its fused parts
    block_notes="i8",  # in words: of each block the part, and `FOLDED_AT`; the same in all rows
)
"""A row of ``parts``."""

FOLDED_AT = 23
"""First of the eight bits of a block's note that tell which of its faces are folded over; below, the part."""

NO_GRID = -1
CELL_OUTSIDE = 0
CELL_INSIDE = 1
CELL_CROSSED = 2
CELL_UNKNOWN = 3
CELLS_PER_WORD = 16
"""Of a grid, see `sign.inside_grid`."""
SIGN_NONE = 0
SIGN_PSEUDONORMAL = 1
SIGN_WINDING = 2
REASON_NO_AREA = 0
REASON_AGREES = 1
REASON_DISAGREES = 2
REASON_MANY_FACES = 3
REASON_SMALL_HOLES = 4
REASON_OPEN = 5
"""Why a part has its sign, see `part.sign_choice`."""

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
"""A row of ``frames``: numbers throughout, so that vectors of eight may be read across fields."""
FRAME_COLUMNS = FRAME.itemsize // 8
PART_COLUMNS = PART.itemsize // 8


def columns_of(rows):
    """Rows of ``frames`` or ``parts`` as columns of numbers, in the same memory."""
    return rows.view(np.float64 if rows.dtype == FRAME else np.int64).reshape(len(rows), -1)


def field_at(layout, field):
    """Position of a field in a row of numbers of eight bytes."""
    return layout.fields[field][1] // 8


# --- how a query turned out ---
FEATURE_NONE = -1
FEATURE_FACE = 0
FEATURE_EDGE = 1
FEATURE_VERTEX = 2

# --- a compiled scene: how its file is named, and begins ---
EXTENSION = ".prox"
MAGIC = b"\x93PROX\r\n\x1a"
"""No text, and changed by programs that take it for text."""


class ModelArrays(NamedTuple):
    """A solid, or a scene of hundreds: what most kernels are handed first."""

    reals: np.ndarray  # (R,) float64
    words: np.ndarray  # (W,) float32
    frames: np.ndarray  # (P + 1,) FRAME
    parts: np.ndarray  # (P + 1,) PART


bundle(ModelArrays, reals="float64[:]", words="float32[:]", frames="Frame[:]", parts="Part[:]")


class DynamicParts(NamedTuple):
    """Those parts that move by themselves, and their order along the curve."""

    rows: np.ndarray  # (L,) int64, of the parts
    order: np.ndarray  # (L,) int64, positions in *rows*, along the curve
    keys: np.ndarray  # (L,) int64, scratch: where each is along the curve


bundle(DynamicParts, rows="int64[:]", order="int64[:]", keys="int64[:]")
