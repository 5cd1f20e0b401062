"""Tables for queries that process points in chunks, each step for all points of a chunk.

Row *k* of a table belongs to the *k*-th point of the chunk.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.closest_feature import CLOSEST
from proximity.kernels.geometry.closest_lanes import LANES_COLUMNS
from proximity.kernels.layout import LANES, NO_PART, NO_SLOT, STACKS_SIZE
from proximity.kernels.stack_arrays import stack_bundle
from proximity.native import inlined

POINT_CHUNK = 64
"""Points of a chunk."""
RECENT_PARTS = 16
"""Parts whose last result is stored, as a start for the next search."""


class Chunk(NamedTuple):
    """The points of a chunk."""

    points: np.ndarray  # (N, 3) float64, m, scene's frame: all points of the query
    rows: np.ndarray  # (POINT_CHUNK,) int64, of *points*
    point_count: int  # rows in use


class Candidates(NamedTuple):
    """The parts that may contain each point."""

    certain: np.ndarray  # (POINT_CHUNK,) int64, 1 if a part certainly contains the point
    lists: np.ndarray  # (POINT_CHUNK, 2) int64, ends of the list of parts, see `part_grid.list_of`
    pairs: np.ndarray  # (POINT_CHUNK * LANES, 3) int64: row of the chunk, part, state of its sign grid
    positions: np.ndarray  # (POINT_CHUNK, 3) float32, in the scene's scaled frame


class Found(NamedTuple):
    """Intermediate results of each point."""

    nearest: np.ndarray  # (POINT_CHUNK + 1, 2) int64, part or NO_PART, slot; last row: of the previous chunk
    depths: np.ndarray  # (POINT_CHUNK,) float64, squared depth, scene's scaled frame; -1: not inside
    deeper: np.ndarray  # (POINT_CHUNK, 2) int64, part with the largest depth, or NO_PART, and slot
    distances: np.ndarray  # (POINT_CHUNK,) float64, signed, m; inf or nan if not found


class Features(NamedTuple):
    """The closest feature of each point, on its nearest triangle."""

    offsets: np.ndarray  # (POINT_CHUNK,) int64, see `offset_of`
    local_points: np.ndarray  # (3 * POINT_CHUNK,) float64, local frame, coordinate by coordinate
    parts: np.ndarray  # (POINT_CHUNK,) int64, of the triangles, or NO_PART
    slots: np.ndarray  # (POINT_CHUNK,) int64
    faces: np.ndarray  # (POINT_CHUNK,) int64
    are_inside: np.ndarray  # (POINT_CHUNK,) int64, 1 if the point is certainly inside the part
    table: np.ndarray  # (LANES_COLUMNS * POINT_CHUNK,) float64, see `closest_lanes`


class Workspace(NamedTuple):
    """Scratch for queries of single parts."""

    stacks: np.ndarray  # (STACKS_SIZE,) float32, see `traversal`
    closest: np.ndarray  # (1,) CLOSEST, see `closest_feature`
    recent: np.ndarray  # (RECENT_PARTS, 2) int64, parts searched last and slots found there, to start from


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
    Features,
    ("int64", POINT_CHUNK),
    ("float64", 3 * POINT_CHUNK),
    ("int64", POINT_CHUNK),
    ("int64", POINT_CHUNK),
    ("int64", POINT_CHUNK),
    ("int64", POINT_CHUNK),
    ("float64", LANES_COLUMNS * POINT_CHUNK),
)
new_workspace = stack_bundle(Workspace, ("float32", STACKS_SIZE), (CLOSEST, 1), ("int64", RECENT_PARTS, 2))


@inlined
def reset_recent(workspace):
    """Clear the parts searched last."""
    for k in range(RECENT_PARTS):
        workspace.recent[k, 0] = NO_PART


@inlined
def reset_found(found, workspace):
    """Clear the previous result, and the parts searched last."""
    found.nearest[POINT_CHUNK, 0], found.nearest[POINT_CHUNK, 1] = NO_PART, NO_SLOT
    reset_recent(workspace)
