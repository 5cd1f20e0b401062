"""Bounds are guarantees: none is broken in a hundred thousand finger-ticks of all kinds.

`bench/prove_bounds.py` does the same for any number of ticks. Cases that it once found are separate tests
here.
"""

import dataclasses
from functools import cache

import numpy as np
import prove_bounds
import pytest
import shapes
from bound_trials import log_of_trial, run_trial
from trial_cells import solid_of
from trial_judging import judge
from trial_log import Tally

from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

pytestmark = pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")  # far away and tiny on purpose
FINGER_TICKS = 100_000
SIZES = (500, 1500, 2500, 2500)  # of trials: short ones meet more scenes, long ones move farther
SEARCHED = 60  # trials, for one in which a wrong field matters


def trials():
    """Return number and size of enough trials."""
    planned, found = 0, []
    while planned < 1.2 * FINGER_TICKS:  # some lose fingers
        found.append((len(found), SIZES[len(found) % len(SIZES)]))
        planned += found[-1][1]
    return found


def test_all_bounds_hold_in_a_hundred_thousand_finger_ticks():
    total = Tally()
    for seed, size in trials():
        _, tally = run_trial(seed, size)
        total.add(tally)

    assert not total.broken, "\n".join(total.broken[:5])
    assert total.checks["the distance lies between its bounds"].count >= FINGER_TICKS
    # Every bound was checked; the oracle, which is slow, is called least.
    seldom = {name: check.count for name, check in total.checks.items() if check.count < 200}
    assert not seldom


@cache
def honest(seed):
    _, log = log_of_trial(seed, 500)
    return log


def lied(log, name, change, flags=()):
    """Return the log with one field changed in the records with those flags."""
    records = log.records.copy()
    rows = log.has("TRACKED", *flags)
    records[name][rows] = change(records[name][rows])
    return dataclasses.replace(log, records=records)


@pytest.mark.parametrize(
    ("promise", "field", "change", "flags"),
    [
        ("lower <= true, exact", "lower", lambda lower: lower + 1e-12, ["EXACT"]),
        ("true <= upper, exact", "upper", lambda upper: upper - 1e-12, ["EXACT"]),
        ("lower <= true, bounded", "lower", lambda lower: lower + 0.3, ["BOUNDED"]),
        ("exact is exact", "signed_distance", lambda told: told * (1.0 + 1e-10), ["EXACT"]),
        ("inside", "flags", lambda flags: flags ^ np.uint32(ContactFlag.INSIDE), []),
        ("signed", "flags", lambda flags: flags ^ np.uint32(ContactFlag.SIGNED), ["EXACT"]),
        ("the point is on its part", "point_on_part", lambda point: point + 1e-9, ["EXACT"]),
        ("the normal goes to the point", "normal", lambda normal: -normal, ["EXACT"]),
        ("predicted lower <= true", "predicted_lower", lambda lower: lower + 0.5, []),
        ("true <= predicted upper", "predicted_upper", lambda upper: upper - 0.5, []),
        ("free until the time to contact, along the velocity", "time_to_contact_lower",
         lambda time: 1.1 * time + 0.05, ["PREDICTED"]),
        ("free until the contact on the path", "contact_bend", lambda bend: bend + 0.2, ["ON_PATH"]),
        ("a contact that has an error is one", "contact_bend", lambda bend: bend - 0.2, ["CONTACT_FOUND"]),
    ],
)  # fmt: skip
def test_a_lie_is_found(promise, field, change, flags):
    """In at least one of the trials."""
    for seed in range(SEARCHED):
        tally = judge(lied(honest(seed), field, change, flags))
        if tally.broken and tally.checks[promise].broken_count:
            break
    assert any(broken.startswith(promise) for broken in tally.broken)


def test_a_trial_comes_again_with_its_number():
    (first, one), (second, two) = (log_of_trial(11, 300) for _ in range(2))

    assert str(first) == str(second)
    assert one.records.tobytes() == two.records.tobytes()


def ball(subdivisions=4):
    """Return a ball of 0.1 m."""
    return Scene([Solid(*shapes.sphere(0.1, subdivisions))])


