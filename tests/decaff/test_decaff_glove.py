"""The glove's geometry: derived tables of reference values, and formulas checked in independent ways."""

import math

import numpy as np
import pytest
from bending_finger_objects import THINGS
from printed import printed
from scipy.integrate import quad
from scipy.optimize import brentq

from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.glove import ArmDrum, Glove
from proximity.decaff.glove.transmission import Cable, Linkage, Potentiometer
from proximity.errors import ArgumentError
from proximity.message import PATH_CORNERS
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.placement import turn_about_axes
from proximity.tracker.tracker import Tracker

MM = 1e-3
DEGREE = math.pi / 180.0
GLOVE = Glove()
FINGER = GLOVE.finger
BENDS = np.linspace(0.0, 1.0, 41)
CARELESS = Linkage(base=(-0.015, 0.025), first_bar=0.060, second_bar=0.075)


# b, p_x, p_y, |dp/db| [mm], beta, phi [deg], dphi/db [rad]
TABLE_9_1 = """
0   91.0000  0        230.616 44.7622  0       2.1854
0.5 23.4818  -71.6352 194.009 -36.5777 54.2266 1.59197
1   -26.1074 -25.9520 106.273 -89.4227 89.4566 0.8534
"""
ROWS = [line.split() for line in TABLE_9_1.split("\n")[1:-1]]


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_table_of_the_paper_is_derived(row):
    """All digits. The last joint bends 200/3 degrees: with 66.67, as printed, p_x(1) is 0.001 mm off."""
    bend, x, y, speed, beta, phi, rate = row
    b = float(bend)

    assert (FINGER.point(b) / MM).tolist() == printed(x, y)
    assert float(FINGER.speed(b)) / MM == printed(speed)
    assert float(GLOVE.linkage.angle(FINGER, b)) / DEGREE == printed(beta)
    assert float(GLOVE.replica_angle(b)) / DEGREE == printed(phi)
    assert float(GLOVE.replica_rate(b)) == printed(rate)


def chain_of_turns(bend, along=1.0, dorsal=0.0):
    """Return the same point by complex numbers: each phalanx rotates the following ones."""
    position = along * FINGER.phalanges[2] + 1j * dorsal
    for length, flexion in zip((*FINGER.phalanges[1::-1], 0.0), FINGER.flexions[::-1], strict=True):
        position = length + np.exp(-1j * bend * flexion) * position
    return position


@pytest.mark.parametrize(("along", "dorsal"), [(1.0, 0.0), (0.5, 0.010), (0.0, -0.003)])
def test_points_of_the_finger_agree_with_a_chain_of_turns(along, dorsal):
    expected = chain_of_turns(BENDS, along, dorsal)
    points = FINGER.point(BENDS, along, dorsal)

    np.testing.assert_allclose(points[:, 0] + 1j * points[:, 1], expected, rtol=0, atol=1e-16)
    step = 1e-4
    slope = (
        8 * (chain_of_turns(BENDS + step, along, dorsal) - chain_of_turns(BENDS - step, along, dorsal))
    ) / 12
    slope -= (
        chain_of_turns(BENDS + 2 * step, along, dorsal) - chain_of_turns(BENDS - 2 * step, along, dorsal)
    ) / 12
    rates = FINGER.point_rate(BENDS, along, dorsal)
    np.testing.assert_allclose(rates[:, 0] + 1j * rates[:, 1], slope / step, rtol=0, atol=1e-11)


def test_lengths_along_the_path_agree_with_an_integral():
    expected = quad(lambda b: float(FINGER.speed(b)), 0.1, 0.9, epsabs=1e-15, epsrel=1e-13)[0]

    assert float(FINGER.path_length(0.1, 0.9)) == pytest.approx(expected, rel=1e-13)
    assert float(FINGER.path_length(0.9, 0.1)) == pytest.approx(-expected, rel=1e-13)
    np.testing.assert_array_equal(FINGER.path_length(BENDS, BENDS), 0.0)


