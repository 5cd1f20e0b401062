"""Kernels that make targets of a drum from distances, by four policies.

A distance to the wall, which may move, is measured at some instants and delivered later. The contact location
is a position in the same coordinate as the link's: the wall's.
"""

from math import exp, floor, inf, pi
from typing import NamedTuple

import numpy as np

from proximity.decaff.drum import drum_kernels as drums
from proximity.decaff.drum.drum_kernels import rounded, serve
from proximity.lab.simulation.press_kernels import PressArrays, advance_drum
from proximity.native import bundle, entry, inlined, record

SENSING = record(
    "PressSensing",
    rate="f8",  # Hz, of distances
    latency="f8",  # s, from measurement to delivery
    reach="f8",  # m, farther distances are not reported
    bias="f8",  # m, added to each distance
    scale_error="f8",  # share, by which each distance is too large
    wall_speed="f8",  # m/s, of the wall
    phase="f8",  # of a period, from the first row to the first measurement
    resolution="f8",  # m, of the potentiometer, by the link; 0: none
)
HOLDING = record(
    "PressHolding",
    retracted="f8",  # m, where the drum waits
    touch_gap="f8",  # m, of link and drum: nearer is touching
    release_gap="f8",  # m, farther is released
    compliance="f8",  # m/N, of the cable, whose stretch the target is brought nearer by; 0: it is not
    smoothing="f8",  # Hz, of the force that stretches it
    has_force_sensor="f8",  # whether that force is measured, or taken from the motor's
)
MEMORY = record(
    "PressMemory",  # what a policy remembers
    is_held="f8",
    target="f8",  # m
    now="f8",  # s, of the last sample
    force="f8",  # N, smoothed twice, that stretches the cable
    first="f8",  # N, smoothed once
)
MESSAGE = record(
    "PressMessage",
    at="f8",  # s, of the measurement; -inf: there is none
    link="f8",  # m
    speed="f8",  # m/s
    distance="f8",  # m
)


# --- how a target is made; `target_policies.Target` names them ---
POLICY_NAIVE = 0  # where the link is now, and the old distance
POLICY_LATCHED = 1  # the same, held from touch to release
POLICY_FEED_FORWARD = 2  # the old distance, less what the link has gone since at its old speed; held
POLICY_TIME_STAMPED = 3  # where the link was when the distance was measured; held


class TargetArrays(NamedTuple):
    """What makes targets of distances."""

    sensing: np.ndarray  # (1,) SENSING
    noise: np.ndarray  # (K,) float64, m, of each distance
    holding: np.ndarray  # (1,) HOLDING
    memory: np.ndarray  # (1,) MEMORY
    message: np.ndarray  # (1,) MESSAGE, the newest


bundle(
    TargetArrays, sensing="PressSensing[:]", noise="float64[:]", holding="PressHolding[:]",
    memory="PressMemory[:]", message="PressMessage[:]",
)  # fmt: skip


@entry(PressArrays, TargetArrays, "int")
def read_message(press: PressArrays, targets: TargetArrays, row: int) -> None:
    """The newest message that is delivered at *row*; none if there is none, or nothing within reach."""
    body, sensing, message = press.body[0], targets.sensing[0], targets.message[0]
    message.at = -inf
    # A millionth of a period decides nothing but ties.
    asked = floor((row * body.step - sensing.latency) * sensing.rate - sensing.phase + 1e-6)
    if asked < 0:
        return
    then = min(row, round((asked + sensing.phase) / (sensing.rate * body.step)))
    at = (then - body.zero) * body.step
    link = rounded(press.link[then], sensing.resolution)
    distance = sensing.wall_speed * at - link
    noise = targets.noise[asked % targets.noise.shape[0]]
    distance += sensing.scale_error * distance + sensing.bias + noise
    if not distance <= sensing.reach:
        return
    message.at, message.link, message.distance = at, link, distance
    message.speed = press.link_speed[then]


@inlined
def predicted_contact(kind: int, now: float, link: float, message: np.record) -> float:
    """Predicted position of the contact by one of the four policies, m."""
    if kind == POLICY_TIME_STAMPED:
        return message.link + message.distance
    contact = link + message.distance
    if kind == POLICY_FEED_FORWARD:
        contact -= message.speed * (now - message.at)
    return contact


@inlined
def stretched(now: float, pressing: float, holding: np.record, memory: np.record) -> float:
    """Stretch of the cable, m, by the force that presses on the drum, smoothed; 0 if none is made up for."""
    elapsed, memory.now = now - memory.now, now
    share = 1.0 - exp(-2.0 * pi * holding.smoothing * max(elapsed, 0.0))
    memory.first += share * (pressing - memory.first)
    force: float = memory.force + share * (memory.first - memory.force)
    memory.force = force
    return holding.compliance * max(force, 0.0)


@entry("int, float, float, float, float", TargetArrays, "-> float")
def choose_target(
    kind: int, now: float, link: float, drum: float, pressing: float, targets: TargetArrays
) -> float:
    """Target of the drum, m: retracted, or the contact; while it is touched, the target before."""
    holding, memory, message = targets.holding[0], targets.memory[0], targets.message[0]
    if kind != POLICY_NAIVE:
        was_held = memory.is_held > 0.0
        memory.is_held = (
            1.0 if drum - link < (holding.release_gap if was_held else holding.touch_gap) else 0.0
        )
        if was_held and memory.is_held > 0.0:
            return memory.target - stretched(now, pressing, holding, memory)
        memory.now, memory.force, memory.first = now, 0.0, 0.0
    target = holding.retracted
    if message.at > -inf:
        target = min(target, predicted_contact(kind, now, link, message))
    memory.target = target
    return target


@entry("int", PressArrays, TargetArrays, "int")
def press_informed_drum(kind: int, press: PressArrays, targets: TargetArrays, steps: int) -> None:
    """A whole press with one of the four policies; *steps* of the plant to a sample of the servo."""
    body, command, back = press.body[0], press.command, 0.0
    command[drums.COMMAND_MODE] = drums.MODE_POSITION
    command[drums.COMMAND_SPEED_CAP] = command[drums.COMMAND_FORCE_CAP] = inf
    count = press.force.shape[0] - 1
    for first in range(0, count, steps):
        read_message(press, targets, first)
        link = rounded(press.link[first], targets.sensing[0].resolution)
        measured = targets.holding[0].has_force_sensor > 0.0
        command[drums.COMMAND_TARGET] = choose_target(
            kind,
            (first - body.zero) * body.step,
            link,
            press.drive[drums.DRIVE_POSITION],
            back if measured else -press.drive[drums.DRIVE_APPLIED],
            targets,
        )
        serve(press.drum, press.servo, press.drive, command, back)
        last = min(first + steps, count)
        advance_drum(press, first, last)
        back = press.contact[last - 1]
