"""Budgeted traversal for tests: models of plain meshes, guarded memory, named results."""

from typing import NamedTuple

import numpy as np
import shapes
from models import arrays_of, model_of

from proximity.kernels.geometry.frames import part_of_slot
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    FRAME,
    LANES,
    MOMENT_STRIDE,
    NO_PART,
    NO_SLOT,
    NODE_CHILDREN,
    NODE_STRIDE,
    PART,
    STACKS_SIZE,
)
from proximity.kernels.point.budgeted_walk import known_sq, nearest_with_budget
from proximity.kernels.point.walk import NOTHING_SEEN, nearest_in_scene
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE
from proximity.mesh.bvh import common_frame
from proximity.pose import Pose

GUARD = 64
UNTOUCHED = np.float32(-12345.0)
UNLIMITED = 2**40


class Answer(NamedTuple):
    """Result of a traversal; squared distances in the scene's scaled frame."""

    best_sq: float
    slot: int
    lower_sq: float
    work: int


def start_of(model):
    """The node reference that covers the whole model, and the row of its frame."""
    scene = len(model.parts) - 1
    part = 0 if scene == 1 else scene
    return int(model.parts["root"][part]), part


def guarded_room():
    """A workspace, and the array with guards around it."""
    whole = np.full(WORKSPACE_SIZE + 2 * GUARD, UNTOUCHED, np.float32)
    return whole[GUARD:-GUARD], whole


WORKSPACE, WHOLE = guarded_room()


def walk(model, point, budget, best_sq=np.inf, slot=NO_SLOT, *, tolerance=0.0, exact_within=0.0):
    """Run a traversal; check that it wrote within its workspace only and that its work is in 1..budget."""
    arrays = arrays_of(model)
    found = nearest_with_budget(
        arrays,
        *start_of(model),
        tuple(map(float, point)),
        (best_sq, slot),
        (tolerance, exact_within),
        budget,
        WORKSPACE,
    )
    assert (WHOLE[:GUARD] == UNTOUCHED).all() and (WHOLE[-GUARD:] == UNTOUCHED).all(), (
        "nothing is written beside the room"
    )
    answer = Answer(float(found[0]), int(found[1]), float(found[2]), int(found[3]))
    assert 1 <= answer.work <= budget
    return answer


def without_budget(model, point, best_sq=np.inf, slot=NO_SLOT):
    """Squared distance and slot by the traversal without a budget."""
    arrays = arrays_of(model)
    part = int(part_of_slot(model.words, model.parts, slot)) if slot >= 0 else NO_PART
    stacks = np.empty(STACKS_SIZE, np.float32)
    found_sq, _, found = nearest_in_scene(
        arrays, tuple(map(float, point)), best_sq, part, slot, NOTHING_SEEN, stacks
    )
    return float(found_sq), int(found)


def known(model, point, slot):
    """Squared distance to the triangle at *slot*, in the scene's scaled frame, as a warm start."""
    part = int(part_of_slot(model.words, model.parts, slot))
    return float(known_sq(arrays_of(model), part, slot, tuple(map(float, point))))


def block_count(model):
    """Number of blocks of all parts."""
    return int(model.parts["block_count"][:-1].sum())


SCENES = ["ball", "box far away", "parts of a file", "parts apart", "large and small", "minute"]
MINUTE_BESIDE_LARGE = ["1e-15", "1e-18", "1e-21", "1e-22", "1e-24", "1e-30", "1e-60"]


def placed(mesh, pose):
    """Transform a mesh to the scene's frame, for the oracle."""
    return mesh[0] @ pose.rotation.T + pose.translation, mesh[1]


def scattered(sizes, reach, seed, subdivisions=1):
    """Balls and rings of several sizes at random poses."""
    rng = np.random.default_rng(seed)
    meshes, poses = [], []
    for number, size in enumerate(sizes):
        mesh = shapes.sphere(size, subdivisions) if number % 2 else shapes.torus(size, 0.3 * size, 11, 7)
        meshes.append(mesh)
        poses.append(Pose(shapes.rotation(number), rng.uniform(-reach, reach, 3)))
    return meshes, poses


