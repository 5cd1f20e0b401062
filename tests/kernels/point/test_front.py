"""The coherent search from a front: the same nearest face as from the root, for any motion."""

import numpy as np
import pytest
import shapes
from budgeted import SCENES, WORKSPACE, points_at, scene_named, without_budget
from models import arrays_of, model_of
from scene_parts import part_of

from proximity.kernels.geometry.frames import part_of_slot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_CHILDREN, NODE_STRIDE
from proximity.kernels.point import coherent_search as frontiers
from proximity.kernels.point.coherent_search import (
    FRONTIER_BEGINS,
    FRONTIER_CAPACITY,
    FRONTIER_GROUP,
    FRONTIER_SIZE,
    LONG_WALK,
    nearest_from_last_answer,
)
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

PLENTY = 10**6


class Searcher:
    """A point that moves in a model, and its front."""

    def __init__(self, model):
        self.model = model
        self.arrays = arrays_of(model)
        self.row = np.full(FRONTIER_SIZE + LANES, np.nan, np.float32)
        self.row[:FRONTIER_SIZE] = 0.0
        self.count, self.slot = FRONTIER_BEGINS, None
        self.steps = 0

    def at(self, point, budget=PLENTY):
        """Return squared distance, slot, and whether it was found; check for writes past the front."""
        if self.slot is None:
            _, self.slot = without_budget(self.model, point)
        part = int(part_of_slot(self.model.words, self.model.parts, self.slot))
        found_sq, part, slot, is_found, self.count, self.steps = nearest_from_last_answer(
            self.arrays, tuple(map(float, point)), part, self.slot, self.row[:FRONTIER_SIZE],
            self.count or FRONTIER_BEGINS, budget, WORKSPACE,
        )  # fmt: skip
        assert np.isnan(self.row[FRONTIER_SIZE:]).all() and 0 <= self.count <= FRONTIER_CAPACITY
        assert part == part_of_slot(self.model.words, self.model.parts, slot)
        self.slot = int(slot)
        return float(found_sq), int(slot), bool(is_found)


def ways(mesh, rng, count):
    """Paths of several kinds: at rest, straight, random, oscillating, and jumping."""
    extent = np.ptp(mesh[0], axis=0).max()
    start = points_at(mesh, rng, 5)
    for kind, step in enumerate((0.0, 1e-9, 1e-3, 1e-2, 0.3)):
        place = start[kind]
        velocity = step * extent * rng.normal(size=3)
        for _ in range(count):
            yield place
            if kind % 2:
                velocity = 0.9 * velocity + 0.4 * step * extent * rng.normal(size=3)
            place = place + velocity + 0.01 * step * extent * rng.normal(size=3)


@pytest.mark.internals
@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_answer_of_the_walk_wherever_the_point_goes(name):
    model, mesh = scene_named(name)
    searcher = Searcher(model)
    found = 0
    for point in ways(mesh, np.random.default_rng(4), 120):
        true_sq, slot = without_budget(model, point)
        got_sq, got, is_found = searcher.at(point)
        if is_found:
            assert got_sq == pytest.approx(true_sq, rel=1e-12, abs=1e-26)
            assert got == slot or got_sq == true_sq
            found += 1
        else:
            assert got_sq >= true_sq * (1.0 - 1e-12)
    assert found > 300


@pytest.mark.internals
def test_slots_and_squares_are_those_of_the_walk_to_the_bit():
    model, mesh = scene_named("ball")
    searcher = Searcher(model)
    for point in ways(mesh, np.random.default_rng(5), 200):
        got_sq, got, is_found = searcher.at(point)
        if is_found:
            assert (got_sq, got) == without_budget(model, point)


def faces_below(model, reference):
    """Corners (N, 3) of all triangles below a reference, in the frame of the tree."""
    if reference < 0:
        block = model.reals[BLOCK_STRIDE * ~reference :][:BLOCK_STRIDE].reshape(3, 3, LANES)
        corners = block.transpose(2, 0, 1).reshape(-1, 3)
        return corners[~np.isnan(corners[:, 0])]
    node = model.words[NODE_STRIDE * reference :][:NODE_STRIDE]
    lanes = np.flatnonzero(node[:LANES] <= node[24 : 24 + LANES])
    children = node.view(np.int32)[NODE_CHILDREN + lanes]
    return np.concatenate([faces_below(model, int(child)) for child in children])


