"""Nearest two triangles of two leaf blocks.

Most pairs of blocks are rejected as a whole: their separation along the current best connection, or along the
mean normal of either, exceeds the best. In the others, each triangle is tested against eight, and rejected by
separation along that connection, the line between centroids, or their normals.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import TINY, cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, ORIENTED_STRIDE
from proximity.kernels.nodes import corners_at, corners_of_block
from proximity.kernels.pair.boxes import MAP_ROUNDING, SHRINK, mapped
from proximity.kernels.pair.meeting import APART_HERE, ON_SURFACE, meeting_reach, share_at
from proximity.kernels.pair.triangles import (
    BOTH,
    CROSSING,
    SIDE_ROUNDING,
    between,
    connect,
    in_all_lanes,
    read_both,
    triangles_apart,
)
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import inlined, kernel
from proximity.native.simd import (
    absolute,
    bits,
    horizontal_min,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    trailing_zeros,
)

REACH_ROUNDING = 1.0 + 2.0**-40
"""Factor on distances, corresponding to `SHRINK` on their squares."""


@inlined
def _gap_along(axis, triangle, others, slack, axis_sq):
    """Return squared separations of triangles along an axis of any length, in both directions."""
    a0, a1, a2 = dot(*axis, *triangle[0]), dot(*axis, *triangle[1]), dot(*axis, *triangle[2])
    b0, b1, b2 = dot(*axis, *others[0]), dot(*axis, *others[1]), dot(*axis, *others[2])
    above = minimum(minimum(b0, b1), b2) - maximum(maximum(a0, a1), a2)
    below = minimum(minimum(a0, a1), a2) - maximum(maximum(b0, b1), b2)
    # In units of the axis' length, as is the slack.
    gap = maximum(maximum(above, below) - slack * square_root(axis_sq), splat(0.0))
    return select(axis_sq > splat(TINY), gap * gap * splat(SHRINK) / axis_sq, splat(0.0))


@kernel
def turn_axis(reals, slots, turn, offset, axis):
    """Set the axis to the direction of the best connection, from the first part; return squared length."""
    corners, ends = stack_f64(BOTH), stack_f64(6)
    read_both(reals, slots, turn, offset, corners)
    length_sq = connect(corners, ends)
    length = sqrt(length_sq)
    for k in range(3):
        axis[k] = (ends[3 + k] - ends[k]) / length if length > 0.0 else 0.0
    return length_sq


@inlined
def _ends_along(axis, triangles):
    """Return the upper ends of eight triangles along an axis, and the interval of all.

    Unused lanes are nan.
    """
    x, y, z = splat(axis[0]), splat(axis[1]), splat(axis[2])
    a, b, c = dot(x, y, z, *triangles[0]), dot(x, y, z, *triangles[1]), dot(x, y, z, *triangles[2])
    begins, ends = minimum(minimum(a, b), c), maximum(maximum(a, b), c)
    far = splat(np.inf)
    return (
        ends,
        horizontal_min(select(begins < far, begins, far)),
        -horizontal_min(select(ends < far, -ends, far)),
    )


@inlined
def _block_normal(words, at):
    """Return the mean normal of a block's triangles, of length about 1."""
    return np.float64(words[at]), np.float64(words[at + 3]), np.float64(words[at + 6])


@inlined
def _gap_to_either_side(normal, one, other, margin, axis):
    """Return the separation of two sets of eight triangles along a normal of any length; 0 if they overlap.

    Also sets the direction of a separation, in the last three numbers of *axis*.
    """
    _, begin, end = _ends_along(normal, one)
    _, other_begin, other_end = _ends_along(normal, other)
    length = sqrt(dot(*normal, *normal))
    gap = max(other_begin - end, begin - other_end) - 2.0 * margin * length
    if not gap > 0.0:
        return 0.0
    scale = SHRINK / length if other_begin > end else -SHRINK / length
    axis[3], axis[4], axis[5] = normal[0] * scale, normal[1] * scale, normal[2] * scale
    return gap / length


