"""Kernels of a press of hand, finger and pad against a wall, a device or a drum.

The loop over the rows has a plug-in, a kernel that writes force and contact of a row and the positions in the
next row. There are three: a massless surface, rigid or soft; a device that is carried by the finger and
pushed back by delayed, sampled forces; and a link that is free until it meets a drum. Steps are
semi-implicit, in that speeds are computed first and positions with the new speeds. The contact is at row
*zero* of the curves, and row i is the instant (i - zero) step. Positions are positive into the wall, in one
coordinate for finger, link and drum.
"""

from collections.abc import Callable
from math import inf
from typing import NamedTuple

import numpy as np

from proximity.decaff.drum import drum_kernels as drums
from proximity.decaff.drum.drum_kernels import push_drum, rounded
from proximity.native import bundle, entry, inlined, record

MIN_DAMPING = 1.0  # N s/m, of a returning surface, whose spring alone would return it instantly
TOUCHING = 1e-9  # m; nearer is touching, as the positions of an approach add up with rounding

BODY = record(
    "PressBody",
    hand_stiffness="f8",  # N/m
    hand_damping="f8",  # N s/m
    finger_mass="f8",  # kg
    pad_stiffness="f8",  # N/m
    pad_damping="f8",  # N s/m
    link_mass="f8",  # kg, of the parts that move with the pad's far side
    link_damping="f8",  # N s/m
    contact_stiffness="f8",  # N/m, of link on drum
    contact_damping="f8",  # N s/m
    cable_stiffness="f8",  # N/m, at the fingertip; 0: the pad presses on the link itself
    cable_damping="f8",  # N s/m
    capstan="f8",  # share of the tension lost to friction in the sheath, as the tension grows
    drag="f8",  # N, minimum friction
    play="f8",  # m at the fingertip, backlash of the cable before the link follows a returning finger
    step="f8",  # s, of the loop
    zero="i8",  # row of the contact
)
WALL = record(
    "PressWall",
    stiffness="f8",  # N/m; inf: a rigid surface
    damping="f8",  # N s/m
    resolution="f8",  # m, of a device's encoder; 0: none
    every="i8",  # steps from one sample of a device to the next
    late="i8",  # steps of its delay
    first="i8",  # row of its first sample
    before="f8",  # m, the previous reading; written by the loop
)


class PressArrays(NamedTuple):
    """Input and output of a press. Curves have N rows, and one more for the result of the last step."""

    body: np.ndarray  # (1,) BODY
    intent: np.ndarray  # (3,) float64: speed, m/s, depth, m, and release, s
    wall: np.ndarray  # (1,) WALL
    held: np.ndarray  # (M,) float64, N: the force of each sample of a device
    drum: np.ndarray  # (1,) `drum_kernels.DRUM`
    drive: np.ndarray  # float64, see `drum_kernels`
    force: np.ndarray  # (N + 1,) float64, N, of the pad on the finger
    finger: np.ndarray  # m
    finger_speed: np.ndarray  # m/s
    link: np.ndarray  # m
    link_speed: np.ndarray  # m/s
    thimble: np.ndarray  # m, of the pad's far side, which is the cable's near end or the link
    where: np.ndarray  # m, of the drum or of a wall's surface
    contact: np.ndarray  # N, on the link


bundle(
    PressArrays, body="PressBody[:]", intent="float64[:]", wall="PressWall[:]", held="float64[:]",
    drum="ContactDrum[:]", **dict.fromkeys(PressArrays._fields[5:], "float64[:]"),
)  # fmt: skip


