"""The sheathed cable between hand and replica, as it is felt at the fingertip."""

import math
from dataclasses import dataclass

from proximity.checks import not_negative, positive
from proximity.decaff.glove.default_bend import CONTACT_BEND
from proximity.decaff.glove.glove import Glove

FRICTION = 0.1  # of a cable in a lined sheath; assumed
WRAP = 0.5 * math.pi  # rad, all bends of the sheath together; assumed
PRELOAD = 1.0  # N, of both strands together, which keep it taut; assumed
LOSS = 0.05  # of critical damping, of link and cable; assumed


@dataclass(frozen=True, slots=True)
class TipCable:
    """A cable with what it costs at the fingertip: it stretches, and rubs in its sheath."""

    stiffness: float  # N/m
    capstan: float = 0.0  # share of its tension by which it rubs
    drag: float = 0.0  # N, by which it rubs where nothing pulls
    loss: float = LOSS
    play: float = 0.0  # m, that the finger goes back before the link follows

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("capstan", self.capstan, "shares")
        not_negative("drag", self.drag, "newtons")
        not_negative("loss", self.loss, "shares")
        not_negative("play", self.play, "metres")

    @classmethod
    def of(
        cls, glove: Glove, bend: float = CONTACT_BEND, *, friction: float = FRICTION, wrap: float = WRAP
    ) -> "TipCable":
        """Return the cable of a glove."""
        capstan = math.expm1(not_negative("friction", friction, "shares") * not_negative("wrap", wrap, "rad"))
        tension_a_newton = float(glove.cable_tension(bend, 1.0))
        drag, play = capstan * PRELOAD / tension_a_newton, float(glove.tip_play(bend))
        return cls(float(glove.tip_stiffness(bend)), capstan, drag, play=play)

    def damping(self, mass: float) -> float:
        """Return the damping of the cable itself, N s/m."""
        return 2.0 * self.loss * math.sqrt(self.stiffness * mass)
