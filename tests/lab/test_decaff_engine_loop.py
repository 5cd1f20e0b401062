"""A hand on CAD parts with tracker, message and controller in the loop, against the true wall."""

import math

import numpy as np
import pytest
import shapes
from pages import PAGES
from paper_drums import GEAR49, steady_force
from project import MESHES

from proximity.decaff.drum.drum_model import with_random_phases
from proximity.errors import ArgumentError
from proximity.lab import part_press
from proximity.lab.engine.engine_loop import Distances, EngineSetup, press_on_part
from proximity.lab.engine.finger_placement import place_finger, placed
from proximity.lab.engine.simulated_service import DelayedLink
from proximity.lab.simulation.devices import Hand
from proximity.lab.simulation.metrics import drum_offset, rest
from proximity.lab.simulation.target_policies import Target
from proximity.pose import Pose
from proximity.scene.loader import load
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.placement import turn_about_axes

AFTER_SWITCH = 0.3  # s, searched for bumps
HAND = Hand()
SAGITTA = 30e-6  # m of the polyline of a finger's path (`Finger.path_world`)
START_DISTANCE = 0.045  # m: enough for a drum to arrive


def box_scene(**surface):
    scene = Scene([Solid(*shapes.box((-0.05, -0.05, -0.02), (0.05, 0.05, 0.0)), name="box")])
    if surface:
        scene.set_surface("box", **surface)
    return scene


@pytest.fixture(scope="module")
def flat():
    return place_finger(box_scene(), (0.0, 0.0, 0.01))


PLACED = with_random_phases(GEAR49, 1)[0]


def run(finger, speed=0.5, hold=0.2, **setup):
    return press_on_part(
        finger,
        HAND.press(speed, hold=hold),
        EngineSetup(**{"start_distance": START_DISTANCE, "drum": PLACED, **setup}),
    )


def test_finger_touches_where_it_was_asked_to(flat):
    point = flat.point(flat.contact_bend)

    assert flat.scene.signed_distance(point) == pytest.approx(0.007, abs=1e-8)
    np.testing.assert_allclose(point, (0.0, 0.0, 0.007), atol=1e-7)
    assert flat.incidence == pytest.approx(1.0, abs=1e-9)
    assert flat.retraction == pytest.approx(0.030, abs=1e-6)


def test_hand_is_turned_until_the_way_is_free():
    """The bracket's upright blocks most attitudes."""
    scene = load(MESHES / "bracket.stl")
    finger = place_finger(scene, (0.048, 0.03, 0.02))

    bends = np.linspace(0.0, finger.contact_bend, 400)[:-1]
    points = finger.world_from_hand.point(finger.glove.finger.point_hand(bends))
    assert (scene.signed_distance(points) > 0.007).all()
    assert finger.incidence == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("speed", [0.25, 1.0])
def test_engine_is_the_ideal_distance_on_a_flat_part(flat, speed):
    """The reported position is off by the polyline's sagitta at most, the drum by another encoder count.

    At rest the force differs by the series stiffness of hand and pad times these.
    """
    engine = run(flat, speed)
    ideal = press_on_part(flat, HAND.press(speed), engine.setup.ideal)
    drum = 2.0 * engine.setup.drum.resolution

    assert abs(engine.reported_contact) < SAGITTA
    assert abs(drum_offset(engine.response) - drum_offset(ideal.response)) < SAGITTA + drum
    off = [one.response.force[rest(one.response)].mean() for one in (engine, ideal)]
    assert abs(off[0] - off[1]) < HAND.series_stiffness * (SAGITTA + drum)
    assert abs(engine.error.share - ideal.error.share) < 0.01
    assert engine.error.onset < (SAGITTA + drum) / speed + 1e-4
    assert engine.counts.lost == 0 and not engine.counts.flawed


@pytest.mark.parametrize(
    ("mesh", "at"),
    [
        ("sphere.stl", None),
        ("torus.ply", None),
        ("gear.stl", None),
        ("plate.stl", (0.006, 0.005, 0.02)),  # on the rim of a hole
        ("bracket.stl", (0.03, 0.01, 0.005)),  # the fillet of a rib, at a grazing incidence of 0.53
    ],
)
def test_engine_knows_curved_and_needle_meshed_parts_as_well(mesh, at):
    finger = place_finger(load(MESHES / mesh), at)
    press = run(finger, 0.5, latency=0.003)

    assert press.reported_error < SAGITTA / finger.incidence
    assert abs(press.reported_contact) < press.reported_error + SAGITTA / finger.incidence
    assert press.error.share < 0.11  # reference 10 % at 0.5 m/s; a shift of 0.1 ms is 3 points
    assert press.error.penetration < 0.2e-3


