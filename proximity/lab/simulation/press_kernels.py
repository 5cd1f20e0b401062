"""Kernels that step a finger, driven by its hand, on a real wall and on a coupled wall.

Steps are semi-implicit (speeds first, positions with the new speeds). A run has its contact at row *zero* of
the record; row i is the instant (i - zero) step. The device of a coupled wall is bound to the finger through
the pad, which pushes and pulls; a real wall only pushes.
"""

import numpy as np

from proximity.decaff.drum.drum_kernels import rounded
from proximity.native import entry, inlined

# --- a body: hand, finger, pad, link ---
BODY_HAND_STIFFNESS = 0  # N/m
BODY_HAND_DAMPING = 1  # N s/m
BODY_FINGER_MASS = 2  # kg
BODY_PAD_STIFFNESS = 3  # N/m
BODY_PAD_DAMPING = 4  # N s/m
BODY_LINK_MASS = 5  # kg, of what moves with the pad's far side
BODY_LINK_DAMPING = 6  # N s/m
BODY_CONTACT_STIFFNESS = 7  # N/m, of link on drum
BODY_CONTACT_DAMPING = 8  # N s/m
BODY_CABLE_STIFFNESS = 9  # N/m, at the fingertip; 0: the pad presses on the link itself
BODY_CABLE_DAMPING = 10  # N s/m
BODY_CAPSTAN = 11  # share of its tension by which the cable rubs in its sheath, as the tension grows
BODY_DRAG = 12  # N, by which it rubs at least
BODY_PLAY = 13  # m at the fingertip, of the cable's backlash: so far the finger goes back without the link
BODY_SIZE = 14

LEAST_DAMPING = 1.0  # N s/m, of a surface that goes back: its spring alone would be there at once
TOUCHING = 1e-9  # m; so near is touching: the positions of an approach add up with rounding

# --- an intent ---
PRESS_SPEED = 0  # m/s
PRESS_DEPTH = 1  # m
PRESS_RELEASE = 2  # s
PRESS_SIZE = 3
# One that was recorded goes on: all its positions, m, and all its speeds, m/s, at even steps.
PRESS_BEGIN = 3  # s, of the first
PRESS_STEP = 4  # s, from one to the next
PRESS_TABLE = 5

# --- a row of a record ---
RECORD_FORCE = 0  # N, of the pad on the finger
RECORD_FINGER = 1  # m
RECORD_FINGER_SPEED = 2  # m/s
RECORD_LINK = 3  # m
RECORD_LINK_SPEED = 4  # m/s
RECORD_DRUM = 5  # m; of a wall that is not a drum: its surface
RECORD_CONTACT = 6  # N, on the link
RECORD_THIMBLE = 7  # m, of what the pad presses on: the cable's near end
RECORD_SIZE = 8

# --- a coupled wall ---
WALL_STIFFNESS = 0  # N/m
WALL_DAMPING = 1  # N s/m
WALL_RESOLUTION = 2  # m, of the encoder; 0: none
WALL_SIZE = 3


@inlined
def recorded_intent(press: np.ndarray, t: float) -> tuple[float, float]:
    """The same of a `recorded_press.RecordedPress`: lines between instants, at rest before and after."""
    count = (press.shape[0] - PRESS_TABLE) // 2
    at = (t - press[PRESS_BEGIN]) / press[PRESS_STEP]
    if not at > 0.0:
        return press[PRESS_TABLE], 0.0
    i = int(at)
    if i >= count - 1:
        return press[PRESS_TABLE + count - 1], 0.0
    share, speeds = at - i, PRESS_TABLE + count
    where = press[PRESS_TABLE + i] + share * (press[PRESS_TABLE + i + 1] - press[PRESS_TABLE + i])
    return where, press[speeds + i] + share * (press[speeds + i + 1] - press[speeds + i])


@inlined
def intent(press: np.ndarray, t: float) -> tuple[float, float]:
    """Intended position and speed of the hand at *t*: `trajectories.Press`, touching at 0."""
    if press.shape[0] > PRESS_SIZE:
        return recorded_intent(press, t)
    speed, depth = press[PRESS_SPEED], press[PRESS_DEPTH]
    rise = 2.0 * depth / speed
    if t < 0.0:
        return speed * t, speed
    if t < rise:
        s = t / rise
        return depth * s * (2.0 - s * s * (2.0 - s)), speed * (1.0 - s) * (1.0 - s) * (1.0 + 2.0 * s)
    r = (t - press[PRESS_RELEASE]) / rise
    if r < 0.0:
        return depth, 0.0
    if r < 1.0:
        return depth * (1.0 - r * r * r * (2.0 - r)), -speed * r * r * (3.0 - 2.0 * r)
    return -speed * rise * (r - 1.0), -speed


