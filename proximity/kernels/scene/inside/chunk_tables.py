"""Tables for points that take each step of a query together, a chunk at a time.

Row *k* of a table is of the *k*-th point of the chunk.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.closest_feature import CLOSEST
from proximity.kernels.geometry.closest_lanes import LANES_COLUMNS
from proximity.kernels.layout import LANES, NO_PART, NO_SLOT, STACKS_SIZE
from proximity.kernels.stack_arrays import stack_bundle
from proximity.native import inlined

POINT_CHUNK = 64
"""Points that go through each step together."""
RECENT_PARTS = 16
"""Parts of which it is remembered what was found in them last."""


class Chunk(NamedTuple):
    """The points that are asked together."""

    points: np.ndarray  # (N, 3) float64, m, scene's frame: all points of the query
    rows: np.ndarray  # (POINT_CHUNK,) int64, of *points*
    point_count: int  # rows in use


class Candidates(NamedTuple):
    """Which parts may contain each point."""

    certain: np.ndarray  # (POINT_CHUNK,) int64, 1 where a part contains the point for certain
    lists: np.ndarray  # (POINT_CHUNK, 2) int64, where parts are listed, see `part_grid.list_of`
    pairs: np.ndarray  # (POINT_CHUNK * LANES, 3) int64: row of the chunk, part, state of its sign grid
    positions: np.ndarray  # (POINT_CHUNK, 3) float32, in the scene's scaled frame


class Found(NamedTuple):
    """Results so far, for each point."""

    nearest: np.ndarray  # (POINT_CHUNK + 1, 2) int64, part or NO_PART, slot; last: the chunk's last answer
    depths: np.ndarray  # (POINT_CHUNK,) float64, squared depth, scene's scaled frame; -1: not inside
    deeper: np.ndarray  # (POINT_CHUNK, 2) int64, part that contains it deepest, or NO_PART, and slot
    distances: np.ndarray  # (POINT_CHUNK,) float64, signed, m; inf or nan where there is no answer


class Features(NamedTuple):
    """What is closest to each point, of the triangle that is nearest to it."""

    offsets: np.ndarray  # (POINT_CHUNK,) int64, see `offset_of`
    local_points: np.ndarray  # (3 * POINT_CHUNK,) float64, local frame, coordinate by coordinate
    table: np.ndarray  # (LANES_COLUMNS * POINT_CHUNK,) float64, see `closest_lanes`


class Workspace(NamedTuple):
    """Scratch for queries of single parts."""

    stacks: np.ndarray  # (STACKS_SIZE,) float32, see `traversal`
    closest: np.ndarray  # (1,) CLOSEST, see `closest_feature`
    recent: np.ndarray  # (RECENT_PARTS, 2) int64, parts asked last and slots found there, where walks start


new_candidates = stack_bundle(
    Candidates,
    ("int64", POINT_CHUNK),
    ("int64", POINT_CHUNK, 2),
    ("int64", POINT_CHUNK * LANES, 3),
    ("float32", POINT_CHUNK, 3),
)
new_found = stack_bundle(
    Found,
    ("int64", POINT_CHUNK + 1, 2),
    ("float64", POINT_CHUNK),
    ("int64", POINT_CHUNK, 2),
    ("float64", POINT_CHUNK),
)
new_features = stack_bundle(
    Features, ("int64", POINT_CHUNK), ("float64", 3 * POINT_CHUNK), ("float64", LANES_COLUMNS * POINT_CHUNK)
)
new_workspace = stack_bundle(Workspace, ("float32", STACKS_SIZE), (CLOSEST, 1), ("int64", RECENT_PARTS, 2))


@inlined
def reset_recent(workspace):
    """Mark the parts asked last as unknown."""
    for k in range(RECENT_PARTS):
        workspace.recent[k, 0] = NO_PART


@inlined
def reset_found(found, workspace):
    """Mark what has been found, and the parts asked last, as unknown."""
    found.nearest[POINT_CHUNK, 0], found.nearest[POINT_CHUNK, 1] = NO_PART, NO_SLOT
    reset_recent(workspace)
