"""Records of fingers without a search: bounds, and a point of the surface."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, near, plate, solid

from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker


def skipped(contacts):
    return contacts["flags"] & ContactFlag.SKIPPED != 0


def surface_of(scene):
    """Return the scene's present surface, without regard to sides."""
    meshes = [
        (part.solid.mesh.vertices @ part.pose.rotation.T + part.pose.translation, part.solid.mesh.faces)
        for part in scene.parts
    ]
    return Solid(*shapes.join(*meshes))


def assert_told_rightly(scene, contacts, tips):
    """Check the bounds, and that the reported point is on the surface, at its distance, along the normal."""
    surface = surface_of(scene)
    true = scene.signed_distance(tips) - RADIUS
    slack = 1e-12 * (np.abs(true) + 1.0)
    assert (contacts["lower"] <= true + slack).all() and (true <= contacts["upper"] + slack).all()
    feet = contacts["point_on_part"]
    assert surface.distance(feet).max() <= 1e-12
    ways = tips - feet
    lengths = np.linalg.norm(ways, axis=1)
    far = skipped(contacts)
    assert np.abs(lengths - RADIUS - contacts["signed_distance"])[far].max(initial=0.0) <= 1e-12
    assert np.abs(ways - lengths[:, None] * contacts["normal"])[far].max(initial=0.0) <= 1e-12
    assert np.abs(tips - RADIUS * contacts["normal"] - contacts["point_on_finger"]).max() <= 1e-12


@pytest.mark.parametrize("tolerance", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_far_from_parts_that_move_now_and_then_every_answer_holds(seed, tolerance):
    rng = np.random.default_rng(seed)
    scene = Scene(
        [solid(shapes.moved(shapes.sphere(0.03, 3), (0.2 * k, 0, 0)), f"ball {k}") for k in range(3)]
        + [plate(top=-0.05, half=0.3)]
    )
    count, skips = 6, 0
    tracker = Tracker(scene, fingers=count, radius=RADIUS, working_range=0.02, tolerance=tolerance)
    tips = rng.uniform((-0.3, -0.3, 0.0), (0.3, 0.3, 0.6), (count, 3))
    for k in range(200):
        tips = tips + rng.normal(scale=rng.choice([1e-5, 1e-3]), size=tips.shape)
        seen = tips.copy()
        seen[rng.uniform(size=count) < 0.1] = np.nan
        if rng.uniform() < 0.1:
            name, turn = scene.parts[rng.integers(4)].name, rng.uniform(0, 1e-2)
            pose = np.eye(4)
            pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
            pose[:3, 3] = rng.uniform(-0.01, 0.01, 3)
            scene.move(name, pose)
        contacts = tracker.tick(seen, k * MS, k * MS)
        is_seen = np.isfinite(seen).all(axis=1)
        assert_told_rightly(scene, contacts[is_seen], tips[is_seen])
        skips += np.count_nonzero(skipped(contacts))
    assert skips > 250


def test_the_point_told_stays_until_the_finger_has_gone_a_sixteenth_of_its_distance():
    tracker = Tracker(Scene([plate()]), fingers=1, radius=0.0, working_range=0.01)
    begin = np.array([[-0.05, 0.03, 0.064]])
    tracker.tick(begin, 0, 0)

    for k in range(1, 40):
        tip = np.add(begin, (1e-4 * k, 0.0, 0.0))
        contacts = tracker.tick(tip, k * MS, k * MS)

        assert skipped(contacts).all()
        assert contacts["point_on_part"][0] == near([-0.05, 0.03, 0.0])
        assert contacts["upper"][0] == near(np.hypot(0.064, 1e-4 * k))
    for k in range(40, 400):
        contacts = tracker.tick(np.add(begin, (1e-4 * k, 0.0, 0.0)), k * MS, k * MS)
        assert contacts["upper"][0] <= 0.064 * (1.0 + 0.5 / 16.0**2)


def test_a_part_that_moved_while_the_finger_was_lost_is_told_where_it_is():
    scene = Scene([plate()])
    tracker = Tracker(scene, fingers=1, radius=0.0, working_range=0.01)
    tip = np.array([[0.01, 0.02, 0.1]])
    for k in range(3):
        assert skipped(tracker.tick(tip, k * MS, k * MS)).any() == (k > 0)
    scene.move("plate", Pose(translation=(0.0, 0.0, -0.01)))
    tracker.tick(np.full((1, 3), np.nan), 3 * MS, 3 * MS)

    contacts = tracker.tick(tip, 4 * MS, 4 * MS)

    assert skipped(contacts).all()
    assert contacts["point_on_part"][0] == near([0.01, 0.02, -0.01])


def test_a_part_that_was_parked_far_away_is_not_passed_over_when_it_is_fetched():
    """Regression: after 1 km the bound was reset, but not the displacement of parts at that instant."""
    balls = [
        solid(shapes.moved(shapes.sphere(0.03, 2), (k, 0, 0)), name) for k, name in enumerate(("a", "b"))
    ]
    scene = Scene(balls)
    tracker, tip = Tracker(scene, fingers=1, radius=0.0), np.array([[0.0, 0.0, 0.3]])
    way = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.29]])
    for k, place in enumerate([(0, 0, 0), (0, 0, 600), (0, 0, 0), (-1, 0, 0.25), (-1, 0, 0.26)]):
        scene.move("b", Pose(translation=place))

        contacts = tracker.tick(tip, k * MS, k * MS, velocities=np.zeros((1, 3)), paths=way[None])

        true = scene.signed_distance(tip)[0]
        assert contacts["lower"][0] <= true + 1e-12 and true <= contacts["upper"][0] + 1e-12
        assert contacts["predicted_lower"][0] <= true + 1e-12
