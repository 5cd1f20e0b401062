"""Where things lie in the arrays that kernels share.

A *model* is four arrays, whether it holds one solid or a scene of hundreds:

- ``reals`` (float64): first all leaf blocks, then corners and corner normals of every part;
- ``words`` (float32, its bits often int32): first all tree nodes and what else the trees over parts are made
  of (`proximity.model.part_trees`), then faces of slots, moments, faces, neighbours and sign grids;
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
An unused lane is NaN: every comparison with it fails. A triangle's place in leaf order is its slot,
``8 * block + lane``; slots never leave the kernels. Nodes, blocks and slots are numbered through the whole
model, so that of two slots the lower is of the lower part.
"""

LANES = 8
NODE_STRIDE = 64
CHILDREN = 48
"""Offset of the child references in a node."""
PARTS_OF_LANES = 56
"""Offset of the part numbers, int32, in those nodes of the dynamic tree that have parts for children."""
BLOCK_STRIDE = 72
NO_FACE = -1
NO_PART = -1

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
ROOT = 0  # node to start from; of the scene's row: of all trees over parts, see `dynamic_tree`
NODE_COUNT = 1  # nodes of the part, from its root on; of the scene's row: room for a static tree
FIRST_BLOCK = 2  # of the scene's row: first node of the trees over parts
BLOCK_COUNT = 3  # of the scene's row: nodes of the static tree
SLOT_FACES = 4  # in words: face of each slot, or NO_FACE; the same for all parts
MOMENTS = 5  # in words: see `winding`; the same for all parts
FACES = 6  # in words: three corners a face; of the scene's row: the entries
NEIGHBORS = 7  # in words: face across each edge; of the scene's row: root of the static tree, or -1
CORNERS = 8  # in reals: local coordinates, three a corner
CORNER_NORMALS = 9  # in reals: angle-weighted pseudo-normal, three a corner
CORNER_COUNT = 10  # of the scene's row: entries of the static tree; those of dynamic parts follow
FACE_COUNT = 11
GRID = 12  # in words: see `grid`; NO_GRID where there is none; of the scene's row: see `occupancy`
GRID_X = 13  # cells along x, y, z; of the scene's row: 0 where there is none
GRID_Y = 14
GRID_Z = 15
SIGN = 16  # how inside is decided: one of the three below
IS_TURNED = 17  # 0 where the part's rotation is the identity
IS_FUSED = 18  # 1 where the part's local frame is the scene's, and the part at the identity pose; of the
# scene's row: 1 where that holds for all, or there is only one
IS_DYNAMIC = 19  # 1 where the part has moved by itself: it stands whole in the tree over parts
IS_HIDDEN = 20  # 1 where no question finds it
REGION = 21  # of the scene's row: the super node, behind which the dynamic tree is
DYNAMIC_COUNT = 22  # of the scene's row: parts that are dynamic
BLOCK_NOTES = 23  # in words: of each block the part, and `FOLDED_AT`; the same for all parts
PART_COLUMNS = 24

FOLDED_AT = 23
"""First of the eight bits of a block's note that tell which of its faces are folded over; below, the part."""

NO_GRID = -1
SIGN_NONE = 0
SIGN_PSEUDONORMAL = 1
SIGN_WINDING = 2

# --- columns of ``frames`` (float64) ---
ROTATION = 0  # nine numbers, row by row: scene from part
TRANSLATION = 9  # scene from part
CENTRE = 12  # of the local frame, in the part's frame
SCALE = 15  # local units a metre, a power of two
GRID_LOWER = 16  # corner of the sign grid, local; of the scene's row: of the grid over it, m
GRID_RATE = 19  # cells a local unit; of the scene's row: a metre
BOX_LOWER = 20  # of the part's faces, in the scene's frame
BOX_UPPER = 23
OWN_LOWER = 26  # of the part's faces, in its own frame, m
OWN_UPPER = 29
VELOCITY = 32  # of the part's origin, scene's frame, m/s
ANGULAR_VELOCITY = 35  # rad/s, about the part's origin
SURFACE = 38  # see `contact`
STIFFNESS = 39  # N/m
DAMPING = 40  # N s/m
FRAME_COLUMNS = 48

# --- how a query turned out ---
ANSWERED = -1
"""Returned by queries that have answered every row; others return the first row that they could not."""
FEATURE_NONE = -1
FEATURE_FACE = 0
FEATURE_EDGE = 1
FEATURE_VERTEX = 2
