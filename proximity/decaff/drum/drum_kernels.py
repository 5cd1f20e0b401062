"""Kernels that step a motor-driven drum.

The drum consists of a rotor behind a gear with play, and of an arm that meets the link. All quantities are at
the fingertip, masses in kg and positions in m. A positive position is away from the finger, and a positive
motor force pushes there; to press on the finger the motor pulls. Rotor and arm are at the same position when
the link has pushed the arm through the play. The servo's demand acts until the next sample. A drum with a
latency applies it later: the array of a drive ends with the pending forces, one per step.
"""

from math import floor

import numpy as np

from proximity.native import entry, inlined, record

DRUM = record(
    "ContactDrum",
    mass="f8",  # kg, of the rotor behind its gear
    friction="f8",  # N, Coulomb, of the rotor
    stiction="f8",  # of that friction, at rest
    stall_force="f8",  # N, of a motor at rest, at its full voltage
    speed_limit="f8",  # m/s, at which the voltage is exhausted
    electrical_time="f8",  # s, inductance over resistance; 0: the current follows the demand without delay
    current_rate="f8",  # 1/s, of the current's loop
    loss="f8",  # share of the force through the gear lost to friction
    play="f8",  # m, of the gear; 0: rotor and arm are one
    arm="f8",  # kg
    arm_friction="f8",  # N
    spring="f8",  # N, turns the arm away from the finger
    gear_stiffness="f8",  # N/m, at the ends of the play
    gear_damping="f8",  # N s/m
    stop="f8",  # m, of the mechanical stop; inf: none
    stop_stiffness="f8",  # N/m
    stop_damping="f8",  # N s/m
)

MODE_FREE = 0
MODE_POSITION = 1
MODE_FORCE = 2
MODE_BRAKED = 3

# --- state of a drive ---
DRIVE_POSITION = 0  # m, where the arm meets the link
DRIVE_SPEED = 1  # m/s
DRIVE_ROTOR = 2  # m
DRIVE_ROTOR_SPEED = 3  # m/s
DRIVE_MODE = 4  # of the motor's driver
DRIVE_APPLIED = 5  # N, demanded by the servo
DRIVE_FORCE = 6  # N, of the motor: from its current
DRIVE_NEXT = 7  # index of the pending force that is due
DRIVE_SIZE = 8

STUCK = 1e-5  # m/s, below which the rotor is at rest; assumed


@inlined
def slid(speed: float, force: float, friction: float, mass: float, step: float) -> float:
    """Return the speed after a step under a force and Coulomb friction.

    Friction stops a motion, but never reverses it.
    """
    free = speed + force / mass * step
    held = friction / mass * step
    return free - held if free > held else (free + held if free < -held else 0.0)


@inlined
def motor_force(
    drum: np.record, mode: float, applied: float, force: float, speed: float, step: float
) -> float:
    """Return the motor's force after a step, N.

    The current follows the demand within the limits of the voltage. The current loop compensates for the
    resistance and the back-EMF, which reduces the available voltage. A motor with shorted windings has only
    its back-EMF, and a free motor has no current.
    """
    if mode == MODE_FREE:
        return 0.0
    slow, lost = drum.electrical_time, drum.stall_force * speed / drum.speed_limit
    if mode == MODE_BRAKED:
        return force - step * (lost + force) / slow if slow > 0.0 else -lost
    if not slow > 0.0:
        is_too_fast = abs(speed) >= drum.speed_limit and applied * speed > 0.0
        return 0.0 if is_too_fast else applied
    stall, wanted = drum.stall_force, drum.current_rate * (applied - force)
    return force + step * max((-stall - lost - force) / slow, min((stall - lost - force) / slow, wanted))


@inlined
def arrived(drive: np.ndarray) -> float:
    """Return the servo's force that takes effect in this step, N. Its present demand becomes pending."""
    count = drive.shape[0] - DRIVE_SIZE
    if count == 0:
        return drive[DRIVE_APPLIED]
    due = DRIVE_SIZE + int(drive[DRIVE_NEXT])
    force, drive[due] = drive[due], drive[DRIVE_APPLIED]
    drive[DRIVE_NEXT] = 0.0 if due + 1 == drive.shape[0] else drive[DRIVE_NEXT] + 1.0
    return force


