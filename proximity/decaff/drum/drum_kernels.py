"""Kernels that step a motor-driven drum, as a moving mass, and its servo.

All is given at the fingertip: masses in kg, positions in m. A positive position is away from the finger, and
a positive motor force pushes there; to press on the finger the motor pulls. The servo acts one sample late:
what it computes from a measurement is applied from the next sample on. A drum with a latency applies it later
still: behind the memory of a drive lie the forces that are under way, one a step of the plant.
"""

from math import exp, floor, inf, pi, sqrt

import numpy as np

from proximity.native import entry, inlined, record

# --- a drum ---
DRUM_MASS = 0  # kg, with the rotor behind its gear
DRUM_FRICTION = 1  # N, Coulomb
DRUM_FORCE_LIMIT = 2  # N
DRUM_SPEED_LIMIT = 3  # m/s, beyond which the motor has no force left
DRUM_RESOLUTION = 4  # m, of the encoder
DRUM_FORCE_STEP = 5  # N, of the pulse width; 0: none
DRUM_OFFSET = 6  # m, at which an encoder count lies
DRUM_STALL_FORCE = 7  # N, of a motor that stands, at its full voltage
DRUM_ELECTRICAL_TIME = 8  # s, inductance over resistance; 0: the current is what is asked for, at once
DRUM_CURRENT_RATE = 9  # 1/s, of the current's loop
DRUM_LOSS = 10  # share of the force on the link by which the gear rubs
DRUM_SIZE = 11

# --- a servo ---
SERVO_PERIOD = 0  # s
SERVO_STIFFNESS = 1  # N/m
SERVO_DAMPING = 2  # N s/m
SERVO_INTEGRAL = 3  # N/(m s)
SERVO_ACCELERATION = 4  # m/s², of the reference
SERVO_SPEED = 5  # m/s, of the reference
SERVO_FORCE_GAIN = 6  # 1/s, of the force integrator
SERVO_FORCE_DAMPING = 7  # N s/m, while the force is served
SERVO_FORCE_SLEW = 8  # N/s, of the force reference
SERVO_SMOOTHING = 9  # Hz, of what is remembered of the motor's force
SERVO_DEADBAND = 10  # m, so near a reference that stands is at it
SERVO_SIZE = 11

# --- a command ---
COMMAND_MODE = 0
COMMAND_TARGET = 1  # m, or N to press on the finger with
COMMAND_SPEED_CAP = 2  # m/s, of the reference
COMMAND_FORCE_CAP = 3  # N
COMMAND_START_FORCE = 4  # N, from where the force reference starts; nan: from nothing, all memory lost
COMMAND_SLEW = 5  # N/s, of the force reference; 0: the servo's own
COMMAND_SIZE = 6

STANDING = 1e-6  # m/s, of a reference that has arrived, but for rounding

MODE_OFF = 0
MODE_POSITION = 1
MODE_FORCE = 2

# --- what a drive remembers ---
DRIVE_POSITION = 0  # m, where the drum is
DRIVE_SPEED = 1  # m/s
DRIVE_APPLIED = 2  # N, by the motor during this sample
DRIVE_DEMANDED = 3  # N, for the next
DRIVE_REFERENCE = 4  # m
DRIVE_REFERENCE_SPEED = 5  # m/s
DRIVE_INTEGRATED = 6  # N
DRIVE_LAST_POSITION = 7  # m, position given a sample ago
DRIVE_FORCE_REFERENCE = 8  # N
DRIVE_LAST_MODE = 9
DRIVE_SMOOTHED = 10  # N, what the motor did of late
DRIVE_FORCE = 11  # N, of the motor: what its current makes of the applied one
DRIVE_NEXT = 12  # which of the forces under way is due
DRIVE_SIZE = 13


@inlined
def slid(speed: float, force: float, friction: float, mass: float, step: float) -> float:
    """The speed after a step under a force and Coulomb friction, which stops and holds, but never turns."""
    free = speed + force / mass * step
    held = friction / mass * step
    return free - held if free > held else (free + held if free < -held else 0.0)


