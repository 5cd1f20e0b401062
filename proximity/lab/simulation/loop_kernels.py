"""Kernels that step hand, finger, link and drum in closed loop, with four drum target policies.

A link moves with the finger, free until it meets the drum. A distance is measured at some instants, to a wall
that may move, and delivered later. The contact location is a position in the same coordinate as the link's:
the wall's. Steps are semi-implicit; row *zero* of the record is the instant 0, at which the hand's intent
reaches the position 0.
"""

from math import exp, floor, inf, pi

import numpy as np

from proximity.decaff.drum import drum_kernels as drums
from proximity.decaff.drum.drum_kernels import push_drum, rounded, serve
from proximity.lab.simulation.press_kernels import (
    BODY_CABLE_DAMPING,
    BODY_CABLE_STIFFNESS,
    BODY_CAPSTAN,
    BODY_CONTACT_DAMPING,
    BODY_CONTACT_STIFFNESS,
    BODY_DRAG,
    BODY_LINK_DAMPING,
    BODY_LINK_MASS,
    BODY_PAD_DAMPING,
    BODY_PAD_STIFFNESS,
    BODY_PLAY,
    RECORD_CONTACT,
    RECORD_DRUM,
    RECORD_FINGER,
    RECORD_FINGER_SPEED,
    RECORD_FORCE,
    RECORD_LINK,
    RECORD_LINK_SPEED,
    RECORD_THIMBLE,
    intent,
    step_finger,
)
from proximity.native import entry, inlined

# --- how a target is made; policies.Target names them ---
POLICY_NAIVE = 0  # where the link is now, and the old distance
POLICY_LATCHED = 1  # the same, held from touch to release
POLICY_FEED_FORWARD = 2  # the old distance, less what the link has gone since at its old speed; held
POLICY_TIME_STAMPED = 3  # where the link was when the distance was measured; held

# --- sensing ---
SENSING_RATE = 0  # Hz, of distances
SENSING_LATENCY = 1  # s, from measurement to delivery
SENSING_REACH = 2  # m, farther distances are not reported
SENSING_BIAS = 3  # m, added to each distance
SENSING_SCALE_ERROR = 4  # share, by which each distance is too large
SENSING_WALL_SPEED = 5  # m/s, of the wall
SENSING_PHASE = 6  # of a period, from the first row to the first measurement
SENSING_RESOLUTION = 7  # m, of the potentiometer, by the link; 0: none
SENSING_SIZE = 8

# --- holding ---
HOLDING_RETRACTED = 0  # m, where the drum waits
HOLDING_TOUCH_GAP = 1  # m, of link and drum: nearer is touching
HOLDING_RELEASE_GAP = 2  # m, farther is released
HOLDING_COMPLIANCE = 3  # m/N, of the cable, whose stretch the target is brought nearer by; 0: it is not
HOLDING_SMOOTHING = 4  # Hz, of the force that stretches it
HOLDING_HAS_SENSOR = 5  # whether that force is measured, or taken from the motor's
HOLDING_SIZE = 6

# --- what a policy remembers ---
MEMORY_IS_HELD = 0
MEMORY_TARGET = 1  # m
MEMORY_NOW = 2  # s, of the last sample
MEMORY_FORCE = 3  # N, smoothed twice, that stretches the cable
MEMORY_FIRST = 4  # N, smoothed once
MEMORY_SIZE = 5

# --- a message ---
MESSAGE_AT = 0  # s, of the measurement; -inf: there is none
MESSAGE_LINK = 1  # m
MESSAGE_SPEED = 2  # m/s
MESSAGE_DISTANCE = 3  # m
MESSAGE_SIZE = 4


@inlined
def contact_force(body: np.ndarray, link: float, link_speed: float, drum: float, drum_speed: float) -> float:
    """Force of the drum on the link, N; never pulls."""
    if not link > drum:
        return 0.0
    force = body[BODY_CONTACT_STIFFNESS] * (link - drum) + body[BODY_CONTACT_DAMPING] * (
        link_speed - drum_speed
    )
    return max(0.0, force)


