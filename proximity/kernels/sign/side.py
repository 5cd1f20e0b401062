"""Decision between inside and outside of one part, by the nearest triangle."""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    over_face,
    read_corners,
)
from proximity.kernels.geometry.closest_lanes import LANES_COLUMNS, read_row
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import (
    FEATURE_EDGE,
    FEATURE_VERTEX,
    FOLDED_AT,
    LANES,
    NO_GRID,
    SIGN_NONE,
    SIGN_PSEUDONORMAL,
)
from proximity.kernels.sign.winding_along_ray import winding_along_ray
from proximity.kernels.sign.winding_number import winding_number
from proximity.native import inlined
from proximity.native.simd import load_int

MIN_SIDE_SINE = 1e-6
"""Minimum sine of the angle between the direction to the closest point and a plane.

The plane is perpendicular to the pseudo-normal. Below the minimum, the winding number decides the sign:
rounding rotates that direction by 1e-7 at a point 1e-9 part sizes away.
"""


@inlined
def is_inside_by_winding(model, part, p):
    """Test whether a local point has a winding number above one half.

    Return also how many nodes and leaves were visited. For a part with holes the number is computed by
    expansion, and no steps are counted.
    """
    reals, words, _, parts = model
    (px, py, pz), root = p, parts[part].root
    if parts[part].sign == SIGN_PSEUDONORMAL or parts[part].grid != NO_GRID:
        turns, steps = winding_along_ray(reals, words, root, px, py, pz)
        return turns > 0, steps
    turns = winding_number(reals, words, root, parts[part].moments, px, py, pz)
    return turns > 0.5, np.int64(0)


@inlined
def is_beyond(p):
    """Test whether *p* is outside the local cube. From there, both sides of a part may be equally near."""
    return max(abs(p[0]), abs(p[1]), abs(p[2])) > 1.0


@inlined
def has_normals(words, parts, part, slot):
    """Test whether normals decide the sign of the face at *slot*. The face must not be marked as folded."""
    notes, mark = parts[part].block_notes + slot // LANES, FOLDED_AT + slot % LANES
    return parts[part].sign == SIGN_PSEUDONORMAL and not (load_int(words, notes) >> mark) & 1


@inlined
def _add_face_normal(reals, words, corners_at, face_at, closest):
    """Add the unit normal of a face to the pseudo-normal. *face_at*: the word at which the face is stored."""
    a = corners_at + 3 * load_int(words, face_at)
    b = corners_at + 3 * load_int(words, face_at + 1)
    c = corners_at + 3 * load_int(words, face_at + 2)
    ux, uy, uz = reals[b] - reals[a], reals[b + 1] - reals[a + 1], reals[b + 2] - reals[a + 2]
    vx, vy, vz = reals[c] - reals[a], reals[c + 1] - reals[a + 1], reals[c + 2] - reals[a + 2]
    nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
    length = sqrt(dot(nx, ny, nz, nx, ny, nz))
    if length > 0.0:
        closest.normal[0] += nx / length
        closest.normal[1] += ny / length
        closest.normal[2] += nz / length


@inlined
def pseudo_normal(model, part, face, feature, which, closest):
    """Replace the unit normal in *closest* by the pseudo-normal of the closest feature, which gives the sign.

    Source: Bærentzen & Aanæs 2005, "Signed distance computation using the angle weighted pseudonormal".
    """
    reals, words, _, parts = model
    if feature == FEATURE_VERTEX:
        corner = load_int(words, parts[part].faces + 3 * face + which)
        at = parts[part].corner_normals + 3 * corner
        closest.normal[0], closest.normal[1], closest.normal[2] = reals[at], reals[at + 1], reals[at + 2]
    elif feature == FEATURE_EDGE:
        neighbor = load_int(words, parts[part].neighbors + 3 * face + which)
        if neighbor >= 0:
            _add_face_normal(reals, words, parts[part].corners, parts[part].faces + 3 * neighbor, closest)
            nx, ny, nz = vector(closest.normal)
            length = sqrt(dot(nx, ny, nz, nx, ny, nz))
            if length > 0.0:
                for axis in range(3):
                    closest.normal[axis] /= length


@inlined
def closest_of_slot(model, part, slot, p, closest):
    """Fill *closest* for the triangle at *slot*.

    Return its face, the feature, and whether *p* is inside the part.
    """
    read_corners(model.reals, slot, closest)
    face = load_int(model.words, model.parts[part].slot_faces + slot)
    feature, which = closest_on_triangle(p[0], p[1], p[2], closest)
    pseudo_normal(model, part, face, feature, which, closest)
    return face, feature, _is_inside(model, part, slot, p, closest)


@inlined
def closest_of_lane(model, part, slot, p, table, k, closest):
    """Return the results of `closest_of_slot`, taken from column *k* of a *table*.

    `closest_lanes.sides_of_lanes` has filled the table. Weights and the point are not computed.
    """
    feature, which = read_row(table, len(table) // LANES_COLUMNS, k, closest)
    face = load_int(model.words, model.parts[part].slot_faces + slot)
    pseudo_normal(model, part, face, feature, which, closest)
    return face, feature, _is_inside(model, part, slot, p, closest)


@inlined
def _is_inside(model, part, slot, p, closest):
    """Test whether *p* is inside the part, given its closest feature. A point on the surface is outside."""
    sign = model.parts[part].sign
    length = closest.length
    if sign == SIGN_NONE or length == 0.0 or is_beyond(p):
        return False
    if has_normals(model.words, model.parts, part, slot):
        side = dot(*vector(closest.arm), *vector(closest.normal))
        if abs(side) > MIN_SIDE_SINE * length:
            return side < 0.0
    is_inside, _ = is_inside_by_winding(model, part, p)
    return is_inside


@inlined
def signed_of_slot(model, part, slot, p, closest):
    """Return the signed local distance from *p* to a triangle. It equals that of `closest_of_slot`."""
    read_corners(model.reals, slot, closest)
    if has_normals(model.words, model.parts, part, slot):
        is_over, height = over_face(closest, p[0], p[1], p[2])
        if is_over and not is_beyond(p):
            return height + 0.0  # never -0.0
    _, _, inside = closest_of_slot(model, part, slot, p, closest)
    return -closest.length if inside else closest.length
