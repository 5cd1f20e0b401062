"""A finger, driven by its hand, on a real wall and on a penalty wall: step by step.

Steps are semi-implicit (speeds first, positions with the new speeds). A run has its contact at row *zero* of
the record; row i is the instant (i - zero) step. The device of a penalty wall is bound to the finger through
the pad, which pushes and pulls; a real wall only pushes.
"""

import numpy as np

from proximity.decaff.drum.drum_kernels import rounded
from proximity.native import entry, inlined

# --- a body: hand, finger, pad, link ---
HAND_STIFFNESS = 0  # N/m
HAND_DAMPING = 1  # N s/m
FINGER_MASS = 2  # kg
PAD_STIFFNESS = 3  # N/m
PAD_DAMPING = 4  # N s/m
LINK_MASS = 5  # kg, of what moves with the pad's far side
LINK_DAMPING = 6  # N s/m
CONTACT_STIFFNESS = 7  # N/m, of link on drum
CONTACT_DAMPING = 8  # N s/m
BODY_SIZE = 9

LEAST_DAMPING = 1.0  # N s/m, of a surface that goes back: its spring alone would be there at once
TOUCHING = 1e-9  # m; so near is touching: the positions of an approach add up with rounding

# --- an intent ---
SPEED = 0  # m/s
DEPTH = 1  # m
RELEASE = 2  # s
PRESS_SIZE = 3
# One that was recorded goes on: all its positions, m, and all its speeds, m/s, at even steps.
BEGIN = 3  # s, of the first
EVERY = 4  # s, from one to the next
TABLE = 5

# --- a row of a record ---
FORCE = 0  # N, of the pad on the finger
FINGER = 1  # m
FINGER_SPEED = 2  # m/s
LINK = 3  # m
LINK_SPEED = 4  # m/s
DRUM = 5  # m; of a wall that is not a drum: its surface
CONTACT = 6  # N, on the link
RECORD_SIZE = 7

# --- a penalty wall ---
WALL_STIFFNESS = 0  # N/m
WALL_DAMPING = 1  # N s/m
WALL_RESOLUTION = 2  # m, of the encoder; 0: none
WALL_SIZE = 3


@inlined
def recorded_intent(press: np.ndarray, t: float) -> tuple[float, float]:
    """The same of a `recorded_press.RecordedPress`: lines between instants, at rest before and after."""
    count = (press.shape[0] - TABLE) // 2
    at = (t - press[BEGIN]) / press[EVERY]
    if not at > 0.0:
        return press[TABLE], 0.0
    i = int(at)
    if i >= count - 1:
        return press[TABLE + count - 1], 0.0
    share, speeds = at - i, TABLE + count
    where = press[TABLE + i] + share * (press[TABLE + i + 1] - press[TABLE + i])
    return where, press[speeds + i] + share * (press[speeds + i + 1] - press[speeds + i])


@inlined
def intent(press: np.ndarray, t: float) -> tuple[float, float]:
    """Where the hand means to be at *t*, and how fast it means to go: `trajectories.Press`, touching at 0."""
    if press.shape[0] > PRESS_SIZE:
        return recorded_intent(press, t)
    speed, depth = press[SPEED], press[DEPTH]
    rise = 2.0 * depth / speed
    if t < 0.0:
        return speed * t, speed
    if t < rise:
        s = t / rise
        return depth * s * (2.0 - s * s * (2.0 - s)), speed * (1.0 - s) * (1.0 - s) * (1.0 + 2.0 * s)
    r = (t - press[RELEASE]) / rise
    if r < 0.0:
        return depth, 0.0
    if r < 1.0:
        return depth * (1.0 - r * r * r * (2.0 - r)), -speed * r * r * (3.0 - 2.0 * r)
    return -speed * rise * (r - 1.0), -speed


@inlined
def hand_force(body: np.ndarray, press: np.ndarray, t: float, finger: float, speed: float) -> float:
    """What the hand pushes the finger with, N."""
    wanted, wanted_speed = intent(press, t)
    return body[HAND_STIFFNESS] * (wanted - finger) + body[HAND_DAMPING] * (wanted_speed - speed)