@inlined
def current_force(drum: np.ndarray, applied: float, force: float, speed: float, step: float) -> float:
    """Force of the motor after a step, N: its current follows, no faster than its voltage can make it.

    The loop of the current knows resistance and speed; the motor's speed takes its share of the voltage.
    """
    slow = drum[DRUM_ELECTRICAL_TIME]
    if not slow > 0.0:
        return applied
    stall, lost = drum[DRUM_STALL_FORCE], drum[DRUM_STALL_FORCE] * speed / drum[DRUM_SPEED_LIMIT]
    wanted = drum[DRUM_CURRENT_RATE] * (applied - force)
    return force + step * max((-stall - lost - force) / slow, min((stall - lost - force) / slow, wanted))


@inlined
def pushed(
    drum: np.ndarray, applied: float, contact: float, where: float, speed: float, step: float
) -> tuple[float, float]:
    """Place and speed of the drum after a step under its motor and the link's *contact* force.

    At its speed limit the motor has no force left that would make the drum faster. A gear rubs by a share of
    what it carries, either way: it helps to hold, and does not help to press.
    """
    is_too_fast = abs(speed) >= drum[DRUM_SPEED_LIMIT] and applied * speed > 0.0
    force = contact if is_too_fast else applied + contact
    friction = drum[DRUM_FRICTION] + drum[DRUM_LOSS] * abs(contact)
    speed = slid(speed, force, friction, drum[DRUM_MASS], step)
    return where + speed * step, speed


@inlined
def arrived(drive: np.ndarray) -> float:
    """Force of the servo that takes effect in this step, N; the one that it applies now gets under way."""
    count = drive.shape[0] - DRIVE_SIZE
    if count == 0:
        return drive[DRIVE_APPLIED]
    due = DRIVE_SIZE + int(drive[DRIVE_NEXT])
    force, drive[due] = drive[due], drive[DRIVE_APPLIED]
    drive[DRIVE_NEXT] = 0.0 if due + 1 == drive.shape[0] else drive[DRIVE_NEXT] + 1.0
    return force


@inlined
def push_drum(drum: np.ndarray, drive: np.ndarray, contact: float, step: float) -> None:
    """Move the drum by a step under its motor and the link's *contact* force."""
    force = current_force(drum, arrived(drive), drive[DRIVE_FORCE], drive[DRIVE_SPEED], step)
    drive[DRIVE_FORCE] = force
    drive[DRIVE_POSITION], drive[DRIVE_SPEED] = pushed(
        drum, force, contact, drive[DRIVE_POSITION], drive[DRIVE_SPEED], step
    )


@inlined
def shape_reference(servo: np.ndarray, drive: np.ndarray, target: float, speed_cap: float) -> None:
    """Move the reference towards *target*: as fast as it may and still stop there, in whole samples.

    It may pass the target, by no more than acceleration times period squared over eight.
    """
    period, acceleration = servo[SERVO_PERIOD], servo[SERVO_ACCELERATION]
    away = target - drive[DRIVE_REFERENCE]
    half = 0.5 * acceleration * period
    wanted = min(sqrt(half * half + 2.0 * acceleration * abs(away)) - half, servo[SERVO_SPEED], speed_cap)
    wanted = min(wanted, abs(away) / period)
    change = (wanted if away > 0.0 else -wanted) - drive[DRIVE_REFERENCE_SPEED]
    most = acceleration * period
    drive[DRIVE_REFERENCE_SPEED] += max(-most, min(most, change))
    drive[DRIVE_REFERENCE] += drive[DRIVE_REFERENCE_SPEED] * period


@inlined
def enter_mode(drive: np.ndarray, command: np.ndarray, reported: float) -> None:
    """Start a mode where the last one left off.

    A position starts where the drum is, with no integral: with one, a drum whose finger has gone would go
    after it. A force starts so that the motor does what it did of late. Taking its force at the very
    sample was tried: where that one saw an encoder count, the damping adds 4 N, and the finger is thrown off
    (2026-11-21, a drum of 0.24 kg).
    """
    if command[COMMAND_MODE] == MODE_POSITION:
        drive[DRIVE_REFERENCE], drive[DRIVE_REFERENCE_SPEED], drive[DRIVE_INTEGRATED] = reported, 0.0, 0.0
    elif command[COMMAND_MODE] == MODE_FORCE:
        start = command[COMMAND_START_FORCE]
        drive[DRIVE_FORCE_REFERENCE] = start if start == start else 0.0
        drive[DRIVE_INTEGRATED] = -drive[DRIVE_SMOOTHED] - start if start == start else 0.0
    drive[DRIVE_LAST_MODE] = command[COMMAND_MODE]