def one_tick(scene, position, velocity=(0.0, 0.0, 0.0), *, paths=None, age_ns=0, **settings):
    tracker = Tracker(scene, fingers=1, **settings)
    return tracker.tick([position], 0, age_ns, velocities=[velocity], paths=paths)[0]


def test_finger_at_rest_that_may_touch_is_not_told_that_it_is_free():
    contact = one_tick(ball(), [0.0, 0.0, 0.103], budget=1)

    assert contact["lower"] <= 0.0 < contact["signed_distance"]  # touching, beyond the budget
    assert contact["time_to_contact_lower"] == 0.0


def test_finger_that_creeps_is_free_no_longer_than_it_takes_to_arrive():
    scene = Scene([Solid(*shapes.cube())])
    contact = one_tick(scene, [0.5, 0.5, 1.007 + 1e-8], [0.0, 0.0, -5e-7])

    assert 0.0 < contact["time_to_contact_lower"] <= contact["signed_distance"] / 5e-7 < 0.021


def test_predicted_bounds_count_the_way_where_no_face_was_found():
    scene = ball()
    position, velocity = np.array([0.0, 0.0, 0.15]), np.array([0.0, 0.0, 1.0])
    contact = one_tick(scene, position, velocity, budget=1, latency=0.05, max_acceleration=1e-3)

    assert contact["part"] == -1
    true = scene.signed_distance(position + 0.05 * velocity) - 0.007
    assert contact["predicted_lower"] <= true <= contact["predicted_upper"]


def test_predicted_bounds_hold_where_a_finger_slips_through_a_hole():
    """Inside and outside meet there away from the surface: the distance jumps from plus to minus."""
    scene = Scene([solid_of("holed ball", 0.3)])
    height = np.linspace(0.1, 0.2, 500)
    positions, velocity = np.stack([0.003 + 0.0 * height, 0.0 * height, height], axis=1), [0.0, 0.0, -0.5]
    tracker = Tracker(scene, fingers=500, latency=0.05, radius=0.0, max_acceleration=20.0)
    contacts = tracker.tick(positions, 0, 0, velocities=np.tile(velocity, (500, 1)))

    now, true = (scene.signed_distance(positions + seconds * np.array(velocity)) for seconds in (0.0, 0.05))
    assert ((now > 0.03) & (true < -0.03)).any()
    assert ((contacts["predicted_lower"] <= true) & (true <= contacts["predicted_upper"])).all()


def test_finger_beside_a_path_that_touches_already_has_no_time_left_on_it():
    scene = Scene([Solid(*shapes.cube())])
    path = [[[0.5, 0.5, 1.003], [0.5, 0.5, 0.9]]]
    contact = one_tick(scene, [0.5, 0.5, 1.02], [0.0, 0.0, -0.01], paths=path)

    assert contact["bend_rate"] > 0.0 and contact["lower"] > 0.0
    assert contact["time_to_contact_lower"] == 0.0


def test_time_left_on_a_path_is_never_negative_at_its_end():
    rng = np.random.default_rng(3)
    paths = 50.0 + np.cumsum(rng.normal(size=(2000, 8, 3)), axis=1)
    tracker = Tracker(ball(0), fingers=2000, max_speed=1e6)
    ends = paths[:, -1] + 1e-3 * rng.normal(size=(2000, 3))
    contacts = tracker.tick(ends, 0, 0, velocities=paths[:, -1] - paths[:, -2], paths=paths)

    assert (contacts["bend_rate"] > 0.0).all()
    assert (contacts["time_to_contact_lower"] >= 0.0).all()


def test_script_shows_one_trial_and_is_content(capsys):
    assert prove_bounds.main(["--trial", "0"]) == 0
    told = capsys.readouterr().out
    assert "trial 0: " in told and "lower <= true, exact" in told


def test_script_tells_what_was_broken_and_how_to_see_it_again(capsys, monkeypatch):
    def broken_trial(seed, size, *, is_heavy):
        log = lied(honest(0), "lower", lambda lower: lower + 1.0)
        return f"trial {seed}", judge(log)

    monkeypatch.setattr(prove_bounds, "run_trial", broken_trial)
    assert prove_bounds.main(["--trial", "7"]) == 1
    told = capsys.readouterr()
    assert "lower <= true, bounded: tick 0, finger" in told.out
    assert "see it again: python bench/prove_bounds.py --trial N" in told.err
