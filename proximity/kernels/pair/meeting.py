"""Test whether two solids share volume at a pair of meeting triangles.

Surfaces that meet along a line share volume next to it if the wedges of material around the line overlap: the
wedge of a face is a half-space, that of an edge the space between its two faces. Coplanar overlapping faces
bound a common volume if their normals agree. A point inside both solids, found in that direction, confirms
it.

Source: neighbourhoods of edges and faces in set operations, Requicha, Voelcker 1985.
"""

from math import floor, sqrt

from proximity.kernels.geometry.closest_feature import stack_closest
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import SIGN_NONE
from proximity.kernels.pair.boxes import mapped, to_second
from proximity.kernels.pair.triangles import (
    BOTH,
    between,
    between_edges,
    corner_of,
    on_triangle,
    read_both,
)
from proximity.kernels.scene.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.scene.inside.containment import is_deep
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel
from proximity.native.simd import load_int

MEETING = 2.0**-44
"""Surfaces nearer than this meet; in sizes of coordinates."""
ON_SURFACE = 8.0
"""Tolerance, in multiples of `MEETING`, for points on a line or plane."""
MIN_OVERLAP = 2.0**-30
"""Wedges that overlap by a smaller angle only touch."""
SCALES = 4
"""Number of distances from the line at which interior points are tried, each 16 times shorter than the
last."""
APART_HERE, PASSING, SHARING = 0, 1, 2
"""Results: no common volume at the pair; surfaces cross; an interior point is found."""
COMMON_SIZE = 63
"""Coordinates of the corners of a common piece: at most 6 corners, 6 ends and 9 crossings of edges."""


@inlined
def meeting_reach(slack):
    """Return the distance, local units, below which surfaces meet; *slack*: size of coordinates."""
    return MEETING * slack


@kernel
def _add_common(corners, triangle, point, reach, points, count):
    """Append *point* if it is on the triangle with number *triangle*, 0 or 1; return the count."""
    off = between(point, on_triangle(corners, triangle, *point, stack_closest(1)[0]))
    if dot(*off, *off) > reach * reach:
        return count
    points[3 * count], points[3 * count + 1], points[3 * count + 2] = point
    return count + 1


@kernel
def _common_points(corners, reach, points):
    """Fill corners of the common piece of two triangles, (`COMMON_SIZE`,); return the count."""
    count = 0
    for one in range(2):
        a = corner_of(corners, 1 - one, 0)
        normal = cross(
            *between(a, corner_of(corners, 1 - one, 1)), *between(a, corner_of(corners, 1 - one, 2))
        )
        for k in range(3):
            p, q = corner_of(corners, one, k), corner_of(corners, one, k + 1)
            count = _add_common(corners, 1 - one, p, reach, points, count)
            h, g = dot(*normal, *between(a, p)), dot(*normal, *between(a, q))
            if h != g and (h > 0.0) != (g > 0.0):
                t = h / (h - g)
                x = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2])
                count = _add_common(corners, 1 - one, x, reach, points, count)
    for i in range(3):
        p = corner_of(corners, 0, i)
        d = between(p, corner_of(corners, 0, i + 1))
        for j in range(3):
            q = corner_of(corners, 1, j)
            is_inside, x, y = between_edges(p, d, q, between(q, corner_of(corners, 1, j + 1)))
            if is_inside and dot(*between(x, y), *between(x, y)) <= reach * reach:
                points[3 * count], points[3 * count + 1], points[3 * count + 2] = x
                count += 1
    return count


@kernel
def common_line(corners, reach, line):
    """Fill a point inside the common piece of two triangles and its direction, (6,); return its length.

    The length is 0 if they meet in a point. *line* is unchanged if they do not meet.
    """
    points, total = stack_f64(COMMON_SIZE), 0.0
    count = _common_points(corners, reach, points)
    if count == 0:
        return 0.0
    for k in range(6):
        line[k] = 0.0
    for row in range(count):
        total += row + 1.0  # unequal weights: the mean is unlikely to coincide with another corner
        for k in range(3):
            line[k] += (row + 1.0) * points[3 * row + k]
    longest_sq = 0.0
    for k in range(3):
        line[k] /= total
    for row in range(count):
        x, y, z = points[3 * row] - line[0], points[3 * row + 1] - line[1], points[3 * row + 2] - line[2]
        if dot(x, y, z, x, y, z) > longest_sq:
            longest_sq, line[3], line[4], line[5] = dot(x, y, z, x, y, z), x, y, z
    length = sqrt(longest_sq)
    for k in range(3):
        line[3 + k] = line[3 + k] / length if length > 0.0 else 0.0
    return length if length > ON_SURFACE * reach else 0.0