@inlined
def gear_force(drum: np.record, twist: float, turning: float) -> float:
    """Return the force of the rotor on the arm, N. It is 0 within the play.

    *twist*: distance of the arm from the rotor, m, positive away from the finger; *turning*: its rate, m/s.
    """
    if twist > 0.0:
        return min(0.0, -drum.gear_stiffness * twist - drum.gear_damping * turning)
    if twist < -drum.play:
        return max(0.0, -drum.gear_stiffness * (twist + drum.play) - drum.gear_damping * turning)
    return 0.0


@inlined
def turned_rotor(drum: np.record, speed: float, motor: float, load: float, step: float) -> float:
    """Return the speed of the rotor after a step under its motor and a *load*.

    The friction of the gear is a share of the load. It helps the motor to hold a force, but not to press.
    """
    friction = drum.friction * (drum.stiction if abs(speed) < STUCK else 1.0) + drum.loss * abs(load)
    return slid(speed, motor + load, friction, drum.mass, step)


@inlined
def push_drum(drum: np.record, drive: np.ndarray, contact: float, step: float) -> None:
    """Move the drum by a step under its motor and the link's *contact* force."""
    arm, arm_speed, rotor, speed = (
        drive[DRIVE_POSITION],
        drive[DRIVE_SPEED],
        drive[DRIVE_ROTOR],
        drive[DRIVE_ROTOR_SPEED],
    )
    motor = motor_force(drum, drive[DRIVE_MODE], arrived(drive), drive[DRIVE_FORCE], speed, step)
    drive[DRIVE_FORCE] = motor
    if arm > drum.stop:
        contact -= max(0.0, drum.stop_stiffness * (arm - drum.stop) + drum.stop_damping * arm_speed)
    if drum.play > 0.0:
        gear = gear_force(drum, arm - rotor, arm_speed - speed)
        speed = turned_rotor(drum, speed, motor, -gear, step)
        arm_speed = slid(arm_speed, gear + contact + drum.spring, drum.arm_friction, drum.arm, step)
    else:
        arm_speed = speed = turned_rotor(drum, speed, motor, contact, step)
    drive[DRIVE_POSITION], drive[DRIVE_SPEED] = arm + arm_speed * step, arm_speed
    drive[DRIVE_ROTOR], drive[DRIVE_ROTOR_SPEED] = rotor + speed * step, speed


@entry("ContactDrum[:], float64[:], float, float, float, float64[:] -> float")
def push_against(
    drums: np.ndarray,
    drive: np.ndarray,
    finger: float,
    stiffness: float,
    step: float,
    positions: np.ndarray,
) -> float:
    """Step a drum, write its position after each step, and return the final force on the finger, N.

    The finger stays in place, and its pad yields to the drum.
    """
    drum, contact = drums[0], 0.0
    for i in range(positions.shape[0]):
        contact = max(0.0, stiffness * (finger - drive[DRIVE_POSITION]))
        push_drum(drum, drive, contact, step)
        positions[i] = drive[DRIVE_POSITION]
    return contact


@inlined
def rounded(position: float, resolution: float) -> float:
    """Round a position to the resolution of an encoder. With *resolution* 0 it is unchanged."""
    return floor(position / resolution + 0.5) * resolution if resolution > 0.0 else position


# --- a drum swung by torques, in angles; positive is away from the finger ---
SWING = record(
    "DrumSwing",
    inertia="f8",  # kg m²
    friction="f8",  # N m, Coulomb
    viscous="f8",  # N m s
    stiffness="f8",  # N m/rad, of the contact below angle 0; 0: none
    damping="f8",  # N m s, of the same
)


@entry("DrumSwing[:], float64[:], int, float, float64[:]")
def swing(plants: np.ndarray, torques: np.ndarray, steps: int, step: float, angles: np.ndarray) -> None:
    """Compute the angles of a drum that is swung by torques from rest at angle 0.

    *torques*: the mean over each step; *steps*: number of steps per angle. The method is leapfrog, which is
    exact under a constant torque and has no numerical damping against a spring.
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
