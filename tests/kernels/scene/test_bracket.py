"""Bounds of the signed distance: correct for any budget and start, and equal if the budget suffices."""

import numpy as np
import pytest
import shapes
from models import arrays_of
from scene_parts import part_of, some_parts

import oracle
from proximity.kernels import contact_record
from proximity.kernels.geometry.closest_feature import CLOSEST
from proximity.kernels.layout import NO_SLOT
from proximity.kernels.scene.queries import distance_bounds
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE
from proximity.pose import Pose
from proximity.scene.scene import Scene

pytestmark = pytest.mark.internals

PLENTY = 10**6


class Asked:
    """A scene and the scratch memory of its queries."""

    def __init__(self, scene):
        self.scene = scene
        self.model = scene.snapshot()
        self.workspace, self.closest = np.zeros(WORKSPACE_SIZE, np.float32), np.zeros(1, CLOSEST)[0]
        m = self.model
        self.arrays = arrays_of(m)

    def at(self, point, *, part=-1, slot=NO_SLOT, is_outside=False, tolerance=0.0, core=0.0, budget=PLENTY):
        """Return distance, lower, upper, clear, part, slot, bits, work."""
        return distance_bounds.bounds_at(
            self.arrays, tuple(map(float, point)), part, slot, is_outside, tolerance, core, budget,
            self.workspace, self.closest,
        )  # fmt: skip

    def face(self, part, slot):
        return self.model.words.view(np.int32)[self.model.parts["slot_faces"][part] + slot]

    def triangle(self, part, slot):
        """Corners in the scene's frame."""
        each = self.scene.parts[part]
        return each.pose.point(each.solid.mesh.vertices[each.solid.mesh.faces[self.face(part, slot)]])


@pytest.fixture(scope="module")
def asked():
    """Overlapping parts of all kinds, a sheet, one with a hole; one has moved, one is hidden."""
    parts = some_parts(12, seed=4)
    vertices, faces = shapes.sphere(1.0, 2)
    parts.append(part_of((vertices, faces[1:]), "holed", Pose(translation=(3, 0, 0))))
    parts.append(part_of(shapes.grid(), "sheet", Pose(shapes.rotation(1), (-2, 0, 0))))
    scene = Scene(parts)
    scene.move("part 2", Pose(shapes.rotation(5), (0.5, 0.5, 0.0)))
    scene.hide("part 4")
    return Asked(scene)


def unsigned(scene, points):
    """Distances to the nearest surface, also inside overlapping parts, by segments of zero length."""
    return scene.closest_to_segments(points, points).distance


def points(count, seed=2):
    return np.random.default_rng(seed).uniform(-5.0, 5.0, (count, 3))


def test_with_plenty_of_steps_both_bounds_are_the_distance_of_the_scene(asked):
    where = points(300)
    for point, true in zip(where, asked.scene.signed_distance(where), strict=True):
        distance, lower, upper, _, part, slot, bits, _ = asked.at(point)
        assert distance == lower == upper == pytest.approx(true, rel=1e-12, abs=1e-13)
        assert bits & contact_record.EXACT and not bits & contact_record.BOUNDED
        assert bool(bits & contact_record.INSIDE) == (true < 0.0)
        assert asked.closest["length"] > 0.0 and slot != NO_SLOT and part >= 0


@pytest.mark.parametrize("budget", [1, 2, 3, 5, 8, 13, 21, 50])
def test_bounds_hold_for_any_budget(asked, budget):
    where = points(200, seed=budget)
    true, bare = asked.scene.signed_distance(where), unsigned(asked.scene, where)
    gaps = []
    for row, point in enumerate(where):
        distance, lower, upper, clear, _, _, bits, work = asked.at(point, budget=budget)
        assert lower <= true[row] + 1e-13 and true[row] <= upper + 1e-13
        assert lower <= distance <= upper
        assert clear <= bare[row] + 1e-13
        assert bool(bits & contact_record.EXACT) == (lower == upper) != bool(bits & contact_record.BOUNDED)
        assert work <= budget + 12 * distance_bounds.MIN_DEPTH_STEPS
        gaps.append(upper - lower)
    assert (np.array(gaps) > 0.0).any() == (budget < 50)


