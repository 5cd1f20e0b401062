"""Bounds of a contact that stay valid after its pose, and the fields that no longer hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from ticking import RADIUS, block
from wire import KNOWN, MS, NOW, frame, is_silent

from proximity.message import CONTACT, ContactFlag, Surface
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker
from proximity.transport import forget, widen

SECOND = 1000 * MS
MAX_SPEED, MAX_ACCELERATION = 3.0, 120.0  # m/s and m/s², the defaults of trackers and subscribers


def contacts_of(count=1, **values):
    contacts = frame(count=count).records.copy()
    for name, value in values.items():
        contacts[name] = value
    return contacts


def way_after(seconds, contacts, max_speed=3.0, max_acceleration=120.0):
    before = contacts["upper"][0]
    widen(contacts, int(contacts["pose_ns"][0]) + round(seconds * SECOND), max_speed, max_acceleration)
    return contacts["upper"][0] - before


@pytest.mark.parametrize(
    ("values", "way"),
    [
        ({}, 0.5 * 120 * 0.02**2),
        ({"velocity": (0.3, 0, -0.4)}, (0.5 + 1.2) * 0.02),
        ({"velocity": (0, 2.5, 0)}, 3.0 * 0.02),  # the maximum speed of a finger
        ({"velocity": (0, 2, 0), "part_velocity": (0, 2, 0)}, 1.2 * 0.02),  # finger and part move together
        ({"part_velocity": (1, 0, 0)}, (1.0 + 1.2) * 0.02),
        ({"part_velocity": np.nan, "velocity": (0.5, 0, 0)}, 3.0 * 0.02),  # no part near
        ({"flags": ContactFlag.TRACKED}, 3.0 * 0.02),  # the part may move anywhere
        ({"flags": ContactFlag.TRACKED, "part_velocity": (0, 0, 1)}, 4.0 * 0.02),
        ({"predicted_upper": 0.052}, (0.5 * 1.0 + 1.2) * 0.02),  # the 2 mm in 2 ms may be prediction error
        ({"predicted_upper": 0.052, "flags": ContactFlag.TRACKED}, 3.0 * 0.02),
        ({"predicted_upper": 0.090}, (10.0 + 1.2) * 0.02),  # the part is fast
        ({"predicted_upper": 0.090, "flags": ContactFlag.TRACKED}, 10.0 * 0.02),
        ({"predicted_upper": 0.066, "velocity": (2, 0, 0), "part_velocity": (2, 0, 0)}, (4 + 2 + 1.2) * 0.02),
        ({"predicted_ns": NOW - MS}, 3.0 * 0.02),  # predicted for the instant of the pose: no information
        ({"predicted_upper": np.inf}, 3.0 * 0.02),
        ({"source": 1, "velocity": np.nan, "approach_speed": -0.5}, (0.5 + 1.2) * 0.02),
        ({"source": 1, "velocity": np.nan, "approach_speed": np.nan}, 3.0 * 0.02),
        # A sensor's error of 1 mm does not count towards its speed.
        (
            {"source": 1, "approach_speed": 0, "lower": 0.049, "upper": 0.051, "predicted_lower": 0.049,
             "predicted_upper": 0.051},
            1.2 * 0.02,
        ),
    ],
)  # fmt: skip
def test_bounds_widen_by_what_may_have_moved(values, way):
    assert way_after(0.02, contacts_of(**values)) == pytest.approx(way, rel=1e-9)


def test_late_contact_keeps_its_place_and_promises_nothing_of_it():
    contacts = contacts_of(
        contact_bend=0.4, contact_bend_error=0.01, force=2.0, force_is_valid=1, surface=Surface.DEFORMABLE,
        flags=KNOWN | ContactFlag.ON_PATH | ContactFlag.CONTACT_FOUND | ContactFlag.SKIPPED,
    )  # fmt: skip
    widen(contacts, NOW + 20 * MS, 3.0, 120.0)

    assert contacts["contact_bend"][0] == 0.4 and contacts["contact_bend_error"][0] == np.inf
    assert contacts["force_is_valid"][0] == 0
    assert ContactFlag(contacts["flags"][0]) == (
        ContactFlag.TRACKED | ContactFlag.SIGNED | ContactFlag.BOUNDED | ContactFlag.ON_PATH
    )


def test_time_to_contact_goes_on_counting_from_the_pose():
    contacts = contacts_of(time_to_contact=0.06, time_to_contact_lower=0.05, signed_distance=0.03, lower=0.03)
    widen(contacts, NOW - MS + 10 * MS, 3.0, 120.0)
    lower = contacts["lower"][0]

    assert contacts["time_to_contact"][0] == 0.06
    assert contacts["time_to_contact_lower"][0] == pytest.approx(0.01 + lower / 3.0)


def test_everything_is_forgotten():
    rng = np.random.default_rng(1)
    contacts = np.zeros(3, CONTACT)
    contacts.view(np.uint8)[:] = rng.integers(0, 256, contacts.nbytes)
    kept = {name: contacts[name].copy() for name in ("finger", "pose_ns", "source")}
    forget(contacts)

    assert is_silent(contacts)
    assert (contacts["part"] == -1).all() and (contacts["surface"] == Surface.UNKNOWN).all()
    for name, value in kept.items():
        assert (contacts[name] == value).all()
    told = [name for name in CONTACT.names if CONTACT[name].base.kind == "f" and name not in (
        "lower", "upper", "predicted_lower", "predicted_upper", "time_to_contact_lower")]  # fmt: skip
    for name in told:
        assert np.isnan(contacts[name]).all(), name


class Moving:
    """Up to three cubes that move and rotate, with their velocities."""

    def __init__(self, rng):
        count = int(rng.integers(1, 4))
        self.names = [f"block{number}" for number in range(count)]
        self.scene = Scene([block(name, (0, 0, 0), 0.03) for name in self.names])
        self.places = rng.uniform(-0.15, 0.15, (count, 3))
        self.velocities = rng.uniform(-1, 1, (count, 3)) * rng.choice([0, 0.5, 2.0], (count, 1))
        self.turns = rng.uniform(-1, 1, (count, 3)) * rng.choice([0, 5.0, 20.0], (count, 1))
        self.rotations = Rotation.random(count, random_state=int(rng.integers(2**31)))

    def at(self, seconds):
        """Move the parts to their poses at that time; return the scene."""
        rotations = Rotation.from_rotvec(self.turns * seconds) * self.rotations
        places = self.places + self.velocities * seconds
        poses = [Pose(rotation, place) for rotation, place in zip(rotations.as_matrix(), places, strict=True)]
        self.scene.move_many(self.names, poses, self.velocities, self.turns)
        return self.scene


def courses(rng, moving, count, steps):
    """Position and velocity of fingers, (steps, count, 3), each ms; every other moves to or from a part."""
    places = [rng.uniform(-0.2, 0.2, (count, 3))]
    outward = moving.at(0.0).closest(places[0]).gradient
    push = np.where(rng.random((count, 1)) < 0.7, -outward, outward)
    push[::2] = rng.normal(size=push[::2].shape)
    push *= MAX_ACCELERATION / np.linalg.norm(push, axis=1, keepdims=True)
    velocity = (
        rng.uniform(0, 1.7, (count, 1)) * rng.choice([-1, 1], (count, 3)) * (rng.random((count, 1)) < 0.5)
    )
    velocities = [velocity]
    for _ in range(1, steps):
        later = velocity + 1e-3 * push
        is_slow = np.linalg.norm(later, axis=1, keepdims=True) <= MAX_SPEED
        later = np.where(is_slow, later, velocity)
        places.append(places[-1] + 0.5e-3 * (velocity + later))
        velocity = later
        velocities.append(velocity)
    return np.array(places), np.array(velocities)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("seen", "is_told"), [(1, False), (2, False), (8, False), (1, True)])
def test_true_distance_stays_within_the_bounds_as_they_widen(seed, seen, is_told):
    """After any history of a finger, with or without a given velocity, for any approaching part."""
    rng = np.random.default_rng(seed)
    moving = Moving(rng)
    course, velocities = courses(rng, moving, 200, 110)
    tracker = Tracker(moving.scene, fingers=200, radius=RADIUS, latency=float(rng.choice([0.001, 0.004])))
    for tick in range(seen):
        moving.at(1e-3 * tick)
        velocity = velocities[tick] if is_told else None
        contacts = tracker.tick(course[tick], tick * MS, tick * MS, velocities=velocity)
    for ms in (1, 3, 10, 20, 50, 100):
        told = contacts.copy()
        widen(told, (tick + ms) * MS, MAX_SPEED, MAX_ACCELERATION)
        true = moving.at(1e-3 * (tick + ms)).signed_distance(course[tick + ms]) - RADIUS

        assert (told["lower"] <= true + 1e-12).all(), ms
        assert (true - 1e-12 <= told["upper"]).all(), ms
        free = told["time_to_contact_lower"] - 1e-3 * ms
        assert (true[free > 0.0] > 0.0).all(), ms