@inlined
def _gap_between_middles(triangle, others, slack):
    """Return squared separations of triangles along the lines between their centroids."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangle
    (px, py, pz), (qx, qy, qz), (rx, ry, rz) = others
    line = (px + qx + rx) - (ax + bx + cx), (py + qy + ry) - (ay + by + cy), (pz + qz + rz) - (az + bz + cz)
    return _gap_along(line, triangle, others, slack, dot(*line, *line))


@kernel
def _block_gap(model, boxes, first, second, frame_map, margin, reach, axis):
    """Return a lower bound of the distance of two blocks, from successive tests until it exceeds *reach*.

    *boxes*: offset in words of the oriented boxes of blocks. The last three numbers of *axis* receive the
    direction of a separation that exceeds *reach*.
    """
    reals, words, _, _ = model
    turn, offset = frame_map
    triangles = corners_of_block(reals, BLOCK_STRIDE * first)
    a, b, c = corners_of_block(reals, BLOCK_STRIDE * second)
    others = mapped(turn, offset, *a), mapped(turn, offset, *b), mapped(turn, offset, *c)
    _, _, end = _ends_along(axis, triangles)
    _, begin, _ = _ends_along(axis, others)
    gap = (begin - end - 2.0 * margin) * SHRINK
    if gap > reach:
        axis[3], axis[4], axis[5] = axis[0] * SHRINK, axis[1] * SHRINK, axis[2] * SHRINK
        return gap
    normal = _block_normal(words, boxes + ORIENTED_STRIDE * first)
    gap = _gap_to_either_side(normal, triangles, others, margin, axis) * SHRINK
    if gap > reach:
        return gap
    x, y, z = _block_normal(words, boxes + ORIENTED_STRIDE * second)
    normal = (
        turn[0] * x + turn[1] * y + turn[2] * z,
        turn[3] * x + turn[4] * y + turn[5] * z,
        turn[6] * x + turn[7] * y + turn[8] * z,
    )
    return _gap_to_either_side(normal, triangles, others, margin, axis) * SHRINK


@inlined
def _is_back_to_back(triangle, others, normals, reach):
    """Return the mask of eight triangles that lie in the plane of a triangle with opposite normals."""
    normal = cross(*between(triangle[0], triangle[1]), *between(triangle[0], triangle[2]))
    highest = splat(0.0)
    for corner in others:
        highest = maximum(highest, absolute(dot(*normal, *between(triangle[0], corner))))
    near = ON_SURFACE * reach
    is_flat = highest * highest <= splat(near * near) * dot(*normal, *normal)
    return is_flat & (dot(*normal, *normals) < splat(0.0))


@kernel
def nearer_in_blocks(model, pair, first, second, frame_map, slack, best, axis, slots):
    """Update the best squared distance, its slots and its axis with triangles of two blocks; return it.

    Also returns a lower bound of their squared distance. *pair*: rows of both parts. A best of
    `meeting_reach` squared is final: only triangles where the parts share volume are still searched. *axis*:
    (6,), of the best connection, and one along which the bound separates all triangles, or 0.
    """
    reals, (turn, offset) = model.reals, frame_map
    base, nearer = BLOCK_STRIDE * first, MAP_ROUNDING * slack
    boxes, meeting_sq = model.parts[pair[0]].block_boxes, meeting_reach(slack) * meeting_reach(slack)
    gap = _block_gap(model, boxes, first, second, frame_map, nearer, sqrt(best), axis)
    if gap > 0.0 and gap * gap > best:
        return best, gap * gap
    axis[3] = axis[4] = axis[5] = 0.0
    a, b, c = corners_of_block(reals, BLOCK_STRIDE * second)
    others = mapped(turn, offset, *a), mapped(turn, offset, *b), mapped(turn, offset, *c)
    is_used, far = a[0] == a[0], splat(np.inf)
    normals = cross(*between(others[0], others[1]), *between(others[0], others[2]))
    normal_sq = dot(*normals, *normals)
    margin, rounding_sq = splat(nearer), splat(SIDE_ROUNDING * slack * SIDE_ROUNDING * slack)
    # Skip triangles of the first block that are too far along the axis.
    ends, _, _ = _ends_along(axis, corners_of_block(reals, base))
    _, begin, _ = _ends_along(axis, others)
    gaps = maximum((splat(begin - 2.0 * nearer) - ends) * splat(SHRINK), splat(0.0))
    gaps = select(ends == ends, gaps * gaps, far)
    left = bits(gaps < splat(best))
    least = select(gaps < splat(best), far, gaps)
    while left:
        lane = trailing_zeros(left)
        left &= left - 1
        triangle = in_all_lanes(*corners_at(reals, base + lane))
        along = splat(axis[0]), splat(axis[1]), splat(axis[2])
        bound = select(is_used, _gap_along(along, triangle, others, margin, splat(1.0)), far)
        if bits(bound < splat(best)):
            bound = maximum(bound, _gap_between_middles(triangle, others, margin))
        if bits(bound < splat(best)):
            normal = cross(*between(triangle[0], triangle[1]), *between(triangle[0], triangle[2]))
            axis_sq = dot(*normal, *normal)
            bound = maximum(bound, _gap_along(normal, triangle, others, margin, axis_sq))
            bound = maximum(bound, _gap_along(normals, triangle, others, margin, normal_sq))
        if not bits(bound < splat(best)):
            least = minimum(least, bound)
            continue
        apart_sq = select(is_used, triangles_apart(triangle, others, rounding_sq), far)
        least = minimum(least, apart_sq)
        smallest = horizontal_min(apart_sq)
        if smallest < best and (best > meeting_sq or smallest == CROSSING):
            best = max(smallest, meeting_sq) if smallest > CROSSING else CROSSING
            slots[0] = LANES * first + lane
            slots[1] = LANES * second + trailing_zeros(bits(apart_sq <= splat(smallest)))
            if best == CROSSING:
                break
            turn_axis(reals, slots, turn, offset, axis)
        if best == meeting_sq:
            is_back = _is_back_to_back(triangle, others, normals, meeting_reach(slack))
            which = bits((apart_sq <= splat(meeting_sq)) & ~is_back)
            if _shares_at_any(
                model, pair, LANES * first + lane, LANES * second, which, frame_map, slack, slots
            ):
                best = CROSSING
                break
    return best, horizontal_min(least)


@kernel
def _shares_at_any(model, pair, slot, base, which, frame_map, slack, slots):
    """Test whether two parts share volume at a triangle and one of eight others; if so, set the slots.

    *which*: bits of the others to test.
    """
    tried, inside = stack_i64(2), stack_f64(6)
    while which:
        tried[0], tried[1] = slot, base + trailing_zeros(which)
        which &= which - 1
        if share_at(model, pair[0], pair[1], tried, frame_map, slack, inside) != APART_HERE:
            slots[0], slots[1] = tried[0], tried[1]
            return True
    return False
