"""Flags of a record, bounds of skipped fingers, and changes between ticks."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, block, flags_of, plate, sheet, solid, tick_at

from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

KINDS = ContactFlag.EXACT | ContactFlag.BOUNDED | ContactFlag.SKIPPED


def ticks(tracker, positions, *, start=0):
    """Return a copy of the first finger's record at each position, a tick each millisecond."""
    found = []
    for k, position in enumerate(positions, start=start):
        row = np.full((len(tracker.contacts), 3), np.nan)
        row[0] = position
        found.append(tracker.tick(row, k * MS, k * MS)[0].copy())
    return found


def true_distance(scene, position):
    return float(scene.signed_distance(position)) - RADIUS


def assert_bounds_hold(scene, found):
    """Check bounds of a record against the present scene, within rounding."""
    true, room = true_distance(scene, found["position"]), 1e-13
    assert found["lower"] <= true + room
    assert true - room <= found["upper"]
    assert found["lower"] <= found["signed_distance"] <= found["upper"]


def test_first_tick_is_tracked_and_exact_but_knows_no_velocity():
    found = tick_at([plate()], [(0, 0, 0.05)])

    assert flags_of(found) == (
        ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED | ContactFlag.IN_RANGE
    )
    assert found["velocity"].tolist() == [[0, 0, 0]]
    assert found["time_to_contact"] == np.inf
    # The earliest contact at a hand's maximum speed.
    assert 0.0 < found["time_to_contact_lower"][0] <= 0.043 / 3.0


@pytest.mark.parametrize("budget", [1, 20, None])
def test_each_answer_is_exact_or_bounded_or_skipped(budget):
    rng = np.random.default_rng(5)
    scene = Scene([solid(shapes.sphere(0.1, 4), "ball"), sheet(height=0.2), block("block", (0.3, 0, 0))])
    tracker = Tracker(scene, fingers=1, budget=budget)
    way = np.cumsum(rng.normal(size=(500, 3)) * 0.03, axis=0)
    seen = set()
    for found in ticks(tracker, way):
        kind = flags_of(found) & KINDS
        seen.add(kind)
        assert kind in (ContactFlag.EXACT, ContactFlag.BOUNDED, ContactFlag.SKIPPED)
        assert_bounds_hold(scene, found)
        assert (found["lower"] == found["upper"]) == (kind == ContactFlag.EXACT)

    assert ContactFlag.SKIPPED in seen
    assert (ContactFlag.EXACT if budget is None else ContactFlag.BOUNDED) in seen


def test_budget_limits_the_work():
    """At the centre of a ball all faces are equally near; prediction and path add a few steps."""
    scene = Scene([solid(shapes.sphere(0.1, 5), "ball")])
    free, tight = tick_at(scene, [(0, 0, 0)], budget=10**6), tick_at(scene, [(0, 0, 0)], budget=20)

    assert free["work"][0] > 1000 and flags_of(free) & ContactFlag.EXACT
    assert tight["work"][0] <= 20 + 16 and flags_of(tight) & ContactFlag.BOUNDED
    assert flags_of(tight) & ContactFlag.INSIDE
    assert tight["lower"][0] <= free["signed_distance"][0] <= tight["upper"][0]


def test_range_is_about_the_sphere_and_its_edge_belongs_to_it():
    inner, outer = tick_at(
        [plate()], [(0, 0, 0.125), (0, 0, 0.125 + 1e-9)], radius=0.0625, working_range=0.0625
    )

    assert flags_of(inner) & ContactFlag.IN_RANGE
    assert not flags_of(outer) & ContactFlag.IN_RANGE


