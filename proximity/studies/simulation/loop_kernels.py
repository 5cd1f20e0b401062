"""Hand, finger, link and drum in closed loop, and the four ways to make a drum target of a distance.

A link moves with the finger, free until it meets the drum. A distance is measured at some instants, to a wall
that may move, and delivered later. The contact location is a position in the same coordinate as the link's:
the wall's. Steps are semi-implicit; row *zero* of the record is the instant 0, at which the hand's intent
reaches the place 0.
"""

from math import floor, inf

import numpy as np

from proximity.decaff.drum import drum_kernels as drums
from proximity.decaff.drum.drum_kernels import pushed, serve
from proximity.native import entry, inlined
from proximity.studies.simulation.finger_kernels import (
    CONTACT,
    CONTACT_DAMPING,
    CONTACT_STIFFNESS,
    DRUM,
    FINGER,
    FINGER_MASS,
    FINGER_SPEED,
    FORCE,
    LINK,
    LINK_DAMPING,
    LINK_MASS,
    LINK_SPEED,
    PAD_DAMPING,
    PAD_STIFFNESS,
    hand_force,
    intent,
)

# --- how a target is made; policies.Target names them ---
NAIVE = 0  # where the link is now, and the old distance
LATCHED = 1  # the same, held from touch to release
FEED_FORWARD = 2  # the old distance, less what the link has gone since at its old speed; held
TIME_STAMPED = 3  # where the link was when the distance was measured; held

# --- sensing ---
RATE = 0  # Hz, of distances
LATENCY = 1  # s, from measurement to delivery
REACH = 2  # m, farther distances are not reported
BIAS = 3  # m, added to each distance
SCALE_ERROR = 4  # share, by which each distance is too large
WALL_SPEED = 5  # m/s, of the wall
SENSING_PHASE = 6  # of a period, from the first row to the first measurement
SENSING_SIZE = 7

# --- holding ---
RETRACTED = 0  # m, where the drum waits
TOUCH_GAP = 1  # m, of link and drum: nearer is touching
RELEASE_GAP = 2  # m, farther is released
HOLDING_SIZE = 3

# --- what a policy remembers ---
IS_HELD = 0
TARGET = 1  # m
MEMORY_SIZE = 2

# --- a message ---
AT = 0  # s, of the measurement; -inf: there is none
LINK_THEN = 1  # m
SPEED_THEN = 2  # m/s
DISTANCE = 3  # m
MESSAGE_SIZE = 4


@inlined
def contact_force(body: np.ndarray, link: float, link_speed: float, drum: float, drum_speed: float) -> float:
    """What the drum pushes the link back with, N; never pulls."""
    if not link > drum:
        return 0.0
    force = body[CONTACT_STIFFNESS] * (link - drum) + body[CONTACT_DAMPING] * (link_speed - drum_speed)
    return max(0.0, force)


@entry("float64[:], int, float, float64[:, :]")
def start_record(press: np.ndarray, zero: int, step: float, record: np.ndarray) -> None:
    """The first row: hand, finger and link move together, at the hand's speed."""
    where, speed = intent(press, -zero * step)
    record[FINGER, 0] = record[LINK, 0] = where
    record[FINGER_SPEED, 0] = record[LINK_SPEED, 0] = speed


@entry("float64[:], float64[:], float64[:], float64[:], int, int, int, float, float64[:, :] -> float")
def advance_plant(
    body: np.ndarray,
    press: np.ndarray,
    drum: np.ndarray,
    drive: np.ndarray,
    first: int,
    last: int,
    zero: int,
    step: float,
    record: np.ndarray,
) -> float:
    """Move all by the steps from row *first* to row *last*; the rows between, and the next, are filled.

    Returns the force between link and drum at the last step, N.
    """
    finger, speed = record[FINGER, first], record[FINGER_SPEED, first]
    link, link_speed = record[LINK, first], record[LINK_SPEED, first]
    where, drum_speed, applied = drive[drums.WHERE], drive[drums.SPEED_NOW], drive[drums.APPLIED]
    back = 0.0
    for i in range(first, last):
        force = body[PAD_STIFFNESS] * (finger - link) + body[PAD_DAMPING] * (speed - link_speed)
        back = contact_force(body, link, link_speed, where, drum_speed)
        record[FORCE, i], record[CONTACT, i] = force, back
        record[FINGER, i], record[FINGER_SPEED, i] = finger, speed
        record[LINK, i], record[LINK_SPEED, i] = link, link_speed
        record[DRUM, i] = where
        push = hand_force(body, press, (i - zero) * step, finger, speed)
        speed += (push - force) / body[FINGER_MASS] * step
        link_speed += (force - back - body[LINK_DAMPING] * link_speed) / body[LINK_MASS] * step
        where, drum_speed = pushed(drum, applied, back, where, drum_speed, step)
        finger += speed * step
        link += link_speed * step
    drive[drums.WHERE], drive[drums.SPEED_NOW] = where, drum_speed
    if last < record.shape[1]:
        record[FINGER, last], record[FINGER_SPEED, last] = finger, speed
        record[LINK, last], record[LINK_SPEED, last] = link, link_speed
    return back


