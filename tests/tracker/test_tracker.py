"""Answers of a tick, against closed forms: distances, surfaces, velocities, times to contact."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, block, contact, flags_of, moving_block, near, plate, sheet, solid, tick_at

from proximity.message import CONTACT, ContactFlag, Surface
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker


def test_above_a_plate_all_fields_are_known():
    found = contact([plate()], (0.01, 0.02, 0.05))

    for name in ("signed_distance", "lower", "upper"):
        assert found[name] == near(0.05 - RADIUS)
    assert found["point_on_part"] == near([0.01, 0.02, 0.0])
    assert found["point_on_finger"] == near([0.01, 0.02, 0.05 - RADIUS])
    assert found["normal"] == near([0, 0, 1])
    assert (found["part"], found["surface"]) == (0, Surface.RIGID)
    assert found["face"] in (2, 3)  # the two faces of the top
    assert found["finger"] == 0 and found["work"] > 0
    assert found["part_velocity"].tolist() == [0, 0, 0]


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_distance_is_that_of_the_sphere(radius):
    found = contact([plate()], (0, 0, 0.05), radius=radius)

    assert found["signed_distance"] == near(0.05 - radius)
    assert found["point_on_finger"] == near([0, 0, 0.05 - radius])


def test_each_finger_has_its_own_radius():
    found = tick_at([plate()], [(0, 0, 0.05)] * 3, radius=[0.001, 0.01, 0.02])

    assert found["signed_distance"] == near([0.049, 0.04, 0.03])
    assert found["finger"].tolist() == [0, 1, 2]


def test_finger_pressed_in_has_negative_distance_and_the_same_normal():
    found = contact([plate()], (0, 0, 0.004))

    assert found["signed_distance"] == near(-0.003)
    assert found["normal"] == near([0, 0, 1])
    assert found["time_to_contact"] == found["time_to_contact_lower"] == 0.0


def test_finger_with_its_centre_inside_is_told_the_way_out():
    found = tick_at([plate()], [(0, 0, -0.002)])

    assert found["signed_distance"][0] == near(-0.002 - RADIUS)
    assert found["normal"][0] == near([0, 0, 1])
    assert found["point_on_part"][0] == near([0, 0, 0])
    assert found["point_on_finger"][0] == near([0, 0, -0.002 - RADIUS])
    assert flags_of(found) & (ContactFlag.INSIDE | ContactFlag.SIGNED | ContactFlag.EXACT) == (
        ContactFlag.INSIDE | ContactFlag.SIGNED | ContactFlag.EXACT
    )


@pytest.mark.parametrize(
    ("position", "normal"),
    [((0.0, 0.0, 0.0), (0, 0, 1)), ((0.1, 0.0, -0.005), (1, 0, 0)), ((0.1, 0.1, 0.0), (1, 1, 1))],
)
def test_centre_on_the_surface_has_the_normal_of_face_edge_or_corner(position, normal):
    """The pseudo-normal at edges and corners; the corner's weighs the three right angles equally."""
    found = contact([plate()], position)

    assert found["signed_distance"] == near(-RADIUS)
    assert found["normal"] == near(np.array(normal) / np.linalg.norm(normal))


def test_beside_a_corner_the_normal_points_to_the_finger():
    offset = np.array([0.01, 0.02, 0.02])  # length 0.03
    found = contact([plate()], np.add((0.1, 0.1, 0.0), offset))

    assert found["signed_distance"] == near(0.03 - RADIUS)
    assert found["normal"] == near(offset / 0.03)


def test_of_a_fine_ball_distance_and_normal_are_the_balls():
    ball = solid(shapes.sphere(0.05, 5), "ball")
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    found = contact([ball], 0.1 * direction)

    assert found["signed_distance"] == pytest.approx(0.05 - RADIUS, abs=2e-5)
    assert found["normal"] == pytest.approx(direction, abs=0.02)


def test_of_a_turned_and_moved_part_everything_is_in_the_frame_of_the_scene():
    turn = shapes.rotation(5)
    scene = Scene([plate("far", top=-1.0), plate()])
    scene.move("plate", Pose(turn, (0.3, -0.2, 0.1)))
    found = contact(scene, turn @ (0.01, 0.02, 0.03) + (0.3, -0.2, 0.1))

    assert (found["part"], found["face"]) in {(1, 2), (1, 3)}
    assert found["signed_distance"] == near(0.03 - RADIUS)
    assert found["normal"] == near(turn[:, 2])
    assert found["point_on_part"] == near(turn @ (0.01, 0.02, 0.0) + (0.3, -0.2, 0.1))


def test_of_parts_that_hold_the_finger_the_deepest_counts():
    """As for the scene: the minimum over all parts."""
    parts = [block("small", (0, 0, 0), 0.02), block("large", (0, 0, 0), 0.05)]
    found = contact(parts, (0, 0, 0.01))

    assert found["signed_distance"] == near(-0.04 - RADIUS)
    assert found["part"] == 1


def test_a_sheet_has_no_sign_and_its_normal_points_to_the_finger():
    above, below = tick_at([sheet()], [(0, 0, 0.02), (0, 0, -0.02)])

    assert above["signed_distance"] == below["signed_distance"] == near(0.02 - RADIUS)
    assert above["normal"] == near([0, 0, 1]) and below["normal"] == near([0, 0, -1])
    assert not above["flags"] & (ContactFlag.SIGNED | ContactFlag.INSIDE)
    assert above["flags"] & ContactFlag.EXACT


