"""The choice of how inside is decided for a body, checked by sampling.

- *pseudo-normal*: the surface is closed and oriented, so the normal of the nearest feature tells the side;
  over faces that are folded onto their neighbours, pass through others or are as thin as a line, the winding
  number.
- *winding number*: the surface is closed but much of it meets itself, or it has small holes; how often it
  winds around a point tells.
- *none*: a sheet, or a surface with large holes. There is no inside; distances have no sign.
"""

from dataclasses import replace
from enum import Enum
from functools import cache

import numpy as np

from proximity.kernels import layout
from proximity.kernels.answers import POINT_ANSWER_WIDTH
from proximity.kernels.entries import closest_batch, double_areas, uncertain_points, winding_numbers
from proximity.mesh.part_arrays import (
    NO_FOLDED,
    PartArrays,
    beside_thin_faces,
    with_passing_faces,
    with_sign,
)
from proximity.mesh.topology import Topology
from proximity.scene.model.assembly import Model, model_of_piece

POINT_SAMPLE_COUNT = 64
"""Points on the surface from which both sides are looked at."""
SAMPLE_OFFSETS = (1e-6, 3e-2)
"""Distances from the surface, in sizes of the part: just beside it, and where other faces may be nearest."""
SAMPLE_SEED = 7
FACE_SAMPLE_COUNT = 128
"""Points close above those faces whose sides the sign grid does not tell, at most; where a part has no more
faces than this, above any of them."""
FACE_SAMPLE_WEIGHTS = np.array([[100, 100, 100], [298, 1, 1], [1, 298, 1], [1, 1, 298]]) / 300.0
"""Weights of a face's corners at the points: in its middle, and near its corners, which reach in first."""
CLEAR_TURNS = 0.95
"""An open surface has an inside where just below it the winding number is above this ..."""
CLEAR_SHARE = 0.95
"""... on this share of its area. A sheet, a hemisphere or a box without its lid does not get there."""


class SignMethod(Enum):
    """The method that decides the sign of a distance.

    PSEUDONORMAL: by the normal of the nearest face, edge or corner of a closed and oriented surface.
    WINDING_NUMBER: by how often the surface winds around the point, if it is closed but intersects itself,
    or has small holes. NONE: there is no inside, and distances have no sign.
    """

    PSEUDONORMAL = "pseudo-normal"
    WINDING_NUMBER = "winding number"
    NONE = "none"


_KERNEL_SIGN = {
    SignMethod.PSEUDONORMAL: layout.SIGN_PSEUDONORMAL,
    SignMethod.WINDING_NUMBER: layout.SIGN_WINDING,
    SignMethod.NONE: layout.SIGN_NONE,
}


def kernel_sign(method: SignMethod) -> int:
    """Return the ``layout.SIGN_*`` of a method."""
    return _KERNEL_SIGN[method]


def choose_sign(piece: PartArrays, topology: Topology) -> tuple[Model, SignMethod, str]:
    """Return the model of a part with its sign, the method, and why.

    Notes
    -----
    Source: Bærentzen & Aanæs 2005 (pseudo-normals), Jacobson et al. 2013 (winding numbers).
    """
    points, normals = _surface_samples(piece)
    if len(points) == 0:
        why = "no face has an area: there is no inside, so distances have no sign"
        return model_of_piece(piece), SignMethod.NONE, why
    if topology.is_watertight:
        signed = with_sign(piece, layout.SIGN_PSEUDONORMAL, has_grid=True)
        model = model_of_piece(signed)
        asked, against = _contradictions(signed, model, points, normals)
        if against == 0:
            why = f"closed and oriented; agrees with the winding number at {asked} of {asked} sample points"
            passed = with_passing_faces(signed)
            if passed.folded.any():
                why += _exceptions(passed)
            is_same = np.array_equal(passed.folded, signed.folded)
            return model if is_same else model_of_piece(passed), SignMethod.PSEUDONORMAL, why
        why = (
            "closed and oriented, but it intersects itself or has shells that face the wrong way: the "
            f"nearest face and the winding number disagree at {against} of {asked} sample points"
        )
        wound = replace(signed, sign=layout.SIGN_WINDING, folded=NO_FOLDED)
        return model_of_piece(wound), SignMethod.WINDING_NUMBER, why
    if topology.is_balanced:
        why = "closed, but edges have more than two faces"
        wound = with_sign(piece, layout.SIGN_WINDING, has_grid=True)
        return model_of_piece(wound), SignMethod.WINDING_NUMBER, why
    share = _clear_share(piece, points, normals)
    if share >= CLEAR_SHARE:
        why = f"not closed, but the winding number is clear below {share:.0%} of the surface"
        wound = with_sign(piece, layout.SIGN_WINDING, has_grid=False)
        return model_of_piece(wound), SignMethod.WINDING_NUMBER, why
    why = "not closed: there is no inside, so distances have no sign"
    return model_of_piece(piece), SignMethod.NONE, why


def _exceptions(signed: PartArrays) -> str:
    """Where and why the winding number decides inside and outside of a part that has pseudo-normals."""
    thin_count = int(np.unpackbits(beside_thin_faces(signed)).sum())
    folded_count = int(np.unpackbits(signed.folded).sum()) - thin_count
    kinds = ((thin_count, "as thin as a line"), (folded_count, "folded over, or pass through others"))
    return "".join(
        f"; {count} faces are {kind}, or next to such faces: there the winding number decides"
        for count, kind in kinds
        if count
    )