@inlined
def cable_forces(
    body: np.ndarray, finger: float, speed: float, thimble: float, link: float, link_speed: float
) -> tuple[float, float, float]:
    """Force of the pad and tension of the cable, N at the fingertip, and speed of the thimble between them.

    The thimble has no mass: it goes as fast as pad, cable and the friction in the sheath, which is where the
    cable leaves the hand, let it. Without a cable it is the link.
    """
    stiffness, damping = body[BODY_PAD_STIFFNESS], body[BODY_PAD_DAMPING]
    if not body[BODY_CABLE_STIFFNESS] > 0.0:
        force = stiffness * (finger - thimble) + damping * (speed - link_speed)
        return force, force, link_speed
    slack, own = thimble - link, body[BODY_CABLE_DAMPING]
    if slack < 0.0 and body[BODY_PLAY] > 0.0:  # the finger goes back: first through the backlash
        slack = min(0.0, slack + body[BODY_PLAY])
        own = own if slack < 0.0 or not damping > 0.0 else 0.0
    stretch = body[BODY_CABLE_STIFFNESS] * slack
    free = stiffness * (finger - thimble) + damping * speed - stretch + own * link_speed
    # Capstan: e^(mu angle) - 1 where the tension grows, 1 - e^(-mu angle) where it falls.
    share = body[BODY_CAPSTAN] / (1.0 if free * stretch > 0.0 else 1.0 + body[BODY_CAPSTAN])
    rubbing = max(body[BODY_DRAG], share * abs(stretch))
    left = free - rubbing if free > rubbing else (free + rubbing if free < -rubbing else 0.0)
    thimble_speed = left / (damping + own)
    force = stiffness * (finger - thimble) + damping * (speed - thimble_speed)
    return force, stretch + own * (thimble_speed - link_speed), thimble_speed


@entry("float64[:], int, float, float64[:, :]")
def start_record(press: np.ndarray, zero: int, step: float, record: np.ndarray) -> None:
    """The first row: hand, finger and link move together, at the hand's speed."""
    where, speed = intent(press, -zero * step)
    record[RECORD_FINGER, 0] = record[RECORD_LINK, 0] = record[RECORD_THIMBLE, 0] = where
    record[RECORD_FINGER_SPEED, 0] = record[RECORD_LINK_SPEED, 0] = speed


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
    finger, speed = record[RECORD_FINGER, first], record[RECORD_FINGER_SPEED, first]
    link, link_speed = record[RECORD_LINK, first], record[RECORD_LINK_SPEED, first]
    thimble, back = record[RECORD_THIMBLE, first], 0.0
    for i in range(first, last):
        force, tension, thimble_speed = cable_forces(body, finger, speed, thimble, link, link_speed)
        where = drive[drums.DRIVE_POSITION]
        back = contact_force(body, link, link_speed, where, drive[drums.DRIVE_SPEED])
        record[RECORD_FORCE, i], record[RECORD_CONTACT, i] = force, back
        record[RECORD_FINGER, i], record[RECORD_FINGER_SPEED, i] = finger, speed
        record[RECORD_LINK, i], record[RECORD_LINK_SPEED, i] = link, link_speed
        record[RECORD_DRUM, i], record[RECORD_THIMBLE, i] = where, thimble
        link_speed += (tension - back - body[BODY_LINK_DAMPING] * link_speed) / body[BODY_LINK_MASS] * step
        push_drum(drum, drive, back, step)
        link += link_speed * step
        thimble = thimble + thimble_speed * step if body[BODY_CABLE_STIFFNESS] > 0.0 else link
        finger, speed = step_finger(body, press, (i - zero) * step, force, finger, speed, step)
    if last < record.shape[1]:
        record[RECORD_FINGER, last], record[RECORD_FINGER_SPEED, last] = finger, speed
        record[RECORD_LINK, last], record[RECORD_LINK_SPEED, last] = link, link_speed
        record[RECORD_THIMBLE, last] = thimble
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
    message[MESSAGE_AT] = -inf
    # A millionth of a period decides nothing but ties.
    asked = floor(
        (row * step - sensing[SENSING_LATENCY]) * sensing[SENSING_RATE] - sensing[SENSING_PHASE] + 1e-6
    )
    if asked < 0:
        return
    then = min(row, round((asked + sensing[SENSING_PHASE]) / (sensing[SENSING_RATE] * step)))
    at = (then - zero) * step
    link = rounded(record[RECORD_LINK, then], sensing[SENSING_RESOLUTION])
    distance = sensing[SENSING_WALL_SPEED] * at - link
    distance += (
        sensing[SENSING_SCALE_ERROR] * distance + sensing[SENSING_BIAS] + noise[asked % noise.shape[0]]
    )
    if not distance <= sensing[SENSING_REACH]:
        return
    message[MESSAGE_AT], message[MESSAGE_LINK], message[MESSAGE_DISTANCE] = at, link, distance
    message[MESSAGE_SPEED] = record[RECORD_LINK_SPEED, then]


