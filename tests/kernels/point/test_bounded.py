"""The budgeted traversal: bounds correct for any work, guaranteed termination, no stray writes."""

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import shapes
from budgeted import (
    GUARD,
    MINUTE_BESIDE_LARGE,
    SCENES,
    UNLIMITED,
    UNTOUCHED,
    block_count,
    by_hand,
    eightfold,
    guarded_room,
    known,
    points_at,
    scene_named,
    walk,
    without_budget,
)
from models import model_of, model_of_one

import oracle
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    MAX_DEPTH,
    MOMENT_AREA_NORMAL,
    MOMENT_SLAB_LARGEST,
    MOMENT_SLAB_LEAST,
    MOMENT_STRIDE,
    NO_SLOT,
    NODE_CHILDREN,
    NODE_STRIDE,
)
from proximity.kernels.point.budgeted_walk import NO_TOLERANCE, nearest_with_budget
from proximity.kernels.traverse.best_first import MAX_SWEPT_STEPS, MAX_WAITING
from proximity.pose import Pose
from proximity.scene.model.assembly import assemble

pytestmark = pytest.mark.internals

ROUNDING = 1e-13
"""Error of distances, relative and in coordinates; accuracy.md states 1e-12 and 1e-15, in lengths."""


def assert_between(low, distance, high, size):
    """Check that a distance lies between two bounds within its own rounding."""
    slack = ROUNDING * (distance + size)
    assert low - slack <= distance <= high + slack, (low, distance, high)


@pytest.mark.parametrize("name", SCENES + MINUTE_BESIDE_LARGE)
def test_bounds_hold_whatever_the_budget(name):
    """Start without a candidate, from a known triangle, or with a limit; complete traversals are exact."""
    rng = np.random.default_rng(7)
    model, mesh = scene_named(name)
    points = points_at(mesh, rng, 40)
    if name in MINUTE_BESIDE_LARGE:
        points = float(name) * rng.normal(size=(40, 3)) * 10.0 ** rng.uniform(-0.5, 0.5, (40, 1))
        # Other points between the two parts, some along axes; for the small part their squares overflow.
        points[::4] = rng.normal(size=(10, 3)) * 10.0 ** rng.uniform(np.log10(float(name)), -1, (10, 1))
        points[4::12, :2] = 0.0
    # Relative to the small part in those cases: the oracle is accurate next to the large one.
    size = float(name) if name in MINUTE_BESIDE_LARGE else abs(mesh[0]).max()
    scale = model.frames["scale"][-1]
    used = np.flatnonzero(~np.isnan(model.reals[: BLOCK_STRIDE * block_count(model)].reshape(-1, 9, 8)[:, 0]))
    for point, distance in zip(points, oracle.closest(*mesh, points).distance, strict=True):
        exact = without_budget(model, point)
        slot = int(rng.choice(used))
        limit = float(exact[0] * rng.choice([0.25, 4.0]))
        starts = [(np.inf, NO_SLOT), (known(model, point, slot), slot), (limit, NO_SLOT)]
        for best_sq, best_slot in starts:
            ended = without_budget(model, point, best_sq, best_slot)
            assert walk(model, point, UNLIMITED, best_sq, best_slot)[:3] == (*ended, ended[0])
            for budget in [*rng.integers(1, 2000, 2), *rng.integers(1, 60, 4)]:
                found = walk(model, point, int(budget), best_sq, best_slot)
                low, high = np.sqrt([found.lower_sq, found.best_sq]) / scale
                assert_between(low, distance, np.inf, size)
                if found.slot != NO_SLOT:
                    assert_between(0.0, distance, high, size)
                    assert found.best_sq == known(model, point, found.slot)
                else:
                    assert found.best_sq == best_sq
                if found.work < budget:
                    assert found[:3] == (*ended, ended[0])