@entry("float64[:], float64[:], int, int, float, float64[:, :], float64[:]")
def read_message(
    sensing: np.ndarray,
    noise: np.ndarray,
    row: int,
    zero: int,
    step: float,
    record: np.ndarray,
    message: np.ndarray,
) -> None:
    """The newest message that is delivered at *row*; none if there is none, or nothing within reach."""
    message[AT] = -inf
    # A millionth of a period decides nothing but ties.
    asked = floor((row * step - sensing[LATENCY]) * sensing[RATE] - sensing[SENSING_PHASE] + 1e-6)
    if asked < 0:
        return
    then = min(row, round((asked + sensing[SENSING_PHASE]) / (sensing[RATE] * step)))
    at = (then - zero) * step
    link = record[LINK, then]
    distance = sensing[WALL_SPEED] * at - link
    distance += sensing[SCALE_ERROR] * distance + sensing[BIAS] + noise[asked % noise.shape[0]]
    if not distance <= sensing[REACH]:
        return
    message[AT], message[LINK_THEN], message[DISTANCE] = at, link, distance
    message[SPEED_THEN] = record[LINK_SPEED, then]


@inlined
def predicted_contact(kind: int, now: float, link: float, message: np.ndarray) -> float:
    """Where the contact will be, as a message is read in one of the four ways, m."""
    if kind == TIME_STAMPED:
        return message[LINK_THEN] + message[DISTANCE]
    contact = link + message[DISTANCE]
    if kind == FEED_FORWARD:
        contact -= message[SPEED_THEN] * (now - message[AT])
    return contact


@entry("int, float, float, float, float64[:], float64[:], float64[:] -> float")
def choose_target(
    kind: int,
    now: float,
    link: float,
    drum: float,
    message: np.ndarray,
    holding: np.ndarray,
    memory: np.ndarray,
) -> float:
    """Where the drum shall go, m: retracted, or to the contact; while it is touched, where it was to be."""
    gap = drum - link
    if kind != NAIVE:
        limit = holding[RELEASE_GAP] if memory[IS_HELD] > 0.0 else holding[TOUCH_GAP]
        was_held = memory[IS_HELD] > 0.0
        memory[IS_HELD] = 1.0 if gap < limit else 0.0
        if was_held and memory[IS_HELD] > 0.0:
            return memory[TARGET]
    target = holding[RETRACTED]
    if message[AT] > -inf:
        target = min(target, predicted_contact(kind, now, link, message))
    memory[TARGET] = target
    return target


@entry(
    "int, float64[:], float64[:], float64[:], float64[:], float64[:], float64[:], float64[:], "
    "float64[:], int, int, float64[:, :]",
    makes_arrays=True,
)
def run_loop(
    kind: int,
    body: np.ndarray,
    press: np.ndarray,
    drum: np.ndarray,
    servo: np.ndarray,
    drive: np.ndarray,
    sensing: np.ndarray,
    noise: np.ndarray,
    holding: np.ndarray,
    steps: int,
    zero: int,
    record: np.ndarray,
) -> None:
    """A whole press with one of the four policies; *steps* of the plant to a sample of the servo."""
    command, message, memory = (
        np.zeros(drums.COMMAND_SIZE),
        np.zeros(MESSAGE_SIZE),
        np.zeros(MEMORY_SIZE),
    )
    command[drums.MODE] = drums.POSITION
    command[drums.SPEED_CAP] = command[drums.FORCE_CAP] = inf
    step = servo[drums.PERIOD] / steps
    start_record(press, zero, step, record)
    back = 0.0
    for first in range(0, record.shape[1], steps):
        now = (first - zero) * step
        read_message(sensing, noise, first, zero, step, record, message)
        link = record[LINK, first]
        command[drums.TARGET] = choose_target(kind, now, link, drive[drums.WHERE], message, holding, memory)
        serve(drum, servo, drive, command, back)
        last = min(first + steps, record.shape[1])
        back = advance_plant(body, press, drum, drive, first, last, zero, step, record)


@entry("float64[:], float64[:], float, int, float, float64[:, :]", makes_arrays=True)
def run_stop(
    body: np.ndarray, press: np.ndarray, where: float, zero: int, step: float, record: np.ndarray
) -> None:
    """A whole press on a drum that stands *where* it should, whatever pushes it."""
    drum, drive = np.zeros(drums.DRUM_SIZE), np.zeros(drums.DRIVE_SIZE)
    drum[drums.MASS] = drum[drums.SPEED_LIMIT] = inf
    drive[drums.WHERE] = where
    start_record(press, zero, step, record)
    advance_plant(body, press, drum, drive, 0, record.shape[1], zero, step, record)
