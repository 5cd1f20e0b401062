"""Layout of the arrays that kernels share: strides, columns and special values.

A *model* is four arrays, whether it holds one solid or a scene of hundreds:

- ``reals`` (float64): first all leaf blocks, then corners and corner normals of every part;
- ``words`` (float32, its bits often int32): first all tree nodes and what else the trees over parts are made
  of (`proximity.scene.model.part_trees`), then faces of slots, moments, faces, neighbours and sign grids;
- ``frames`` (float64, a row a part, and one for the scene): where the part is, how it is scaled;
- ``parts`` (int64, likewise): where in the first two its arrays start, and what kind of part it is.

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

**Names of columns** begin with the name of a row of their table: `PART_` in ``parts``, `FRAME_` in
``frames``, and likewise `RECORD_`, `TRACK_`, `SETTING_`, `ESTIMATE_`, `PLAN_`, `CLOSEST_` in other files.
A column that means something else in the row of the scene, the last one, has a second name there: `SCENE_`.
A test compares the names with the tables that are indexed.
"""

from proximity.native.simd import LANES

ALL_LANES = 2**LANES - 1
"""Bits of all lanes."""
NODE_STRIDE = 64
NODE_CHILDREN = 48
"""Offset of the child references in a node."""
NODE_PARTS = 56
"""Offset of the part numbers, int32, in those nodes of the dynamic tree that have parts for children."""
BLOCK_STRIDE = 72
NO_FACE = -1
NO_PART = -1
NO_ROW = -1
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

# --- columns of ``parts`` (int64) ---
PART_ROOT = 0  # node to start from; the scene has one as well: of the trees over parts, see `dynamic_tree`
PART_NODE_COUNT = 1  # nodes of the part, from its root on
PART_FIRST_BLOCK = 2
PART_BLOCK_COUNT = 3
PART_SLOT_FACES = 4  # in words: face of each slot, or NO_FACE; the same in all rows
PART_MOMENTS = 5  # in words: see `winding_number`; the same in all rows
PART_FACES = 6  # in words: three corners a face
PART_NEIGHBORS = 7  # in words: face across each edge
PART_CORNERS = 8  # in reals: local coordinates, three a corner
PART_CORNER_NORMALS = 9  # in reals: angle-weighted pseudo-normal, three a corner
PART_CORNER_COUNT = 10
PART_FACE_COUNT = 11  # of the scene: of all parts
PART_GRID = 12  # in words: see `inside_grid`; NO_GRID where there is none
PART_GRID_X = 13  # cells along x, y, z of the row's grid; of the scene: 0 where there is none
PART_GRID_Y = 14
PART_GRID_Z = 15
PART_SIGN = 16  # how inside is decided: one of the three below
PART_IS_TURNED = 17  # 0 where the part's rotation is the identity
PART_IS_FUSED = 18  # 1 where the part's local frame is the scene's, and the part at the identity pose
PART_IS_DYNAMIC = 19  # 1 where the part has moved by itself: it stands whole in the tree over parts
PART_IS_HIDDEN = 20  # 1 where no question finds it
PART_BLOCK_NOTES = 23  # in words: of each block the part, and `FOLDED_AT`; the same in all rows
PART_COLUMNS = 24

# --- columns of ``parts`` that mean something else in the scene's row ---
SCENE_STATIC_CAPACITY = 1  # nodes that a static tree may have
SCENE_FIRST_NODE = 2  # of the trees over parts
SCENE_STATIC_NODE_COUNT = 3
SCENE_ENTRIES = 6  # in words: part and reference of each entry
SCENE_STATIC_ROOT = 7  # of the static tree, or -1
SCENE_ENTRY_COUNT = 10  # of the static tree; those of dynamic parts follow
SCENE_GRID = 12  # in words: see `part_grid`
SCENE_ALL_FUSED = 18  # 1 where every part is fused, or there is only one
SCENE_SUPER_NODE = 21  # the dynamic tree is behind it
SCENE_DYNAMIC_COUNT = 22  # parts that are dynamic

FOLDED_AT = 23
"""First of the eight bits of a block's note that tell which of its faces are folded over; below, the part."""

NO_GRID = -1
SIGN_NONE = 0
SIGN_PSEUDONORMAL = 1
SIGN_WINDING = 2

# --- columns of ``frames`` (float64) ---
FRAME_ROTATION = 0  # nine numbers, row by row: scene from part
FRAME_TRANSLATION = 9  # scene from part
FRAME_CENTRE = 12  # of the local frame, in the part's frame
FRAME_SCALE = 15  # local units a metre, a power of two
FRAME_GRID_LOWER = 16  # corner of the row's grid: of a part, local; of the scene, m
FRAME_GRID_RATE = 19  # cells a local unit; of the scene: a metre
FRAME_BOX_LOWER = 20  # of the part's faces, in the scene's frame
FRAME_BOX_UPPER = 23
FRAME_OWN_LOWER = 26  # of the part's faces, in its own frame, m
FRAME_OWN_UPPER = 29
FRAME_VELOCITY = 32  # of the part's origin, scene's frame, m/s
FRAME_ANGULAR_VELOCITY = 35  # rad/s, about the part's origin
FRAME_SURFACE = 38  # one of `contact_columns.SURFACE_…`
FRAME_STIFFNESS = 39  # N/m
FRAME_DAMPING = 40  # N s/m
FRAME_COLUMNS = 48

# --- the same for rows in Python: three numbers ---
FRAME_TRANSLATION_XYZ = slice(FRAME_TRANSLATION, FRAME_TRANSLATION + 3)
FRAME_BOX_LOWER_XYZ = slice(FRAME_BOX_LOWER, FRAME_BOX_LOWER + 3)
FRAME_BOX_UPPER_XYZ = slice(FRAME_BOX_UPPER, FRAME_BOX_UPPER + 3)
FRAME_OWN_LOWER_XYZ = slice(FRAME_OWN_LOWER, FRAME_OWN_LOWER + 3)
FRAME_OWN_UPPER_XYZ = slice(FRAME_OWN_UPPER, FRAME_OWN_UPPER + 3)

# --- how a query turned out ---
FEATURE_NONE = -1
FEATURE_FACE = 0
FEATURE_EDGE = 1
FEATURE_VERTEX = 2