def as_one_file(sizes):
    """Meshes side by side, and their common frame."""
    meshes = [shapes.moved(shapes.sphere(1.0, 2), (2.5 * i, 0, 0)) for i in range(sizes)]
    corners = np.concatenate([mesh[0] for mesh in meshes])
    return meshes, common_frame(corners.min(axis=0), corners.max(axis=0))


def scene_named(name):
    """A model, and the same geometry as one mesh."""
    frame = None
    if name == "ball":
        meshes, poses = [shapes.sphere(1.0, 3)], [Pose()]
    elif name == "box far away":
        meshes = [shapes.moved(shapes.box((0, 0, 0), (1, 2, 3)), (1e5, -1e5, 1e5))]
        poses = [Pose(shapes.rotation(5), (3.0, 2.0, 1.0))]
    elif name == "parts of a file":
        meshes, frame = as_one_file(4)
        poses = [Pose()] * 4
    elif name == "parts apart":
        meshes, poses = scattered([1.0] * 7, 3.0, 1)
    elif name == "large and small":
        meshes, poses = scattered([1e3, 1e-3, 1.0, 1e-2, 30.0], 100.0, 2)
    elif name == "minute":
        meshes, poses = scattered([1e-60, 3e-60], 4e-60, 3)
    else:
        meshes, poses = [shapes.sphere(1.0, 2), shapes.sphere(float(name), 3)], [Pose(), Pose()]
        poses[0] = Pose(np.eye(3), (0.0, 0.0, 3.0))
    return model_of(*meshes, poses=poses, frame=frame), shapes.join(*map(placed, meshes, poses))


def points_at(mesh, rng, count):
    """Points on and near faces, among them, off them, and a million sizes away."""
    corners = mesh[0][mesh[1][rng.integers(0, len(mesh[1]), count)]]
    weights = rng.dirichlet(np.ones(3), count)
    weights[::4] = np.eye(3)[0]
    on = (weights[..., None] * corners).sum(axis=1)
    size = np.ptp(corners, axis=1).max(axis=-1, keepdims=True)
    middle = 0.5 * (mesh[0].min(axis=0) + mesh[0].max(axis=0))
    extent = np.ptp(mesh[0], axis=0).max()
    away = rng.normal(size=(count, 3))
    kinds = [on, on + size * 10.0 ** rng.uniform(-9, 1, (count, 1)) * away, middle + 0.7 * extent * away]
    kinds += [middle + 0.01 * size * away, middle + 1e6 * extent * away]
    return np.concatenate([kind[i :: len(kinds)] for i, kind in enumerate(kinds)])


def by_hand(node_count, children):
    """A one-part model of nodes whose boxes all contain the origin; leaves are empty."""
    nodes = np.zeros((node_count, NODE_STRIDE), np.float32)
    nodes[:, :24], nodes[:, 24:48] = -1.0, 1.0
    nodes.view(np.int32)[:, NODE_CHILDREN : NODE_CHILDREN + LANES] = children
    moments = np.zeros(node_count * MOMENT_STRIDE, np.float32)
    parts, frames = np.zeros(2, PART), np.zeros(2, FRAME)
    parts["moments"], parts["node_count"][0], frames["scale"] = nodes.size, node_count, 1.0
    frames["rotation"] = np.eye(3).reshape(-1)
    return np.full(BLOCK_STRIDE, np.nan), np.concatenate([nodes.ravel(), moments]), frames, parts


def eightfold(depth):
    """A tree whose nodes have eight children each, down to one empty leaf that all share."""
    count = (8**depth - 1) // 7
    children = 1 + 8 * np.arange(count)[:, None] + np.arange(LANES)
    children[children >= count] = ~0
    return by_hand(count, children)
