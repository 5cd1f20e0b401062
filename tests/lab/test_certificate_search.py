"""The search for the worst positions: it finds known ones, only increases the work, and is reproducible."""

import numpy as np
import pytest
import shapes
from certificates import ball_subject

from proximity import Pose, Scene, Solid
from proximity.lab.certificate import starting_positions
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.work import GOALS, Probe, SearchGoal, StartMode, worth
from proximity.lab.certificate.worst_positions import ascend, search
from proximity.scene.part import Part

COUNTS = (60, 60, 20)
COLD_EXACT = SearchGoal(StartMode.COLD, False)


@pytest.fixture(scope="module", autouse=True)
def few_climbs():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("proximity.lab.certificate.worst_positions.CLIMBS", 4)
        yield


@pytest.fixture(scope="module")
def ball():
    """A ball of 5120 faces, 50 mm in radius: at its centre an exact search visits all of them."""
    return ball_subject(0.05, 4)


@pytest.fixture(scope="module")
def searched(ball):
    return search(ball, 3, counts=COUNTS)


def test_centre_of_a_ball_is_found_by_balls_that_shrink(ball, monkeypatch):
    """Without the other starting positions: random, near the surface, and centres of parts."""
    monkeypatch.setattr(starting_positions, "centres", lambda scene: np.zeros((0, 3)))
    at_centre = Probe(ball, COLD_EXACT).contacts(np.zeros((1, 3)))["work"][0]

    found = search(ball, 3, counts=(0, 0, 20))[COLD_EXACT]

    worst = found.positions[0]
    assert worst.work >= 0.95 * at_centre
    assert np.linalg.norm(worst.position) < 0.002
    assert worst.origin == "medial"
    assert np.isnan(found.typical_work)  # undefined without random positions


def test_every_goal_has_its_places_the_dearest_first(searched, ball):
    assert tuple(searched) == GOALS
    for goal, found in searched.items():
        works = [worst.work for worst in found.positions]
        assert works == sorted(works, reverse=True)
        assert all(worst.work >= worst.start_work for worst in found.positions)
        assert found.is_complete
        for worst in found.positions:
            assert worst.lower <= worst.upper <= ball.working_range
            assert goal.has_budget or worst.upper - worst.lower <= 1e-12


def test_budget_bounds_the_work_and_leaves_a_bracket(searched, ball):
    worst = searched[SearchGoal(StartMode.COLD, True)].positions[0]

    assert ball.budget <= worst.work <= ball.budget + 16
    true = ball.scene.signed_distance(worst.position) - 0.007
    assert worst.lower <= true <= worst.upper
    assert worst.upper - worst.lower > 0.0001
    assert worst.work > 5 * searched[SearchGoal(StartMode.COLD, True)].typical_work


def test_same_seed_finds_the_same_and_another_one_elsewhere(ball):
    one, again, other = (
        search(ball, seed, counts=(20, 20, 4), max_steps=20_000)[GOALS[0]] for seed in (5, 5, 6)
    )

    assert [worst.work for worst in one.positions] == [worst.work for worst in again.positions]
    np.testing.assert_array_equal(one.positions[0].position, again.positions[0].position)
    assert not np.array_equal(one.positions[0].position, other.positions[0].position)


def test_search_that_has_spent_its_steps_ends_and_says_so(ball):
    found = search(ball, 3, counts=(400, 400, 20), max_steps=20_000)

    assert not found[COLD_EXACT].is_complete
    assert found[COLD_EXACT].start_count < found[SearchGoal(StartMode.COLD, True)].start_count


@pytest.mark.parametrize("goal", GOALS, ids=str)
def test_ascent_never_goes_down(ball, goal):
    probe, rng = Probe(ball, goal), np.random.default_rng(11)
    for start in rng.uniform(-0.1, 0.1, (3, 3)):
        position, gained = ascend(probe, start, 0.01, rng, max_steps=np.inf)

        assert (np.diff(gained) >= 0.0).all()
        assert gained[-1] == worth(probe.contacts(position[None]))[0]


def test_shrunk_balls_touch_the_ball_and_hold_none_of_it(ball):
    points, normals = starting_positions.surface_samples(ball.scene, 8, np.random.default_rng(2))

    inside = starting_positions.medial_positions(ball, points, normals)[8:]

    touching = np.linalg.norm(inside - points, axis=1)
    # Near the centre the budget bounds the search, so the distance is approximate.
    np.testing.assert_allclose(ball.scene.distance(inside), touching, rtol=0.02)


def test_shrunk_balls_between_two_walls_are_in_the_middle():
    walls = [Solid(*shapes.box([-0.1, -0.1, z], [0.1, 0.1, z + 0.005]), name=f"{z}") for z in (-0.025, 0.020)]
    subject = Subject(Scene(walls))
    points, normals = np.array([[0.01, 0.0, 0.020]]), np.array([[0.0, 0.0, -1.0]])

    positions = starting_positions.medial_positions(subject, points, normals)

    np.testing.assert_allclose(positions[0], [0.01, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(positions[1], [0.01, 0.0, 0.0225], atol=1e-9)


def test_surface_is_sampled_by_area_where_parts_stand_and_are_shown():
    small, large = (Solid(*shapes.cube(size, (0, 0, 0)), name=f"{size}") for size in (0.01, 0.03))
    rows = np.arange(12, dtype=np.int32)
    parts = [Part("small", small, Pose(translation=[1.0, 0.0, 0.0]), rows), large]

    points, normals = starting_positions.surface_samples(Scene(parts), 2000, np.random.default_rng(3))
    hidden = Scene([*parts[:1], Part("large", large, Pose(), rows, is_hidden=True)])
    shown, _ = starting_positions.surface_samples(hidden, 50, np.random.default_rng(3))

    assert (points[:, 0] > 0.9).mean() == pytest.approx(0.1, abs=0.03)
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1.0)
    assert (shown[:, 0] > 0.9).all()
