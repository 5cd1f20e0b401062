"""Make ``hand.csv``, a hand at the sample bracket: ``python meshes/make_recording.py``.

Generated from formulas and one seed, in the form of the recordings of optical hand sensors: ``time_s, hand,
finger (0 thumb ... 4 little), x_m, y_m, z_m``, about 100 frames a second, in the frame of ``bracket.stl``.
The hand comes in from the front, takes the foot of the bracket between thumb and fingers, slides towards
the upright and back, lets go, pinches once more and leaves. As sensors do, this one jitters by a tenth of a
millimetre, is never quite on time, loses frames (single ones, and once all for 0.13 s) and the little
finger (for 0.3 s), and once sees the whole hand elsewhere for two frames.
"""

from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parent
NAME = "hand.csv"
SEED = 20261120
FRAME_S = (0.0090, 0.0110)  # shortest and longest time between two frames
TIP_RADIUS = 7.0  # mm, of the spheres that touch
PRESS = 0.8  # mm, how far a closed finger presses in
FOOT = (0.0, 4.0)  # mm, underside and top of the bracket's foot

# time in s; the hand's place x y z in mm; how far the fingers are open, 0 to 1
KEYFRAMES = np.array(
    [
        [0.00, 190, 24, 70, 0.7],
        [1.25, 46, 22, 0, 1.0],
        [1.70, 46, 22, 0, 0.0],
        [2.00, 46, 22, 0, 0.0],
        [2.60, 38, 20, 0, 0.0],
        [3.20, 50, 23, 0, 0.0],
        [3.45, 50, 23, 0, 0.8],
        [3.80, 48, 22, 0, 0.0],
        [3.95, 48, 22, 0, 0.0],
        [4.20, 52, 22, 0, 0.9],
        [5.20, 200, 10, 80, 0.6],
    ]
)
# of each finger, mm: place in the hand x y; how far it opens, up or (the thumb) down; its delay in s
FINGERS = np.array(
    [
        [-2, 8, -34, 0.00],
        [0, 14, 26, 0.02],
        [5, 4, 30, 0.00],
        [3, -6, 28, 0.03],
        [-7, -15, 24, 0.05],
    ]
)
LITTLE = 4
DROPPED_FRAMES = (31, 118, 263, 264, 402)
ALL_LOST_S = (0.55, 0.68)
LITTLE_LOST_S = (2.62, 2.92)
JUMP_FRAMES = (96, 97)
JUMP = (55.0, -30.0, 20.0)  # mm
JITTER = 0.1  # mm
TREMOR_HZ = 9.0
TREMOR = 0.15  # mm


def times(rng: np.random.Generator) -> np.ndarray:
    """Instants of the frames, s, from 0 on, in whole microseconds."""
    steps = rng.uniform(*FRAME_S, 2 * int(KEYFRAMES[-1, 0] / sum(FRAME_S)) + 50)
    found = np.concatenate([[0.0], np.cumsum(steps)]).round(6)
    return found[found <= KEYFRAMES[-1, 0]]


def between_keyframes(at: np.ndarray) -> np.ndarray:
    """The hand at the instants *at*, (T, 4): place and opening, smooth from each keyframe to the next."""
    at = np.clip(at, 0.0, KEYFRAMES[-1, 0])
    last = np.clip(np.searchsorted(KEYFRAMES[:, 0], at, side="right"), 1, len(KEYFRAMES) - 1)
    start, end = KEYFRAMES[last - 1], KEYFRAMES[last]
    way = (at - start[:, 0]) / (end[:, 0] - start[:, 0])
    way = way**3 * (10.0 - 15.0 * way + 6.0 * way**2)
    return start[:, 1:] + way[:, None] * (end - start)[:, 1:]


def positions(at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Centres of the fingertips at the instants *at*, (T, 5, 3), mm, as the sensor sees them."""
    seen = np.empty((len(at), len(FINGERS), 3))
    for finger, (x, y, opening, delay) in enumerate(FINGERS):
        place, is_open = between_keyframes(at), between_keyframes(at - delay)[:, 3]
        closed = FOOT[0] - TIP_RADIUS + PRESS if opening < 0 else FOOT[1] + TIP_RADIUS - PRESS
        seen[:, finger] = place[:, :3] + [x, y, closed]
        seen[:, finger, 2] += opening * is_open
    phase = rng.uniform(0.0, 2.0 * np.pi, (len(FINGERS), 3))
    seen += TREMOR * np.sin(2.0 * np.pi * TREMOR_HZ * at[:, None, None] + phase)
    seen += rng.normal(0.0, JITTER, seen.shape)
    seen[list(JUMP_FRAMES)] += JUMP
    return seen


def recording_bytes() -> bytes:
    """The content of the file."""
    rng = np.random.default_rng(SEED)
    at = times(rng)
    millimetres = positions(at, rng)
    lines = ["time_s,hand,finger,x_m,y_m,z_m"]
    for frame, time_s in enumerate(at):
        if frame in DROPPED_FRAMES or ALL_LOST_S[0] < time_s < ALL_LOST_S[1]:
            continue
        for finger, (x, y, z) in enumerate(1e-3 * millimetres[frame]):
            if finger == LITTLE and LITTLE_LOST_S[0] < time_s < LITTLE_LOST_S[1]:
                continue
            lines.append(f"{time_s:.6f},0,{finger},{x:.6f},{y:.6f},{z:.6f}")
    return "\n".join([*lines, ""]).encode("ascii")


def main() -> None:
    content = recording_bytes()
    (FOLDER / NAME).write_bytes(content)
    print(f"{len(content):>10,} bytes  {NAME}")


if __name__ == "__main__":
    main()