def test_finger_far_away_is_skipped_until_it_may_have_come_near():
    """Down to a plate at 2 mm a tick: a new query whenever the bound is used up."""
    scene = Scene([plate(), plate("floor", top=-0.5)])
    tracker = Tracker(scene, fingers=1)
    found = ticks(tracker, [(0, 0, 1.0 - 0.002 * k) for k in range(480)])
    skipped = [bool(flags_of(each) & ContactFlag.SKIPPED) for each in found]

    assert not skipped[0] and skipped[1] and not skipped[-1]
    assert 0.9 < np.mean(skipped[:400]) < 1.0
    for each, was_skipped in zip(found, skipped, strict=True):
        assert_bounds_hold(scene, each)
        if was_skipped:
            assert not flags_of(each) & (ContactFlag.EXACT | ContactFlag.IN_RANGE)
            assert each["lower"] >= 0.12
            assert flags_of(each) & ContactFlag.SIGNED
            assert each["work"] == 0


@pytest.mark.parametrize("tolerance", [0.01, 0.5])
def test_within_the_tolerance_a_finger_near_by_is_skipped_too(tolerance):
    scene = Scene([plate(half=0.5)])
    tracker = Tracker(scene, fingers=1, tolerance=tolerance)
    found = ticks(tracker, [(0.0005 * k, 0, 0.08 - 0.0001 * k) for k in range(300)])
    skipped = [bool(flags_of(each) & ContactFlag.SKIPPED) for each in found]

    assert 0.2 < np.mean(skipped) < 1.0
    for each, was_skipped in zip(found, skipped, strict=True):
        assert_bounds_hold(scene, each)
        assert flags_of(each) & ContactFlag.IN_RANGE
        if was_skipped:
            assert not flags_of(each) & ContactFlag.EXACT
            assert each["upper"] - each["lower"] <= tolerance * each["lower"] * (1 + 1e-9)


def test_part_that_comes_ends_the_skipping_of_a_finger_at_rest():
    scene = Scene([block("still", (0, 0, 0)), block("other", (0, 0, 2.0))])
    tracker = Tracker(scene, fingers=1)
    for k in range(200):
        scene.move("other", Pose(translation=(0, 0, -0.008 * k)))
        found = ticks(tracker, [(0, 0, 0.3)], start=k)[0]
        assert_bounds_hold(scene, found)
        assert bool(flags_of(found) & ContactFlag.SKIPPED) or found["lower"] == found["upper"]

    assert found["part"] == 1 and flags_of(found) & ContactFlag.IN_RANGE


