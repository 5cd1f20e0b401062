"""Closed shells one within another: which bound the same body, and which way they face.

A shell with material inside has a positive volume, a cavity a negative one. A shell's sign counts relative
to that of the shell around it, so that a hollow body that was exported inside out is turned as a whole. A
shell that faces the same way as the body around it is a body of its own (an insert, or a part that overlaps
another): nothing in the file says otherwise.
"""

import numpy as np

VOLUME_ROUNDING = 64 * np.finfo(np.float64).eps
"""A volume is zero when it drowns in the rounding of its coordinates; times area and diagonal."""

_WITNESS_COUNT = 5
"""Faces of a shell that are asked whether they lie within another. The majority counts: shells may touch."""


def enclosed_volumes(triangles: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return six times the signed volume of each shell, 0 where rounding leaves the sign open: (P,).

    *triangles* and *labels* as for `nest_shells`; means nothing for shells that are not closed.
    """
    shell, first = np.unique(labels, return_index=True)
    origin = triangles[first, 0]  # on the surface, so that a flat one comes out as zero
    a, b, c = np.moveaxis(triangles - origin[labels][:, None], 1, 0)
    volumes = np.bincount(labels, weights=np.einsum("ij,ij->i", a, np.cross(b, c)))
    normals = np.cross(b - a, c - a)
    areas = np.bincount(labels, weights=np.sqrt(np.einsum("ij,ij->i", normals, normals)))
    reach = np.zeros(len(shell))
    np.maximum.at(reach, labels, np.einsum("ij,ij->i", a, a))
    signed: np.ndarray = np.where(np.abs(volumes) > VOLUME_ROUNDING * areas * np.sqrt(reach), volumes, 0.0)
    return signed


def nest_shells(
    triangles: np.ndarray, labels: np.ndarray, volumes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each shell the shell whose body it belongs to, and whether it is to be turned.

    Parameters
    ----------
    triangles : (K, 3, 3) float64
        Corners of the faces, scaled to coordinates of at most 1; those of each shell run one way.
    labels : (K,) integers
        The shell of each face, 0 .. P - 1, none without a face.
    volumes : (P,) float64
        Signed, in any unit; a shell of none belongs to itself and stays as it is.

    Returns
    -------
    (P,) int64, (P,) bool
    """
    body, is_turned = np.arange(len(volumes)), np.zeros(len(volumes), dtype=bool)
    side = np.sign(volumes)
    if not (side < 0).any():
        return body, is_turned
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(len(volumes) + 1))
    shells = _Shells(triangles[order], starts, np.abs(volumes))
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
        face_lower, face_upper = triangles.min(axis=1), triangles.max(axis=1)
        self._face_lower, self._face_upper = face_lower.T.copy(), face_upper.T.copy()  # (3, K) each
        self._lower = np.minimum.reduceat(face_lower, starts[:-1])
        self._upper = np.maximum.reduceat(face_upper, starts[:-1])

    def smallest_around(self, shell: int) -> int:
        """The smallest larger shell that *shell* lies within; -1 if there is none."""
        is_candidate = self.sizes > self.sizes[shell]
        is_candidate &= (self._lower <= self._lower[shell]).all(axis=1)
        is_candidate &= (self._upper >= self._upper[shell]).all(axis=1)
        candidates = np.flatnonzero(is_candidate)
        witnesses = self._witnesses(shell)
        for candidate in candidates[np.argsort(self.sizes[candidates], kind="stable")]:
            column = self._column_of(candidate, shell)
            inside_count = sum(_crossing_count(column - witness) != 0 for witness in witnesses)
            if 2 * inside_count > len(witnesses):
                return int(candidate)
        return -1

    def _witnesses(self, shell: int) -> np.ndarray:
        """Middles of a few faces of *shell*."""
        first, end = self._starts[shell], self._starts[shell + 1]
        chosen = np.unique(np.linspace(first, end - 1, _WITNESS_COUNT).astype(np.int64))
        middles: np.ndarray = self._triangles[chosen].mean(axis=1)
        return middles

    def _column_of(self, candidate: int, shell: int) -> np.ndarray:
        """The triangles of *candidate* that a ray from *shell* along z may meet."""
        lower, upper = self._lower[shell], self._upper[shell]
        run = slice(self._starts[candidate], self._starts[candidate + 1])
        is_in_column = self._face_upper[2, run] >= lower[2]
        for axis in (0, 1):
            is_in_column &= self._face_lower[axis, run] <= upper[axis]
            is_in_column &= self._face_upper[axis, run] >= lower[axis]
        triangles: np.ndarray = self._triangles[run][is_in_column]
        return triangles


def _crossing_count(triangles: np.ndarray) -> int:
    """How often the z axis from the origin up leaves (K, 3, 3) *triangles* more than it enters: 0 if outside.

    An edge that two faces share is decided the same way for both, so that none is missed or counted twice.
    """
    following = np.roll(triangles, -1, axis=1)
    is_low, is_next_low = triangles[..., 1] < 0, following[..., 1] < 0
    # Seen along z: does the edge pass the x axis, and on its positive half? Asked from the low end upwards.
    low = np.where(is_low[..., None], triangles, following)
    high = np.where(is_low[..., None], following, triangles)
    passes = (is_low != is_next_low) & (low[..., 0] * high[..., 1] > low[..., 1] * high[..., 0])
    turns = np.where(is_low, 1, -1) * passes
    turn = turns.sum(axis=1)
    a, b, c = np.moveaxis(triangles, 1, 0)
    is_above = np.einsum("ij,ij->i", a, np.cross(b, c)) * turn > 0
    return int(turn[is_above].sum())