@inlined
def _across(x, y, z, line):
    """Return the unit vector across a line in the plane of a vector and the line, and its original length."""
    along = dot(x, y, z, line[3], line[4], line[5])
    x, y, z = x - along * line[3], y - along * line[4], z - along * line[5]
    length = sqrt(dot(x, y, z, x, y, z))
    return (x / length, y / length, z / length, length) if length > 0.0 else (0.0, 0.0, 0.0, 0.0)


@inlined
def _set(rays, number, x, y, z):
    """Write one of three rays."""
    rays[3 * number], rays[3 * number + 1], rays[3 * number + 2] = x, y, z


@inlined
def _ray(rays, number):
    """Return one of three rays."""
    return rays[3 * number], rays[3 * number + 1], rays[3 * number + 2]


@kernel
def _fill_wedge(model, part, slot, frame_map, corners, number, line, reach, rays):
    """Fill rays that bound the material of triangle *number*, 0 or 1, around a line; return its edge there.

    (9,): within the face, inwards, and within the face across the edge. The edge is -1 within the face, and
    -2 if the face has no area.
    """
    a, b, c = corner_of(corners, number, 0), corner_of(corners, number, 1), corner_of(corners, number, 2)
    normal = cross(*between(a, b), *between(a, c))
    x, y, z, length = _across(-normal[0], -normal[1], -normal[2], line)
    if length == 0.0:
        return -2
    _set(rays, 1, x, y, z)
    x, y, z = cross(x, y, z, line[3], line[4], line[5])
    _set(rays, 0, x, y, z)
    _set(rays, 2, -x, -y, -z)
    start = line[0], line[1], line[2]
    for k in range(3):
        p, q = corner_of(corners, number, k), corner_of(corners, number, k + 1)
        edge = between(p, q)
        off = cross(*edge, *between(p, start))
        if dot(*off, *off) > ON_SURFACE * ON_SURFACE * reach * reach * dot(*edge, *edge):
            continue
        x, y, z, _ = _across(*between(start, corner_of(corners, number, k + 2)), line)
        _set(rays, 0, x, y, z)
        _set(rays, 2, -x, -y, -z)
        _fill_ray_beyond(model, part, slot, k, frame_map, number, line, rays)
        return k
    return -1


@kernel
def _fill_ray_beyond(model, part, slot, edge, frame_map, number, line, rays):
    """Fill the ray within the face across an edge, if that face exists."""
    reals, words, _, parts = model
    face = load_int(words, parts[part].slot_faces + slot)
    neighbor = load_int(words, parts[part].neighbors + 3 * face + edge)
    if neighbor < 0:
        return
    farthest = 0.0
    for k in range(3):
        at = parts[part].corners + 3 * load_int(words, parts[part].faces + 3 * neighbor + k)
        x, y, z = reals[at], reals[at + 1], reals[at + 2]
        if number == 1:
            x, y, z = mapped(frame_map[0], frame_map[1], x, y, z)
        x, y, z, length = _across(x - line[0], y - line[1], z - line[2], line)
        if length > farthest:
            farthest = length
            _set(rays, 2, x, y, z)


@inlined
def _angle(x, y):
    """Return a number from 0 to 4 that increases monotonically with the angle of a vector."""
    if y >= 0.0:
        return y / (x + y) if x > 0.0 else (1.0 - x / (y - x) if x < 0.0 or y > 0.0 else 0.0)
    return 2.0 + y / (x + y) if x < 0.0 else 3.0 + x / (x - y)


@inlined
def _vector(angle):
    """Return the vector at an angle of `_angle`."""
    turn = floor(angle)
    rest, turn = angle - turn, turn % 4
    x, y = (1.0 - rest, rest) if turn % 2 == 0 else (-rest, 1.0 - rest)
    return (x, y) if turn < 2 else (-x, -y)