@inlined
def predicted_contact(kind: int, now: float, link: float, message: np.ndarray) -> float:
    """Predicted position of the contact by one of the four policies, m."""
    if kind == POLICY_TIME_STAMPED:
        return message[MESSAGE_LINK] + message[MESSAGE_DISTANCE]
    contact = link + message[MESSAGE_DISTANCE]
    if kind == POLICY_FEED_FORWARD:
        contact -= message[MESSAGE_SPEED] * (now - message[MESSAGE_AT])
    return contact


@inlined
def stretched(now: float, pressing: float, holding: np.ndarray, memory: np.ndarray) -> float:
    """Stretch of the cable, m, by the force that presses on the drum, smoothed; 0 if none is made up for."""
    elapsed, memory[MEMORY_NOW] = now - memory[MEMORY_NOW], now
    share = 1.0 - exp(-2.0 * pi * holding[HOLDING_SMOOTHING] * max(elapsed, 0.0))
    memory[MEMORY_FIRST] += share * (pressing - memory[MEMORY_FIRST])
    memory[MEMORY_FORCE] += share * (memory[MEMORY_FIRST] - memory[MEMORY_FORCE])
    return holding[HOLDING_COMPLIANCE] * max(memory[MEMORY_FORCE], 0.0)


@entry("int, float, float, float, float, float64[:], float64[:], float64[:] -> float")
def choose_target(
    kind: int,
    now: float,
    link: float,
    drum: float,
    pressing: float,
    message: np.ndarray,
    holding: np.ndarray,
    memory: np.ndarray,
) -> float:
    """Target of the drum, m: retracted, or the contact; while it is touched, the target before."""
    gap = drum - link
    if kind != POLICY_NAIVE:
        limit = holding[HOLDING_RELEASE_GAP] if memory[MEMORY_IS_HELD] > 0.0 else holding[HOLDING_TOUCH_GAP]
        was_held = memory[MEMORY_IS_HELD] > 0.0
        memory[MEMORY_IS_HELD] = 1.0 if gap < limit else 0.0
        if was_held and memory[MEMORY_IS_HELD] > 0.0:
            return memory[MEMORY_TARGET] - stretched(now, pressing, holding, memory)
        memory[MEMORY_NOW], memory[MEMORY_FORCE], memory[MEMORY_FIRST] = now, 0.0, 0.0
    target = holding[HOLDING_RETRACTED]
    if message[MESSAGE_AT] > -inf:
        target = min(target, predicted_contact(kind, now, link, message))
    memory[MEMORY_TARGET] = target
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
    command[drums.COMMAND_MODE] = drums.MODE_POSITION
    command[drums.COMMAND_SPEED_CAP] = command[drums.COMMAND_FORCE_CAP] = inf
    step = servo[drums.SERVO_PERIOD] / steps
    start_record(press, zero, step, record)
    back = 0.0
    for first in range(0, record.shape[1], steps):
        now = (first - zero) * step
        read_message(sensing, noise, first, zero, step, record, message)
        link = rounded(record[RECORD_LINK, first], sensing[SENSING_RESOLUTION])
        pressing = back if holding[HOLDING_HAS_SENSOR] > 0.0 else -drive[drums.DRIVE_APPLIED]
        command[drums.COMMAND_TARGET] = choose_target(
            kind, now, link, drive[drums.DRIVE_POSITION], pressing, message, holding, memory
        )
        serve(drum, servo, drive, command, back)
        last = min(first + steps, record.shape[1])
        back = advance_plant(body, press, drum, drive, first, last, zero, step, record)


@entry("float64[:], float64[:], float, int, float, float64[:, :]", makes_arrays=True)
def run_stop(
    body: np.ndarray, press: np.ndarray, where: float, zero: int, step: float, record: np.ndarray
) -> None:
    """A whole press on a drum that stands *where* it should, whatever pushes it."""
    drum, drive = np.zeros(drums.DRUM_SIZE), np.zeros(drums.DRIVE_SIZE)
    drum[drums.DRUM_MASS] = drum[drums.DRUM_SPEED_LIMIT] = inf
    drive[drums.DRIVE_POSITION] = where
    start_record(press, zero, step, record)
    advance_plant(body, press, drum, drive, 0, record.shape[1], zero, step, record)
