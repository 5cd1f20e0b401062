"""The hand of the controller in C: a service, and a finger that bends until it touches a box.

Start it in this folder, together with `./main`, as main.c explains:

    python hand.py

It serves scene.toml for three seconds and sends the finger 100 times a second: the position of its tip, its
bend, and the path of the tip from the flat hand to the fist. From the path the service computes the bend at
which the finger touches. It prints the number of ticks of the service.
"""

import time
from pathlib import Path

import numpy as np

import proximity

SCENE_FILE = Path(__file__).with_name("scene.toml")
KNUCKLE, LENGTH = np.array([-0.045, 0.015, 0.070]), 0.080  # m
FIST = 1.6  # rad, rotation of the finger at bend 1
SECONDS = 3.0


def tip_at(bend):
    """Return the position of the fingertip at each bend from 0 to 1, (..., 3) in metres."""
    angle = FIST * np.asarray(bend)
    return KNUCKLE + LENGTH * np.stack([np.cos(angle), 0.0 * angle, -np.sin(angle)], axis=-1)


def main():
    message = proximity.Message(proximity.PATH_POSES, 1)
    corners = message.records["corners"]
    corners[:] = tip_at(np.linspace(0.0, 1.0, corners.shape[1]))
    message.records["velocity"] = np.nan  # unknown: the service estimates it

    with (
        proximity.start_service(SCENE_FILE) as service,
        proximity.open_publisher("udp://127.0.0.1:9101") as to_service,
    ):
        began = time.monotonic()
        while (gone := time.monotonic() - began) < SECONDS:
            # The box stops the finger at a bend of 0.355.
            bend = min(0.2 * gone, 0.355)
            message.records["position"], message.records["bend"] = tip_at(bend), bend
            message.records["pose_ns"] = message.header["send_ns"] = time.monotonic_ns()
            to_service.publish(message)
            time.sleep(0.01)
        print(service.stop()["ticks"], "ticks")


if __name__ == "__main__":
    try:
        main()
    except proximity.ProximityError as failure:  # the file of the box, for example, in a copy of this folder
        raise SystemExit(str(failure)) from None
