"""Closed shells inside each other: which ones bound the same body, and how they face.

A shell with material inside has a positive volume, a cavity a negative one. A shell's sign counts relative
to that of the shell around it, so that a hollow body that was exported inside out is turned as a whole. A
shell that faces the same way as the body around it is a body of its own (an insert, or a part that overlaps
another): nothing in the file says otherwise. A shell with small holes counts as a closed one.
"""

import numpy as np

from proximity.kernels.entries import shell_sizes, winding_numbers
from proximity.kernels.thresholds import VOLUME_ROUNDING
from proximity.mesh.bvh import build_bvh, local_frame
from proximity.mesh.part_arrays import moments_of
from proximity.mesh.part_memory import joined

NEARLY_CLOSED = 0.8
"""A shell with holes has an inside where its winding number is clear on both sides of this share of its area.
Less than a sign asks for: an outer shell that gets one has been asked about its cavities."""

_UNCLEAR_TURNS = 0.1
"""Largest distance of a clear winding number from a whole one."""

_SAMPLE_COUNT = 64
"""Places on a shell with holes, of like areas, at which both sides are looked at."""

_VOTE_COUNT = 5
"""Faces of a shell that are asked whether they lie within another."""

_BESIDE = 2.0**-20
"""Distance at which both sides of a face are sampled, in sizes of the shell: of a face that lies on another
shell one side is within and one is not, so that the other faces decide."""


def enclosed_volumes(positions: np.ndarray, corners: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return six times the signed volume of each shell, 0 where rounding leaves the sign open: (P,).

    The arguments are those of `nest_shells`; roughly right for shells with small holes.
    """
    corners = np.ascontiguousarray(corners, dtype=np.int32)
    volumes, areas, reach = shell_sizes(positions, corners, labels.astype(np.int64), int(labels.max()) + 1)
    signed: np.ndarray = np.where(np.abs(volumes) > VOLUME_ROUNDING * areas * reach, volumes, 0.0)
    return signed


def nest_shells(
    positions: np.ndarray,
    corners: np.ndarray,
    labels: np.ndarray,
    volumes: np.ndarray,
    is_closed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each shell the shell whose body it belongs to, and whether it is to be turned.

    *positions*: (C, 3). *corners*: (K, 3); rows of *positions*, a face each; those of each closed shell run
    one way. *labels*: the shell of each face, 0 .. P - 1, none without a face. *volumes*: signed, in any
    unit; a shell of none belongs to itself and stays as it is. *is_closed*: the others have holes; those that
    have no inside belong to themselves and stay as they are.
    """
    body, is_turned = np.arange(len(volumes)), np.zeros(len(volumes), dtype=bool)
    if not (volumes < 0).any():
        return body, is_turned
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(len(volumes) + 1))
    shells = _Shells(positions[corners[order]], starts, np.abs(volumes))
    side = np.sign(volumes)
    for shell in np.flatnonzero(~is_closed & (volumes != 0)).tolist():
        if volumes[shell] < 0 or shells.is_nested(shell):
            side[shell] = shells.clear_side(shell)
    shells.sizes[side == 0] = 0.0
    is_cavity = np.zeros(len(volumes), dtype=bool)
    # Largest first: a shell comes after those around it.
    for shell in np.argsort(-shells.sizes, kind="stable")[: np.count_nonzero(side)]:
        around = shells.smallest_around(shell)
        is_cavity[shell] = around >= 0 and not is_cavity[around] and side[shell] != side[around]
        if is_cavity[shell]:
            body[shell], is_turned[shell] = around, is_turned[around]
        else:
            is_turned[shell] = side[shell] < 0
    return body, is_turned