def _surface_samples(piece: PartArrays) -> tuple[np.ndarray, np.ndarray]:
    """Points on faces, by area, and the faces' unit normals; local frame."""
    areas = double_areas(piece.corners, piece.faces)
    if not areas.sum() > 0.0:
        return np.empty((0, 3)), np.empty((0, 3))
    shares, weights = _random_samples()
    chosen = np.searchsorted(np.cumsum(areas), shares * areas.sum(), side="right")
    chosen = np.minimum(chosen, len(areas) - 1)
    return _placed(piece.corners[piece.faces[chosen]], weights)


@cache
def _random_samples() -> tuple[np.ndarray, np.ndarray]:
    """Shares of a surface, and weights of corners: the same for every part."""
    rng = np.random.default_rng(SAMPLE_SEED)
    return rng.random(POINT_SAMPLE_COUNT), rng.dirichlet((1.0, 1.0, 1.0), POINT_SAMPLE_COUNT)


def _turns(model: Model, points: np.ndarray) -> np.ndarray:
    """Winding numbers of a model's only part at local points."""
    root, moments = int(model.parts["root"][0]), int(model.parts["moments"][0])
    turns = np.empty(len(points))
    winding_numbers(model.reals, model.words, root, moments, np.ascontiguousarray(points), turns)
    return turns


def _contradictions(
    signed: PartArrays, model: Model, points: np.ndarray, normals: np.ndarray
) -> tuple[int, int]:
    """Number of points that were asked, and of those at which the two methods disagree about the side.

    *points*, *normals*: (N, 3).

    Notes
    -----
    Where a surface does not meet itself, it winds 0 times around what is just above it and once around what
    is just below. Where it does, curves in which it meets itself part it into regions, and in some of them
    that is wrong everywhere: so a look at each region would do. The sign grid is looked at next to all faces,
    for regions some cells wide; faces next to which it tells nothing are sampled, for those of small faces.
    """
    offsets = signed.size * np.array(SAMPLE_OFFSETS)
    around = np.concatenate([points + side * offset * normals for offset in offsets for side in (-1.0, 1.0)])
    grid_lower = np.array(signed.grid_lower)
    uncertain, is_inside, is_clear = uncertain_points(
        signed.corners, signed.faces, grid_lower, signed.grid_rate, *signed.grid_counts, signed.grid
    )
    is_clear &= len(is_clear) > FACE_SAMPLE_COUNT
    # What is folded over has been looked at, and gets its sides from the winding number.
    is_clear[signed.bvh.slot_faces[np.unpackbits(signed.folded, bitorder="little") == 1]] = True
    points, normals = _face_samples(signed, np.flatnonzero(~is_clear))
    bare = model
    if signed.folded.any():
        # Asked as if nothing were folded: a surface of which much is meets itself.
        bare = model_of_piece(replace(signed, folded=beside_thin_faces(signed), memory=None))
    above = points + offsets[0] * normals
    against = _differing(bare, signed, around) + _differing(model, signed, above)
    against += _differing(model, signed, uncertain, is_inside)
    return len(around) + len(above) + len(uncertain), against


def _face_samples(piece: PartArrays, among: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over faces, whatever their areas, and the faces' unit normals; local frame."""
    sample_count = len(FACE_SAMPLE_WEIGHTS) * len(among)
    count = min(FACE_SAMPLE_COUNT, sample_count)
    chosen, sample = np.divmod(np.arange(count) * sample_count // max(count, 1), len(FACE_SAMPLE_WEIGHTS))
    return _placed(piece.corners[piece.faces[among[chosen]]], FACE_SAMPLE_WEIGHTS[sample])


def _placed(corners: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of (N, 3, 3) *corners* by their weights, (N, 3), with unit normals; where there is an area."""
    a, b = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
    normals = np.stack(
        [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)], axis=1
    )  # np.cross is slow
    areas = np.sqrt((normals * normals).sum(axis=1))
    points = (corners * weights[:, :, None]).sum(axis=1)
    if not areas.all():
        points, normals, areas = points[areas > 0.0], normals[areas > 0.0], areas[areas > 0.0]
    return points, normals / areas[:, None]


def _differing(
    model: Model, piece: PartArrays, asked: np.ndarray, is_inside: np.ndarray | None = None
) -> int:
    """At how many local points the sign of a part's distances and the winding number differ.

    *is_inside* (N,): what the sign grid tells of them; then only those are asked where that differs.
    """
    size = piece.size
    answers = np.empty((len(asked), POINT_ANSWER_WIDTH))
    world = asked / piece.frame.scale + piece.frame.centre
    # Far from the origin this rounds; both methods are asked about the point that it has become.
    asked = piece.frame.of(world)
    closest_batch(model.packed, world, np.empty(0, np.int64), np.full(1, np.inf), answers)
    if is_inside is not None:
        suspect = (answers[:, 0] < 0.0) != is_inside
        asked, answers = asked[suspect], answers[suspect]
    turns = _turns(model, asked)
    # On the surface itself, to rounding, no side is right.
    is_off = np.abs(answers[:, 0]) * piece.frame.scale > 1e-9 * size
    differs = (answers[:, 0] < 0.0) != (turns > 0.5)
    unclear = np.abs(turns - np.rint(turns)) > 0.2
    twice = np.abs(turns - 0.5) > 0.7
    return int((is_off & (differs | unclear | twice)).sum())


def _clear_share(piece: PartArrays, points: np.ndarray, normals: np.ndarray) -> float:
    """The share of the area with a winding number near 1 just below and near 0 just above."""
    model = model_of_piece(piece)
    step = SAMPLE_OFFSETS[0] * piece.size
    below, above = _turns(model, points - step * normals), _turns(model, points + step * normals)
    return float(np.mean((below > CLEAR_TURNS) & (above < 1.0 - CLEAR_TURNS)))