@pytest.mark.internals
def test_planes_have_all_that_is_below_them_behind():
    model = model_of(shapes.sphere(1.0, 5))
    searcher = Searcher(model)
    rng = np.random.default_rng(6)
    place, seen = np.array([0.9, 1.1, 1.3]), 0
    for step in range(60):
        place = place + 0.005 * rng.normal(size=3)
        searcher.at(place)
        if step % 10:
            continue
        for k in range(searcher.count):
            planes = (
                searcher.row[FRONTIER_GROUP * k : FRONTIER_GROUP * (k + 1)]
                .reshape(4, LANES)
                .astype(np.float64)
            )
            node = model.words[NODE_STRIDE * int(searcher.row[frontiers.FRONTIER_NODES + k]) :][:NODE_STRIDE]
            for lane in np.flatnonzero((node[:LANES] <= node[24 : 24 + LANES]) & np.isfinite(planes[3])):
                corners = faces_below(model, int(node.view(np.int32)[NODE_CHILDREN + lane]))
                direction, offset = planes[:3, lane], planes[3, lane]
                assert np.linalg.norm(direction) <= 1.0 + 1e-6
                assert (corners @ direction).max() <= offset + 1e-6
                seen += 1
    assert seen > 500


@pytest.mark.internals
def test_the_front_holds_every_face():
    model = model_of(shapes.torus(1.0, 0.4, 40, 30))
    searcher = Searcher(model)
    for turn in range(50):
        searcher.at((0.02 + 1e-4 * turn, 0.0, 1.5))
    held = set()
    opened = {int(searcher.row[frontiers.FRONTIER_NODES + k]) for k in range(searcher.count)}
    assert int(model.parts["root"][0]) in opened
    for node in opened:
        words = model.words[NODE_STRIDE * node :][:NODE_STRIDE]
        for lane in np.flatnonzero(words[:LANES] <= words[24 : 24 + LANES]):
            child = int(words.view(np.int32)[NODE_CHILDREN + lane])
            if child not in opened:
                held |= set(map(tuple, faces_below(model, child)))
    assert held == set(map(tuple, faces_below(model, int(model.parts["root"][0]))))


@pytest.mark.internals
def test_a_point_that_hardly_moves_takes_few_steps():
    model = model_of(shapes.sphere(1.0, 5))
    searcher = Searcher(model)
    place = np.array([0.9, 1.1, 1.3])
    searcher.at(place)
    first, later = searcher.steps, []
    assert first >= LONG_WALK
    for _ in range(100):
        place = place + 1e-4
        searcher.at(place)
        later.append(searcher.steps)
    assert np.mean(later) < 0.2 * first and min(later) >= 1


@pytest.mark.internals
def test_few_faces_are_not_worth_a_front():
    searcher = Searcher(model_of(shapes.cube()))
    assert searcher.at((2.0, 0.3, 0.2))[2]
    assert searcher.steps < LONG_WALK and searcher.count == 0


@pytest.mark.internals
@pytest.mark.parametrize("budget", [1, 2, 5, 20])
def test_without_steps_enough_it_says_so(budget):
    model, _ = scene_named("ball")
    searcher = Searcher(model)
    searcher.at((2.0, 0.0, 0.0))
    searcher.count = FRONTIER_BEGINS
    got_sq, _, is_found = searcher.at((0.0, 0.0, 1e-3), budget)
    assert not is_found and searcher.count == 0 and searcher.steps <= budget
    assert got_sq >= without_budget(model, (0.0, 0.0, 1e-3))[0]


@pytest.mark.internals
@pytest.mark.parametrize("point", [(1e9, 0.0, 0.0), (0.0, -1e200, 0.0)])
def test_from_very_far_away_it_is_not_for_fronts(point):
    searcher = Searcher(scene_named("ball")[0])
    searcher.at((2.0, 0.0, 0.0))
    assert not searcher.at(point)[2]


@pytest.mark.internals
def test_where_more_nodes_are_near_than_it_holds_it_is_given_up():
    model = model_of(shapes.sphere(1.0, 5))
    searcher = Searcher(model)
    assert not searcher.at((1e-4, 0.0, 0.0))[2]
    assert searcher.count == 0


def ticked(scene, tracker, places, between=lambda step: None):
    """Tick along *places* (N, F, 3); compare each exact distance with the scene's."""
    kept = 0
    for step, place in enumerate(places):
        between(step)
        found = tracker.tick(place, (step + 1) * 10**6, (step + 1) * 10**6)
        true = scene.signed_distance(place)
        is_there = np.isfinite(place).all(axis=1)
        assert np.abs(found["signed_distance"] - true)[is_there].max() <= 1e-12
        assert (found["lower"] == found["upper"])[is_there].all()
        kept += int((tracker._arrays["tracks"]["frontier_count"] > 0).sum())
    return kept


