"""Oriented boxes of blocks: lower bounds of distance, and tight where axis-aligned boxes are not."""

import numba
import numpy as np
import pytest
import shapes
from models import piece_of
from part_arrays import part_arrays

from proximity.kernels.geometry.box import FAR, point_boxes_distance_sq
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_CHILDREN, NODE_STRIDE, ORIENTED_STRIDE
from proximity.kernels.point.walk import slot_distance_sq
from proximity.kernels.tree.oriented_box import (
    BOX_ROUNDING,
    LARGEST,
    LEAST,
    oriented_box_distance_sq,
    reach_into_boxes,
)
from proximity.native.simd import lane, splat32
from proximity.scene.scene import Scene

pytestmark = pytest.mark.internals
compiled = numba.njit(error_model="numpy")


@compiled
def fill_box_distances(boxes, reals, points, found, reaches):
    """Fill squared distances of points to the boxes, and the reach of the nearest triangle in each."""
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        for block in range(found.shape[1]):
            nearest = np.inf
            for k in range(LANES):
                distance_sq = slot_distance_sq(reals, LANES * block + k, px, py, pz)
                if distance_sq < nearest:
                    nearest = distance_sq
            x, y, z = np.float32(px), np.float32(py), np.float32(pz)
            found[i, block] = oriented_box_distance_sq(boxes, ORIENTED_STRIDE * block, x, y, z)
            reaches[i, block] = reach_into_boxes(nearest)


@compiled
def fill_leaf_bounds(words, points, bounds):
    """Fill the bounds by axis-aligned boxes, of each point and block."""
    children = words.view(np.int32)
    for i in range(len(points)):
        x, y, z = (
            splat32(np.float32(points[i, 0])),
            splat32(np.float32(points[i, 1])),
            splat32(np.float32(points[i, 2])),
        )
        for node in range(len(words) // NODE_STRIDE):
            found = point_boxes_distance_sq(words, NODE_STRIDE * node, x, y, z)
            for k in range(LANES):
                child = children[NODE_STRIDE * node + NODE_CHILDREN + k]
                if words[NODE_STRIDE * node + k] <= words[NODE_STRIDE * node + 24 + k] and child < 0:
                    bounds[i, ~child] = lane(found, k)


def box_distances(boxes, blocks, points):
    shape = len(points), len(blocks) // BLOCK_STRIDE
    found, reaches = np.empty(shape, np.float32), np.empty(shape, np.float32)
    with np.errstate(all="ignore"):
        fill_box_distances(boxes, blocks, points, found, reaches)
    return found, reaches


def random_faces(size):
    rng = np.random.default_rng(3)
    corners = rng.uniform(-0.9, 0.9, (150, 1, 3)) + size * rng.uniform(-0.1, 0.1, (150, 3, 3))
    return corners.reshape(-1, 3), np.arange(450).reshape(-1, 3)


SOUP, SHEET = random_faces(1.0), shapes.grid(9, 7)
MESHES = {
    "ball": shapes.sphere(0.9, 2),
    "box": shapes.box((-1, -0.5, -0.25), (1, 0.5, 0.25)),
    "one face": (np.eye(3), np.array([[0, 1, 2]])),
    "soup": SOUP,
    "large faces": random_faces(9.0),
    "needles": (SOUP[0] * [1, 1e-9, 1e-12], SOUP[1]),
    "tilted sheet": (0.1 * SHEET[0] @ shapes.rotation(5).T, SHEET[1]),
    "lines": (SOUP[0], SOUP[1][:, [0, 1, 1]]),
    "points": (SOUP[0], SOUP[1][:, [0, 0, 0]]),
    "motes": shapes.join(shapes.cube(2.0, (0, 0, 0)), (1e-30 * SOUP[0], SOUP[1])),
    "both sides": shapes.join(SOUP, shapes.inside_out(SOUP)),
}


def points_around(corners):
    """Local points on corners, near them, and up to the largest distance at which boxes are used."""
    rng = np.random.default_rng(11)
    on = corners[rng.integers(0, len(corners), 40)]
    beside = on + 10.0 ** rng.uniform(-9, 0, (40, 1)) * rng.normal(size=(40, 3))
    return np.clip(np.concatenate([on, beside, rng.uniform(-FAR, FAR, (40, 3))]), -FAR, FAR)


@pytest.mark.parametrize("name", MESHES)
def test_no_box_is_farther_than_a_triangle_in_it(name):
    piece = piece_of(MESHES[name])

    found, reaches = box_distances(piece.boxes, piece.bvh.blocks, points_around(piece.corners))

    assert (found <= reaches).all()


@pytest.mark.parametrize("name", MESHES)
def test_axes_are_at_right_angles_and_intervals_in_order(name):
    table = piece_of(MESHES[name]).boxes.reshape(-1, ORIENTED_STRIDE)
    axes = table[:, :9].reshape(-1, 3, 3).astype(np.float64)

    assert np.abs(np.einsum("bxi,bxj->bij", axes, axes) - np.eye(3)).max() < 2.0**-21
    assert (table[:, LEAST:LARGEST] <= table[:, LARGEST : LARGEST + 3]).all()


def test_off_a_ball_max_blocks_that_boxes_along_the_axes_let_in_are_refused():
    piece = piece_of(shapes.sphere(0.9, 4))
    rng = np.random.default_rng(5)
    points = rng.normal(size=(50, 3))
    points *= rng.uniform(1.1, 1.4, (50, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    bounds = np.empty((50, piece.bvh.block_count), np.float32)
    fill_leaf_bounds(piece.bvh.nodes, points, bounds)

    found, reaches = box_distances(piece.boxes, piece.bvh.blocks, points)

    best = reaches.min(axis=1, keepdims=True)
    assert ((found <= best) & (bounds <= best)).sum() < 0.6 * (bounds <= best).sum()


def test_boxes_follow_faces_that_are_deformed():
    mesh = shapes.sphere(1.0, 3)
    scene = Scene.from_mesh(*mesh, name="ball")
    bent = scene.parts[0].solid.mesh.vertices * (1.0, 0.3, 1.2)
    bent[:, 2] += 0.5 * bent[:, 0] ** 2

    scene.deform("ball", bent)

    views = part_arrays(scene.snapshot(), 0)
    found, reaches = box_distances(views.boxes, views.bvh.blocks, points_around(views.corners))
    assert (found <= reaches).all()
    assert np.median(np.sqrt(reaches) - np.sqrt(found)) < 0.02 + 2.0 * BOX_ROUNDING
