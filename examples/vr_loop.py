"""A VR loop with a `Tracker`: a lid that closes, two hands with ten fingertips, an answer every millisecond.

Start it:

    python examples/vr_loop.py

The lid of the sample box closes. The left hand holds the rim of the box, the right hand comes down from
above. When a finger is about to touch the lid, the lid stops. Hands and lid move by the formulas of
`hands_at` and `lid_at`: replace them by your headset and your scene graph. The loop runs in simulated time,
so it ends quickly and prints the same distances on every run. In your program use `time.monotonic_ns()`.

It prints a line every 0.1 s for each hand: the finger that is nearest to a part, the part, the distance,
and the time until it touches, if that is within 0.25 s. At the end it prints the duration of a tick.
"""

import time
from pathlib import Path

import numpy as np

import proximity

BOX = Path(__file__).resolve().parent.parent / "meshes" / "assembly.glb"
FRAME_MS = 11  # a headset with 90 Hz has new poses about every 11 ms
FINGERS = [f"{hand} {name}" for hand in ("left", "right") for name in ("thumb", "2", "3", "4", "5")]
HINGE = np.array([0.0, 0.040, 0.012])  # m, a point of the hinge, which runs along x
CLOSING_SPEED = 1.2  # rad/s


def hands_at(ms):
    """Return the positions of the ten fingertips, (10, 3) in metres: the left hand first."""
    across = np.linspace(0.010, 0.050, 5)
    left = np.column_stack([across, np.full(5, -0.001), np.full(5, 0.020)])
    right = np.column_stack([across, np.full(5, 0.020), np.full(5, 0.125 - 1e-4 * ms)])
    return np.concatenate([left, right])


def lid_at(angle, speed, closed):
    """Return pose, velocity and angular velocity of the lid, turned about the hinge by *angle* (rad)."""
    turn = proximity.Pose.from_quaternion([np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)], HINGE)
    pose = turn @ proximity.Pose(translation=-HINGE) @ closed
    spin = np.array([speed, 0.0, 0.0])
    return pose, np.cross(spin, pose.translation - HINGE), spin


def main():
    proximity.warm_up()
    scene = proximity.load(BOX)
    names, closed = [part.name for part in scene.parts], scene.part("lid").pose
    tracker = proximity.Tracker(scene, fingers=10, radius=0.007, latency=0.001)
    angle, speed, took = np.radians(-60.0), CLOSING_SPEED, []

    for ms in range(951):
        now_ns = (1000 + ms) * 1_000_000
        frame = ms - ms % FRAME_MS  # the poses are those of the last frame of the headset
        pose, velocity, spin = lid_at(angle, speed, closed)
        scene.move("lid", pose, velocity=velocity, angular_velocity=spin)
        started = time.perf_counter()
        contacts = tracker.tick(hands_at(frame), (1000 + frame) * 1_000_000, now_ns)
        took.append(1e6 * (time.perf_counter() - started))

        # Times to contact count from the instant of the pose.
        touch_ms = 1e3 * contacts["time_to_contact"] - 1e-6 * contacts["age_ns"]
        soon = (contacts["part"] == names.index("lid")) & (touch_ms < 10.0)
        if speed and soon.any():
            speed = 0.0
            print(f"{ms:4d} ms  the lid stops: the {FINGERS[soon.argmax()]} would touch it within 10 ms")
        angle += 1e-3 * speed
        for hand in (slice(0, 5), slice(5, 10)) if ms % 100 == 0 and ms else ():
            finger = min(contacts[hand], key=lambda contact: contact["signed_distance"])
            touch = touch_ms[finger["finger"]]
            where = f"{1e3 * finger['signed_distance']:5.1f} mm from {names[finger['part']]}"
            print(f"{ms:4d} ms  {FINGERS[finger['finger']]:12} {where}", end="")
            print(f", touches in {touch:.0f} ms" if np.isfinite(touch) else "")
    usual, slow = np.percentile(took, [50, 99])
    print(f"half of the ticks took {usual:.0f} µs at most, 99 of 100 took {slow:.0f} µs at most")


if __name__ == "__main__":
    main()