def wandering(scene, count, fingers, seed=8):
    lower, upper = scene.bounds
    rng = np.random.default_rng(seed)
    start = rng.uniform(lower, upper, (fingers, 3))
    steps = 1e-3 * np.ptp([lower, upper]) * rng.normal(size=(count, fingers, 3))
    return start + np.cumsum(np.cumsum(steps, axis=0) / 20.0, axis=0)


def test_ticks_answer_as_the_scene_does_while_parts_move_deform_hide_and_go():
    balls = [shapes.moved(shapes.sphere(1.0, 4), (2.2 * k, 0.3 * k, 0.0)) for k in range(5)]
    scene = Scene.from_mesh(*shapes.join(*balls))
    names = [part.name for part in scene.parts]
    tracker = Tracker(scene, fingers=5, radius=0.0, working_range=10.0, max_speed=1e6)

    def between(step):
        if step == 60:
            scene.move(names[2], Pose(shapes.rotation(5), (0.5, 0.5, 0.0)))
        if step == 90:
            scene.hide(names[1])
        if step == 120:
            scene.deform(names[0], 1.1 * scene.parts[0].solid.mesh.vertices)
        if step == 150:
            scene.remove(names[3])
        if 170 < step < 180:
            scene.move(names[4], Pose(translation=(0.01 * step, 0.0, 0.0)))
        if step == 185:
            tracker.reset()
        if step == 190:
            scene.show(names[1])

    places = wandering(scene, 240, 5)
    places[100:105, 1] = np.nan
    assert ticked(scene, tracker, places, between) > 300


def test_fronts_go_on_while_the_only_part_moves_and_begin_anew_when_its_shape_changes():
    """Regression: a part that moved at every tick required a full traversal for each finger."""
    scene = Scene([part_of(shapes.sphere(1.0, 5), "ball", Pose())])
    tracker = Tracker(scene, fingers=5, radius=0.0, working_range=10.0, max_speed=1e6)
    vertices, rng = scene.parts[0].solid.mesh.vertices, np.random.default_rng(4)
    shift, angle = np.zeros(3), 0.0

    def between(step):
        nonlocal angle
        shift[:] += 1e-3 * rng.normal(size=3)
        angle += 1e-3 * rng.normal()
        if step == 100:
            shift[:] += 5.0
        turn = Pose.from_quaternion([0, 0, np.sin(angle), np.cos(angle)]).rotation
        scene.move("ball", Pose(turn, shift), velocity=shift, angular_velocity=[0.0, 0.0, 1.0])
        if step == 60:
            scene.hide("ball")
            scene.show("ball")
        if step in (80, 81):
            scene.deform("ball", vertices * [1.0, 1.0 + 0.01 * step, 1.0])

    places = wandering(scene, 200, 5)
    assert ticked(scene, tracker, places, between) > 300


def test_a_move_is_not_forgotten_when_the_tick_is_interrupted(monkeypatch):
    scene = Scene.from_mesh(
        *shapes.join(shapes.sphere(1.0, 4), shapes.moved(shapes.sphere(1.0, 4), (9, 0, 0)))
    )
    tracker = Tracker(scene, fingers=1, radius=0.0, working_range=10.0, max_speed=1e6)
    place = np.array([[2.0, 1.0, 0.2]])
    assert ticked(scene, tracker, np.repeat(place[None], 10, axis=0))
    scene.move(scene.parts[1].name, Pose(translation=(-5.0, 0.0, 0.0)))
    with monkeypatch.context() as patch:
        patch.setattr("proximity.tracker.tracker.tick", interrupted)
        with pytest.raises(KeyboardInterrupt):
            tracker.tick(place, 11 * 10**6, 11 * 10**6)
    assert tracker.tick(place, 12 * 10**6, 12 * 10**6)["signed_distance"] == scene.signed_distance(place)


def interrupted(*_):
    raise KeyboardInterrupt


def test_crowds_keep_no_fronts():
    scene = Scene([part_of(shapes.sphere(1.0, 4), "fine", Pose())])
    assert len(Tracker(scene, fingers=11)._arrays["frontiers"]) == 0
    assert len(Tracker(scene, fingers=10)._arrays["frontiers"]) == 10
