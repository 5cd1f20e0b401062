"""Tables of a chunk: points that go through each step of a query together, and what is noted of each.

Row *k* of a table is of the *k*-th point of the chunk.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.closest_feature import WITNESS_SIZE
from proximity.kernels.layout import LANES, NO_PART, NO_SLOT, STACKS_SIZE
from proximity.kernels.stack_arrays import bundle_here
from proximity.native import inlined

CHUNK = 64
"""Points that go through each step together."""
RECENT = 16
"""Parts of which it is remembered what was found in them last."""


class Chunk(NamedTuple):
    """The points that are asked together."""

    points: np.ndarray  # (N, 3) float64, m, scene's frame: all points of the query
    rows: np.ndarray  # (CHUNK,) int64, of *points*
    point_count: int  # rows in use


class Candidates(NamedTuple):
    """Which parts may contain each point."""

    certain: np.ndarray  # (CHUNK,) int64, 1 where a part contains the point for certain
    lists: np.ndarray  # (CHUNK, 2) int64, where parts are listed, see `part_grid.list_of`
    pairs: np.ndarray  # (CHUNK * LANES, 3) int64: row of the chunk, part, and state of the part's sign grid
    positions: np.ndarray  # (CHUNK, 3) float32, in the scene's scaled frame


class Found(NamedTuple):
    """What has been found of each point."""

    nearest: np.ndarray  # (CHUNK + 1, 2) int64, part, or NO_PART, and slot; last: what the chunk ended with
    depths: np.ndarray  # (CHUNK,) float64, squared, scene's scaled frame: how deep inside; -1: not inside
    deeper: np.ndarray  # (CHUNK, 2) int64, part that contains it deepest, or NO_PART, and slot
    distances: np.ndarray  # (CHUNK,) float64, signed, m; inf or nan where there is no answer


class Heights(NamedTuple):
    """Points over the faces that are nearest to them."""

    places: np.ndarray  # (CHUNK,) int64, see `place_of`
    spots: np.ndarray  # (3 * CHUNK,) float64, points in the local frame, coordinate by coordinate
    heights: np.ndarray  # (CHUNK,) float64, local
    is_over: np.ndarray  # (CHUNK,) float64, 1 of points with their feet inside the face


class Workspace(NamedTuple):
    """What asking single parts takes."""

    stacks: np.ndarray  # (STACKS_SIZE,) float32, see `traversal`
    witness: np.ndarray  # (WITNESS_SIZE,) float64, see `closest_feature`
    recent: np.ndarray  # (RECENT, 2) int64, parts asked last and slots found there, where walks start


candidates_here = bundle_here(
    Candidates,
    ("int64", CHUNK),
    ("int64", CHUNK, 2),
    ("int64", CHUNK * LANES, 3),
    ("float32", CHUNK, 3),
)
found_here = bundle_here(
    Found,
    ("int64", CHUNK + 1, 2),
    ("float64", CHUNK),
    ("int64", CHUNK, 2),
    ("float64", CHUNK),
)
heights_here = bundle_here(
    Heights,
    ("int64", CHUNK),
    ("float64", 3 * CHUNK),
    ("float64", CHUNK),
    ("float64", CHUNK),
)
workspace_here = bundle_here(
    Workspace,
    ("float32", STACKS_SIZE),
    ("float64", WITNESS_SIZE),
    ("int64", RECENT, 2),
)


@inlined
def forget(workspace):
    """Say in a workspace that nothing has been found yet."""
    for k in range(RECENT):
        workspace.recent[k, 0] = NO_PART


@inlined
def begin(found, workspace):
    """Say in the tables that nothing has been found yet."""
    found.nearest[CHUNK, 0], found.nearest[CHUNK, 1] = NO_PART, NO_SLOT
    forget(workspace)
