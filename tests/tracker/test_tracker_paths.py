"""The first contact on a finger's path, its time and its rate, against formulas and brute force."""

import numpy as np
import pytest
import shapes
from bending_finger_objects import THINGS
from ticking import (
    MS,
    RADIUS,
    bending,
    block,
    contact,
    fingertip,
    flags_of,
    line,
    plate,
    sheet,
    solid,
    tick_path,
)

from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

FOUND = ContactFlag.ON_PATH | ContactFlag.CONTACT_FOUND


ARC_PER_BEND = 0.2306
"""Maximum speed of the fingertip, m per unit of bend: at the flat hand."""


def first_touch(scene, path, path_bends, radius=RADIUS):
    """Return the bend at the first contact of the sphere, by brute force and bisection."""
    place = lambda bend: [np.interp(bend, path_bends, path[:, axis]) for axis in range(3)]  # noqa: E731
    bends = np.linspace(path_bends[0], path_bends[-1], 4001)
    distances = scene.signed_distance(np.stack([np.interp(bends, path_bends, c) for c in path.T], axis=1))
    row = int(np.argmax(distances <= radius))
    assert distances[row] <= radius and row > 0
    low, high = bends[row - 1], bends[row]
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if scene.signed_distance(place(middle)) <= radius else (middle, high)
    return low


@pytest.mark.parametrize("ahead", [0.001, 0.02])
@pytest.mark.parametrize("name", THINGS)
def test_contact_of_a_bending_finger_is_where_the_paper_has_it(name, ahead):
    """Within 0.01 mm of arc, and certified; 20 mm before, the paper's linear guess is off by 0.3 to 2 mm."""
    thing, expected = THINGS[name]
    path, bends = bending()
    bend = expected - ahead / ARC_PER_BEND
    found = tick_path([thing], path, fingertip(bend), path_bends=bends, bend=bend)
    true = first_touch(Scene([thing]), path, bends)

    assert abs(found["contact_bend"] - expected) * ARC_PER_BEND <= 1e-5
    assert abs(found["contact_bend"] - true) <= found["contact_bend_error"]
    assert found["contact_bend_error"] * ARC_PER_BEND <= 1e-4 + 0.02 * ahead
    assert flags_of(found) & FOUND == FOUND


@pytest.mark.parametrize("name", THINGS)
def test_from_the_flat_hand_the_contact_is_within_its_error(name):
    """The first disc is grazed: there the search would need more steps."""
    thing, expected = THINGS[name]
    path, bends = bending()
    found = tick_path([thing], path, path_bends=bends)

    assert found["bend"] == 0.0
    assert abs(found["contact_bend"] - expected) * ARC_PER_BEND <= 1e-4
    assert abs(found["contact_bend"] - expected) <= found["contact_bend_error"] <= 0.006
    assert flags_of(found) & FOUND == FOUND


@pytest.mark.parametrize("name", THINGS)
def test_rate_of_the_contact_is_its_drift_as_the_part_moves(name):
    """Against a difference quotient of the contact, with the part displaced by v dt."""
    thing, expected = THINGS[name]
    (path, bends), scene = bending(4001), Scene([thing])
    velocity, dt = np.array([0.03, 0.05, 0.0]), 1e-3
    places = []
    for step in (-0.5, 0.5):
        scene.move(thing.name, Pose(translation=velocity * step * dt))
        places.append(first_touch(scene, path, bends))
    scene.move(thing.name, Pose(), velocity=velocity)
    bend = expected - 0.005 / ARC_PER_BEND
    found = tick_path(scene, path, fingertip(bend), path_bends=bends, bend=bend)

    rate = (places[1] - places[0]) / dt
    assert found["contact_bend_rate"] == pytest.approx(rate, rel=0.03)
    assert abs(rate) > 0.05