@kernel
def _common_direction(one, other, direction):
    """Fill the unit direction in the middle of the intersection of two wedges; return False if empty."""
    u, v = _ray(one, 0), _ray(one, 1)
    end = _angle(dot(*_ray(one, 2), *u), dot(*_ray(one, 2), *v))
    x, y = dot(*_ray(other, 0), *u), dot(*_ray(other, 0), *v)
    inward_x, inward_y = dot(*_ray(other, 1), *u), dot(*_ray(other, 1), *v)
    low, high = _angle(x, y), _angle(dot(*_ray(other, 2), *u), dot(*_ray(other, 2), *v))
    if x * inward_y < y * inward_x:
        low, high = high, low
    high = high if high > low else high + 4.0
    first, last = low, min(end, high)
    if min(end + 4.0, high) - 4.0 > last - low:
        first, last = 4.0, min(end + 4.0, high)
    x, y = _vector(0.5 * (first + last))
    length = sqrt(x * x + y * y)
    for k in range(3):
        direction[k] = (x * u[k] + y * v[k]) / length
    return last - first > MIN_OVERLAP


@inlined
def _is_flat(corners, number, reach):
    """Test whether the other triangle is coplanar with triangle *number*."""
    a = corner_of(corners, number, 0)
    normal = cross(*between(a, corner_of(corners, number, 1)), *between(a, corner_of(corners, number, 2)))
    highest = 0.0
    for k in range(3):
        highest = max(highest, abs(dot(*normal, *between(a, corner_of(corners, 1 - number, k)))))
    return highest * highest <= ON_SURFACE * ON_SURFACE * reach * reach * dot(*normal, *normal)


@kernel
def _width(corners, reach, line):
    """Return the half width of the common piece of two triangles across its line."""
    points, widest = stack_f64(COMMON_SIZE), 0.0
    for row in range(_common_points(corners, reach, points)):
        x, y, z = points[3 * row] - line[0], points[3 * row + 1] - line[1], points[3 * row + 2] - line[2]
        widest = max(widest, _across(x, y, z, line)[3])
    return widest


@kernel
def find_inside(model, first, second, frame_map, margin, inside):
    """Move a point along a direction, (6,) in the first local frame, until it is inside both; return success.

    *inside* holds the point, then the vector to the farthest point to try; it receives the point found and
    the unit direction.
    """
    workspace = new_workspace()
    reset_recent(workspace)
    ratio, share = abs(model.frames[second].scale / model.frames[first].scale), 1.0
    start, arrow = (inside[0], inside[1], inside[2]), (inside[3], inside[4], inside[5])
    for _ in range(SCALES):
        x, y, z = start[0] + share * arrow[0], start[1] + share * arrow[1], start[2] + share * arrow[2]
        share *= 0.0625
        if is_deep(model, first, (x, y, z), margin, workspace) and is_deep(
            model, second, to_second(frame_map, x, y, z), margin * ratio, workspace
        ):
            length = sqrt(dot(*arrow, *arrow))
            inside[0], inside[1], inside[2] = x, y, z
            inside[3], inside[4], inside[5] = arrow[0] / length, arrow[1] / length, arrow[2] / length
            return True
    return False


@kernel
def share_at(model, first, second, slots, frame_map, slack, inside):
    """Return how two parts share volume at a pair of triangles: `APART_HERE`, `PASSING` or `SHARING`.

    *inside*, (6,), first local frame: receives a point inside both parts, if they share volume, and the
    direction in which it was found.
    """
    corners, line, reach = stack_f64(BOTH), stack_f64(6), meeting_reach(slack)
    one, other = stack_f64(9), stack_f64(9)
    read_both(model.reals, slots, frame_map[0], frame_map[1], corners)
    length = common_line(corners, reach, line)
    if length == 0.0:
        return APART_HERE
    edge = _fill_wedge(model, first, slots[0], frame_map, corners, 0, line, reach, one)
    other_edge = _fill_wedge(model, second, slots[1], frame_map, corners, 1, line, reach, other)
    if edge == -2 or other_edge == -2:
        return APART_HERE
    is_flat = _is_flat(corners, 0, reach) or _is_flat(corners, 1, reach)
    width = _width(corners, reach, line) if is_flat else 0.0
    direction, is_common = stack_f64(3), False
    if width > ON_SURFACE * reach:
        length = min(width, length)
        is_common = dot(*_ray(one, 1), *_ray(other, 1)) > 0.0
        direction[0], direction[1], direction[2] = _ray(one, 1)
    else:
        is_common = _common_direction(one, other, direction)
    if not is_common:
        return APART_HERE
    for k in range(3):
        inside[k], inside[3 + k] = line[k], 0.25 * length * direction[k]
    if find_inside(model, first, second, frame_map, ON_SURFACE * reach, inside):
        return SHARING
    is_through = width == 0.0 and edge == -1 and other_edge == -1
    is_open = model.parts[first].sign == SIGN_NONE or model.parts[second].sign == SIGN_NONE
    return PASSING if is_through and not is_flat and is_open else APART_HERE
