"""The grid over a scene that lists the parts that may contain a point."""

from dataclasses import dataclass

import numpy as np

from proximity.kernels import layout
from proximity.kernels.entries import cells_of_part
from proximity.mesh.part_arrays import PartArrays, grid_size

CELLS_PER_PART = 64
"""On 118 touching parts signed distances take as long with sixteen times as many."""
MOST_CELLS = 2**18
LONGEST = 4
"""Parts listed a cell, on average, at most; where there are more, cells are larger and fewer."""


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Lists of parts, a cell each."""

    words: np.ndarray  # int32: where in itself each cell's list begins, where the last ends, and the lists
    counts: tuple[int, int, int]  # cells along x, y, z
    lower: np.ndarray  # (3,) m, scene's frame: corner of the grid
    rate: float  # cells a metre


NOTHING = Occupancy(np.zeros(0, np.int32), (0, 0, 0), np.zeros(3), 0.0)


def occupancy(pieces: list[PartArrays], frames: np.ndarray, parts: np.ndarray) -> Occupancy:
    """Return which parts may hold a point, of those that are not dynamic.

    *frames*, *parts*: of the model, complete but for what comes of this.
    """
    if len(pieces) == 1:
        return NOTHING
    rows = [
        row
        for row, piece in enumerate(pieces)
        if piece.sign != layout.SIGN_NONE and not parts["is_dynamic"][row]
    ]
    if not rows:
        return NOTHING
    lower = frames["box_lower"][rows].min(axis=0)
    upper = frames["box_upper"][rows].max(axis=0)
    wanted = min(CELLS_PER_PART * len(rows), MOST_CELLS)
    while True:
        rate, counts = grid_size(upper - lower, wanted)
        limit = LONGEST * int(np.prod(counts)) if wanted > 1 else None
        cells = _cells(rows, pieces, frames, parts, lower, rate, counts, limit)
        if cells is not None:
            return Occupancy(_listed(cells, rows, int(np.prod(counts))), counts, lower, rate)
        wanted = max(wanted // 8, 1)


def _cells(
    rows: list[int],
    pieces: list[PartArrays],
    frames: np.ndarray,
    parts: np.ndarray,
    lower: np.ndarray,
    rate: float,
    counts: tuple[int, int, int],
    limit: int | None,
) -> list[np.ndarray] | None:
    """The cells of each part; None where there are more than *limit* in all."""
    cells: list[np.ndarray] = []
    total = 0
    for row in rows:
        cells.append(cells_of_part(frames, parts, row, pieces[row].grid, lower, rate, *counts))
        total += len(cells[-1])
        if limit is not None and total > limit:
            return None
    return cells


def _listed(cells: list[np.ndarray], rows: list[int], cell_count: int) -> np.ndarray:
    everywhere = np.concatenate(cells)
    listed = np.repeat(np.array(rows, np.int32), [len(own) for own in cells])
    # Within a cell parts stay in their order.
    order = np.argsort(everywhere, kind="stable")
    ends = np.cumsum(np.bincount(everywhere, minlength=cell_count))
    starts = np.concatenate(([0], ends)) + cell_count + 1
    return np.concatenate((starts.astype(np.int32), listed[order]))
