"""A VR program with a service: sends fingertips and a moving lid as messages, receives frames of distances.

Start it; `vr_service.toml`, the scene file, must be in the same folder:

    python examples/vr_service.py

The service runs in a separate process and publishes a frame every millisecond, independently of the VR
program. This program sends ten fingertips and the lid 90 times a second for two seconds and reads the
newest frame. Other programs on this machine can read the same frames, for example `proximity watch shm://box`.
Replace `hands_at` by your headset and `lid_at` by your scene graph.

It prints four lines a second, once the names of the parts have arrived: the state of the frame, the age of
its poses, and the finger that is nearest to a part. At the end it prints the numbers of received and lost
frames.
"""

import math
import time
from pathlib import Path

import numpy as np

import proximity

SCENE_FILE = Path(__file__).with_name("vr_service.toml")
ADDRESS = "shm://box"
RATE = 90  # pictures a second


def hands_at(seconds):
    """Return the positions of the ten fingertips, (10, 3) in metres: above the lid, coming down."""
    return [[0.005 * finger, 0.020, 0.050 - 0.010 * seconds] for finger in range(1, 11)]


def lid_at(seconds):
    """Return position (m) and velocity (m/s) of the lid: closed at first, then rising."""
    return [0.0, 0.040, 0.016 + 0.005 * seconds], [0.0, 0.0, 0.005]


def main():
    hands, lid = proximity.Message(proximity.POSES, 10), proximity.Message(proximity.MOVES, 1)
    hands.records["finger"] = range(10)
    hands.records["velocity"] = hands.records["bend"] = math.nan  # unknown: the service estimates velocities
    lid.records["name"], lid.records["rotation"] = b"lid", np.diag([1.0, -1.0, -1.0])

    with (
        proximity.start_service(SCENE_FILE),
        proximity.open_publisher(f"{ADDRESS}/poses") as to_hands,
        proximity.open_publisher(f"{ADDRESS}/moves") as to_lid,
        proximity.open_subscriber(ADDRESS) as frames,
    ):
        for picture in range(2 * RATE):
            # `pose_ns` is the instant of the poses, `send_ns` that of sending the message.
            hands.records["position"] = hands_at(picture / RATE)
            lid.records["translation"], lid.records["velocity"] = lid_at(picture / RATE)
            for message, publisher in ((hands, to_hands), (lid, to_lid)):
                message.records["pose_ns"] = message.header["send_ns"] = time.monotonic_ns()
                publisher.publish(message)

            time.sleep(1 / RATE)  # your program draws its picture here
            frame = frames.read()  # the newest frame, verified and aged; never waits

            if picture % 22 == 21 and frame.is_valid and frames.part_names:
                nearest = frame.contacts[frame.contacts["signed_distance"].argmin()]
                part = frames.part_names[nearest["part"]]
                print(
                    f"{frame.state.name}, {1e-6 * frame.age_ns:4.1f} ms old: finger",
                    nearest["finger"],
                    end="",
                )
                print(f" is {1e3 * nearest['signed_distance']:5.1f} mm from {part}")
        print(frames.counts)


if __name__ == "__main__":
    main()