@inlined
def hand_force(body: np.ndarray, press: np.ndarray, t: float, finger: float, speed: float) -> float:
    """Force of the hand on the finger, N."""
    wanted, wanted_speed = intent(press, t)
    return body[BODY_HAND_STIFFNESS] * (wanted - finger) + body[BODY_HAND_DAMPING] * (wanted_speed - speed)


@inlined
def step_finger(
    body: np.ndarray, press: np.ndarray, t: float, force: float, finger: float, speed: float, step: float
) -> tuple[float, float]:
    """Position and speed of the finger a step after *t*, driven by the hand against the pad's *force*."""
    push = hand_force(body, press, t, finger, speed)
    speed += (push - force) / body[BODY_FINGER_MASS] * step
    return finger + speed * step, speed


@entry("float64[:], float64[:], int, float, float64[:, :]")
def press_real_wall(body: np.ndarray, press: np.ndarray, zero: int, step: float, record: np.ndarray) -> None:
    """A finger on a wall that neither moves nor pulls."""
    finger, speed = intent(press, -zero * step)
    for i in range(record.shape[1]):
        force = 0.0
        # At the surface the damper already pushes: the force begins with a step.
        if finger >= -TOUCHING:
            force = max(0.0, body[BODY_PAD_STIFFNESS] * finger + body[BODY_PAD_DAMPING] * speed)
        record[RECORD_FORCE, i], record[RECORD_FINGER, i], record[RECORD_FINGER_SPEED, i] = (
            force,
            finger,
            speed,
        )
        record[RECORD_LINK, i], record[RECORD_LINK_SPEED, i] = (
            min(finger, 0.0),
            0.0 if finger > 0.0 else speed,
        )
        record[RECORD_THIMBLE, i] = record[RECORD_LINK, i]
        record[RECORD_DRUM, i], record[RECORD_CONTACT, i] = 0.0, force
        finger, speed = step_finger(body, press, (i - zero) * step, force, finger, speed, step)


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
            pad = body[BODY_PAD_STIFFNESS] * (finger - surface) + body[BODY_PAD_DAMPING] * speed
            sink = (pad - wall[WALL_STIFFNESS] * surface) / (body[BODY_PAD_DAMPING] + wall[WALL_DAMPING])
            force = pad - body[BODY_PAD_DAMPING] * sink
        if not force > 0.0:  # it goes back by itself
            force = 0.0
            sink = -wall[WALL_STIFFNESS] * surface / max(wall[WALL_DAMPING], LEAST_DAMPING)
        record[RECORD_FORCE, i], record[RECORD_FINGER, i], record[RECORD_FINGER_SPEED, i] = (
            force,
            finger,
            speed,
        )
        record[RECORD_LINK, i], record[RECORD_LINK_SPEED, i] = max(surface, min(finger, 0.0)), sink
        record[RECORD_THIMBLE, i] = record[RECORD_LINK, i]
        record[RECORD_DRUM, i], record[RECORD_CONTACT, i] = surface, force
        finger, speed = step_finger(body, press, (i - zero) * step, force, finger, speed, step)
        surface += sink * step


@entry("float64[:], float64[:], float64[:], int64[:], int, float, float64[:, :]", makes_arrays=True)
def press_coupled_wall(
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
        force = body[BODY_PAD_STIFFNESS] * (finger - link) + body[BODY_PAD_DAMPING] * (speed - link_speed)
        record[RECORD_FORCE, i], record[RECORD_FINGER, i], record[RECORD_FINGER_SPEED, i] = (
            force,
            finger,
            speed,
        )
        record[RECORD_LINK, i], record[RECORD_LINK_SPEED, i] = link, link_speed
        record[RECORD_THIMBLE, i] = link
        record[RECORD_DRUM, i], record[RECORD_CONTACT, i] = 0.0, push_back
        link_speed += (force - push_back - body[BODY_LINK_DAMPING] * link_speed) / body[BODY_LINK_MASS] * step
        link += link_speed * step
        finger, speed = step_finger(body, press, (i - zero) * step, force, finger, speed, step)
