"""Distance from a point to triangles, with one formula for scalars and for vectors of eight.

The squared distance to a triangle is the minimum of those to its three edges and, if the foot of the point is
inside, that to its plane. Edge parameters are clamped, so that each edge distance is the distance to an
existing point of the edge. The normal is a compensated cross product, and the side of an edge comes from
``normal · (edge × arm)``. The error is a few roundings of the coordinates for any shape. The textbook
barycentric formula divides by the squared area and loses up to 90 % of the distance on needles. Degenerate
triangles are replaced by their edges, and edges without length by their ends.

Source for the method: the Voronoi regions of Ericson, Real-Time Collision Detection, 5.1.5; Kahan's
difference of products (see Jeannerod, Louvet, Muller 2013) for the cross product.
"""

from proximity.kernels.nodes import corners_of_block
from proximity.native import inlined
from proximity.native.simd import fma, like, maximum, minimum, select, square_root

TINY = 1e-60
"""Squared lengths and squared double areas below this count as zero.

In the local frame this is an edge of 1e-30, far below the rounding of coordinates.
"""


@inlined
def difference_of_products(a, b, c, d):
    """Return a b - c d to 1.5 units in the last place, and so with the correct sign (Kahan)."""
    cd = c * d
    return fma(a, b, -cd) + fma(-c, d, cd)


@inlined
def cross(ax, ay, az, bx, by, bz):
    """Return the vector product, with compensated components, of vectors of scalars or of eight lanes."""
    return (
        difference_of_products(ay, bz, az, by),
        difference_of_products(az, bx, ax, bz),
        difference_of_products(ax, by, ay, bx),
    )


@inlined
def dot(ax, ay, az, bx, by, bz):
    """Return the scalar product of two vectors."""
    return fma(ax, bx, fma(ay, by, az * bz))


@inlined
def edge_distance_sq(p, e):
    """Return the squared distance from a point to a segment that starts at the origin.

    *p*: the point, *e*: the end of the segment; (x, y, z) each.
    """
    px, py, pz = p
    ex, ey, ez = e
    t = dot(px, py, pz, ex, ey, ez) / maximum(dot(ex, ey, ez, ex, ey, ez), like(TINY, ex))
    t = minimum(maximum(t, like(0.0, ex)), like(1.0, ex))
    dx, dy, dz = fma(-t, ex, px), fma(-t, ey, py), fma(-t, ez, pz)
    return dot(dx, dy, dz, dx, dy, dz)


@inlined
def point_triangle_distance_sq(p, a, b, c):
    """Return the squared distance from a point to a triangle.

    *p*, *a*, *b*, *c*: (x, y, z) each, scalars or vectors of eight. The coordinates of the triangle are
    local, so within [-1, 1].
    """
    px, py, pz = p
    ax, ay, az = a
    bx, by, bz = b
    cx, cy, cz = c
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    bcx, bcy, bcz = cx - bx, cy - by, cz - bz
    pax, pay, paz = px - ax, py - ay, pz - az
    pbx, pby, pbz = px - bx, py - by, pz - bz
    nx, ny, nz = cross(abx, aby, abz, acx, acy, acz)
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    # Side of an edge: normal · (edge x arm) = edge · (arm x normal). The three sum to normal_sq, but the
    # third must not be computed as the difference: on a needle with its tip at a, the error of the other two,
    # small across the needle, would count along it (seen: 1 % of the part's size; costs 2 % of the time).
    qx = fma(pay, nz, -(paz * ny))
    qy = fma(paz, nx, -(pax * nz))
    qz = fma(pax, ny, -(pay * nx))
    side_ab = dot(abx, aby, abz, qx, qy, qz)
    side_ac = -dot(acx, acy, acz, qx, qy, qz)
    rx = fma(pby, nz, -(pbz * ny))
    ry = fma(pbz, nx, -(pbx * nz))
    rz = fma(pbx, ny, -(pby * nx))
    side_bc = dot(bcx, bcy, bcz, rx, ry, rz)
    inside = (minimum(side_ab, minimum(side_ac, side_bc)) >= like(0.0, px)) & (normal_sq > like(TINY, px))
    height = dot(nx, ny, nz, pax, pay, paz)
    plane_sq = height * height / normal_sq

    edge_sq = minimum(
        edge_distance_sq((pax, pay, paz), (abx, aby, abz)),
        minimum(
            edge_distance_sq((pax, pay, paz), (acx, acy, acz)),
            edge_distance_sq((pbx, pby, pbz), (bcx, bcy, bcz)),
        ),
    )
    # With the foot inside, the plane is never farther than an edge, except by rounding on needles.
    return select(inside, minimum(plane_sq, edge_sq), edge_sq)


@inlined
def point_block_distance_sq(blocks, base, p):
    """Return squared distances from a point to the eight triangles of the block at *base*.

    *p*: (x, y, z) of float64x8.
    """
    return point_triangle_distance_sq(p, *corners_of_block(blocks, base))


@inlined
def height_over(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Test whether the foot of *p* is strictly inside triangle *abc*.

    Return also its height and the unit normal. The arguments are scalars or vectors of eight. The formula is
    the same as in the walk, so that both agree on the interior. A triangle without area has normal and height
    0.
    """
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    pax, pay, paz = px - ax, py - ay, pz - az
    nx, ny, nz = cross(abx, aby, abz, acx, acy, acz)
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    zero = like(0.0, normal_sq)
    has_area = normal_sq > like(TINY, normal_sq)
    nx, ny, nz = select(has_area, nx, zero), select(has_area, ny, zero), select(has_area, nz, zero)
    qx = fma(pay, nz, -(paz * ny))
    qy = fma(paz, nx, -(pax * nz))
    qz = fma(pax, ny, -(pay * nx))
    side_ab = dot(abx, aby, abz, qx, qy, qz)
    side_ac = -dot(acx, acy, acz, qx, qy, qz)
    pbx, pby, pbz = px - bx, py - by, pz - bz
    rx = fma(pby, nz, -(pbz * ny))
    ry = fma(pbz, nx, -(pbx * nz))
    rz = fma(pbx, ny, -(pby * nx))
    side_bc = dot(cx - bx, cy - by, cz - bz, rx, ry, rz)
    length = select(has_area, square_root(normal_sq), like(1.0, normal_sq))
    nx, ny, nz = nx / length, ny / length, nz / length
    is_over = minimum(minimum(side_ab, side_ac), side_bc) > zero
    return is_over, dot(nx, ny, nz, pax, pay, paz), nx, ny, nz


__all__ = [
    "cross",
    "difference_of_products",
    "dot",
    "edge_distance_sq",
    "height_over",
    "maximum",
    "point_block_distance_sq",
    "point_triangle_distance_sq",
]
