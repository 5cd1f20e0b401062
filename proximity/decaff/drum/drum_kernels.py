"""A motor-driven drum as a moving mass, and the servo that runs it, sample by sample.

All is given at the drum's rim: masses in kg, positions in m. A positive position is away from the finger, and
a positive motor force pushes there; to press on the finger the motor pulls. The servo acts one sample late:
what it computes from a measurement is applied from the next sample on.
"""

from math import exp, floor, inf, pi, sqrt

import numpy as np

from proximity.native import entry, inlined

# --- a drum ---
MASS = 0  # kg, with the rotor behind its gear
FRICTION = 1  # N, Coulomb
FORCE_LIMIT = 2  # N
SPEED_LIMIT = 3  # m/s, beyond which the motor has no force left
RESOLUTION = 4  # m, of the encoder
FORCE_STEP = 5  # N, of the pulse width; 0: none
DRUM_SIZE = 6

# --- a servo ---
PERIOD = 0  # s
STIFFNESS = 1  # N/m
DAMPING = 2  # N s/m
INTEGRAL = 3  # N/(m s)
ACCELERATION = 4  # m/s², of the reference
SPEED = 5  # m/s, of the reference
FORCE_GAIN = 6  # 1/s, of the force integrator
FORCE_DAMPING = 7  # N s/m, while the force is served
FORCE_SLEW = 8  # N/s, of the force reference
SMOOTHING = 9  # Hz, of what is remembered of the motor's force
SERVO_SIZE = 10

# --- a command ---
MODE = 0
TARGET = 1  # m, or N to press on the finger with
SPEED_CAP = 2  # m/s, of the reference
FORCE_CAP = 3  # N
START_FORCE = 4  # N, from where the force reference starts; nan: from nothing, all memory lost
SLEW = 5  # N/s, of the force reference; 0: the servo's own
COMMAND_SIZE = 6

OFF = 0
POSITION = 1
FORCE = 2

# --- what a drive remembers ---
WHERE = 0  # m, where the drum is
SPEED_NOW = 1  # m/s
APPLIED = 2  # N, by the motor during this sample
DEMANDED = 3  # N, for the next
REFERENCE = 4  # m
REFERENCE_SPEED = 5  # m/s
INTEGRATED = 6  # N
LAST = 7  # m, position given a sample ago
FORCE_REFERENCE = 8  # N
LAST_MODE = 9
SMOOTHED = 10  # N, what the motor did of late
DRIVE_SIZE = 11


@inlined
def slid(speed: float, force: float, friction: float, mass: float, step: float) -> float:
    """The speed after a step under a force and Coulomb friction, which stops and holds, but never turns."""
    free = speed + force / mass * step
    held = friction / mass * step
    return free - held if free > held else (free + held if free < -held else 0.0)


@inlined
def pushed(
    drum: np.ndarray, applied: float, contact: float, where: float, speed: float, step: float
) -> tuple[float, float]:
    """Place and speed of the drum after a step under its motor and the link's *contact* force.

    At its speed limit the motor has no force left that would make the drum faster.
    """
    is_too_fast = abs(speed) >= drum[SPEED_LIMIT] and applied * speed > 0.0
    force = contact if is_too_fast else applied + contact
    speed = slid(speed, force, drum[FRICTION], drum[MASS], step)
    return where + speed * step, speed


@inlined
def shape_reference(servo: np.ndarray, drive: np.ndarray, target: float, speed_cap: float) -> None:
    """Move the reference towards *target*: as fast as it may and still stop there, in whole samples.

    It may pass the target, by no more than acceleration times period squared over eight.
    """
    period, acceleration = servo[PERIOD], servo[ACCELERATION]
    away = target - drive[REFERENCE]
    half = 0.5 * acceleration * period
    wanted = min(sqrt(half * half + 2.0 * acceleration * abs(away)) - half, servo[SPEED], speed_cap)
    wanted = min(wanted, abs(away) / period)
    change = (wanted if away > 0.0 else -wanted) - drive[REFERENCE_SPEED]
    most = acceleration * period
    drive[REFERENCE_SPEED] += max(-most, min(most, change))
    drive[REFERENCE] += drive[REFERENCE_SPEED] * period


@inlined
def enter_mode(drive: np.ndarray, command: np.ndarray, reported: float) -> None:
    """Start a mode where the last one left off.

    A position starts where the drum is, with no integral: with one, a drum whose finger has gone would go
    after it. A force starts so that the motor does what it did of late. Taking its force at the very
    sample was tried: where that one saw an encoder count, the damping adds 4 N, and the finger is thrown off
    (2026-11-21, gear4).
    """
    if command[MODE] == POSITION:
        drive[REFERENCE], drive[REFERENCE_SPEED], drive[INTEGRATED] = reported, 0.0, 0.0
    elif command[MODE] == FORCE:
        start = command[START_FORCE]
        drive[FORCE_REFERENCE] = start if start == start else 0.0
        drive[INTEGRATED] = -drive[SMOOTHED] - start if start == start else 0.0
    drive[LAST_MODE] = command[MODE]


