"""Compiling everything before it is needed.

Kernels are compiled for this very processor when first called, and kept on disk; loading them takes a
fraction of a second. A program that must not wait later calls `warm_up` first.
"""

import numpy as np

from proximity.kernels.compiling import cache_folder
from proximity.pose import Pose
from proximity.scene import Part, Scene
from proximity.solid import Solid

_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def kernels_are_cached() -> bool:
    """Return whether kernels for these sources lie on disk, so that nothing waits for a compiler."""
    try:
        return any(cache_folder().rglob("query.closest_batch-*.nbi"))
    except OSError:
        return False


def warm_up() -> None:
    """Compile or load every kernel: a minute or two the first time on a machine, later less than a second."""
    first = Solid(_CORNERS, _FACES, name="first")
    second = Part(
        "second", Solid(_CORNERS, _FACES), Pose(translation=(2.0, 0.0, 0.0)), np.arange(4, dtype=np.int32)
    )
    points = np.linspace(-1.0, 3.0, 192).reshape(64, 3)
    Scene.from_mesh(_CORNERS, _FACES)
    scene = Scene([first, second])
    scene.deform("second", 2.0 * _CORNERS)
    for asked in (first, scene):
        for rows in (points, points[:2]):  # many and few have kernels of their own
            asked.closest(rows)
            asked.signed_distance(rows)
            asked.distance(rows)
            asked.contains(rows)
            asked.cast(rows, rows + 1.5)
            asked.cast_distance(rows, rows + 1.5)
            asked.closest_to_segments(rows, rows + 0.1)
        if isinstance(asked, Scene):
            asked.move_many(["second"], [Pose(translation=(2.0, 1.0, 0.0))])
            asked.closest(points)
            _tick(asked)


def _tick(scene: Scene) -> None:
    """Tick with and without what a caller may know besides poses."""
    from proximity.tracker import Tracker  # most that ask whether kernels are there tick nothing

    tracker = Tracker(scene, fingers=2)
    tips = np.array([[0.3, 0.3, 0.5], [2.1, 1.1, 0.1]])
    for now_ns in (0, 1_000_000, 2_000_000):
        tracker.tick(tips, now_ns, now_ns)
        tracker.tick(tips, now_ns, now_ns, velocities=-tips, paths=np.stack((tips, 0.5 * tips), axis=1))
