"""Model of the glove: finger, linkage, cable, potentiometer, drum, gear and motor, and derived quantities.

One degree of freedom a finger: bend, fingertip, angle of the linkage, travel of the cable, angle of the
replica, counts, and the drum's position are all functions of one another (docs/guide/drums.md). A
calibration replaces the models of cable, linkage and motor by measurements (`calibration`).

The replica is a straight link of some width that turns about the potentiometer, the origin. The roller of the
drum is on the side to which the link turns as the finger bends. Angles count from the same axis: ``replica``
of the link, ``drum`` of the arm that carries the roller, at a touch.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import positive
from proximity.decaff.drum.drum_model import GEARS, USUAL_GEAR, Drum, Gear, Motor, gear_named
from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.transmission import Cable, Linkage, Potentiometer
from proximity.errors import ArgumentError

CONTACT_BEND = 0.5
"""Default bend at contact: half way to the fist."""


@dataclass(frozen=True, slots=True)
class ArmDrum:
    """A roller on an arm about the potentiometer's axis: linear; values assumed."""

    arm: float = 0.040  # m, from the axis to the roller's centre
    roller_radius: float = 0.006  # m
    link_width: float = 0.004  # m

    def __post_init__(self) -> None:
        positive("roller_radius", self.roller_radius, "metres")
        positive("link_width", self.link_width, "metres")
        if not positive("arm", self.arm, "metres") > self.clearance:
            raise ArgumentError(
                f"the arm is {1e3 * self.arm:g} mm, expected more than the roller's radius and half of the "
                f"link's width, {1e3 * self.clearance:g} mm"
            )

    @property
    def clearance(self) -> float:
        """Distance between the link's middle and the roller's centre at a touch, m."""
        return self.roller_radius + 0.5 * self.link_width

    @property
    def alpha(self) -> float:
        """Angle between arm and link at a touch, rad."""
        return math.asin(self.clearance / self.arm)

    def drum_angle(self, replica: ArrayLike) -> np.ndarray:
        """Return the drum's angle as it touches the link, (...), rad."""
        return np.asarray(replica, np.float64) + self.alpha

    def lever(self, replica: ArrayLike) -> np.ndarray:
        """Return the distance of the touch from the potentiometer, (...), m."""
        return np.full(np.shape(replica), self.arm * math.cos(self.alpha))


@dataclass(frozen=True, slots=True)
class Glove:
    """One finger of the glove. Raises if the linkage cannot follow the finger.

    Angles of the replica count from that with the flat hand and a slack-free cable; ``bend`` everywhere is an
    array of any shape (...).
    """

    finger: Finger = field(default_factory=Finger)
    linkage: Linkage = field(default_factory=Linkage)
    cable: Cable = field(default_factory=Cable)
    potentiometer: Potentiometer = field(default_factory=Potentiometer)
    drum: ArmDrum = field(default_factory=ArmDrum)
    motor: Motor = field(default_factory=Motor)
    gear: Gear = GEARS[USUAL_GEAR]

    def __post_init__(self) -> None:
        self.linkage.check(self.finger)

    # --- positions ---

    def replica_angle(
        self, bend: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return the angle of the replica, (...), rad."""
        return self.cable.replica_turn(self.linkage.turn(self.finger, bend), tension, is_closing=is_closing)

    def replica_rate(self, bend: ArrayLike) -> np.ndarray:
        """Return the derivative of `replica_angle` with respect to the bend, (...), rad."""
        ratio = self.cable.hand_pulley / self.cable.replica_pulley
        return ratio * self.linkage.turn_rate(self.finger, bend)

    def bend(
        self, replica_angle: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return the bend of an angle of the replica, (...): the inverse of `replica_angle`."""
        turn = self.cable.hand_turn(replica_angle, tension, is_closing=is_closing)
        return self.linkage.bend(self.finger, turn)

    def counts(self, bend: ArrayLike) -> np.ndarray:
        """Return the potentiometer's counts, (...), int64."""
        return self.potentiometer.read(self.replica_angle(bend))

    def bend_of_counts(self, counts: ArrayLike) -> np.ndarray:
        """Return the bend of counts, (...)."""
        return self.bend(self.potentiometer.angle(counts))

    def drum_angle(self, bend: ArrayLike) -> np.ndarray:
        """Return the drum angle that meets the finger, (...), rad."""
        return self.drum.drum_angle(self.replica_angle(bend))

    # --- resolution, stiffness, force ---

    def tip_per_radian(self, bend: ArrayLike) -> np.ndarray:
        """Return the displacement of the fingertip per radian of the replica, (...), m.

        It is also the torque of the replica, N m, per newton at the fingertip along its path.
        """
        return self.finger.speed(bend) / self.replica_rate(bend)

    def resolution(self, bend: ArrayLike) -> np.ndarray:
        """Return the displacement of the fingertip per count of the potentiometer, (...), m."""
        return self.tip_per_radian(bend) / self.potentiometer.gain

    def replica_torque(self, bend: ArrayLike, tip_force: ArrayLike) -> np.ndarray:
        """Return the torque on the replica for a force at the fingertip, (...), N m."""
        return np.asarray(tip_force, np.float64) * self.tip_per_radian(bend)

    def lever(self, bend: ArrayLike) -> np.ndarray:
        """Return the displacement of the fingertip per radian of the drum, (...), m; also N m per newton."""
        return self.tip_per_radian(bend)

    def tip_drum(self, bend: float = CONTACT_BEND) -> Drum:
        """Return the drum at the fingertip at a bend."""
        return Drum(float(self.lever(bend)), self.motor, self.gear)

    def cable_tension(self, bend: ArrayLike, tip_force: ArrayLike) -> np.ndarray:
        """Return the tension of the cable for a force at the fingertip, (...), N."""
        return self.replica_torque(bend, tip_force) / self.cable.replica_pulley

    def tip_play(self, bend: ArrayLike) -> np.ndarray:
        """Return the displacement of a reversing fingertip before the cable moves the replica, (...), m."""
        return self.cable.backlash / self.cable.replica_pulley * self.tip_per_radian(bend)

    def tip_stiffness(self, bend: ArrayLike) -> np.ndarray:
        """Return the stiffness of a rigid drum felt through the cable, (...), N/m at the fingertip.

        It scales with the square of cable travel over fingertip travel: a small pulley at the hand makes a
        stiff wall soft.
        """
        ratio = self.cable.replica_pulley / self.tip_per_radian(bend)
        return self.cable.stiffness * ratio**2


def with_gear(glove: Glove, name: str) -> Glove:
    """Return the same glove with another of `GEARS`."""
    return replace(glove, gear=gear_named(name))


def tip_drums(glove: Glove) -> dict[str, Drum]:
    """Return drums on a glove: with each of `GEARS`, and with its own gear if that is another."""
    drums = {name: with_gear(glove, name).tip_drum() for name in GEARS}
    return drums if glove.gear in GEARS.values() else drums | {glove.gear.name: glove.tip_drum()}


DRUMS = tip_drums(Glove())
"""Drums of the glove with default dimensions."""