@inlined
def intent(press: np.ndarray, t: float) -> tuple[float, float]:
    """Return intended position and speed of the hand at *t*, as in a `Press` that touches at 0."""
    speed, depth, release = press[0], press[1], press[2]
    rise = 2.0 * depth / speed
    if t < 0.0:
        return speed * t, speed
    if t < rise:
        s = t / rise
        return depth * s * (2.0 - s * s * (2.0 - s)), speed * (1.0 - s) * (1.0 - s) * (1.0 + 2.0 * s)
    r = (t - release) / rise
    if r < 0.0:
        return depth, 0.0
    if r < 1.0:
        return depth * (1.0 - r * r * r * (2.0 - r)), -speed * r * r * (3.0 - 2.0 * r)
    return -speed * rise * (r - 1.0), -speed


@inlined
def contact_force(body: np.record, link: float, link_speed: float, drum: float, drum_speed: float) -> float:
    """Return the force of the drum on the link, N, which never pulls."""
    if not link > drum:
        return 0.0
    force = body.contact_stiffness * (link - drum) + body.contact_damping * (link_speed - drum_speed)
    return max(0.0, force)


@inlined
def cable_forces(
    body: np.record, finger: float, speed: float, thimble: float, link: float, link_speed: float
) -> tuple[float, float, float]:
    """Return the pad's force and the cable's tension, N at the fingertip, and the speed of the thimble.

    The thimble has no mass. Its speed is determined by the pad, the cable, and the friction in the sheath at
    the cable's exit from the hand. Without a cable the thimble is the link.
    """
    stiffness, damping = body.pad_stiffness, body.pad_damping
    if not body.cable_stiffness > 0.0:
        force = stiffness * (finger - thimble) + damping * (speed - link_speed)
        return force, force, link_speed
    slack, own = thimble - link, body.cable_damping
    if slack < 0.0 and body.play > 0.0:  # a returning finger first moves through the backlash
        slack = min(0.0, slack + body.play)
        own = own if slack < 0.0 or not damping > 0.0 else 0.0
    stretch = body.cable_stiffness * slack
    free = stiffness * (finger - thimble) + damping * speed - stretch + own * link_speed
    # Capstan: e^(mu angle) - 1 for growing tension, 1 - e^(-mu angle) for falling.
    share = body.capstan / (1.0 if free * stretch > 0.0 else 1.0 + body.capstan)
    rubbing = max(body.drag, share * abs(stretch))
    left = free - rubbing if free > rubbing else (free + rubbing if free < -rubbing else 0.0)
    thimble_speed = left / (damping + own)
    force = stiffness * (finger - thimble) + damping * (speed - thimble_speed)
    return force, stretch + own * (thimble_speed - link_speed), thimble_speed


@inlined
def step_finger(press: PressArrays, i: int) -> None:
    """Compute the finger's state in the next row, under the forces of the hand and the pad."""
    body, finger, speed = press.body[0], press.finger[i], press.finger_speed[i]
    wanted, wanted_speed = intent(press.intent, (i - body.zero) * body.step)
    push = body.hand_stiffness * (wanted - finger) + body.hand_damping * (wanted_speed - speed)
    speed += (push - press.force[i]) / body.finger_mass * body.step
    press.finger[i + 1], press.finger_speed[i + 1] = finger + speed * body.step, speed


def pressed_on(answer: Callable[[PressArrays, int], None]) -> Callable[[PressArrays, int, int], None]:
    """Return the kernel that computes a range of rows with a given kernel for the wall."""

    @inlined
    def advance(press: PressArrays, first: int, last: int) -> None:
        for i in range(first, last):
            answer(press, i)
            step_finger(press, i)

    return advance


@inlined
def begin(press: PressArrays) -> None:
    """Initialise the first row, where hand, finger and link move together at the hand's speed."""
    body = press.body[0]
    where, speed = intent(press.intent, -body.zero * body.step)
    press.finger[0] = press.link[0] = press.thimble[0] = where
    press.finger_speed[0] = press.link_speed[0] = speed


# --- walls ---


