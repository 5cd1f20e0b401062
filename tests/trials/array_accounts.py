"""Ask and move and tick a lot; print how many arrays compiled code has not given back, and how many it made.

Run with NUMBA_NRT_STATS=1, which has the allocations counted.
"""

import numpy as np
import shapes
from numba.core.runtime import rtsys

from proximity import Pose, Scene, Solid, Tracker

MS = 1_000_000


def make_scenes():
    ball, cube = Solid(*shapes.sphere(0.1, 2), name="ball"), Solid(*shapes.cube(), name="cube")
    vertices, faces = shapes.sphere(0.1, 2)
    holed = Solid(vertices, faces[:-1], name="holed")
    return [Scene([ball, cube]), Scene([ball]), Scene([holed]), Scene([holed, ball])]


def work(scenes):
    points, ways = np.random.default_rng(0).normal(size=(2, 300, 3))
    for scene in scenes:
        for count in (5, 300):
            few, along = points[:count], ways[:count]
            for limit in (0.1, np.inf):
                scene.closest(few, max_distance=limit)
                scene.cast(few, along, max_distance=limit)
                scene.closest_to_segments(few, along)
            for ask in (scene.signed_distance, scene.distance, scene.contains):
                ask(few)
        scene.closest(points, workers=2)
        tracker = Tracker(scene, fingers=5)
        paths = np.stack([np.linspace(point, 0.5 * point, 4) for point in points[:5]])
        for k in range(20):
            scene.move(scene.parts[0].name, Pose(translation=(1e-3 * k, 0, 0)), velocity=(1, 0, 0))
            tracker.tick(points[:5] + 1e-3 * k, k * MS, k * MS, paths=paths)
        part = scene.parts[0]
        scene.deform(part.name, 1.001 * part.solid.mesh.vertices)


def main():
    scenes = make_scenes()
    work(scenes)
    before = rtsys.get_allocation_stats()
    for _ in range(3):
        work(scenes)
    after = rtsys.get_allocation_stats()
    print(
        after.alloc - before.alloc - (after.free - before.free),
        after.mi_alloc - before.mi_alloc - (after.mi_free - before.mi_free),
        after.alloc,
    )


if __name__ == "__main__":
    main()