def test_more_steps_leave_a_smaller_gap():
    ball = Asked(Scene([part_of(shapes.sphere(1.0, 4))]))
    gaps = []
    for budget in (4, 16, 64, 256, PLENTY):
        _, lower, upper, *_ = ball.at((0.01, 0.02, 0.0), budget=budget)
        assert lower <= -0.97 <= upper or upper - lower < 0.05
        gaps.append(upper - lower)

    assert gaps == sorted(gaps, reverse=True) and gaps[0] > 0.0 and gaps[-1] == 0.0


@pytest.mark.parametrize("budget", [20, 100, 400])
def test_inside_a_part_the_gap_is_that_of_the_walk(budget):
    """The sign is computed after the traversal, with or without remaining steps; it does not widen bounds."""
    ball = Asked(Scene([part_of(shapes.sphere(1.0, 5))]))
    _, lower, upper, _, _, _, bits, _ = ball.at((0.001, 0.002, 0.0), budget=budget)
    _, least, most, *_ = ball.at((0.001, 0.002, 0.0), budget=budget, is_outside=True)

    assert bits & contact_record.INSIDE and most - least > 0.0
    assert (lower, upper) == pytest.approx((-most, -least), rel=1e-14)


def test_inside_of_two_the_gap_holds_the_deeper_one():
    where = np.random.default_rng(5).uniform(-0.6, 0.6, (50, 3))
    two = Asked(Scene([part_of(shapes.sphere(1.0, 4), "ball"), part_of(shapes.cube(9.0), "cube")]))
    expected = two.scene.signed_distance(where)
    for budget in (1, 10, 50, 200):
        for point, true in zip(where, expected, strict=True):
            _, lower, upper, *_ = two.at(point, budget=budget)
            assert lower <= true * (1 - 1e-15) and true * (1 + 1e-15) <= upper


def test_face_to_start_from_changes_no_exact_answer(asked):
    rng, where = np.random.default_rng(3), points(40)
    for point in where:
        expected = asked.at(point)
        for _ in range(3):
            _, _, _, _, part, slot, _, _ = asked.at(points(1, seed=int(rng.integers(1000)))[0])
            assert asked.at(point, part=part, slot=slot)[:4] == expected[:4]
        assert asked.at(point, part=expected[4], slot=expected[5])[:7] == expected[:7]


def test_known_to_be_outside_spares_the_question_for_the_side(asked):
    where = points(100)
    for point in where[asked.scene.signed_distance(where) > 0.0]:
        assert asked.at(point, is_outside=True)[:7] == asked.at(point)[:7]


def test_with_ease_a_bracket_outside_is_as_wide_and_inside_it_is_exact(asked):
    where = points(300)
    for point, true in zip(where, asked.scene.signed_distance(where), strict=True):
        core = 0.1
        _, lower, upper, clear, *_ = asked.at(point, is_outside=True, tolerance=0.2, core=core)
        if true > 0.0:
            assert lower <= true * (1.0 + 1e-12) and true <= upper * (1.0 + 1e-12)
            assert clear <= lower
            assert lower == pytest.approx(upper - 0.2 * max(upper - core, 0.0), rel=1e-12)
        assert asked.at(point, tolerance=0.2, core=core)[:7] == asked.at(point)[:7]


def test_inside_several_parts_the_deepest_counts_and_its_face_is_told():
    nested = Asked(Scene([part_of(shapes.cube(s, (0, 0, 0)), f"{s}") for s in (1.0, 4.0, 2.0)]))
    distance, lower, upper, clear, part, slot, bits, _ = nested.at((0.0, 0.0, 0.25))

    assert distance == lower == upper == -1.75
    assert part == 1 and bits == contact_record.EXACT | contact_record.SIGNED | contact_record.INSIDE
    assert clear <= 0.25 and clear == pytest.approx(0.25)
    assert np.allclose(nested.triangle(part, slot)[:, 2], 2.0)


def test_of_a_sheet_the_side_is_not_known():
    sheet = Asked(Scene([part_of(shapes.grid())]))
    for height in (0.5, -0.5):
        distance, *_, bits, _ = sheet.at((1.3, 1.2, height))
        assert (distance, bits) == (0.5, contact_record.EXACT)


