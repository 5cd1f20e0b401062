"""A soft part: a rubber ball that resists a touch with a force, and is pressed flat.

Start it:

    python examples/soft_part.py

A part can be soft in two ways, both shown here. With a stiffness it keeps its shape, and the
tracker reports the force of a finger that presses into it: stiffness times depth, plus damping times speed.
`scene.deform` sets another shape, for example from a physics engine, and all distances follow.

It prints the depth and the force while a finger presses into the ball at 20 mm/s. Then it prints the
distance of a point above the ball while the ball is pressed flat, and the duration of a change of shape.
"""

import time
from pathlib import Path

import numpy as np

import proximity

BALL = Path(__file__).resolve().parent.parent / "meshes" / "sphere.stl"
RADIUS, FINGER = 0.020, 0.007  # m, of the ball and of the fingertip


def press(scene):
    """Press a finger into the ball, and print the force that the tracker reports."""
    scene.set_surface("sphere", stiffness=800.0, damping=2.0)  # N/m, N s/m
    tracker = proximity.Tracker(scene, fingers=1, radius=FINGER)
    print("depth, mm   force, N")
    for ms in range(301):
        height = RADIUS + FINGER + 0.002 - 0.020e-3 * ms
        (contact,) = tracker.tick([[0.0, 0.0, height]], (1000 + ms) * 1_000_000, (1000 + ms) * 1_000_000)
        if ms % 50 == 0 and contact["force_is_valid"]:
            print(f"{-1e3 * contact['signed_distance'] + 0.0:9.2f} {contact['force']:10.3f}")


def flatten(scene):
    """Press the ball flat step by step, and print the distance of a point above it."""
    round_ball = scene.part("sphere").solid.mesh.vertices
    point = [0.0, 0.0, 0.030]
    took = []
    print("height, %   distance, mm")
    for share in (1.0, 0.9, 0.8, 0.7):
        # The volume is constant: the width grows as the height decreases.
        shape = round_ball * [share**-0.5, share**-0.5, share]
        started = time.perf_counter()
        scene.deform("sphere", shape)
        took.append(time.perf_counter() - started)
        print(f"{100 * share:9.0f} {1e3 * scene.signed_distance(point):14.3f}")
    print(f"a change of shape took {1e6 * np.median(took):.0f} µs")


def main():
    scene = proximity.load(BALL)
    press(scene)
    flatten(scene)


if __name__ == "__main__":
    main()