def test_figures_of_the_page_are_those_of_the_loop():
    """Within bands: friction and encoder vary by a few tenths of a percent at random."""
    bracket = place_finger(load(MESHES / "bracket.stl"), (0.048, 0.030, 0.020))
    text = PAGES["science/drum.md"]
    ours = {"drum": EngineSetup().drum, "start_distance": 0.060}

    for speed, share, latched in ((0.1, 0.019, 0.051), (1.0, 0.176, 0.46)):
        press = run(bracket, speed, latency=0.010, **ours)
        assert press.error.share == pytest.approx(share, rel=0.1)
        plain = run(bracket, speed, reading=Target.LATCHED, **ours)
        assert plain.error.share == pytest.approx(latched, rel=0.1)
        assert f"{100 * share:.0f} %" in text
    assert press.reported_contact == pytest.approx(4.5e-6, abs=0.5e-6)
    coarse = run(bracket, 1.0, corners=9, **ours)
    assert coarse.reported_contact == pytest.approx(0.38e-3, abs=0.01e-3)
    assert "off by 4.5 µm" in text and "off by 0.38 mm" in text and "5 and 46 %" in text


def test_latency_costs_nothing_where_distances_are_read_with_their_own_pose(flat):
    """Reference, the row TS: 10.0, 10.0, 10.0, 10.1 % at 0.5 m/s."""
    errors = [run(flat, latency=latency).error.share for latency in (0.0, 0.003, 0.010)]

    assert max(errors) - min(errors) < 0.01
    assert max(errors) < 0.11


def test_latency_shows_where_distances_are_read_with_the_present_pose(flat):
    """Reference: the drum is late by v (tau + 0.5 to 0.9 ms), and the error grows with latency and speed."""
    errors = {}
    for speed, latency in ((0.25, 0.003), (0.5, 0.001), (0.5, 0.003), (0.5, 0.010)):
        press = run(flat, speed, latency=latency, reading=Target.LATCHED)
        assert 0.2e-3 < drum_offset(press.response) / speed - latency < 0.9e-3
        errors[speed, latency] = press.error.share

    assert errors[0.5, 0.001] < errors[0.5, 0.003] < errors[0.5, 0.010]
    assert errors[0.25, 0.003] < errors[0.5, 0.003]
    assert errors[0.5, 0.010] > 5.0 * 0.11  # the controller's bound at every latency


def test_service_that_is_always_late_leaves_the_drum_away(flat):
    """Frames older than 20 ms when read are not used (reference value)."""
    press = run(flat, latency=0.025)

    assert set(press.states) == {"retracted"}
    assert press.response.drum.min() > 0.99 * flat.retraction
    assert press.response.contact.max() == 0.0


@pytest.mark.parametrize("span", [(-0.02, 0.02), (0.02, 0.1)])
@pytest.mark.parametrize("kind", ["blind", "silent"])
def test_drum_never_advances_on_what_is_lost(flat, kind, span):
    """Lost poses are nan for the tracker; lost frames do not reach the controller."""
    press = run(flat, **{kind: (span,)})

    assert press.advances == 0
    assert "fault" not in press.states
    response = press.response
    since = 0.001 if kind == "blind" else 0.021  # until the loss arrives, or the last frame is old
    settled = 0.010  # settling of the servo
    is_lost = (response.times > span[0] + since + settled) & (response.times < span[1])
    if is_lost.any():
        drum = response.drum[is_lost]
        assert (
            np.maximum.accumulate(drum) - drum
        ).max() < 1e-3  # overshoot of the servo after a fast retreat
    assert press.counts.lost == (0 if kind == "blind" else press.counts.lost)


def test_finger_that_got_inside_unseen_is_brought_back_slowly(flat):
    """Reference: a late drum moves at 0.05 m/s at most, to the last reported surface."""
    press = run(flat, hold=0.6, silent=((-0.02, 0.02),))
    response = press.response

    speed = -np.gradient(response.drum, response.step)
    is_late = (response.drum > 0.5e-3) & (response.times > 0.05) & (response.times < 0.5)
    is_near = is_late & (response.drum - response.link < 2e-3)
    assert response.link.max() > 6e-3  # depth of the finger
    assert speed[is_near].max() < 0.055
    at_rest = response.zero + round(0.62 / response.step)
    assert response.force[at_rest] == pytest.approx(press.real.force[at_rest], rel=0.05)


@pytest.mark.parametrize(("late", "share"), [(0.030, 5), (0.050, 2)])
def test_drum_that_was_sent_away_does_not_meet_the_finger_at_speed(flat, late, share):
    """Occasionally late frames send the drum away; when it returns, the finger approaches too."""
    press = run(flat, start_distance=0.06, latency=(0.001,) * (100 - share) + (late,) * share)
    response = press.response
    met = int(np.flatnonzero(response.contact > 0.0)[0])
    ms = round(1e-3 / response.step)

    assert press.advances == 0
    assert (response.drum[met - ms] - response.drum[met]) / 1e-3 < press.setup.drum.speed_limit / 20.0
    assert response.force.max() < press.real.force.max()


