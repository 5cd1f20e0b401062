"""Sweeps of presses that compare walls over speed, latency, rate and drum (docs/science/drum.md).

A coupled wall has the best stiffness and damping of a grid for its rate and latency. This is the most
favourable tuning, and it is the same for all speeds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from proximity.decaff.glove.glove import CONTACT_BEND, Glove
from proximity.errors import ArgumentError
from proximity.lab.simulation.closed_loop import Response, coupled_wall, decaff, real_wall
from proximity.lab.simulation.devices import (
    COUPLED_DEVICE,
    CoupledWall,
    Decaff,
    Hand,
    Holding,
    Link,
    TipCable,
)
from proximity.lab.simulation.metrics import Deviation, deviation, force_error
from proximity.lab.simulation.target_policies import Controller, Target

SPEEDS = (0.1, 0.25, 0.5, 1.0)  # m/s
# N/m: six to a decade, from softer than the hand to stiffer than any stable sampled wall.
STIFFNESSES = tuple(50.0 * 10.0 ** (k / 6.0) for k in range(16))
# Damping over stiffness, in units of latency plus period; assumed.
DAMPING_RATIOS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.5, 3.0)
TUNING_STEP = 2e-5  # s, of the simulation
HOPELESS = 3.0  # an error beyond which stiffer walls are not tried
SENSOR_SMOOTHING = 10.0  # Hz, of the measured force, not the one from the motor's torque
CABLE_STIFFNESSES = (100.0, 1e6)  # N/m at the fingertip, bounds of the search
HALVINGS = 14  # of the logarithm of that range, to reach a thousandth


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """Deviations of one wall at several speeds."""

    wall: CoupledWall | Decaff
    speeds: tuple[float, ...]  # m/s
    deviations: tuple[Deviation, ...]  # one a speed

    @property
    def errors(self) -> np.ndarray:
        """Force error at each speed."""
        return np.array([one.error for one in self.deviations])


def best_coupled_wall(
    hand: Hand,
    rate: float,
    latency: float,
    *,
    device: Link = COUPLED_DEVICE,
    speeds: Sequence[float] = SPEEDS,
) -> CoupledWall:
    """Return the wall of the grid with the smallest force error, averaged over the speeds."""
    presses = [hand.press(speed) for speed in speeds]
    references: list[Response] = []
    best, best_error = CoupledWall(0.0, 0.0, rate, latency), np.inf
    for ratio in DAMPING_RATIOS:
        for stiffness in STIFFNESSES:
            damping = ratio * stiffness * (latency + 1.0 / rate)
            wall = CoupledWall(stiffness, damping, rate, latency)
            responses = [
                coupled_wall(hand, press, wall, device=device, step=TUNING_STEP) for press in presses
            ]
            references = references or [real_wall(hand, one.press, like=one) for one in responses]
            errors = [force_error(one, real) for one, real in zip(responses, references, strict=True)]
            if np.mean(errors) < best_error:
                best, best_error = wall, float(np.mean(errors))
            if errors[0] > HOPELESS:
                break
    return best


def coupled_row(
    hand: Hand, wall: CoupledWall, *, device: Link = COUPLED_DEVICE, speeds: Sequence[float] = SPEEDS
) -> Row:
    """Simulate presses on a coupled wall at several speeds."""
    deviations = (deviation(coupled_wall(hand, hand.press(speed), wall, device=device)) for speed in speeds)
    return Row(wall, tuple(speeds), tuple(deviations))


def drum_row(
    hand: Hand,
    glove: Decaff,
    target: Target | Controller = Target.TIME_STAMPED,
    *,
    speeds: Sequence[float] = SPEEDS,
) -> Row:
    """Simulate presses on a drum at several speeds."""
    deviations = (deviation(decaff(hand, hand.press(speed), glove, target)) for speed in speeds)
    return Row(glove, tuple(speeds), tuple(deviations))


def with_latency(glove: Decaff, latency: float, rate: float | None = None) -> Decaff:
    """Return a copy of a glove with another latency, and optionally another rate."""
    sensing = replace(glove.sensing, latency=latency, rate=rate or glove.sensing.rate)
    return replace(glove, sensing=sensing)


class Stretch(StrEnum):
    """Compensations of the cable's stretch while the finger is on the drum."""

    LEFT = "left"
    """No compensation, so that the finger sinks in."""
    TORQUE = "torque"
    """Compensation by the motor's torque, slowly smoothed, since the torque also moves the drum."""
    SENSOR = "sensor"
    """Compensation by a force sensor between link and drum."""

    @property
    def words(self) -> str:
        """Text that describes the compensation."""
        return {
            "left": "its stretch left",
            "torque": "its stretch made up for by the motor's torque",
            "sensor": "its stretch made up for by a force sensor",
        }[self]


def with_transmission(glove: Decaff, cable: TipCable, stretch: Stretch = Stretch.LEFT) -> Decaff:
    """Return a copy of a glove with a cable and the resolution of its potentiometer."""
    resolution = float(Glove().resolution(CONTACT_BEND))
    has_sensor = stretch == Stretch.SENSOR
    return replace(
        glove,
        sensing=replace(glove.sensing, resolution=resolution),
        holding=replace(
            glove.holding,
            compliance=0.0 if stretch == Stretch.LEFT else 1.0 / cable.stiffness,
            smoothing=SENSOR_SMOOTHING if has_sensor else Holding().smoothing,
            has_force_sensor=has_sensor,
        ),
        cable=cable,
    )


def needed_cable(hand: Hand, glove: Decaff, speed: float, error: float, stretch: Stretch) -> float:
    """Return the cable stiffness at the fingertip that is needed for a force error, N/m."""
    usual, press = TipCable.of(Glove()), hand.press(speed)

    def is_enough(stiffness: float) -> bool:
        cable = replace(usual, stiffness=stiffness)
        return deviation(decaff(hand, press, with_transmission(glove, cable, stretch))).error <= error

    soft, stiff = CABLE_STIFFNESSES
    if not is_enough(stiff):
        raise ArgumentError(
            f"no cable up to {stiff:g} N/m keeps the force error at {speed:g} m/s to {error:.3g}"
        )
    for _ in range(HALVINGS):
        middle = math.sqrt(soft * stiff)
        soft, stiff = (soft, middle) if is_enough(middle) else (middle, stiff)
    return stiff