def test_path_for_the_tracker_is_even_in_bend_and_in_the_world():
    world_from_hand = Pose(turn_about_axes((20.0, -35.0, 110.0)), (0.4, -0.2, 1.1))
    path = GLOVE.finger.path_world(world_from_hand)

    assert path.shape == (PATH_CORNERS, 3)
    assert path.dtype == np.float64 and path.flags.c_contiguous
    back = world_from_hand.inverse.point(path)
    np.testing.assert_allclose(back[:, :2], FINGER.point(np.linspace(0.0, 1.0, 65)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(back[:, 2], 0.0, rtol=0, atol=1e-15)
    assert GLOVE.finger.path_world(world_from_hand, 3)[1] == pytest.approx(path[32], abs=1e-15)


def test_line_of_65_corners_is_as_near_to_the_path_as_is_said():
    """Corners are at most 3.6 mm apart, and the line at most 0.03 mm off the path (message.inputs)."""
    path = GLOVE.finger.path_world(Pose())[:, :2]
    middles = (np.arange(64) + 0.5) / 64
    off = np.linalg.norm(0.5 * (path[1:] + path[:-1]) - FINGER.point(middles), axis=1)

    assert 3.5e-3 < np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 3.65e-3
    assert 0.015e-3 < off.max() < 0.03e-3


def test_rate_of_the_linkage_is_the_slope_of_its_angle():
    step = 1e-4
    before, after = (GLOVE.linkage.angle(FINGER, BENDS + side * step) for side in (-1, 1))
    before_2, after_2 = (GLOVE.linkage.angle(FINGER, BENDS + side * 2 * step) for side in (-1, 1))
    slope = (8 * (after - before) - (after_2 - before_2)) / (12 * step)

    np.testing.assert_allclose(GLOVE.linkage.angle_rate(FINGER, BENDS), slope, rtol=0, atol=1e-10)


def test_careless_linkage_of_the_paper_folds_back_and_is_refused():
    rate = CARELESS.angle_rate(FINGER, np.linspace(0.0, 1.0, 1001))

    assert np.flatnonzero(rate > 0.0)[0] / 1000 == printed("0.9")
    with pytest.raises(
        ArgumentError,
        match=r"^the linkage folds back at bend 0\.90\d: expected an angle that only grows or only shrinks "
        r"from flat hand to fist$",
    ):
        Glove(linkage=CARELESS)


def test_linkage_that_does_not_reach_is_refused():
    with pytest.raises(
        ArgumentError,
        match=r"^the linkage does not reach the thimble at bend 0\.59\d: it is 87\.0 mm from the base, "
        r"expected 15\.0 to 87\.0 mm$",
    ):
        Glove(linkage=Linkage(first_bar=0.036, second_bar=0.051))


def test_bend_is_found_again_from_the_replica():
    """Beyond flat hand and fist both continue in a straight line."""
    bends = np.linspace(-0.2, 1.2, 1401)

    np.testing.assert_allclose(GLOVE.bend(GLOVE.replica_angle(bends)), bends, rtol=0, atol=1e-12)
    assert (np.diff(GLOVE.replica_angle(bends)) > 0.0).all()


def test_stretched_cable_and_lost_backlash_leave_the_replica_behind():
    glove = Glove(cable=Cable(backlash=0.2e-3))
    tension = 4.0
    lost = (4.0 / 20e3 + 0.2e-3) / 0.030

    behind = GLOVE.replica_angle(BENDS) - glove.replica_angle(BENDS, tension)
    np.testing.assert_allclose(behind, lost, rtol=1e-12)
    opening = GLOVE.replica_angle(BENDS) - glove.replica_angle(BENDS, is_closing=False)
    np.testing.assert_array_equal(opening, 0.0)
    found = glove.bend(glove.replica_angle(BENDS, tension), tension)
    np.testing.assert_allclose(found, BENDS, rtol=0, atol=1e-12)


def test_potentiometer_reads_whole_counts_and_stops_at_its_ends():
    pot = Potentiometer(bits=12)

    assert pot.gain == pytest.approx(4096 / math.radians(270))
    assert pot.read([0.0, 0.3, -10.0, 10.0]).tolist() == [1365, 1626, 0, 4095]
    np.testing.assert_allclose(pot.angle(pot.counts(BENDS)), BENDS, rtol=0, atol=1e-15)
    assert np.abs(pot.angle(pot.read(BENDS)) - BENDS).max() <= 0.5 / pot.gain
    assert GLOVE.bend_of_counts(GLOVE.counts(0.5)) == pytest.approx(0.5, abs=0.5 * 8.8e-6 / 0.194)


REPLICA = np.radians(np.linspace(0.0, 72.0, 37))


def test_roller_touches_the_link():
    """Its centre is off the link's axis by its radius and half the link, on the side of the rotation."""
    drum = ArmDrum()
    centre = 0.040 * np.exp(1j * drum.drum_angle(REPLICA))
    seen = centre * np.exp(-1j * REPLICA)

    np.testing.assert_allclose(seen.imag, 0.008, rtol=0, atol=1e-16)
    np.testing.assert_allclose(seen.real, drum.lever(REPLICA), rtol=1e-13)


def disc(radius, x, y):
    """Return a function: signed distance of the pad, and the normal."""
    centre = np.array([x, y, 0.0])

    def query(point):
        away = point - centre
        return np.linalg.norm(away) - radius - FINGER.pad_radius, away / np.linalg.norm(away)

    return query


def plane(x, y, offset):
    normal = np.array([x, y, 0.0]) / math.hypot(x, y)
    return lambda point: (normal @ point - offset - FINGER.pad_radius, normal)


# bend at contact, incidence cosine, errors at 1, 5, 10, 20 mm, raw error at 10 mm, steps at 20 mm, kappa
TABLE_9_3 = {
    "disc R 10": (disc(0.010, 0.048, -0.052), "0.285802722 0.5734 -0.022 -0.377 -1.005 -2.10 -3.27 4 44.8"),
    "disc R 20": (disc(0.020, 0.045, -0.055), "0.241103082 0.8059 -0.003 -0.064 -0.182 -0.344 -1.78 3 6.8"),
    "disc R 40": (disc(0.040, 0.040, -0.075), "0.210338488 0.9764 0.000 0.014 0.069 0.391 -0.35 3 0.8"),
    "plane y = -45": (plane(0, 1, -0.045), "0.174204922 0.8573 -0.005 -0.103 -0.362 -1.108 -1.10 3 9.0"),
    "plane x+y = -20 sqrt 2": (
        plane(1, 1, -0.020),
        "0.374750685 0.9275 -0.004 -0.092 -0.318 -0.907 -0.48 3 8.4",
    ),
}


def contact_of(query):
    """Return the first bend at which the pad touches, by brute force."""
    bends = np.linspace(0.0, 1.0, 2001)
    distances = [query(point)[0] for point in FINGER.point_hand(bends)]
    row = int(np.argmax(np.array(distances) <= 0.0))
    return brentq(lambda b: query(FINGER.point_hand(b))[0], bends[row - 1], bends[row], xtol=1e-15)


def bend_before(contact, length):
    """Return the bend at which the fingertip is *length* before the contact, along its path."""
    return brentq(lambda b: float(FINGER.path_length(b, contact)) - length, 0.0, contact, xtol=1e-15)


@pytest.mark.parametrize("name", TABLE_9_3)
def test_contact_of_the_paper_is_found(name):
    query, row = TABLE_9_3[name]
    bend, cosine = row.split()[:2]
    contact = contact_of(query)
    normal = query(FINGER.point_hand(contact))[1]

    assert contact == printed(bend)
    assert -float(normal[:2] @ FINGER.point_rate(contact) / FINGER.speed(contact)) == printed(cosine)


@pytest.mark.parametrize("name", TABLE_9_3)
def test_errors_of_one_distance_are_those_of_the_paper(name):
    """Lengths along the path, from the true contact to the reported one; negative: too early."""
    query, row = TABLE_9_3[name]
    contact = contact_of(query)

    for length, error in zip((1, 5, 10, 20), row.split()[2:6], strict=True):
        bend = bend_before(contact, length * MM)
        distance, normal = query(FINGER.point_hand(bend))
        guess = float(FINGER.contact_bend(bend, distance, normal))
        # The -0.907 is -0.90649, also by quadrature.
        assert float(FINGER.path_length(contact, guess)) / MM == printed(error, digits=0.52)
        if length == 10:
            assert distance / MM - length == printed(row.split()[6])


def test_finger_that_bends_away_is_told_no_contact():
    normals = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    bends = FINGER.contact_bend(0.0, 0.010, normals)

    assert bends[0] == pytest.approx(0.010 / float(FINGER.speed(0.0)))
    assert np.isnan(bends[1:]).all(), "away from the surface, and along it"


@pytest.mark.parametrize("name", THINGS)
def test_engine_finds_the_contacts_on_the_path_that_the_glove_gives_it(name):
    """The same with the tracker, 20 mm before contact: discs are prisms, all is rotated and shifted."""
    part, expected = THINGS[name]
    world_from_hand = Pose(turn_about_axes((20.0, -35.0, 110.0)), (0.4, -0.2, 1.1))
    scene = Scene([part])
    scene.move(part.name, world_from_hand)
    tracker = Tracker(scene, fingers=1, radius=FINGER.pad_radius)
    bend = bend_before(expected, 20 * MM)
    found = tracker.tick(
        world_from_hand.point(FINGER.point_hand([bend])),
        0,
        0,
        paths=GLOVE.finger.path_world(world_from_hand)[None],
        bends=[bend],
    )[0]
    normal = world_from_hand.inverse.direction(found["normal"])
    guess = float(FINGER.contact_bend(bend, found["signed_distance"], normal))

    assert float(TABLE_9_3[name][1].split()[0]) == pytest.approx(expected, abs=1e-12)
    # The polyline of 65 corners is off the path by 0.03 mm at most; divided by the cosine where it is grazed.
    off = abs(float(FINGER.path_length(found["contact_bend"], expected)))
    assert off <= 0.03 * MM / float(TABLE_9_3[name][1].split()[1])
    assert abs(found["contact_bend"] - expected) <= found["contact_bend_error"]
    told = float(TABLE_9_3[name][1].split()[5])
    assert float(FINGER.path_length(expected, guess)) / MM == pytest.approx(told, abs=0.01)


def test_forces_are_those_of_the_paper():
    """1 N at the fingertip needs 121.9 mN m at the replica and 4.06 N in the cable."""
    assert float(GLOVE.replica_torque(0.5, 1.0)) * 1e3 == printed("121.9")
    assert float(GLOVE.cable_tension(0.5, 1.0)) == printed("4.06")


def test_cable_makes_the_wall_as_soft_as_the_paper_says():
    """1212 N/m with 20 N/mm, 6060 N/m with 100 N/mm: 0.246 mm of cable per mm of fingertip."""
    ratio = GLOVE.cable.replica_pulley / GLOVE.tip_per_radian(0.5)

    assert float(ratio) == printed("0.246")
    assert float(GLOVE.tip_stiffness(0.5)) == printed("1212")
    assert float(Glove(cable=Cable(stiffness=100e3)).tip_stiffness(0.5)) == printed("6060")


def test_motor_of_the_arm_carries_what_the_replica_does():
    carried = GLOVE.replica_torque(BENDS, 2.0)
    np.testing.assert_allclose(2.0 * GLOVE.lever(BENDS), carried, rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Finger(flexions=(1, 2)), "flexions are (1, 2), expected three numbers of radians"),
        (lambda: Finger(pad_radius=-1), "pad_radius is -1, expected a number of metres of 0 or more"),
        (lambda: FINGER.path_world(Pose(), 1), "a path of 1 corners, expected 2 or more"),
        (lambda: Linkage(base=(0,)), "base is (0,), expected two numbers of metres"),
        (lambda: Cable(backlash=-1e-4), "backlash is -0.0001, expected a number of metres of 0 or more"),
        (lambda: Potentiometer(bits=33), "bits is 33, expected 1 to 32"),
        (lambda: Potentiometer(bits=1.5), "bits is 1.5, expected a whole number of 1 or more"),
        (lambda: Cable(backlash=None), "backlash is None, expected a number of metres of 0 or more"),
        (lambda: Potentiometer(zero_share=1.0), "zero_share is 1.0, expected less than 1"),
        (lambda: ArmDrum(arm=0.008),
         "the arm is 8 mm, expected more than the roller's radius and half of the link's width, 8 mm"),
    ],
)  # fmt: skip
def test_what_cannot_be_built_is_refused(make, message):
    with pytest.raises(ArgumentError) as refused:
        make()

    assert str(refused.value) == message