@entry("float64[:], float64[:], int, float, float64[:, :]")
def press_real_wall(body: np.ndarray, press: np.ndarray, zero: int, step: float, record: np.ndarray) -> None:
    """A finger on a wall that neither moves nor pulls."""
    finger, speed = intent(press, -zero * step)
    for i in range(record.shape[1]):
        force = 0.0
        # At the surface the damper already pushes: the force begins with a step.
        if finger >= -TOUCHING:
            force = max(0.0, body[PAD_STIFFNESS] * finger + body[PAD_DAMPING] * speed)
        record[FORCE, i], record[FINGER, i], record[FINGER_SPEED, i] = force, finger, speed
        record[LINK, i], record[LINK_SPEED, i] = min(finger, 0.0), 0.0 if finger > 0.0 else speed
        record[DRUM, i], record[CONTACT, i] = 0.0, force
        push = hand_force(body, press, (i - zero) * step, finger, speed)
        speed += (push - force) / body[FINGER_MASS] * step
        finger += speed * step


@entry("float64[:], float64[:], float64[:], int, float, float64[:, :]")
def press_soft_wall(
    body: np.ndarray, press: np.ndarray, wall: np.ndarray, zero: int, step: float, record: np.ndarray
) -> None:
    """A finger on a surface without mass, held by a spring and a damper of its own, which never pulls.

    Pad and surface are in a row: the same force is on both, which tells how fast the surface gives way.
    """
    finger, speed = intent(press, -zero * step)
    surface = 0.0
    for i in range(record.shape[1]):
        force = sink = 0.0
        if finger >= surface - TOUCHING:
            pad = body[PAD_STIFFNESS] * (finger - surface) + body[PAD_DAMPING] * speed
            sink = (pad - wall[WALL_STIFFNESS] * surface) / (body[PAD_DAMPING] + wall[WALL_DAMPING])
            force = pad - body[PAD_DAMPING] * sink
        if not force > 0.0:  # it goes back by itself
            force = 0.0
            sink = -wall[WALL_STIFFNESS] * surface / max(wall[WALL_DAMPING], LEAST_DAMPING)
        record[FORCE, i], record[FINGER, i], record[FINGER_SPEED, i] = force, finger, speed
        record[LINK, i], record[LINK_SPEED, i] = max(surface, min(finger, 0.0)), sink
        record[DRUM, i], record[CONTACT, i] = surface, force
        push = hand_force(body, press, (i - zero) * step, finger, speed)
        speed += (push - force) / body[FINGER_MASS] * step
        finger += speed * step
        surface += sink * step


@entry("float64[:], float64[:], float64[:], int64[:], int, float, float64[:, :]", makes_arrays=True)
def press_penalty_wall(
    body: np.ndarray,
    press: np.ndarray,
    wall: np.ndarray,
    samples: np.ndarray,
    zero: int,
    step: float,
    record: np.ndarray,
) -> None:
    """A finger bound to a device that a sampled spring and damper push back, late.

    *samples*: steps from one sample to the next, steps of the delay, and steps from a sample to the contact
    at row *zero*. The force is held from sample to sample, and never pulls.
    """
    every, late, phase = samples[0], samples[1], samples[2]
    first = (zero - phase) % every
    finger, speed = intent(press, -zero * step)
    link, link_speed = finger, speed
    before = rounded(link, wall[WALL_RESOLUTION])
    forces = np.zeros(record.shape[1] // every + 2)
    for i in range(record.shape[1]):
        since = i - first
        if since >= 0 and since % every == 0:
            reported = rounded(link, wall[WALL_RESOLUTION])
            if reported > 0.0:
                damped = wall[WALL_DAMPING] * (reported - before) / (every * step)
                forces[since // every] = max(0.0, wall[WALL_STIFFNESS] * reported + damped)
            before = reported
        push_back = forces[(since - late) // every] if since >= late else 0.0
        force = body[PAD_STIFFNESS] * (finger - link) + body[PAD_DAMPING] * (speed - link_speed)
        record[FORCE, i], record[FINGER, i], record[FINGER_SPEED, i] = force, finger, speed
        record[LINK, i], record[LINK_SPEED, i] = link, link_speed
        record[DRUM, i], record[CONTACT, i] = 0.0, push_back
        push = hand_force(body, press, (i - zero) * step, finger, speed)
        speed += (push - force) / body[FINGER_MASS] * step
        link_speed += (force - push_back - body[LINK_DAMPING] * link_speed) / body[LINK_MASS] * step
        finger += speed * step
        link += link_speed * step