@pytest.mark.parametrize("tolerance", [0.02, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("name", SCENES)
def test_with_ease_bounds_hold_and_no_more_than_its_share_is_missed(name, tolerance):
    """The tolerance applies to the distance beyond *exact_within*, below which the search is exact."""
    rng = np.random.default_rng(8)
    model, mesh = scene_named(name)
    points = points_at(mesh, rng, 40)
    size, scale = abs(mesh[0]).max(), model.frames["scale"][-1]
    steps, exact_steps = 0, 0
    for point, distance in zip(points, oracle.closest(*mesh, points).distance, strict=True):
        for exact_within in (0.0, 0.5 * distance, 2.0 * distance):
            for budget in (UNLIMITED, int(rng.integers(1, 60)), int(rng.integers(1, 2000))):
                found = walk(model, point, budget, tolerance=tolerance, exact_within=exact_within * scale)
                low, high = np.sqrt([found.lower_sq, found.best_sq]) / scale
                assert_between(low, distance, high, size)
                if found.work < budget:
                    least = high - tolerance * max(high - exact_within, 0.0)
                    assert low == pytest.approx(least, rel=1e-12, abs=1e-300)
        steps += walk(model, point, UNLIMITED, tolerance=tolerance).work
        exact_steps += walk(model, point, UNLIMITED).work
    assert steps <= exact_steps


def test_within_the_core_the_search_is_exact():
    model, mesh = scene_named("ball")
    for point in points_at(mesh, np.random.default_rng(9), 20):
        exact = walk(model, point, UNLIMITED)
        exact_within = 1.0001 * np.sqrt(exact.best_sq)

        found = walk(model, point, UNLIMITED, tolerance=0.3, exact_within=exact_within)

        assert found.lower_sq == found.best_sq == exact.best_sq


def test_with_nothing_found_ease_does_not_lower_the_limit():
    model, mesh = scene_named("ball")
    for point in points_at(mesh, np.random.default_rng(10), 20):
        limit = 0.81 * walk(model, point, UNLIMITED).best_sq
        if limit == 0.0:
            continue  # on the surface

        assert walk(model, point, UNLIMITED, limit, tolerance=0.5)[:3] == (limit, NO_SLOT, limit)


def test_answer_does_not_depend_on_how_the_budget_is_divided():
    rng = np.random.default_rng(7)
    for name in ("ball", "parts of a file", "parts apart"):
        model, mesh = scene_named(name)
        for point in [*points_at(mesh, rng, 10), mesh[0].mean(axis=0), np.zeros(3)]:
            expected = without_budget(model, point)
            needed = walk(model, point, UNLIMITED).work
            third = 4 * MAX_SWEPT_STEPS // 3
            for budget in (MAX_SWEPT_STEPS, third, third + 1, MAX_SWEPT_STEPS + needed, 3 * needed):
                found = walk(model, point, budget)
                if found.work < budget:
                    assert found[:3] == (*expected, expected[0])


def test_each_node_and_each_leaf_is_one_step():
    one_face = model_of((np.eye(3), [[0, 1, 2]]))
    for budget, expected in [(1, (np.inf, NO_SLOT)), (2, (1.0 / 3.0, 0)), (3, (1.0 / 3.0, 0))]:
        found = walk(one_face, (0.0, 0.0, 0.0), budget)
        assert found.work == min(budget, 2)
        assert found[:2] == pytest.approx(expected, rel=1e-15)

    # At this distance no node can be pruned, and every step is needed.
    ball = model_of(shapes.sphere(1.0, 3))
    whole = int(ball.parts["node_count"][0]) + block_count(ball)
    for budget in (whole - 1, whole, whole + 1, 4 * whole, UNLIMITED):
        found = walk(ball, (1e20, 2e20, 1e20), budget)
        assert found.work == min(whole, budget)
        assert (found.lower_sq == found.best_sq) == (budget >= whole)


def test_a_part_in_its_own_frame_costs_no_step_to_enter():
    face = (np.eye(3), [[0, 1, 2]])
    model = model_of(face, face, poses=[Pose(shapes.rotation(3), (5, 0, 0)), Pose(shapes.rotation(4))])

    # The root of the tree over parts, which has both entries, and the nearer entry, which is a leaf.
    assert [walk(model, (0.0, 0.0, 0.0), budget).work for budget in (1, 2, UNLIMITED)] == [1, 2, 2]


@pytest.mark.parametrize("best_sq", [0.0, 5e-324, 1e-320, 1e-40, 1.0, 3.5e38, 1e300, np.inf, np.nan])
def test_any_best_ends_within_the_budget(best_sq):
    rng = np.random.default_rng(7)
    for name in ("ball", "parts apart", "1e-22"):
        model, mesh = scene_named(name)
        for point in points_at(mesh, rng, 10):
            for budget in (1, 7, 100, 1999, UNLIMITED):
                found = walk(model, point, budget, best_sq)
                assert not found.best_sq > best_sq and not found.lower_sq > found.best_sq


def test_point_that_is_not_a_number_finds_nothing_and_ends():
    """Regression: unused lanes were opened, a node led to itself, and the workspace overflowed."""
    values = [np.nan, np.inf, -np.inf, 1.7e308, 1e9, 0.3]
    ball = shapes.sphere(1.0, 1)
    turned = Pose(shapes.rotation(3), (0.1, 0.2, 0.3))
    for model in (
        model_of(ball),
        model_of(ball, poses=[turned]),
        model_of(ball, ball, poses=[turned, Pose()]),
    ):
        for point in itertools.product(values, repeat=3):
            for budget in (1, 50, 5000):
                found = walk(model, point, budget)
                assert found.work <= 60
                if np.isnan(point).any():
                    assert found.slot == NO_SLOT


def test_unused_lanes_of_a_minute_part_stay_closed():
    """Regression: they were opened where bounds underflow in float32, and led to another part's faces."""
    size = 1e-30
    large = shapes.moved(shapes.tetrahedron(), (0.25, 0.0, 0.0))
    sheet = shapes.grid(5, 7)
    model = model_of(large, (size * sheet[0], sheet[1]))
    frame = model.frames[1]
    for corner in large[0] * model.frames["scale"][0]:  # as if in the sheet's frame
        point = corner / frame["scale"] + frame["centre"]
        exact = without_budget(model, point)
        for budget in range(1, 60):
            found = walk(model, point, budget)
            assert found.lower_sq <= exact[0] <= found.best_sq
            assert found.work <= 4 + block_count(model)


def probed(arrays, budget, best_sq=np.inf, room=None):
    """Traverse a tree made by hand from the origin, in a guarded workspace."""
    workspace, whole = room or guarded_room()
    found = nearest_with_budget(
        arrays, 0, 0, (0.0, 0.0, 0.0), (best_sq, NO_SLOT), NO_TOLERANCE, budget, workspace
    )
    assert (whole[:GUARD] == UNTOUCHED).all() and (whole[-GUARD:] == UNTOUCHED).all()
    return found


@pytest.mark.parametrize("best_sq", [np.inf, 1.0, 0.0])
def test_room_suffices_where_all_is_open(best_sq):
    """With all bounds 0 and no face, each step leaves eight more nodes pending, up to the budget."""
    arrays, room = eightfold(6), guarded_room()
    few = [1, 2, 9, 100, 1000, 4 * MAX_SWEPT_STEPS // 3, 2 * MAX_SWEPT_STEPS]
    for budget in [*few, *range(MAX_SWEPT_STEPS - 3, 8 * MAX_SWEPT_STEPS, 997)]:
        assert probed(arrays, budget, best_sq, room) == (best_sq, NO_SLOT, 0.0, budget)
    is_used = room[0][: MAX_WAITING - LANES] != UNTOUCHED
    assert is_used.sum() > MAX_WAITING * 3 // 4, "the room was nearly full"


def test_room_suffices_for_the_deepest_trees_and_all_budgets():
    """Seven nodes are pending per level of the tree over parts, of one more level, and of a part."""
    depth = 2 * MAX_DEPTH + 1
    children = np.full((depth, LANES), ~0)
    children[:-1, 0] = np.arange(1, depth)
    arrays, room = by_hand(depth, children), guarded_room()
    total = depth + 7 * depth + 1
    for budget in [1, depth - 1, depth, 4 * depth, 4 * total, MAX_SWEPT_STEPS, UNLIMITED]:
        lower = 0.0 if budget < total else np.inf
        assert probed(arrays, budget, room=room) == (np.inf, NO_SLOT, lower, min(budget, total))


def test_room_suffices_for_sweeps_after_the_deepest_descent():
    depth, below = 2 * MAX_DEPTH + 1, eightfold(5)
    count = int(below[3]["node_count"][0])
    eight = (
        below[1][: count * NODE_STRIDE].view(np.int32).reshape(-1, NODE_STRIDE)[:, NODE_CHILDREN:][:, :LANES]
    )
    children = np.concatenate([np.full((depth, LANES), depth), np.where(eight >= 0, eight + depth, eight)])
    children[: depth - 1, 0] = np.arange(1, depth)
    arrays = by_hand(depth + count, children)
    for budget in range(4 * MAX_SWEPT_STEPS // 3, 4 * MAX_SWEPT_STEPS // 3 + 60, 7):
        assert probed(arrays, budget) == (np.inf, NO_SLOT, 0.0, budget)


def test_opening_a_node_does_not_lower_the_bound():
    """The bound of a node holds for its children, even if their boxes give less."""
    arrays = by_hand(3, [[1] * LANES, [2] * LANES, [~0] * LANES])
    words, at = arrays[1], int(arrays[3]["moments"][0]) + MOMENT_STRIDE
    words[:48].reshape(6, LANES)[:3, 1:], words[:48].reshape(6, LANES)[3:, 1:] = np.inf, -np.inf
    words[at + MOMENT_AREA_NORMAL : at + MOMENT_AREA_NORMAL + LANES] = 2.0
    words[at + MOMENT_SLAB_LEAST : at + MOMENT_SLAB_LEAST + 2 * LANES] = 1.0  # in the plane 2 x = 1
    for budget, expected in [(1, 0.0), (2, 0.25), (3, 0.25), (7, 0.25)]:
        assert probed(arrays, budget) == (np.inf, NO_SLOT, pytest.approx(expected, rel=1e-6), budget)


def test_copies_of_one_triangle_give_the_lowest_slot_or_bounds():
    vertices = np.array([[0.1, 0, 0], [0, 0.3, 0], [0, 0, 0.7]])
    model = model_of((vertices, np.tile([0, 1, 2], (10_000, 1))))
    whole = int(model.parts["node_count"][0]) + block_count(model)
    for point in ([0.0, 0.0, 0.0], [0.05, 0.15, 0.0], [1.0, 1.0, 1.0], [1e6, 0, 0]):
        exact = without_budget(model, point)
        assert exact[1] == 0
        for budget in (1, 10, 300, 1000, whole, 2 * whole, MAX_SWEPT_STEPS, UNLIMITED):
            found = walk(model, point, budget)
            assert found.lower_sq <= exact[0] <= found.best_sq
            if budget >= whole:
                assert found[:3] == (*exact, exact[0])


def test_thousands_of_parts_are_answered_within_any_budget():
    rng = np.random.default_rng(7)
    piece = model_of_one(shapes.sphere(1.0, 0))
    places = rng.uniform(-40, 40, (3000, 3))
    model = assemble([piece] * 3000, [Pose(shapes.rotation(i % 7), place) for i, place in enumerate(places)])
    for point in [*places[:5], *rng.uniform(-60, 60, (15, 3)), [0, 0, 0], [1e7, 0, 0]]:
        exact = without_budget(model, point)
        assert walk(model, point, UNLIMITED)[:3] == (*exact, exact[0])
        for budget in (1, 30, 100, 400, 2000, 5000, 20_000):
            found = walk(model, point, budget)
            assert found.lower_sq <= exact[0] <= found.best_sq


@pytest.fixture(scope="module")
def cavity():
    """A ball of 81 920 faces in a shell of equal face count, within a scene's memory."""
    shell = shapes.join(shapes.sphere(1.0, 6), shapes.sphere(1.25, 6))
    return model_of(shapes.tetrahedron(), shell).part_alone(1)


def gap_of(model, point, budget):
    found = walk(model, point, budget)
    exact, _ = without_budget(model, point)
    assert found.lower_sq <= exact <= found.best_sq
    return 1.0 - np.sqrt(found.lower_sq / found.best_sq)


def without_slabs(model):
    """The same model with slabs that bound no distance."""
    words, part = model.words.copy(), model.parts[0]
    moments = words[part["moments"] + MOMENT_STRIDE * part["root"] :][: MOMENT_STRIDE * part["node_count"]]
    moments.reshape(-1, MOMENT_STRIDE)[:, MOMENT_SLAB_LEAST : MOMENT_SLAB_LEAST + LANES] = -np.inf
    moments.reshape(-1, MOMENT_STRIDE)[:, MOMENT_SLAB_LARGEST : MOMENT_SLAB_LARGEST + LANES] = np.inf
    return replace(model, words=words)


def test_bracket_at_the_centre_of_a_ball_is_narrow_by_its_slabs(cavity):
    """All faces are equally near: a traversal without a budget tests nearly all of them."""
    points = np.random.default_rng(7).normal(size=(8, 3)) * np.array([0, 1e-9, 1e-4, 1e-3] * 2)[:, None]
    blind = without_slabs(cavity)
    gaps = [gap_of(cavity, point, 800) for point in points]
    blind_gaps = [gap_of(blind, point, 800) for point in points]

    assert max(gaps) < 0.01 < 0.05 < min(blind_gaps)


def test_bracket_at_the_centre_closes_with_the_budget(cavity):
    gaps = [gap_of(cavity, (1e-5, 0.0, 0.0), budget) for budget in (200, 800, 3200)]

    assert gaps[0] < 0.035 and gaps[1] < 0.6 * gaps[0] and gaps[2] < 0.6 * gaps[1]


def test_a_few_steps_from_nothing_find_a_near_face_and_raise_the_bound():
    """Each sweep follows a nearest node down to a leaf, and opens the others in order of distance."""
    found = walk(model_of(shapes.sphere(1.0, 5)), (0.0, 0.0, 0.5), 8)

    assert found.slot != NO_SLOT and 0.2 < found.lower_sq <= 0.25 <= found.best_sq * 1.01 < 0.26


def test_bracket_is_narrow_all_around_the_centre(cavity):
    """Regression: boxes mislead the first descent here, and bounds were 18 % apart without the sweeps."""
    rng = np.random.default_rng(4)
    ways = rng.normal(size=(100, 3))
    points = ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.0, 0.1, (100, 1))

    assert max(gap_of(cavity, point, 600) for point in points) < 0.02


@pytest.mark.parametrize("reach", [2.0, 2.5, 30.0, 1e3, 1e9, 1e17])
def test_first_bounds_are_below_exact_distances(reach):
    """Boxes around single points leave only rounding between bound and distance."""
    rng = np.random.default_rng(7)
    ends = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]])
    model = model_of((ends, np.repeat([[0, 0, 0], [1, 1, 1]], 9, axis=0)))
    assert model.frames["scale"][0] == 1.0
    for point in rng.uniform(-1, 1, (1500, 3)) * reach:
        exact = min(
            sum((Fraction(x) - Fraction(y)) ** 2 for x, y in zip(point, end, strict=True)) for end in ends
        )
        found = walk(model, point, 1)

        assert Fraction(found.lower_sq) <= exact
        assert found.lower_sq >= float(exact) * (1.0 - 2.0**-18) - 2.0**-20