def test_part_that_turns_ends_the_skipping_of_a_finger_at_rest():
    bar = solid(shapes.box((-0.01, -0.01, -0.01), (0.6, 0.01, 0.01)), "bar")
    scene = Scene([bar, block("still", (0, -1, 0))])
    tracker = Tracker(scene, fingers=1)
    for k in range(100):
        c, s = np.cos(k * np.pi / 200), np.sin(k * np.pi / 200)
        scene.move("bar", Pose([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
        assert_bounds_hold(scene, ticks(tracker, [(0, 0.6, 0)], start=k)[0])


def test_a_tick_that_is_refused_does_not_lose_that_a_part_has_moved():
    scene = Scene([block("still", (0, 0, 0)), block("comes", (0, 0, 1.0))])
    tracker = Tracker(scene, fingers=1)
    ticks(tracker, [(0, 0, 0.4)] * 3)
    scene.move("comes", Pose(translation=(0, 0, -0.54)))
    with pytest.raises(ValueError, match="positions have shape"):
        tracker.tick([(0, 0)], 3 * MS, 3 * MS)

    assert_bounds_hold(scene, ticks(tracker, [(0, 0, 0.4)], start=3)[0])


@pytest.mark.parametrize("far", [1e3, 1e140])
def test_a_part_that_was_put_away_far_and_back_leaves_small_steps_of_others_seen(far):
    """Steps of 0.1 mm vanish by rounding in a sum that contains such a displacement."""
    scene = Scene([block("still", (0, 0, 0)), block("comes", (0, 0, 0.9)), block("away", (0, 0, 2))])
    tracker = Tracker(scene, fingers=1)
    for k, height in enumerate((far, 0.0, 0.0)):
        scene.move("away", Pose(translation=(0, 0, height)))
        ticks(tracker, [(0, 0, 0.4)], start=k)
    for k in range(1000, 4000, 3):
        scene.move("comes", Pose(translation=(0, 0, -0.0001 * k)))
        assert_bounds_hold(scene, ticks(tracker, [(0, 0, 0.4)], start=k)[0])


def test_finger_that_slips_through_a_small_hole_is_inside():
    """A ball without one face: no surface is crossed on the way in, and the scene reports inside."""
    vertices, faces = shapes.sphere(0.1, 3)
    hole = int(np.argmax(vertices[faces].mean(axis=1)[:, 2]))
    middle = vertices[faces[hole]].mean(axis=0)
    scene = Scene([solid((vertices, np.delete(faces, hole, axis=0)), "holed")])
    assert scene.parts[0].solid.sign_method.value == "winding number"
    tracker = Tracker(scene, fingers=1)
    found = ticks(tracker, [middle * (1.3 - 0.005 * k) for k in range(100)])

    for each in found:
        assert_bounds_hold(scene, each)
        assert bool(flags_of(each) & ContactFlag.INSIDE) == (each["signed_distance"] < -RADIUS)
    assert flags_of(found[-1]) & ContactFlag.INSIDE


def test_part_changed_is_told_once_for_each_change():
    scene = Scene([block("left", (-0.1, 0, 0)), block("right", (0.1, 0, 0))])
    found = ticks(Tracker(scene, fingers=1), [(x, 0, 0.06) for x in (-0.02, -0.01, 0.01, 0.02, -0.01)])

    assert [bool(flags_of(each) & ContactFlag.PART_CHANGED) for each in found] == [
        False, False, True, False, True,
    ]  # fmt: skip


def test_first_tick_and_a_finger_found_again_have_no_part_to_change():
    scene = Scene([block("left", (-0.1, 0, 0)), block("right", (0.1, 0, 0))])
    found = ticks(Tracker(scene, fingers=1), [(0.05, 0, 0.06), (np.nan, 0, 0), (-0.05, 0, 0.06)])

    assert [each["part"] for each in found] == [1, -1, 0]
    assert not any(flags_of(each) & ContactFlag.PART_CHANGED for each in found)


def test_pose_too_far_from_the_last_is_a_jump_and_starts_the_velocity_anew():
    way = [(0, 0, 0.05)] * 3 + [(0.08, 0, 0.05)] * 3
    found = ticks(Tracker(Scene([plate()]), fingers=1), way)

    assert [bool(flags_of(each) & ContactFlag.JUMPED) for each in found] == [False] * 3 + [True, False, False]
    assert not flags_of(found[3]) & ContactFlag.PREDICTED
    assert flags_of(found[3]) & ContactFlag.EXACT
    assert all(np.abs(each["velocity"]).max() < 1e-9 for each in found)


def test_finger_back_from_a_pose_gone_astray_goes_on_with_its_velocity():
    way = [(0.001 * k, 0, 0.05) for k in range(6)]
    way[4] = (0.08, 0, 0.05)
    astray, back = ticks(Tracker(Scene([plate()]), fingers=1), way)[4:]

    assert flags_of(astray) & ContactFlag.JUMPED and not flags_of(astray) & ContactFlag.PREDICTED
    assert flags_of(back) & ContactFlag.JUMPED and flags_of(back) & ContactFlag.PREDICTED
    assert back["velocity"] == pytest.approx([1.0, 0, 0])


def test_higher_speed_allowed_is_no_jump():
    tracker = Tracker(Scene([plate()]), fingers=1, max_speed=100.0)
    found = ticks(tracker, [(0, 0, 0.05), (0.02, 0, 0.05)])

    assert not flags_of(found[1]) & ContactFlag.JUMPED
    assert found[1]["velocity"] == pytest.approx([20.0, 0, 0])


def two_blocks():
    return Scene([block("low", (0, 0, 0)), block("lower", (0, 0, -0.15))])


@pytest.mark.parametrize("take_away", ["hide", "remove"])
def test_when_the_nearest_part_goes_the_next_one_is_answered(take_away):
    scene = two_blocks()
    tracker = Tracker(scene, fingers=1)
    ticks(tracker, [(0, 0, 0.06)] * 3)
    getattr(scene, take_away)("low")
    first, second = ticks(tracker, [(0, 0, 0.06)] * 2, start=3)

    assert first["signed_distance"] == pytest.approx(0.06 + 0.1 - RADIUS)
    assert first["part"] == (1 if take_away == "hide" else 0)
    assert flags_of(first) & ContactFlag.PART_CHANGED and not flags_of(second) & ContactFlag.PART_CHANGED
    assert flags_of(first) & ContactFlag.PREDICTED  # the finger's velocity stays known


def test_when_another_part_goes_the_nearest_is_the_same_though_its_number_changes():
    scene = two_blocks()
    tracker = Tracker(scene, fingers=1)
    ticks(tracker, [(0, 0, -0.21)] * 3)
    scene.remove("low")
    found = ticks(tracker, [(0, 0, -0.21)], start=3)[0]

    assert (found["part"], found["signed_distance"]) == (0, pytest.approx(0.01 - RADIUS))
    assert not flags_of(found) & ContactFlag.PART_CHANGED


def test_part_that_is_added_or_shown_near_a_skipped_finger_is_seen_at_once():
    scene = two_blocks()
    scene.hide("low")
    tracker = Tracker(scene, fingers=1)
    ticks(tracker, [(0, 0, 0.09)] * 3)
    scene.show("low")
    assert ticks(tracker, [(0, 0, 0.09)], start=3)[0]["signed_distance"] == pytest.approx(0.04 - RADIUS)
    scene.add(block("new", (0, 0, 0.16)))
    found = ticks(tracker, [(0, 0, 0.09)], start=4)[0]

    assert found["signed_distance"] == pytest.approx(0.02 - RADIUS)
    assert found["part"] == 2 and flags_of(found) & ContactFlag.PART_CHANGED


def test_part_that_is_deformed_is_seen_as_it_is_now():
    scene = Scene([block("soft", (0, 0, 0))])
    tracker = Tracker(scene, fingers=1)
    ticks(tracker, [(0, 0, 0.3)] * 3)
    scene.deform("soft", scene.parts[0].solid.mesh.vertices * (1, 1, 4))
    found = ticks(tracker, [(0, 0, 0.3)], start=3)[0]

    assert found["signed_distance"] == pytest.approx(0.1 - RADIUS)
    assert not flags_of(found) & ContactFlag.PART_CHANGED


def test_with_all_parts_hidden_there_is_nothing_and_never_was():
    scene = two_blocks()
    for name in ("low", "lower"):
        scene.hide(name)
    for found in ticks(Tracker(scene, fingers=1), [(0, 0, 0.06)] * 3):
        assert found["signed_distance"] == found["lower"] == found["upper"] == np.inf
        assert (found["part"], found["face"], found["surface"]) == (-1, -1, 0)
        assert np.isnan(found["point_on_part"]).all() and np.isnan(found["normal"]).all()
        assert found["time_to_contact"] == np.inf and found["time_to_contact_lower"] > 0.0
        assert found["predicted_lower"] == np.inf
    fastest = Tracker(scene, fingers=1).tick([(0, 0, 0.06)], 0, 0, velocities=[(1e200, 0, 0)])[0]
    assert fastest["predicted_lower"] == -np.inf and fastest["predicted_upper"] == np.inf
    scene.show("low")
    assert ticks(Tracker(scene, fingers=1), [(0, 0, 0.06)])[0]["signed_distance"] == pytest.approx(0.003)


def test_reset_forgets_fingers():
    tracker = Tracker(Scene([plate()]), fingers=1)
    before = ticks(tracker, [(0, 0, 0.05), (0, 0, 0.049)])
    tracker.reset()
    again = ticks(tracker, [(0, 0, 0.05), (0, 0, 0.049)])

    assert [each.tobytes() for each in before] == [each.tobytes() for each in again]