def test_surface_of_the_nearest_part_is_told():
    scene = Scene([block("soft", (0, 0, 0)), block("hard", (0.5, 0, 0))])
    scene.set_surface("soft", stiffness=800.0, damping=2.5)
    soft, hard = tick_at(scene, [(0, 0, 0.07), (0.5, 0, 0.07)])

    assert (soft["surface"], soft["stiffness"], soft["damping"]) == (Surface.DEFORMABLE, 800.0, 2.5)
    assert (hard["surface"], hard["stiffness"], hard["damping"]) == (Surface.RIGID, 0.0, 0.0)


def test_exact_answers_are_those_of_the_scene():
    rng = np.random.default_rng(3)
    scene = Scene([solid(shapes.torus(0.08, 0.03), "ring"), block("block", (0.1, 0.05, 0.0), 0.04)])
    points = rng.uniform(-0.12, 0.12, (400, 3))
    found, expected = tick_at(scene, points, working_range=1.0), scene.closest(points)

    assert (found["flags"] & ContactFlag.EXACT != 0).all()
    assert found["signed_distance"] == pytest.approx(expected.signed_distance - RADIUS, rel=1e-12, abs=1e-15)
    assert np.array_equal(found["flags"] & ContactFlag.INSIDE != 0, expected.signed_distance < 0)
    assert found["point_on_part"] == pytest.approx(expected.point, abs=1e-14)
    assert np.einsum("ij,ij->i", found["normal"], expected.gradient) == pytest.approx(1.0, abs=1e-9)


def test_velocity_is_told_by_the_poses():
    tracker = Tracker(Scene([plate()]), fingers=1)
    velocity = np.array([0.1, -0.2, -0.4])
    for k in range(5):
        found = tracker.tick([(0, 0, 0.05) + 0.002 * k * velocity], 2 * k * MS, (2 * k + 1) * MS)[0]

    assert found["velocity"] == pytest.approx(velocity, rel=1e-9)
    assert found["approach_speed"] == pytest.approx(0.4, rel=1e-9)
    assert (found["pose_ns"], found["age_ns"], found["predicted_ns"]) == (8 * MS, MS, 10 * MS)


def test_velocity_that_is_given_counts_and_a_row_of_nan_is_estimated():
    tracker = Tracker(Scene([plate()]), fingers=2)
    for k in range(3):
        tips = [(0, 0, 0.05 - 0.001 * k), (0.02, 0, 0.05 - 0.001 * k)]
        found = tracker.tick(tips, k * MS, k * MS, velocities=[(0, 0, 0.25), (np.nan, 0, 0)])

    assert found["velocity"][0].tolist() == [0, 0, 0.25]
    assert found["velocity"][1] == pytest.approx([0, 0, -1.0])
    # Without given velocities both are estimated.
    found = tracker.tick([(0, 0, 0.047), (0.02, 0, 0.047)], 3 * MS, 3 * MS)
    assert found["velocity"][:, 2] == pytest.approx([-1.0, -1.0])


def test_part_velocity_is_that_of_the_point_that_is_nearest():
    """The point is 0.05 above and 0.03 to the side of the part's origin, the centre of its rotation."""
    found = contact(moving_block((0.1, 0, 0), (0, 2, 0), (1, 1, 1)), (1.03, 1, 1.1), (0, 0, -0.5))

    assert found["point_on_part"] == near([1.03, 1, 1.05])
    assert found["part_velocity"] == near([0.1 + 2 * 0.05, 0, -2 * 0.03])
    assert found["approach_speed"] == near(0.5 - 0.06)


def test_approach_speed_is_the_rate_of_the_distance():
    """Against a difference quotient of the distance with finger and part moved."""
    turn, v, w = shapes.rotation(4), np.array([0.2, -0.1, 0.15]), np.array([1.0, 2.0, -1.5])
    position, velocity = np.array([0.09, 0.05, 0.11]), np.array([-0.3, 0.1, -0.2])
    scene, h = Scene([block("block", (0.01, 0, 0))]), 1e-6
    distances = []
    for t in (-h, h):
        angle = np.linalg.norm(w) * t
        x, y, z = w / np.linalg.norm(w)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        step = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        scene.move("block", Pose(step @ turn, (0.0, 0.01, 0.0) + v * t))
        distances.append(float(scene.signed_distance(position + velocity * t)))
    scene.move("block", Pose(turn, (0.0, 0.01, 0.0)), velocity=v, angular_velocity=w)
    found = contact(scene, position, velocity)

    assert found["approach_speed"] == pytest.approx((distances[0] - distances[1]) / (2 * h), rel=1e-6)


def test_record_is_the_message_and_every_field_is_written():
    tracker = Tracker(Scene([plate()]), fingers=1)
    raw = tracker.contacts.view(np.uint8)
    raw[:] = 0x5A
    found = tracker.tick([(0, 0, 0.05)], 0, 0, velocities=[(0, 0, -1)])
    untouched = [name for name in CONTACT.names if np.all(found[name].view(np.uint8) == 0x5A)]

    assert found.dtype == CONTACT
    assert untouched == []