@inlined
def demand_position(
    servo: np.ndarray, drive: np.ndarray, reported: float, speed: float, limit: float
) -> float:
    """Stiffness, damping and integral against the shaped reference.

    The integral waits while the force is at its limit. And the reference waits for a drum that is kept away
    by more than the limit: once that is gone, the drum comes from where it is, no faster than it may.
    Near a reference that stands there is no error: else a drum whose reference lies between two encoder
    counts goes to and fro between them, and the finger feels it.
    """
    lead = limit / servo[SERVO_STIFFNESS]
    drive[DRIVE_REFERENCE] = max(reported - lead, min(reported + lead, drive[DRIVE_REFERENCE]))
    error = drive[DRIVE_REFERENCE] - reported
    if abs(error) <= servo[SERVO_DEADBAND] and abs(drive[DRIVE_REFERENCE_SPEED]) <= STANDING:
        error = 0.0
    demand = (
        servo[SERVO_STIFFNESS] * error
        + servo[SERVO_DAMPING] * (drive[DRIVE_REFERENCE_SPEED] - speed)
        + drive[DRIVE_INTEGRATED]
    )
    if abs(demand) <= limit:
        drive[DRIVE_INTEGRATED] += servo[SERVO_INTEGRAL] * error * servo[SERVO_PERIOD]
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
    """The force reference, slewed to *target*, with an integral of what is missing, and damping.

    Of a force that is not measured nothing is known to be missing.
    """
    most = slew * servo[SERVO_PERIOD]
    drive[DRIVE_FORCE_REFERENCE] += max(-most, min(most, target - drive[DRIVE_FORCE_REFERENCE]))
    demand = -drive[DRIVE_FORCE_REFERENCE] - drive[DRIVE_INTEGRATED] - servo[SERVO_FORCE_DAMPING] * speed
    if abs(demand) <= limit and measured == measured:
        drive[DRIVE_INTEGRATED] += (
            servo[SERVO_FORCE_GAIN] * (drive[DRIVE_FORCE_REFERENCE] - measured) * servo[SERVO_PERIOD]
        )
    return demand


@entry("float64[:], float64[:], float64[:], float64[:], float")
def serve(
    drum: np.ndarray, servo: np.ndarray, drive: np.ndarray, command: np.ndarray, measured: float
) -> None:
    """One sample of the servo: apply what the last one computed, and compute the next.

    *measured* is the force between link and drum, N, or nan; only force mode looks at it.
    """
    reported = read_encoder(drum, drive[DRIVE_POSITION])
    speed = (reported - drive[DRIVE_LAST_POSITION]) / servo[SERVO_PERIOD]
    drive[DRIVE_LAST_POSITION] = reported
    if command[COMMAND_MODE] != drive[DRIVE_LAST_MODE]:
        enter_mode(drive, command, reported)
    limit = min(drum[DRUM_FORCE_LIMIT], command[COMMAND_FORCE_CAP])
    demand = 0.0
    if command[COMMAND_MODE] == MODE_POSITION:
        demand = demand_position(servo, drive, reported, speed, limit)
        shape_reference(servo, drive, command[COMMAND_TARGET], command[COMMAND_SPEED_CAP])
    elif command[COMMAND_MODE] == MODE_FORCE:
        slew = command[COMMAND_SLEW] if command[COMMAND_SLEW] > 0.0 else servo[SERVO_FORCE_SLEW]
        demand = demand_force(servo, drive, command[COMMAND_TARGET], slew, speed, measured, limit)
    drive[DRIVE_APPLIED] = rounded(drive[DRIVE_DEMANDED], drum[DRUM_FORCE_STEP])
    drive[DRIVE_SMOOTHED] += (1.0 - exp(-2.0 * pi * servo[SERVO_SMOOTHING] * servo[SERVO_PERIOD])) * (
        drive[DRIVE_APPLIED] - drive[DRIVE_SMOOTHED]
    )
    drive[DRIVE_DEMANDED] = max(-limit, min(limit, demand))