def test_with_all_parts_hidden_nothing_is_near():
    scene = Scene([part_of(shapes.cube())])
    scene.hide("part")
    distance, lower, upper, clear, _, slot, bits, _ = Asked(scene).at((0.5, 0.5, 0.5))

    assert distance == lower == upper == clear == np.inf
    assert slot == NO_SLOT and bits == contact_record.EXACT


def test_a_witness_of_a_slot_is_as_far_as_its_triangle(asked):
    for point in points(50):
        _, _, _, _, part, slot, _, _ = asked.at(points(1, seed=int(abs(point[0]) * 1000))[0])
        corners = asked.triangle(part, slot)
        expected = oracle.closest(corners, np.array([[0, 1, 2]]), point[None]).distance[0]
        assert distance_bounds.fill_closest(
            asked.arrays, part, slot, tuple(map(float, point)), asked.closest
        ) == pytest.approx(expected)


def test_no_face_is_farther_than_the_farthest_corner(asked):
    vertices = np.concatenate([part.pose.point(part.solid.mesh.vertices) for part in asked.scene.parts])
    for point in points(50):
        farthest = np.linalg.norm(vertices - point, axis=1).min()
        assert distance_bounds.beyond_all(asked.model.frames, *point) >= farthest


def test_within_a_limit_only_nearer_faces_are_found(asked):
    scale = asked.model.frames["scale"][-1]
    for point in points(50):
        distance = float(unsigned(asked.scene, point))
        for limit, is_found in ((0.99 * distance, False), (1.01 * distance, True)):
            best_sq, _, slot, lower_sq, _ = distance_bounds.nearest_from_face(
                asked.arrays, tuple(point), 0, NO_SLOT, (limit * scale) ** 2, (0.0, 0.0), PLENTY,
                asked.workspace,
            )  # fmt: skip
            assert (slot != NO_SLOT) == is_found
            assert lower_sq >= best_sq
            assert np.sqrt(best_sq) / scale == pytest.approx(distance if is_found else limit)


def test_only_in_the_box_of_a_part_with_holes_a_point_may_slip_in(asked):
    slips = lambda *point: distance_bounds.is_in_box_with_holes(asked.arrays, tuple(map(float, point)))  # noqa: E731

    assert slips(3.0, 0.0, 0.0) and slips(3.9, 0.9, 0.9)
    assert not slips(4.2, 0.0, 0.0) and not slips(-2.0, 0.0, 0.0) and not slips(0.5, 0.5, 0.0)


@pytest.mark.parametrize("kind", ["balls", "boxes", "open balls"])
@pytest.mark.parametrize("count", [30, 200])
def test_parts_within_parts_are_not_all_searched_when_the_budget_is_spent(kind, count):
    """Regression: each part took eight steps, so that a finger in 200 nested parts took 1.6 ms per tick."""
    vertices, faces = shapes.cube(2.0, (0, 0, 0)) if kind == "boxes" else shapes.sphere(1.0, 2)
    faces = faces[1:] if kind == "open balls" else faces
    sizes = np.random.default_rng(6).permutation(1.0 + 0.01 * np.arange(count))
    nested = Asked(Scene([part_of((size * vertices, faces), f"{size}") for size in sizes]))
    for point in np.random.default_rng(7).uniform(-0.4, 0.4, (20, 3)):
        true = nested.scene.signed_distance(point)
        for budget in (1, 40, 400):
            distance, lower, upper, _, part, slot, bits, work = nested.at(point, budget=budget)
            assert lower <= true * (1.0 - 1e-12) and true * (1.0 + 1e-12) <= upper
            assert lower <= distance <= upper
            assert (
                work
                <= budget + distance_bounds.SPARE_DEPTH_STEPS + count + distance_bounds.MIN_DEPTH_STEPS + 4
            )
            assert bits & contact_record.INSIDE and lower >= -2.5 * nested.scene.bounds[1].max()
            if slot >= 0:
                face = oracle.closest(nested.triangle(part, slot), [[0, 1, 2]], point)
                assert face.distance == pytest.approx(-distance)
        assert nested.at(point)[:3] == pytest.approx((true, true, true))