@inlined
def meet_surface(press: PressArrays, i: int) -> None:
    """Step a massless surface, which is rigid or has a spring and a damper, and never pulls.

    Pad and surface are in series. The same force acts on both, which determines the speed of the surface.
    """
    body, wall, surface = press.body[0], press.wall[0], press.where[i]
    finger, speed, is_soft = press.finger[i], press.finger_speed[i], wall.stiffness < inf
    force = sink = 0.0
    # The damper already pushes at the surface, so that the force begins with a step.
    if finger >= surface - TOUCHING:
        pad = body.pad_stiffness * (finger - surface) + body.pad_damping * speed
        if is_soft:
            sink = (pad - wall.stiffness * surface) / (body.pad_damping + wall.damping)
        force = pad - body.pad_damping * sink
    if not force > 0.0:  # it returns on its own
        force = 0.0
        sink = -wall.stiffness * surface / max(wall.damping, MIN_DAMPING) if is_soft else 0.0
    press.force[i] = press.contact[i] = force
    press.link[i] = press.thimble[i] = max(surface, min(finger, 0.0)) if is_soft else min(finger, 0.0)
    press.where[i + 1] = surface + sink * body.step


@inlined
def pull_link(press: PressArrays, i: int, back: float) -> None:
    """Step the link under the pull of pad and cable and against a force *back*, N."""
    body, link, link_speed, thimble = press.body[0], press.link[i], press.link_speed[i], press.thimble[i]
    force, tension, thimble_speed = cable_forces(
        body, press.finger[i], press.finger_speed[i], thimble, link, link_speed
    )
    press.force[i], press.contact[i] = force, back
    link_speed += (tension - back - body.link_damping * link_speed) / body.link_mass * body.step
    link += link_speed * body.step
    press.link[i + 1], press.link_speed[i + 1] = link, link_speed
    press.thimble[i + 1] = thimble + thimble_speed * body.step if body.cable_stiffness > 0.0 else link


@inlined
def meet_device(press: PressArrays, i: int) -> None:
    """Step a device that is pushed back by a sampled, delayed spring and damper.

    The force is held between two samples, and never pulls.
    """
    wall = press.wall[0]
    since = i - wall.first
    if since >= 0 and since % wall.every == 0:
        reported = rounded(press.link[i], wall.resolution)
        if reported > 0.0:
            damped = wall.damping * (reported - wall.before) / (wall.every * press.body[0].step)
            press.held[since // wall.every] = max(0.0, wall.stiffness * reported + damped)
        wall.before = reported
    pull_link(press, i, press.held[(since - wall.late) // wall.every] if since >= wall.late else 0.0)


@inlined
def meet_drum(press: PressArrays, i: int) -> None:
    """Step the link, which is free until it meets the drum, and the motor-driven drum."""
    where = press.where[i] = press.drive[drums.DRIVE_POSITION]
    link, link_speed = press.link[i], press.link_speed[i]
    back = contact_force(press.body[0], link, link_speed, where, press.drive[drums.DRIVE_SPEED])
    pull_link(press, i, back)
    push_drum(press.drum[0], press.drive, back, press.body[0].step)


advance_surface, advance_device, advance_drum = map(pressed_on, (meet_surface, meet_device, meet_drum))


@entry(PressArrays)
def press_surface(press: PressArrays) -> None:
    """Compute a whole press on a surface."""
    begin(press)
    advance_surface(press, 0, press.force.shape[0] - 1)


@entry(PressArrays)
def press_device(press: PressArrays) -> None:
    """Compute a whole press with a device carried by the finger."""
    begin(press)
    press.wall[0].before = rounded(press.link[0], press.wall[0].resolution)
    advance_device(press, 0, press.force.shape[0] - 1)


@entry(PressArrays)
def begin_press(press: PressArrays) -> None:
    """Initialise the first row of a press."""
    begin(press)


@entry(PressArrays, "int, int")
def press_drum(press: PressArrays, first: int, last: int) -> None:
    """Compute the rows from *first* to *last*, exclusive, of a press on a drum whose servo is idle."""
    advance_drum(press, first, last)