class _Shells:
    """Which shell lies within which."""

    def __init__(self, triangles: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> None:
        self._triangles, self._starts = triangles, starts
        self.sizes = sizes  # (P,) 0: not a shell to lie in
        self._lower = np.minimum.reduceat(triangles.min(axis=1), starts[:-1]).T.copy()  # (3, P)
        self._upper = np.maximum.reduceat(triangles.max(axis=1), starts[:-1]).T.copy()
        self._windings: dict[int, ShellWinding] = {}

    def is_nested(self, shell: int) -> bool:
        """Whether by its box *shell* may lie within another, or another within it."""
        is_other = self.sizes > 0
        is_other[shell] = False
        lower, upper = self._lower[:, [shell]], self._upper[:, [shell]]
        is_around = ((self._lower <= lower) & (self._upper >= upper)).all(axis=0)
        is_within = ((self._lower >= lower) & (self._upper <= upper)).all(axis=0)
        return bool((is_other & (is_around | is_within)).any())

    def clear_side(self, shell: int) -> int:
        """1 where a shell with holes has its inside below its faces, -1 above them, 0 if it has none."""
        triangles = self._faces_of(shell)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        reached = np.cumsum(np.sqrt(np.einsum("ij,ij->i", normals, normals)))
        sampled_areas = (np.arange(_SAMPLE_COUNT) + 0.5) / _SAMPLE_COUNT * reached[-1]
        above, below = self._turns_beside(shell, triangles[np.searchsorted(reached, sampled_areas)], shell)
        is_clear = np.maximum(abs(above - np.rint(above)), abs(below - np.rint(below))) < _UNCLEAR_TURNS
        for side, inner, outer in ((1, below, above), (-1, above, below)):
            has_side = is_clear & (np.rint(inner) == side) & (np.rint(outer) == 0)
            if has_side.mean() >= NEARLY_CLOSED:
                return side
        return 0

    def smallest_around(self, shell: int) -> int:
        """The smallest larger shell that *shell* lies within; -1 if there is none."""
        candidates = np.flatnonzero(self.sizes > self.sizes[shell])
        for lower, upper in zip(self._lower, self._upper, strict=True):
            is_around = (lower[candidates] <= lower[shell]) & (upper[candidates] >= upper[shell])
            candidates = candidates[is_around]
        triangles = self._faces_of(shell)
        chosen = np.unique(np.linspace(0, len(triangles) - 1, _VOTE_COUNT).astype(np.int64))
        for candidate in candidates[np.argsort(self.sizes[candidates], kind="stable")]:
            turns = self._turns_beside(shell, triangles[chosen], candidate)
            if np.minimum(np.abs(turns), 1.0).mean() > 0.5:
                return int(candidate)
        return -1

    def _faces_of(self, shell: int) -> np.ndarray:
        triangles: np.ndarray = self._triangles[self._starts[shell] : self._starts[shell + 1]]
        return triangles

    def _turns_beside(self, shell: int, triangles: np.ndarray, other: int) -> np.ndarray:
        """Winding numbers of *other* above and below (N, 3, 3) faces of *shell*: (2, N)."""
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)[:, None]
        step = _BESIDE * (self._upper[:, shell] - self._lower[:, shell]).max()
        steps = step * normals / np.where(lengths > 0, lengths, 1.0)
        middles = triangles.mean(axis=1)
        if other not in self._windings:
            self._windings[other] = ShellWinding(self._faces_of(other))
        return self._windings[other].turns(np.stack([middles + steps, middles - steps]))


class ShellWinding:
    """The winding number of one shell: whole for a closed one, to a few hundredths.

    *triangles*: (K, 3, 3).
    """

    def __init__(self, triangles: np.ndarray) -> None:
        corners = triangles.reshape(-1, 3)
        self._frame = local_frame(corners.min(axis=0), corners.max(axis=0))
        faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        bvh = build_bvh(np.ascontiguousarray(self._frame.of(corners)), faces)
        self._words, (_, self._moments) = joined([[bvh.nodes], [moments_of(bvh)]], np.float32)
        self._blocks = bvh.blocks

    def turns(self, points: np.ndarray) -> np.ndarray:
        """Return how often the shell winds around *points* (..., 3)."""
        local = np.ascontiguousarray(self._frame.of(points)).reshape(-1, 3)
        turns = np.empty(len(local))
        winding_numbers(self._blocks, self._words, 0, self._moments, local, turns)
        return turns.reshape(points.shape[:-1])
