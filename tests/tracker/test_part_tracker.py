"""A tracked part: bounds and exact distance, inside and outside, groups, and times."""

import numpy as np
import part_trials
import pytest
import shapes
from trial_log import Tally

from proximity import (
    NO_PART,
    ArgumentError,
    ConnectionFlag,
    PartTracker,
    Pose,
    Scene,
    SceneError,
    Solid,
)

pytestmark = pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")  # parts are far apart on purpose
MS = 1_000_000
START = 10**12


def turned(axis, angle):
    """Return a rotation about an axis."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def table(**others):
    """Return a scene of a bumpy held part and others at their positions."""
    parts = [Solid(*shapes.torus(0.03, 0.012, 40, 20), name="held")]
    parts += [Solid(*shape, name=name) for name, (shape, _) in others.items()]
    scene = Scene(parts)
    for name, (_, place) in others.items():
        scene.move(name, place if isinstance(place, Pose) else Pose(None, place))
    return scene


def some_parts():
    return table(
        ball=(shapes.sphere(0.02, 3), [0.09, 0.0, 0.0]),
        ring=(shapes.torus(0.03, 0.01, 30, 16), Pose(shapes.rotation(3), [-0.09, 0.01, 0.0])),
        plate=(shapes.box((-0.2, -0.2, -0.08), (0.2, 0.2, -0.07)), [0.0, 0.0, 0.0]),
    )


def exact_of(scene, held="held"):
    """Return exact distances of the held part to all others, by their rows."""
    names = [part.name for part in scene.parts]
    return {row: scene.clearance(held, name).distance for row, name in enumerate(names) if name != held}


def wander(seed, count, reach=0.12):
    """Yield poses of a part that moves and rotates at random, with some jumps."""
    rng = np.random.default_rng(seed)
    place, turn = rng.uniform(-0.05, 0.05, 3), shapes.rotation(seed)
    for _ in range(count):
        if rng.random() < 0.02:
            place = rng.uniform(-reach, reach, 3)
        place = np.clip(place + rng.normal(size=3) * rng.choice([1e-6, 1e-4, 1e-3]), -reach, reach)
        turn = turned(rng.normal(size=3), rng.normal() * rng.choice([0.0, 1e-3, 1e-2])) @ turn
        yield Pose(turn, place)


@pytest.mark.parametrize("options", [{}, {"tolerance": 0.1}, {"budget": 40}, {"working_range": 0.03}])
def test_bounds_hold_at_every_tick(options):
    scene = some_parts()
    tracker = PartTracker(scene, "held", connections=3, **options)
    for tick, pose in enumerate(wander(5, 300)):
        records = tracker.tick(pose, START + tick * MS, START + tick * MS)
        exact = exact_of(scene)
        assert records["lower"][0] <= min(exact.values()) + 1e-15
        for record in records[records["part"] != NO_PART]:
            true = exact[int(record["part"])]
            assert record["lower"] <= true + 1e-15 and true <= record["upper"] + 1e-15
            if not options:
                assert record["upper"] == pytest.approx(true, abs=1e-14)
            if "tolerance" in options:
                assert record["lower"] * 1.1 >= record["upper"] * (1.0 - 1e-9)
        for record in records[records["part"] == NO_PART]:
            known = set(records["part"].tolist())
            assert all(record["lower"] <= true + 1e-15 for row, true in exact.items() if row not in known)
        if "budget" not in options:
            in_range = records["distance"][records["flags"] & ConnectionFlag.IN_RANGE != 0]
            assert (np.diff(in_range) >= 0.0).all()


def test_every_promise_holds_in_ten_thousand_ticks_of_all_kinds():
    """``bench/prove_bounds.py --parts`` does the same for any number of ticks."""
    total = Tally()
    for seed in range(len(part_trials.PAIRS)):
        total.add(part_trials.run_trial(seed, 500)[1])

    assert not total.broken, "\n".join(total.broken[:5])
    assert min(check.count for check in total.checks.values()) > 20  # every bound was checked


@pytest.mark.parametrize(
    ("promise", "field", "change"),
    [
        ("lower <= true", "lower", lambda lower: 1.001 * lower),
        ("true <= upper", "upper", lambda upper: 0.999 * upper),
        ("ends are on their surfaces", "point_on_part", lambda point: point + 1e-9),
        ("INSIDE is true", "flags", lambda flags: flags | np.uint32(ConnectionFlag.INSIDE)),
        ("CROSSING is true", "flags", lambda flags: flags | np.uint32(ConnectionFlag.CROSSING)),
        ("predicted lower <= true", "predicted_lower", lambda lower: lower + 0.01),
    ],
)
def test_a_broken_promise_is_found(monkeypatch, promise, field, change):
    class Liar(PartTracker):
        def tick(self, *given, **named):
            records = super().tick(*given, **named).copy()
            records[field] = change(records[field])
            self.connections = records
            return records

    monkeypatch.setattr(part_trials, "PartTracker", Liar)
    tallies = [part_trials.run_trial(seed, 300)[1] for seed in range(3, 8)]

    assert any(tally.checks[promise].broken_count for tally in tallies if promise in tally.checks)


def test_exact_records_tell_the_nearest_of_each_part_in_order():
    scene = some_parts()
    tracker = PartTracker(scene, "held", connections=3)
    for tick, pose in enumerate(wander(8, 60)):
        records = tracker.tick(pose, START + tick * MS, START + tick * MS)
        exact = sorted(exact_of(scene).values())
        np.testing.assert_allclose(records["distance"], exact, atol=1e-14)
        for record in records[records["distance"] > 0.0]:
            apart = record["point_on_own"] - record["point_on_part"]
            np.testing.assert_allclose(apart, record["distance"] * record["normal"], atol=1e-14)
            assert record["flags"] & ConnectionFlag.EXACT


def test_a_part_that_goes_into_a_hollow_one_is_outside_and_in_its_wall_inside():
    hollow = Solid(*shapes.hollow_cube(0.3, 0.2), name="hollow")
    scene = Scene([Solid(*shapes.sphere(0.01, 2), name="held"), hollow])
    tracker = PartTracker(scene, "held")
    places = {0.0: 0.09, 0.125: 0.0, 0.103: 0.0, 0.2: 0.04}
    for tick, (x, distance) in enumerate(places.items()):
        record = tracker.tick(Pose(None, [x, 0.0, 0.0]), START + tick * MS, START + tick * MS)[0]
        assert record["distance"] == pytest.approx(distance, abs=1e-3)
        assert bool(record["flags"] & ConnectionFlag.INSIDE) == (x == 0.125)
        assert bool(record["flags"] & ConnectionFlag.CROSSING) == (x == 0.103)


@pytest.mark.parametrize(
    ("other", "is_moved"),
    [(shapes.box((-0.2, 0.025, -0.2), (0.2, 0.03, 0.2)), False), (shapes.sphere(0.02, 4), True)],
)
def test_motion_across_the_connection_or_of_both_parts_opens_little_again(other, is_moved):
    scene = Scene([Solid(*shapes.sphere(0.02, 4), name="held"), Solid(*other, name="other")])
    tracker, work = PartTracker(scene, "held"), []
    for tick in range(40):
        along = [2e-4 * (tick - 20), 0.0, 1e-4 * tick]
        scene.move("held", Pose(shapes.rotation(1), along))
        if is_moved:
            scene.move("other", Pose(None, np.add(along, [0.0, 0.042, 0.0])))
        work.append(tracker.tick(None, START + tick * MS, START + tick * MS)[0]["work"])
    assert tracker.connections[0]["distance"] == scene.clearance("held", "other").distance
    assert max(work[1:]) <= 8  # several times as many if each displacement lowers all bounds


def test_a_group_moves_together_and_is_not_compared_with_itself():
    scene = some_parts()
    scene.add(Solid(*shapes.cube(0.01, (0.0, 0.0, 0.0)), name="tip"))
    scene.move("tip", Pose(None, [0.0, 0.0, 0.05]))
    tracker = PartTracker(scene, ["held", "tip"], connections=2)
    names = [part.name for part in scene.parts]
    for tick, pose in enumerate(wander(2, 40)):
        records = tracker.tick(pose, START + tick * MS, START + tick * MS)
        tip = scene.part("tip").pose
        np.testing.assert_allclose(tip.translation, pose.point([0.0, 0.0, 0.05]), atol=1e-15)
        exact = sorted(
            min(scene.clearance(own, other).distance for own in ("held", "tip"))
            for other in ("ball", "ring", "plate")
        )
        np.testing.assert_allclose(records["distance"], exact[:2], atol=1e-14)
        assert all(names[row] not in tracker.parts for row in records["part"])


@pytest.mark.parametrize("seed", range(6))
def test_no_part_is_met_before_the_certified_time_while_it_moves_and_turns(seed):
    scene, rng = some_parts(), np.random.default_rng(seed)
    tracker = PartTracker(scene, "held", horizon=0.5)
    velocity, turning = rng.normal(size=3) * 0.15, rng.normal(size=3) * 3.0
    pose = Pose(shapes.rotation(seed), [0.0, 0.0, 0.01])
    record = tracker.tick(pose, START, START, velocity=velocity, angular_velocity=turning)[0].copy()
    lower, expected = record["time_to_contact_lower"], record["time_to_contact"]
    assert tracker.free_time == lower > 0.0
    rate = np.linalg.norm(turning)
    met = None
    for t in np.linspace(0.0, 0.5, 251):
        scene.move("held", Pose(turned(turning, rate * t) @ pose.rotation, pose.translation + velocity * t))
        if min(exact_of(scene).values()) == 0.0:
            met = t
            break
    assert 0.05 < lower <= (0.5 if met is None else met)
    assert expected >= lower


def test_predictions_are_for_the_instant_of_the_controller():
    scene = table(plate=(shapes.box((-0.2, -0.2, -0.1), (0.2, 0.2, -0.09)), [0.0, 0.0, 0.0]))
    tracker = PartTracker(scene, "held", latency=0.01)
    for tick in range(3):
        place = [0.0, 0.0, -0.1 * 1e-3 * tick]
        record = tracker.tick(Pose(None, place), START + tick * MS, START + tick * MS)[0]
    assert record["approach_speed"] == pytest.approx(0.1)
    assert record["predicted_distance"] == pytest.approx(record["distance"] - 0.001)
    assert record["predicted_lower"] <= record["predicted_distance"] <= record["predicted_upper"]
    assert record["time_to_contact"] == np.inf  # 0.8 s, beyond the horizon
    assert record["time_to_contact_lower"] == tracker.free_time == 0.25


def test_parts_may_come_go_be_hidden_and_change_shape():
    scene = some_parts()
    tracker = PartTracker(scene, "held")

    def nearest():
        record = tracker.tick(None, START, START)[0]
        return scene.parts[record["part"]].name, record["distance"]

    for change in (
        lambda: None,
        lambda: scene.hide("ball"),
        lambda: scene.show("ball"),
        lambda: scene.add(Solid(*shapes.cube(0.01, (0.0, 0.0, 0.04)), name="cube")),
        lambda: scene.remove("cube"),
        lambda: scene.deform("ball", scene.part("ball").solid.mesh.vertices * 1.5),
    ):
        change()
        name, distance = nearest()
        visible = [part.name for part in scene.parts if not part.is_hidden and part.name != "held"]
        assert distance == min(scene.clearance("held", other).distance for other in visible)
        assert distance == scene.clearance("held", name).distance
    scene.remove("held")
    with pytest.raises(SceneError, match="'held' is not in the scene any more"):
        nearest()


def test_a_scene_without_others_has_no_connection():
    scene = Scene([Solid(*shapes.cube(0.1), name="held")])
    record = PartTracker(scene, "held").tick(None, START, START)[0]
    assert record["distance"] == np.inf and record["part"] == NO_PART
    assert np.isnan(record["point_on_own"]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"part": []}, "expected one name"),
        ({"part": ["held", "held"]}, "expected one name"),
        ({"connections": 17}, "expected 1 to 16"),
        ({"working_range": 0.0}, "working_range"),
        ({"tolerance": -1.0}, "tolerance"),
    ],
)
def test_arguments_that_cannot_be_used_are_named(arguments, message):
    scene = some_parts()
    with pytest.raises(ArgumentError, match=message):
        PartTracker(scene, **{"part": "held"} | arguments)


def test_a_part_that_is_not_there_is_named():
    with pytest.raises(SceneError, match="'lid'"):
        PartTracker(some_parts(), "lid")