@pytest.mark.parametrize("start", [-0.05, 0.0, 0.02])
def test_rate_of_the_contact_at_a_turning_part_is_that_of_the_place_of_contact(start):
    """Regression: it was that of the last query's point, which may be at the finger."""
    scene, path = Scene([plate()]), line((start, 0, 0.06), (0.05, 0, -0.04))
    speed, dt = 2.0, 1e-4
    places = []
    for step in (-0.5, 0.5):
        c, s = np.cos(speed * step * dt), np.sin(speed * step * dt)
        scene.move("plate", Pose([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
        places.append(first_touch(scene, path, [0.0, 1.0]))
    scene.move("plate", Pose(), angular_velocity=(0.0, speed, 0.0))
    found = tick_path(scene, path)

    assert found["contact_bend_rate"] == pytest.approx((places[1] - places[0]) / dt, rel=1e-3)


def test_time_to_contact_is_along_the_path_when_the_finger_goes_that_way():
    """A quarter circle down to a plate that a straight path misses."""
    angle = np.linspace(0.0, np.pi / 2, 2001)
    path = np.stack([0.06 * np.sin(angle), 0 * angle, 0.06 * np.cos(angle)], axis=1)
    found = tick_path([plate()], path, velocity=(0.3, 0, 0))
    true = 0.06 * np.arccos(RADIUS / 0.06) / 0.3

    assert found["time_to_contact"] == pytest.approx(true, rel=1e-4)
    assert 0.99 * true <= found["time_to_contact_lower"] <= true
    assert found["bend_rate"] == pytest.approx(0.3 / (0.06 * np.pi / 2), rel=1e-6)
    assert contact([plate()], path[0], (0.3, 0, 0))["time_to_contact"] == np.inf


def test_time_along_a_path_counts_from_where_the_finger_is_on_it():
    """After a tenth of the path, 0.033 m are left at 0.25 m/s."""
    path = line((0, 0, 0.05), (0, 0, -0.05))
    found = tick_path([plate()], path, (0, 0, 0.04), (0, 0, -0.25), bend=0.1)

    assert found["time_to_contact"] == pytest.approx(0.033 / 0.25, rel=1e-6)
    assert 0.99 * 0.132 <= found["time_to_contact_lower"] <= 0.132


def test_finger_that_goes_back_along_its_path_has_the_time_of_its_velocity():
    found = tick_path([plate()], line((0, 0, 0.05), (0.1, 0, 0)), velocity=(-0.2, 0, 0))

    assert found["bend_rate"] < 0.0
    assert found["time_to_contact"] == np.inf
    assert found["contact_bend"] > 0.0


@pytest.mark.parametrize("part_speed", [-0.5, 0.1])
def test_time_along_a_path_is_certified_for_a_part_that_moves(part_speed):
    scene = Scene([plate()])
    scene.move("plate", Pose(), velocity=(0, 0, part_speed))
    found = tick_path(scene, line((0, 0, 0.05), (0, 0, -0.05)), velocity=(0, 0, -0.25))
    true = 0.043 / (0.25 + part_speed) if 0.25 + part_speed > 0 else np.inf

    assert found["time_to_contact_lower"] <= true
    assert found["contact_bend"] == pytest.approx(0.43, abs=1e-6)  # with the parts at rest
    assert found["contact_bend_rate"] == pytest.approx(-part_speed / 0.1, rel=1e-6)


def test_without_a_path_the_fields_of_a_path_are_nan():
    found = contact([plate()], (0, 0, 0.05), (0, 0, -1))

    for name in ("bend", "bend_rate", "contact_bend", "contact_bend_error", "contact_bend_rate"):
        assert np.isnan(found[name])
    assert not flags_of(found) & FOUND


def test_path_that_touches_nothing_has_no_contact():
    found = tick_path([plate()], line((0, 0, 0.05), (0.05, 0, 0.05)), velocity=(0.1, 0, 0))

    assert found["bend"] == 0.0
    assert np.isnan(found["contact_bend"]) and np.isnan(found["contact_bend_error"])
    assert flags_of(found) & FOUND == ContactFlag.ON_PATH
    assert found["time_to_contact"] == np.inf
    assert found["time_to_contact_lower"] == pytest.approx(0.5)  # the end of the path


def test_path_that_starts_in_contact_touches_there():
    found = tick_path([plate()], line((0, 0, 0.005), (0, 0, -0.05)), velocity=(0, 0, -0.1))

    assert (found["contact_bend"], found["contact_bend_error"]) == (0.0, 0.0)
    assert found["time_to_contact"] == found["time_to_contact_lower"] == 0.0
    assert flags_of(found) & FOUND == FOUND


def test_finger_beside_a_path_that_is_in_contact_there_has_no_time_left_if_it_goes_that_way():
    path, beside = line((0, 0, 0.005), (0.05, 0, 0.005)), (0, 0, 0.05)
    along = tick_path([plate()], path, beside, velocity=(0.1, 0, 0))
    back = tick_path([plate()], path, beside, velocity=(-0.1, 0, 0))

    assert (along["contact_bend"], along["contact_bend_error"]) == (0.0, 0.0)
    assert along["time_to_contact"] == along["time_to_contact_lower"] == 0.0
    assert back["time_to_contact"] == np.inf and back["time_to_contact_lower"] > 0.0


def test_where_the_steps_do_not_suffice_the_contact_is_not_before_what_is_told():
    """Flush along a plate: the searched part is free, error and rate of the contact are unknown."""
    scene = Scene([plate(half=0.5), solid(shapes.box((0.3, -0.1, 0.0), (0.4, 0.1, 0.1)), "stop")])
    scene.move("stop", Pose(), velocity=(0.1, 0, 0))
    found = tick_path(scene, line((0, 0, RADIUS + 1e-4), (0.4, 0, RADIUS + 1e-4)), velocity=(0.1, 0, 0))

    assert 0.0 < found["contact_bend"] < (0.3 - RADIUS) / 0.4
    assert found["contact_bend_error"] == np.inf and np.isnan(found["contact_bend_rate"])
    assert flags_of(found) & FOUND == ContactFlag.ON_PATH
    assert 0.0 < found["time_to_contact_lower"] <= (0.3 - RADIUS) / 0.1


def test_path_that_ends_just_before_the_surface_has_no_contact_and_just_beyond_it_has():
    for end, is_hit in ((RADIUS + 1e-6, False), (RADIUS - 1e-6, True)):
        found = tick_path([plate()], line((0, 0, 0.05), (0, 0, end)))
        # So close to the end both answers are within the error.
        assert np.isnan(found["contact_bend"]) or found["contact_bend"] >= 1.0 - 1e-3
        if is_hit:
            assert found["contact_bend"] == pytest.approx(1.0, abs=1e-3)


def test_thin_sheet_across_a_path_is_not_passed():
    found = tick_path([sheet()], line((0, 0, 0.05), (0, 0, -0.05)))

    assert found["contact_bend"] == pytest.approx(0.43, abs=1e-5)
    assert found["contact_bend_error"] <= 1e-3


@pytest.mark.parametrize("radius", [0.0, 1e-5])
def test_finger_as_small_as_a_point_has_its_contact_confirmed(radius):
    # Regression: it searched for points deeper than the radius, where a small finger has no contact.
    found = tick_path([plate()], line((0, 0, 0.05), (0, 0, -0.05)), radius=radius)

    true = (0.05 - radius) / 0.1
    assert flags_of(found) & FOUND == FOUND
    assert abs(found["contact_bend"] - true) <= found["contact_bend_error"] <= 1e-3


def test_point_finds_a_sheet_across_its_path_but_cannot_confirm_it():
    found = tick_path([sheet()], line((0, 0, 0.05), (0, 0, -0.05)), radius=0.0)

    assert found["contact_bend"] == pytest.approx(0.5, abs=1e-3)
    assert found["contact_bend_error"] == np.inf


def test_path_of_two_equal_corners_is_none():
    found = tick_path([plate()], line((0, 0, 0.05), (0, 0, 0.05)), velocity=(0, 0, -1))

    assert np.isnan(found["bend"]) and np.isnan(found["contact_bend"])
    assert not flags_of(found) & FOUND
    assert found["time_to_contact"] == pytest.approx(0.043)


@pytest.mark.parametrize("corner", [0, 1, 2])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_path_that_is_not_finite_anywhere_is_none_and_other_fingers_keep_theirs(corner, value):
    paths = np.stack([line((0, 0, 0.05), (0, 0, -0.05), 3), line((0.02, 0, 0.05), (0.02, 0, -0.05), 3)])
    paths[0, corner, 1] = value
    tracker = Tracker(Scene([plate()]), fingers=2)
    found = tracker.tick([(0, 0, 0.05), (0.02, 0, 0.05)], 0, 0, velocities=[(0, 0, -1.0)] * 2, paths=paths)

    assert np.isnan(found["bend"][0]) and found["time_to_contact"][0] == pytest.approx(0.043)
    assert found["contact_bend"][1] == pytest.approx(0.43, abs=1e-6)


def test_paths_given_once_do_not_stay():
    path = line((0, 0, 0.05), (0, 0, -0.05))
    tracker = Tracker(Scene([plate()]), fingers=1)
    for k in range(4):
        found = tracker.tick([path[0]], k * MS, k * MS, paths=path[None] if k % 2 == 0 else None)
        assert np.isfinite(found["contact_bend"][0]) == (k % 2 == 0)
        assert bool(flags_of(found) & ContactFlag.ON_PATH) == (k % 2 == 0)


def test_path_bends_stretch_the_path_and_are_even_where_not_given():
    """Corners at 0, 0.02 and 0.1 m; contact after 0.043 m."""
    path = np.array([(0, 0, 0.05), (0, 0, 0.03), (0, 0, -0.05)])
    even = tick_path([plate()], path)
    given = tick_path([plate()], path, path_bends=[-1.0, 0.0, 8.0])

    share = (0.043 - 0.02) / 0.08
    assert even["contact_bend"] == pytest.approx(0.5 + 0.5 * share, abs=1e-6)
    assert given["contact_bend"] == pytest.approx(8.0 * share, abs=1e-5)
    assert (even["bend"], given["bend"]) == (0.0, -1.0)


def test_bend_not_given_is_the_nearest_place_on_the_path():
    path = line((0, 0, 0.05), (0, 0, -0.05))
    beside = tick_path([plate()], path, (0.004, 0, 0.03))
    before = tick_path([plate()], path, (0, 0, 0.08))

    assert beside["bend"] == pytest.approx(0.2)
    assert before["bend"] == 0.0


@pytest.mark.parametrize(("bend", "expected"), [(0.2, 0.2), (-3.0, 0.0), (np.nan, 0.1), (5.0, 1.0)])
def test_bend_that_is_given_counts_and_is_held_at_the_ends(bend, expected):
    path = line((0, 0, 0.05), (0, 0, -0.05))
    found = tick_path([plate(thickness=0.2)], path, (0, 0, 0.04), bend=bend)

    assert found["bend"] == pytest.approx(expected)
    assert found["contact_bend"] == pytest.approx(max(0.43, expected), abs=1e-6)


def test_finger_far_beside_its_path_gets_the_contact_of_the_path():
    """As with a badly tracked hand: the finger is 3 cm off the path, which leads down to the block."""
    found = tick_path([block("block", (0, 0, -0.05))], line((0, 0, 0.05), (0, 0, -0.05)), (0.03, 0, 0.04))

    assert found["bend"] == pytest.approx(0.1)
    assert found["contact_bend"] == pytest.approx(0.43, abs=1e-5)
    assert abs(found["contact_bend"] - 0.43) <= found["contact_bend_error"]


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_a_told_bend_is_kept_where_corners_are_repeated(bend):
    """A finger that bends before its tip moves; it touches from the start."""
    tracker = Tracker(Scene([plate()]), fingers=1)
    height = RADIUS - 0.0005
    path = np.array([(0.0, 0.0, height), (0.0, 0.0, height), (0.0, 0.0, -0.05)])
    found = tracker.tick([path[0]], 0, 0, velocities=[(0, 0, 0)], paths=path[None], bends=[bend])[0]

    assert flags_of(found) & FOUND == FOUND
    assert found["bend"] == bend == found["contact_bend"] and found["contact_bend_error"] == 0.0


def test_a_contact_where_corners_are_repeated_reaches_back_to_the_first_of_them():
    tracker = Tracker(Scene([plate()]), fingers=1)
    path = np.array([(0, 0, 0.05), (0, 0, RADIUS), (0, 0, RADIUS), (0, 0, -0.05)], float)
    found = tracker.tick([path[0]], 0, 0, velocities=[(0, 0, 0)], paths=path[None], bends=[0.0])[0]

    assert found["contact_bend"] - found["contact_bend_error"] <= 1.0 / 3.0


def test_path_that_grazes_a_part_is_decided():
    """Regression: 14 of these 600 had a contact with an infinite error, so that a drum moved needlessly."""
    box = Solid(*shapes.box((-0.02, -0.015, -0.01), (0.02, 0.015, 0.01)))
    scene, radius, rng = Scene([box]), 0.003, np.random.default_rng(5)
    bends, s = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 9)[:, None]
    decided = 0
    for _ in range(600):
        start = rng.normal(size=3)
        start *= 0.06 / np.linalg.norm(start)
        rng.normal(size=3)
        middle = rng.uniform((-0.02, -0.015, -0.01), (0.02, 0.015, 0.01)) * 1.6
        end = middle + (middle - start) * 0.9 + 0.01 * rng.normal(size=3)
        path = (1 - s) ** 2 * start + 2 * s * (1 - s) * middle + s * s * end
        points = np.stack([np.interp(np.linspace(0, 1, 2401), bends, column) for column in path.T], axis=1)
        gap = scene.signed_distance(points).min() - radius
        tracker = Tracker(scene, fingers=1, radius=radius)
        found = tracker.tick(path[:1], 0, 0, paths=path[None], path_bends=bends)[0]
        if abs(gap) > 5e-5:
            touches = np.isfinite(found["contact_bend"])
            assert touches == (gap < 0.0)
            assert not touches or np.isfinite(found["contact_bend_error"])
            decided += abs(gap) < 1e-3
    assert decided > 40
