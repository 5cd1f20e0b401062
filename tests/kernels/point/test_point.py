"""The closest-point traversal: the same result from any start, and the correct part."""

import numpy as np
import pytest
import shapes
from models import arrays_of
from scene_parts import some_parts

from proximity.kernels.geometry.frames import part_of_slot, to_local
from proximity.kernels.layout import LANES, NO_PART, NO_SLOT, STACKS_SIZE
from proximity.kernels.point.walk import (
    NOTHING_SEEN,
    best_of_block,
    closest_in_part,
    nearest_in_scene,
    slot_distance_sq,
)
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

pytestmark = pytest.mark.internals

MESHES = {
    "sphere": shapes.sphere(1.0, 2),
    "box": shapes.quartered(*shapes.cube(2.0, (0.0, 0.0, 0.0))),
    "one face": (np.eye(3), np.array([[0, 1, 2]])),
    "ten in one place": (np.eye(3), np.tile([[0, 1, 2]], (10, 1))),
}


def model_of(name):
    mesh = TriangleMesh(*MESHES[name])
    return Solid(mesh.vertices, mesh.faces).snapshot()


def some_points(rng, count):
    """Points around, far away, and at the centre of parts."""
    return np.concatenate([rng.normal(size=(count, 3)), 1e4 * rng.normal(size=(3, 3)), np.zeros((1, 3))])


@pytest.mark.parametrize("name", MESHES)
def test_walk_from_a_block_that_was_seen_ends_as_one_from_nothing(name):
    model, stacks = model_of(name), np.empty(STACKS_SIZE, np.float32)
    arrays = arrays_of(model)
    root, count = model.parts["root"][0], model.parts["block_count"][0]
    rng = np.random.default_rng(7)

    for point in some_points(rng, 30):
        local = to_local(model.frames, model.parts, 0, *map(float, point))
        cold = closest_in_part(
            arrays, 0, root, local, np.inf, np.int64(NO_SLOT), np.int64(NOTHING_SEEN), stacks
        )
        for block in rng.integers(0, count, 4) + model.parts["first_block"][0]:
            slot = LANES * block
            best_sq, best = best_of_block(model.reals, slot, *local)
            warm = closest_in_part(arrays, 0, root, local, best_sq, best, ~block, stacks)
            assert warm == cold


@pytest.mark.parametrize("name", MESHES)
def test_best_of_a_block_is_the_lowest_of_its_nearest_triangles(name):
    model = model_of(name)

    for point in some_points(np.random.default_rng(8), 10):
        local = to_local(model.frames, model.parts, 0, *map(float, point))
        for block in range(model.parts["block_count"][0]):
            each = [slot_distance_sq(model.reals, LANES * block + k, *local) for k in range(LANES)]
            assert best_of_block(model.reals, LANES * block + 3, *local) == (
                np.nanmin(each),
                LANES * block + int(np.nanargmin(each)),
            )


@pytest.mark.parametrize("count", [1, 2, 9, 40])
def test_scene_is_walked_from_any_block_to_the_same_end(count):
    model, stacks = Scene(some_parts(count)).snapshot(), np.empty(STACKS_SIZE, np.float32)
    arrays = arrays_of(model)
    rng = np.random.default_rng(count)
    scale = model.frames["scale"][-1 if count > 1 else 0]

    for point in rng.uniform(-6.0, 6.0, (40, 3)):
        place = tuple(map(float, point))
        nothing = (np.inf, np.int64(NO_PART), np.int64(NO_SLOT), np.int64(NOTHING_SEEN))
        cold = nearest_in_scene(arrays, place, *nothing, stacks)
        part = int(rng.integers(count))
        block = model.parts["first_block"][part] + int(rng.integers(model.parts["block_count"][part]))
        best_sq, slot = best_of_block(
            model.reals, LANES * block, *to_local(model.frames, model.parts, part, *place)
        )
        ratio = model.frames["scale"][part] / scale
        warm = nearest_in_scene(arrays, place, best_sq / ratio**2, part, slot, ~block, stacks)
        assert warm == cold


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_each_slot_belongs_to_the_part_that_has_its_block(count):
    model = Scene(some_parts(count)).snapshot()

    for part in range(count):
        first, blocks = model.parts["first_block"][part], model.parts["block_count"][part]
        for slot in (LANES * first, LANES * (first + blocks) - 1):
            assert part_of_slot(model.words, model.parts, slot) == part


def test_parts_of_a_scene_asked_alone_are_part_0():
    scene = Scene(some_parts(5))
    scene.closest((0.0, 0.0, 0.0))
    model = scene.parts[3].solid.snapshot()

    assert part_of_slot(model.words, model.parts, LANES * model.parts["first_block"][0]) == 0