@entry("float64[:], float64[:], float")
def rest_drum(drum: np.ndarray, drive: np.ndarray, where: float) -> None:
    """A drum at rest *where* it should be, with nothing in its memory."""
    drive[:] = 0.0
    drive[DRIVE_POSITION] = drive[DRIVE_REFERENCE] = where
    drive[DRIVE_LAST_POSITION] = read_encoder(drum, where)
    drive[DRIVE_LAST_MODE] = MODE_POSITION


@entry("float64[:], float64[:], float64[:], float, int, float, float64[:]", makes_arrays=True)
def move_drum(
    drum: np.ndarray,
    servo: np.ndarray,
    drive: np.ndarray,
    target: float,
    steps: int,
    step: float,
    positions: np.ndarray,
) -> None:
    """A drum from rest at 0 to a target, with nothing in its path; *steps* of the plant to a sample."""
    command = np.zeros(COMMAND_SIZE)
    rest_drum(drum, drive, 0.0)
    command[COMMAND_MODE], command[COMMAND_TARGET], command[COMMAND_SPEED_CAP], command[COMMAND_FORCE_CAP] = (
        MODE_POSITION,
        target,
        inf,
        inf,
    )
    for i in range(positions.shape[0]):
        if i % steps == 0:
            serve(drum, servo, drive, command, 0.0)
        push_drum(drum, drive, 0.0, step)
        positions[i] = drive[DRIVE_POSITION]


@inlined
def rounded(position: float, resolution: float) -> float:
    """Reading of an encoder; *resolution* 0: the position itself."""
    return floor(position / resolution + 0.5) * resolution if resolution > 0.0 else position


@inlined
def read_encoder(drum: np.ndarray, where: float) -> float:
    """Position of the drum by its encoder, m: that of the nearest count."""
    return rounded(where - drum[DRUM_OFFSET], drum[DRUM_RESOLUTION]) + drum[DRUM_OFFSET]


@entry("float64[:], float64[:], float64[:], float64[:], float, float, int, int, float -> float")
def serve_against(
    drum: np.ndarray,
    servo: np.ndarray,
    drive: np.ndarray,
    command: np.ndarray,
    finger: float,
    stiffness: float,
    samples: int,
    steps: int,
    step: float,
) -> float:
    """Serve a command for so many samples of *steps* each, and return the force on the finger, N.

    The finger stays where it is; its pad gives way where the drum stands before it.
    """
    contact = max(0.0, stiffness * (finger - drive[DRIVE_POSITION]))
    for _ in range(samples):
        serve(drum, servo, drive, command, contact)
        for _ in range(steps):
            contact = max(0.0, stiffness * (finger - drive[DRIVE_POSITION]))
            push_drum(drum, drive, contact, step)
    return contact


# --- a drum that is swung by torques, in angles; positive is away from the finger ---
SWING = record(
    "DrumSwing",
    inertia="f8",  # kg m²
    friction="f8",  # N m, Coulomb
    viscous="f8",  # N m s
    stiffness="f8",  # N m/rad, of what the drum presses on below angle 0; 0: nothing there
    damping="f8",  # N m s, of the same
)


@entry("DrumSwing[:], float64[:], int, float, float64[:]")
def swing(plants: np.ndarray, torques: np.ndarray, steps: int, step: float, angles: np.ndarray) -> None:
    """Angles of a drum that starts at rest at 0; *torques* are means over each step, *steps* to an angle.

    Leapfrog: exact under a constant torque, and without damping of its own against a spring.
    """
    plant, angle, speed = plants[0], 0.0, 0.0
    for i in range(angles.shape[0]):
        angles[i] = angle
        for j in range(i * steps, (i + 1) * steps):
            angle += 0.5 * step * speed
            reaction = min(0.0, plant.stiffness * angle + plant.damping * speed)
            if plant.stiffness <= 0.0 or angle > 0.0:
                reaction = 0.0
            torque = torques[j] - plant.viscous * speed - reaction
            speed = slid(speed, torque, plant.friction, plant.inertia, step)
            angle += 0.5 * step * speed
