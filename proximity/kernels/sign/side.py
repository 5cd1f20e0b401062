"""Inside or outside of one part, decided by its nearest triangle."""

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_ARM,
    CLOSEST_LENGTH,
    CLOSEST_NORMAL,
    CLOSEST_TRIANGLE,
    closest_on_triangle,
    over_face,
    pseudo_normal,
    read_corners,
)
from proximity.kernels.geometry.closest_lanes import LANES_COLUMNS, LANES_FEATURE, LANES_WHICH
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import NO_GRID, SIGN_NONE, SIGN_PSEUDONORMAL
from proximity.kernels.sign.folded_faces import is_folded
from proximity.kernels.sign.winding_along_ray import winding_along_ray
from proximity.kernels.sign.winding_number import winding_number
from proximity.native import inlined
from proximity.native.simd import load_int

LEAST_SIDE_SINE = 1e-6
"""Sine of the angle between the direction to the closest point and the plane across the pseudo-normal below
which the side is not believed: rounding, at a point 1e-9 part sizes away, turns that direction by 1e-7. The
winding number decides there."""


@inlined
def is_inside_by_winding(reals, words, parts, part, px, py, pz):
    """Whether *p*, local, has a winding number above one half, and how many nodes and leaves that took.

    Of a part with holes the number is expanded; that takes no budget.
    """
    root = parts[part].root
    if parts[part].sign == SIGN_PSEUDONORMAL or parts[part].grid != NO_GRID:
        turns, steps = winding_along_ray(reals, words, root, px, py, pz)
        return turns > 0, steps
    turns = winding_number(reals, words, root, parts[part].moments, px, py, pz)
    return turns > 0.5, np.int64(0)


@inlined
def is_beyond(px, py, pz):
    """Whether *p* is outside the cube that holds the part: from far away both sides may be equally near."""
    return max(abs(px), abs(py), abs(pz)) > 1.0


@inlined
def has_normals(words, parts, part, slot):
    """Whether the side of a face, and of its edges and corners, is decided by their normals."""
    return parts[part].sign == SIGN_PSEUDONORMAL and not is_folded(words, parts[part].block_notes, slot)


@inlined
def closest_of_slot(reals, words, parts, part, slot, px, py, pz, closest):
    """Fill *closest* for a triangle found; return face, feature and whether *p* is inside the part."""
    read_corners(reals, slot, closest)
    face = load_int(words, parts[part].slot_faces + slot)
    feature, which = closest_on_triangle(px, py, pz, closest)
    pseudo_normal(reals, words, parts, part, face, feature, which, closest)
    return face, feature, _is_inside(reals, words, parts, part, slot, px, py, pz, closest)


@inlined
def closest_of_lane(reals, words, parts, part, slot, px, py, pz, table, k, closest):
    """As `closest_of_slot`, of what `closest_lanes.closest_of_lanes` has filled in column *k* of *table*."""
    chunk = len(table) // LANES_COLUMNS
    for column in range(CLOSEST_TRIANGLE):
        closest[column] = table[column * chunk + k]
    feature, which = np.int64(table[LANES_FEATURE * chunk + k]), np.int64(table[LANES_WHICH * chunk + k])
    face = load_int(words, parts[part].slot_faces + slot)
    pseudo_normal(reals, words, parts, part, face, feature, which, closest)
    return face, feature, _is_inside(reals, words, parts, part, slot, px, py, pz, closest)


@inlined
def _is_inside(reals, words, parts, part, slot, px, py, pz, closest):
    """The side by a filled closest feature; on the surface: outside."""
    sign = parts[part].sign
    length = closest[CLOSEST_LENGTH]
    if sign == SIGN_NONE or length == 0.0 or is_beyond(px, py, pz):
        return False
    if has_normals(words, parts, part, slot):
        side = dot(
            closest[CLOSEST_ARM],
            closest[CLOSEST_ARM + 1],
            closest[CLOSEST_ARM + 2],
            closest[CLOSEST_NORMAL],
            closest[CLOSEST_NORMAL + 1],
            closest[CLOSEST_NORMAL + 2],
        )
        if abs(side) > LEAST_SIDE_SINE * length:
            return side < 0.0
    is_inside, _ = is_inside_by_winding(reals, words, parts, part, px, py, pz)
    return is_inside


@inlined
def signed_of_slot(reals, words, parts, part, slot, px, py, pz, closest):
    """Signed local distance to a triangle found; what `closest_of_slot` would tell, without the rest."""
    read_corners(reals, slot, closest)
    if has_normals(words, parts, part, slot):
        is_over, height = over_face(closest, px, py, pz)
        if is_over and not is_beyond(px, py, pz):
            return height + 0.0  # never -0.0
    _, _, inside = closest_of_slot(reals, words, parts, part, slot, px, py, pz, closest)
    return -closest[CLOSEST_LENGTH] if inside else closest[CLOSEST_LENGTH]