@inlined
def demand_position(
    servo: np.ndarray, drive: np.ndarray, reported: float, speed: float, limit: float
) -> float:
    """Stiffness, damping and integral against the shaped reference.

    The integral waits while the force is at its limit. And the reference waits for a drum that is kept away
    by more than the limit: once that is gone, the drum comes from where it is, no faster than it may.
    """
    lead = limit / servo[STIFFNESS]
    drive[REFERENCE] = max(reported - lead, min(reported + lead, drive[REFERENCE]))
    error = drive[REFERENCE] - reported
    demand = servo[STIFFNESS] * error + servo[DAMPING] * (drive[REFERENCE_SPEED] - speed) + drive[INTEGRATED]
    if abs(demand) <= limit:
        drive[INTEGRATED] += servo[INTEGRAL] * error * servo[PERIOD]
    return demand


@inlined
def demand_force(
    servo: np.ndarray,
    drive: np.ndarray,
    target: float,
    slew: float,
    speed: float,
    measured: float,
    limit: float,
) -> float:
    """The force reference, slewed to *target*, with an integral of what is missing, and damping."""
    most = slew * servo[PERIOD]
    drive[FORCE_REFERENCE] += max(-most, min(most, target - drive[FORCE_REFERENCE]))
    demand = -drive[FORCE_REFERENCE] - drive[INTEGRATED] - servo[FORCE_DAMPING] * speed
    if abs(demand) <= limit:
        drive[INTEGRATED] += servo[FORCE_GAIN] * (drive[FORCE_REFERENCE] - measured) * servo[PERIOD]
    return demand


@entry("float64[:], float64[:], float64[:], float64[:], float")
def serve(
    drum: np.ndarray, servo: np.ndarray, drive: np.ndarray, command: np.ndarray, measured: float
) -> None:
    """One sample of the servo: apply what the last one computed, and compute the next.

    *measured* is the force between link and drum, N; only force mode looks at it.
    """
    reported = rounded(drive[WHERE], drum[RESOLUTION])
    speed = (reported - drive[LAST]) / servo[PERIOD]
    drive[LAST] = reported
    if command[MODE] != drive[LAST_MODE]:
        enter_mode(drive, command, reported)
    limit = min(drum[FORCE_LIMIT], command[FORCE_CAP])
    demand = 0.0
    if command[MODE] == POSITION:
        demand = demand_position(servo, drive, reported, speed, limit)
        shape_reference(servo, drive, command[TARGET], command[SPEED_CAP])
    elif command[MODE] == FORCE:
        slew = command[SLEW] if command[SLEW] > 0.0 else servo[FORCE_SLEW]
        demand = demand_force(servo, drive, command[TARGET], slew, speed, measured, limit)
    drive[APPLIED] = rounded(drive[DEMANDED], drum[FORCE_STEP])
    drive[SMOOTHED] += (1.0 - exp(-2.0 * pi * servo[SMOOTHING] * servo[PERIOD])) * (
        drive[APPLIED] - drive[SMOOTHED]
    )
    drive[DEMANDED] = max(-limit, min(limit, demand))


@entry("float64[:], float64[:], float")
def rest_drum(drum: np.ndarray, drive: np.ndarray, where: float) -> None:
    """A drum at rest *where* it should be, with nothing in its memory."""
    drive[:] = 0.0
    drive[WHERE] = drive[REFERENCE] = where
    drive[LAST] = rounded(where, drum[RESOLUTION])
    drive[LAST_MODE] = POSITION


@entry("float64[:], float64[:], float, int, float, float64[:]", makes_arrays=True)
def move_drum(
    drum: np.ndarray, servo: np.ndarray, target: float, steps: int, step: float, positions: np.ndarray
) -> None:
    """A drum from rest at 0 to a target, with nothing in its way; *steps* of the plant to a sample."""
    drive, command = np.zeros(DRIVE_SIZE), np.zeros(COMMAND_SIZE)
    rest_drum(drum, drive, 0.0)
    command[MODE], command[TARGET], command[SPEED_CAP], command[FORCE_CAP] = POSITION, target, inf, inf
    for i in range(positions.shape[0]):
        if i % steps == 0:
            serve(drum, servo, drive, command, 0.0)
        drive[WHERE], drive[SPEED_NOW] = pushed(
            drum, drive[APPLIED], 0.0, drive[WHERE], drive[SPEED_NOW], step
        )
        positions[i] = drive[WHERE]


@inlined
def rounded(position: float, resolution: float) -> float:
    """What an encoder tells; *resolution* 0: the position itself."""
    return floor(position / resolution + 0.5) * resolution if resolution > 0.0 else position
