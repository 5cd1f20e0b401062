"""Small scenes for tests of trackers, and the paths of a bending finger. Lengths in metres."""

import numpy as np
import pytest
import shapes

from proximity.kernels.tracking.tick import MANY, MIN_BUDGETS, PRESENCE, SHARED_BUDGETS
from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

MS = 1_000_000  # ns
RADIUS = 0.007


def near(value):
    """Equal within a few roundings."""
    return pytest.approx(value, rel=1e-12, abs=1e-14)


def solid(mesh, name):
    return Solid(*mesh, name=name)


def plate(name="plate", *, top=0.0, thickness=0.01, half=0.1):
    """A square plate about the z axis."""
    return solid(shapes.box((-half, -half, top - thickness), (half, half, top)), name)


def block(name, center, half=0.05):
    """A cube, each face cut in two."""
    return solid(shapes.cube(2.0 * half, center), name)


def moving_block(velocity=(0, 0, 0), angular_velocity=(0, 0, 0), translation=(0, 0, 0)):
    scene = Scene([block("block", (0, 0, 0))])
    scene.move("block", Pose(translation=translation), velocity=velocity, angular_velocity=angular_velocity)
    return scene


def sheet(name="sheet", *, height=0.0, half=0.1):
    """A square without thickness."""
    vertices, faces = shapes.grid(1, 1)
    return solid(((vertices - (0.5, 0.5, 0.0)) * 2.0 * half + (0.0, 0.0, height), faces), name)


def steps_for_all(budget, count):
    """Number of steps that *count* fingers share per tick for their distances."""
    return max(SHARED_BUDGETS * budget - PRESENCE * max(count - MANY, 0), MIN_BUDGETS * budget)


def flags_of(contacts, finger=0):
    """Flags of a record, or of one of several."""
    return ContactFlag(int(np.atleast_1d(contacts["flags"])[finger]))


def tick_at(things, positions, velocity=None, *, ns=0, **settings):
    """Records of a first tick; *things* is a scene or a list of solids."""
    scene = things if isinstance(things, Scene) else Scene(things)
    positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
    tracker = Tracker(scene, fingers=len(positions), **settings)
    velocities = None if velocity is None else np.broadcast_to(np.asarray(velocity, float), positions.shape)
    return tracker.tick(positions, ns, ns, velocities=velocities)


def contact(things, position, velocity=None, **settings):
    """The record of one finger at its first tick."""
    return tick_at(things, [position], velocity, **settings)[0]


def tick_path(
    things, path, position=None, velocity=(0.0, 0.0, 0.0), *, path_bends=None, bend=None, **settings
):
    """The record of one finger with a path, by default at the start of the path."""
    path = np.asarray(path, dtype=np.float64)
    tracker = Tracker(things if isinstance(things, Scene) else Scene(things), fingers=1, **settings)
    return tracker.tick(
        [path[0] if position is None else position],
        0,
        0,
        velocities=[velocity],
        paths=path[None],
        path_bends=path_bends,
        bends=None if bend is None else [bend],
    )[0]


def line(start, end, count=2):
    """A straight path of *count* corners."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return (1.0 - share) * np.asarray(start, float) + share * np.asarray(end, float)


PHALANGES = np.array([0.045, 0.026, 0.020])
FLEXIONS = np.radians([80.0, 100.0, 200.0 / 3.0])


def fingertip(bend):
    """Tip position (..., 3) of a finger that bends in the plane z = 0."""
    angles = -np.asarray(bend, dtype=np.float64)[..., None] * np.cumsum(FLEXIONS)
    x, y = (PHALANGES * np.cos(angles)).sum(axis=-1), (PHALANGES * np.sin(angles)).sum(axis=-1)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def bending(count=401):
    """The path of that fingertip from flat hand to fist as a polyline, and the bend at each corner."""
    bends = np.linspace(0.0, 1.0, count)
    return fingertip(bends), bends
