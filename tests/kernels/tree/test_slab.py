"""Slabs along mean normals: lower bounds of distance, and tight where boxes are not."""

from functools import cache

import numba
import numpy as np
import pytest
import shapes
from models import piece_of

import oracle
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    MOMENT_AREA_NORMAL,
    MOMENT_SLAB_LARGEST,
    MOMENT_SLAB_LEAST,
    MOMENT_STRIDE,
    NODE_CHILDREN,
    NODE_STRIDE,
)
from proximity.kernels.tree.normal_slab import (
    SMALLEST_BOUND,
    fill_slabs,
    slabs_distance_sq,
)
from proximity.native.simd import lane, splat

compiled = numba.njit(error_model="numpy")


@compiled
def slab_bounds(moments, points, factor, bounds):
    """Fill (P, N, 8) float32 bounds of all children of all nodes."""
    for i in range(len(points)):
        x, y, z = splat(points[i, 0]), splat(points[i, 1]), splat(points[i, 2])
        for node in range(len(moments) // MOMENT_STRIDE):
            found = slabs_distance_sq(moments, MOMENT_STRIDE * node, x, y, z, factor)
            for k in range(LANES):
                bounds[i, node, k] = lane(found, k)


def bounds_at(moments, points, factor=1.0):
    bounds = np.empty((len(points), len(moments) // MOMENT_STRIDE, LANES), np.float32)
    with np.errstate(all="ignore"):
        slab_bounds(moments, np.asarray(points, dtype=np.float64), factor, bounds)
    return bounds


def slots_below(bvh):
    """Slots of all faces below each node and lane; empty for unused lanes."""
    nodes = bvh.nodes.reshape(-1, NODE_STRIDE)
    children = nodes.view(np.int32)[:, NODE_CHILDREN : NODE_CHILDREN + LANES].tolist()
    below = {}
    for node in range(bvh.node_count - 1, -1, -1):
        for k, child in enumerate(children[node]):
            if not nodes[node, k] <= nodes[node, 24 + k]:
                below[node, k] = []
            elif child < 0:
                slots = range(LANES * ~child, LANES * ~child + LANES)
                below[node, k] = [slot for slot in slots if bvh.slot_faces[slot] >= 0]
            else:
                below[node, k] = [slot for lane in range(LANES) for slot in below[child, lane]]
    return below


def random_faces(seed, count, size):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-0.9, 0.9, (count, 1, 3)) + size * rng.uniform(-0.1, 0.1, (count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def thin(mesh, widths):
    """Scale a mesh along its axes."""
    return mesh[0] * widths, mesh[1]


def collapsed(mesh, corners):
    """Replace some corners by others, so that faces become lines or points."""
    return mesh[0], mesh[1][:, corners]


NAMES = [
    "ball", "box", "one face", "soup", "large faces", "needles", "sheet", "tilted sheet", "lines", "points",
    "specks", "motes", "both sides", "nearly cancelling", "copies",
]  # fmt: skip


@cache
def piece_named(name):
    """The arrays of one part."""
    soup, large, cube = random_faces(1, 120, 1.0), random_faces(2, 50, 9.0), shapes.cube(2.0, (0, 0, 0))
    one, sheet = (np.eye(3), np.array([[0, 1, 2]])), shapes.grid(9, 7)
    meshes = {
        "ball": shapes.sphere(0.9, 2),
        "box": shapes.box((-1, -0.5, -0.25), (1, 0.5, 0.25)),
        "one face": one,
        "soup": soup,
        "large faces": large,
        "needles": thin(soup, [1, 1e-9, 1e-12]),
        "sheet": shapes.moved(sheet, (-4, -3, 0.3)),
        "tilted sheet": (0.1 * sheet[0] @ shapes.rotation(5).T, sheet[1]),
        "lines": collapsed(soup, [0, 1, 1]),
        "points": collapsed(soup, [0, 0, 0]),
        "specks": shapes.join(cube, thin(soup, 1e-16)),
        "motes": shapes.join(cube, thin(soup, 1e-30)),
        "both sides": shapes.join(large, shapes.inside_out(large)),
        "nearly cancelling": shapes.join(large, shapes.inside_out(shapes.moved(large, (1e-7, 0, 0)))),
        "copies": (one[0], np.tile(one[1], (100, 1))),
    }
    assert list(meshes) == NAMES
    return piece_of(meshes[name])


def points_around(rng, corners):
    """Local points: anywhere, near a face, in the planes of faces, far and very far."""
    faces = corners[rng.integers(0, len(corners), 12)]
    weights = rng.normal(size=(12, 3, 1))
    weights[:, 0] = 1.0 - weights[:, 1] - weights[:, 2]
    in_planes = (weights * faces).sum(axis=1)
    way = rng.normal(size=(12, 3))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    along = faces[:, 0] + normals * rng.choice([-1, 1], (12, 1)) * 10.0 ** rng.uniform(-15, 6, (12, 1))
    far = way * 10.0 ** rng.uniform(0, 30, (12, 1))
    return np.concatenate(
        [rng.uniform(-2, 2, (12, 3)), faces[:, 0], in_planes, along, faces[:, 0] + 1e-9 * way, far]
    )


@pytest.mark.internals
@pytest.mark.parametrize("name", NAMES)
def test_slab_is_never_above_the_distance_of_any_face_below(name):
    piece, rng = piece_named(name), np.random.default_rng(7)
    corners = piece.corners[piece.faces]
    points = points_around(rng, corners)
    faces = piece.bvh.slot_faces
    distances = np.array([oracle.closest(piece.corners, face[None], points).distance for face in piece.faces])
    bounds = bounds_at(piece.moments, points)

    for (node, k), slots in slots_below(piece.bvh).items():
        if slots:
            nearest = distances[faces[slots]].min(axis=0).astype(np.longdouble)
            assert (bounds[:, node, k] <= nearest * nearest * (1 + 1e-15)).all()
    assert np.isfinite(bounds).all() and (bounds >= 0.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_slab_is_as_wide_as_the_corners_reach(name):
    """Along the stored normal, the sum over all faces below."""
    piece = piece_named(name)
    moments = piece.moments.reshape(-1, MOMENT_STRIDE).astype(np.longdouble)
    blocks = piece.bvh.blocks.reshape(-1, 3, 3, LANES)
    for (node, k), slots in slots_below(piece.bvh).items():
        normal = moments[node, MOMENT_AREA_NORMAL + k : MOMENT_AREA_NORMAL + 24 : LANES]
        least, largest = moments[node, [MOMENT_SLAB_LEAST + k, MOMENT_SLAB_LARGEST + k]]
        if not slots:
            assert (least, largest) == (0.0, 0.0) and not normal.any()
            continue
        corners = np.concatenate([blocks[slot // LANES, :, :, slot % LANES] for slot in slots])
        along = corners.astype(np.longdouble) @ normal
        slack = 3e-7 * abs(along).max() + 3e-12 * abs(normal).sum() + 3e-38
        assert along.min() - slack <= least <= along.min()
        assert along.max() <= largest <= along.max() + slack
        a, b, c = corners.reshape(-1, 3, 3).transpose(1, 0, 2)
        expected = 0.5 * np.cross(b - a, c - a).sum(axis=0)
        assert (
            abs(normal - expected).max()
            <= 1e-6 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() + 1e-45
        )


@pytest.mark.internals
def test_slabs_of_a_ball_seen_from_its_centre_miss_by_the_sagitta_only():
    piece = piece_of(shapes.sphere(1.0, 4))
    bounds = np.sqrt(bounds_at(piece.moments, np.zeros((1, 3)))[0])
    blocks = piece.bvh.blocks.reshape(-1, 3, 3, LANES)
    boxes = piece.bvh.nodes.reshape(-1, NODE_STRIDE)
    box_misses, misses = [], []
    for (node, k), slots in slots_below(piece.bvh).items():
        if not slots:
            continue
        corners = np.concatenate([blocks[slot // LANES, :, :, slot % LANES] for slot in slots])
        width = np.linalg.norm(np.ptp(corners, axis=0))
        if width > 0.5:
            continue
        gaps = np.maximum(np.maximum(boxes[node, k:24:LANES], -boxes[node, 24 + k : 48 : LANES]), 0.0)
        box_misses.append((1.0 - np.linalg.norm(gaps)) / width)
        misses.append((1.0 - bounds[node, k]) / width**2)

    assert len(misses) > 500
    assert max(misses) < 0.3
    assert np.median(box_misses) > 0.15  # proportional to the size, not to its square


@pytest.mark.internals
@pytest.mark.parametrize("factor", [2.0**-90, 2.0**-10, 1.0, 2.0**16])
def test_factor_scales_the_bounds(factor):
    piece = piece_named("ball")
    points = np.random.default_rng(7).uniform(-3, 3, (20, 3))
    plain, scaled = bounds_at(piece.moments, points), bounds_at(piece.moments, points, factor)
    is_kept = plain.astype(np.float64) * factor > SMALLEST_BOUND

    np.testing.assert_array_equal(scaled[is_kept], plain[is_kept] * np.float32(factor))
    assert is_kept.any() and not scaled[~is_kept].any()


@pytest.mark.internals
def test_bound_too_small_for_float32_is_none():
    """It would be rounded to a subnormal, half of which are too large."""
    piece = piece_named("one face")
    points = np.random.default_rng(7).uniform(-2, 2, (200, 3))

    assert not bounds_at(piece.moments, points, 2.0**-140).any()
    assert bounds_at(piece.moments, points, 2.0**-90)[:, 0, 0].any()


@pytest.mark.internals
def test_child_without_a_mean_normal_and_unused_lanes_bound_nothing():
    one, two = piece_named("one face"), piece_of((np.eye(3), [[0, 1, 2], [0, 2, 1]]))
    points = points_around(np.random.default_rng(7), one.corners[one.faces])

    assert not two.moments[MOMENT_AREA_NORMAL : MOMENT_AREA_NORMAL + 24].any()
    assert (bounds_at(two.moments, points) == 0.0).all()
    assert (bounds_at(one.moments, points)[:, 0, 0] > 0.0).sum() > 30
    assert (bounds_at(one.moments, points)[:, 0, 1:] == 0.0).all()


@pytest.mark.internals
def test_infinite_slab_bounds_nothing_however_far_the_point():
    moments = piece_named("one face").moments.copy()
    moments[MOMENT_SLAB_LEAST], moments[MOMENT_SLAB_LARGEST] = -np.inf, np.inf
    points = np.array([[0, 0, 0], [1e30, -1e30, 1e30], [1e100, 1e100, 1e100], [-1e100, 0, 1e-100]])

    assert (bounds_at(moments, points) == 0.0).all()


@pytest.mark.internals
def test_bounds_beyond_float32_are_cut_off_below_infinity():
    bounds = bounds_at(piece_named("one face").moments, [[1e20, 1e20, 1e20], [1e100, 1e100, 1e100]])

    assert (bounds[:, 0, 0] > 3e38).all() and np.isfinite(bounds).all()


def test_refilled_slabs_fit_faces_that_have_moved():
    """Refilling gives the same values as building."""
    piece = piece_named("soup")
    again = piece.moments.copy()
    again.reshape(-1, MOMENT_STRIDE)[:, MOMENT_SLAB_LEAST:] = np.nan

    fill_slabs(piece.bvh.nodes, piece.bvh.blocks, 0, piece.bvh.node_count, again, 0)

    np.testing.assert_array_equal(again, piece.moments)
    assert len(piece.bvh.blocks) == BLOCK_STRIDE * piece.bvh.block_count