def test_same_run_gives_the_same_bits(flat):
    latencies = tuple(1e-3 * np.random.default_rng(3).gamma(2.0, 0.5, 200))
    first, second = (run(flat, latency=latencies) for _ in range(2))

    for name in ("force", "finger", "link", "drum", "contact"):
        assert getattr(first.response, name).tobytes() == getattr(second.response, name).tobytes()
    assert first.states == second.states
    assert first.error.share == pytest.approx(run(flat).error.share, abs=0.01)


def test_messages_do_not_overtake_each_other():
    now = [0]
    link = DelayedLink([0.003, 0.001], lambda: now[0])
    for i in range(20):
        now[0] = 1_000_000 * i
        link.send(np.array([i], np.uint8))
    room, seen = np.zeros(1, np.uint8), []
    now[0] = 1_000_000_000
    while link.receive(room) > 0:
        seen.append(int(room[0]))

    assert seen == list(range(20))


CAVITY = Scene([Solid(*shapes.hollow_cube(0.1, 0.04), name="hollow")])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: EngineSetup(rate=0.0), "rate is 0.0, expected a positive number of hertz"),
        (lambda: EngineSetup(phase=1.0), "phase is 1.0, expected 0 or more, and below 1 of a period"),
        (lambda: EngineSetup(far_force=-1.0), "far_force is -1.0, expected"),
        (lambda: DelayedLink(-1.0, lambda: 0), "latency is -1.0, expected"),
        (lambda: DelayedLink((), lambda: 0), "no latency is given"),
        (lambda: place_finger(CAVITY, (0.0, 0.0, 0.015)),
         "no finger gets there without touching the part before"),
        (lambda: place_finger(CAVITY, (0.0, math.nan, 0.0)),
         r"the position is \[0\.0, nan, 0\.0\], expected three coordinates"),
        (lambda: placed(CAVITY, place_finger(box_scene()).glove, Pose(translation=(1.0, 0.0, 0.0))),
         "the finger touches no part between flat hand and fist"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        make()


@pytest.mark.parametrize(("speed", "switch"), [(0.1, 0.123), (1.0, 0.087)])
def test_teleoperation_changes_to_force_when_that_is_steady(flat, speed, switch):
    """Reference: instants of the change, and bumps of about 20 mN at most."""
    press = run(flat, speed, hold=0.4, distances=Distances.SENSOR)

    assert press.switched_at == pytest.approx(switch, abs=0.003)
    row = press.response.zero + round(press.switched_at / press.response.step)
    after = slice(row, row + round(AFTER_SWITCH / press.response.step))
    assert np.abs(press.response.force - press.real.force)[after].max() < 0.025
    assert press.error.share < 0.15


@pytest.mark.parametrize(("stiffness", "damping", "tilt"), [(300.0, 4.0, 0.0), (800.0, 2.0, 40.0)])
def test_deformable_part_gives_way_as_its_law_says(stiffness, damping, tilt):
    """A finger at an angle feels the part of the law along its path: the square of the incidence."""
    finger = place_finger(box_scene(stiffness=stiffness, damping=damping), (0.0, 0.0, 0.01))
    turn = Pose(turn_about_axes((tilt, 0.0, 0.0)))
    finger = placed(finger.scene, finger.glove, turn @ finger.world_from_hand)
    press = run(finger, 0.1, hold=0.6)
    depth, along = HAND.press(0.1).depth, finger.incidence**2
    row = press.response.zero + round(0.6 / press.response.step)

    assert set(press.states) >= {"approach", "force"}
    assert press.real.force[row] == pytest.approx(steady_force(HAND, depth, along * stiffness), rel=1e-6)
    assert press.response.force[row] == pytest.approx(press.real.force[row], rel=0.005)
    assert press.error.share < 0.08


@pytest.mark.parametrize("yields", [300.0, 1000.0, 3000.0])
@pytest.mark.parametrize(("stiffness", "share"), [(300.0, 0.21), (800.0, 0.10)])
def test_deformable_part_is_displayed_to_any_finger_that_yields(yields, stiffness, share):
    """*yields*: N/m of the hand."""
    hand = Hand(stiffness=yields)
    finger = place_finger(box_scene(stiffness=stiffness, damping=2.0), (0.0, 0.0, 0.01))
    setup = EngineSetup(start_distance=START_DISTANCE, drum=EngineSetup().drum)
    press = press_on_part(finger, hand.press(0.1, hold=0.6), setup, hand)
    row = press.response.zero + round(0.6 / press.response.step)

    assert set(press.states) == {"retracted", "approach", "force"}
    assert press.response.force[row] == pytest.approx(press.real.force[row], rel=0.005)
    assert press.error.share < share


def test_press_whose_frames_are_all_old_says_why_there_is_no_force():
    late, plain = (
        part_press.simulate_on_part(box_scene(), EngineSetup(latency=latency), at=(0.0, 0.0, 0.01), speed=0.5)
        for latency in (0.040, 0.010)
    )

    assert late.engine.response.force.max() < 0.1 < plain.engine.response.force.max()
    assert "does not let the drum come nearer on such old frames" in dict(part_press.describe(late))[
        "no force"
    ].replace("\n", " ")
    assert "no force" not in dict(part_press.describe(plain))
