"""Closed-loop simulation of hand and finger on a real wall, a coupled wall, or a drum.

The same hand presses on each, so that the forces compare. Times count from the contact: the instant at which
the hand's intent reaches the surface, at 0. A drum learns of the wall from delayed, sampled distances; its
target comes from one of `target_policies`, or from a controller that is called at every sample of the servo.
"""

import math
from dataclasses import dataclass

import numpy as np

from proximity.checks import not_negative, positive
from proximity.decaff.controller.served_drum import ServedDrum
from proximity.decaff.drum import drum_kernels
from proximity.decaff.drum.drum_model import STOP_GAP
from proximity.decaff.drum.servo import SIMULATION_STEP, DrumCommand, steps_a_sample
from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Intent
from proximity.lab.simulation import press_kernels
from proximity.lab.simulation.devices import COUPLED_DEVICE, CoupledWall, Decaff, Hand, Link, TipCable
from proximity.lab.simulation.press_kernels import PressArrays
from proximity.lab.simulation.target_policies import (
    Controller,
    DistanceSample,
    Message,
    Target,
    TargetPolicy,
)
from proximity.native import packed

TAIL = 0.100  # s, recorded after the hand has left, to include delayed forces
LEAD = 0.005  # s, or m beyond the reach: free motion at the start
PHASE = 0.1  # of a period, from a coupled wall's sample to the contact; assumed
CURVES = 8  # of a response, and that of the link's speed


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response of a press on a wall, instant by instant; N steps."""

    hand: Hand
    press: Intent
    step: float  # s
    zero: int  # row of the contact
    force: np.ndarray  # (N,) N, of the pad on the finger
    finger: np.ndarray  # (N,) m
    finger_speed: np.ndarray  # (N,) m/s
    link: np.ndarray  # (N,) m, of the link, which meets the drum
    link_speed: np.ndarray  # (N,) m/s; 0 for a wall that is not a device
    thimble: np.ndarray  # (N,) m, of the pad's far side: the cable's near end, or the link without one
    drum: np.ndarray  # (N,) m; for a wall that is not a drum: its surface
    contact: np.ndarray  # (N,) N, of wall or drum on the link

    @property
    def times(self) -> np.ndarray:
        """(N,) s, from the contact."""
        return self.step * (np.arange(len(self.force)) - self.zero)


def real_wall(
    hand: Hand, press: Intent, *, like: Response | None = None, step: float = SIMULATION_STEP
) -> Response:
    """Return a press on a wall that neither moves nor pulls."""
    return _on_surface(hand, press, math.inf, 0.0, like, step)


def soft_wall(
    hand: Hand, press: Intent, stiffness: float, damping: float, *, like: Response | None = None
) -> Response:
    """Return a press on a massless surface with a spring and a damper."""
    positive("stiffness", stiffness, "newtons a metre")
    not_negative("damping", damping, "newton seconds a metre")
    return _on_surface(hand, press, stiffness, damping, like, SIMULATION_STEP)


def _on_surface(
    hand: Hand, press: Intent, stiffness: float, damping: float, like: Response | None, step: float
) -> Response:
    response, arrays = _empty(hand, press, step if like is None else like.step, LEAD, like=like)
    wall = arrays.wall[0]
    wall.stiffness, wall.damping = stiffness, damping
    press_kernels.press_surface(packed(arrays))
    return response


def coupled_wall(
    hand: Hand,
    press: Intent,
    wall: CoupledWall,
    *,
    device: Link = COUPLED_DEVICE,
    step: float = SIMULATION_STEP,
) -> Response:
    """Return a press on a traditional wall: the pad binds finger and device to each other."""
    every = steps_a_sample(wall.rate, step)
    response, arrays = _empty(hand, press, 1.0 / (wall.rate * every), LEAD, link=device)
    late, first = round(wall.latency / response.step), (response.zero - round(PHASE * every)) % every
    arrays.wall[0] = (wall.stiffness, wall.damping, wall.resolution, every, late, first, 0.0)
    arrays = arrays._replace(held=np.zeros(len(response.force) // every + 2))
    press_kernels.press_device(packed(arrays))
    return response


def ideal_drum(hand: Hand, press: Intent, *, step: float = SIMULATION_STEP) -> Response:
    """Return a press on a fixed drum at the wall: the error of a link alone."""
    response, arrays = _empty(hand, press, step, LEAD)
    drum, drive = np.zeros(1, drum_kernels.DRUM), np.zeros(drum_kernels.DRIVE_SIZE)
    drum["mass"] = drum["speed_limit"] = drum["stop"] = math.inf
    whole = packed(arrays._replace(drum=drum, drive=drive))
    press_kernels.begin_press(whole)
    press_kernels.press_drum(whole, 0, len(response.force))
    return response


def decaff(
    hand: Hand, press: Intent, glove: Decaff, target: Target | Controller = Target.TIME_STAMPED
) -> Response:
    """Return a press on a drum that is sent to the measured wall."""
    loop = DecaffLoop(hand, press, glove)
    controller = TargetPolicy(target, glove.holding) if isinstance(target, Target) else target
    if not callable(getattr(controller, "command", None)):
        raise ArgumentError(f"target is {target!r}, expected a Target or a controller with a method command")
    while not loop.is_over:
        loop.tick(controller.command(loop.distance_sample()))
    return loop.response


class DecaffLoop:
    """A glove with a drum, simulated one servo sample at a time."""

    response: Response  # filled up to the current sample
    drum: ServedDrum

    def __init__(self, hand: Hand, press: Intent, glove: Decaff) -> None:
        retracted = glove.holding.retracted
        self.drum = ServedDrum(glove.drum, glove.servo, retracted, retracted + STOP_GAP * glove.drum.lever)
        least = 0.5 * glove.link.contact_damping * self.drum.step
        if not glove.drum.mass > least:
            raise ArgumentError(
                f"the drum weighs {1e3 * glove.drum.mass:.2g} g at the fingertip, expected more than "
                f"{1e3 * least:.2g} g: a touch throws it off"
            )
        steps, lead = self.drum.steps, press.lead(glove.sensing.reach + LEAD)
        self.response, arrays = _empty(
            hand, press, self.drum.step, lead, multiple=steps, link=glove.link, cable=glove.cable
        )
        self._steps, self._first, self._back = steps, 0, 0.0
        self._sensing = glove.sensing
        self._noise = glove.sensing.noises(len(self.response.force) * self.response.step)
        self._press = packed(arrays._replace(drum=self.drum.plant, drive=self.drum.drive))
        press_kernels.begin_press(self._press)

    @property
    def is_over(self) -> bool:
        """Whether the press has ended."""
        return self._first >= len(self.response.force)

    @property
    def now(self) -> float:
        """Seconds from the contact."""
        return (self._first - self.response.zero) * self.response.step

    def distance_sample(self) -> DistanceSample:
        """Return the controller's state at this sample."""
        self._must_go_on()
        response, row = self.response, self._first
        return DistanceSample(
            self.now,
            self._read(float(response.link[row])),
            float(response.link_speed[row]),
            float(response.finger_speed[row]),
            self.drum.position,
            self._back,
            self.drum.applied,
            self._message(row),
        )

    def _message(self, row: int) -> Message | None:
        """Return the newest message delivered at a row; None without a message, or with no part in reach."""
        response, sensing = self.response, self._sensing
        # A millionth of a period decides only ties.
        asked = math.floor((row * response.step - sensing.latency) * sensing.rate - sensing.phase + 1e-6)
        if asked < 0:
            return None
        then = min(row, round((asked + sensing.phase) / (sensing.rate * response.step)))
        at, link = (then - response.zero) * response.step, self._read(float(response.link[then]))
        distance = sensing.wall_speed * at - link
        noise = float(self._noise[asked % len(self._noise)])
        distance += sensing.scale_error * distance + sensing.bias + noise
        if not distance <= sensing.reach:
            return None
        return Message(at, link, float(response.link_speed[then]), distance)

    def row(self, time: float) -> int:
        """Return the filled row of the record nearest to an instant."""
        last = min(self._first, len(self.response.force) - 1)
        return min(max(self.response.zero + round(time / self.response.step), 0), last)

    def link_at(self, time: float) -> tuple[float, float]:
        """Return position, m, and speed, m/s, of the link by the potentiometer."""
        row = self.row(time)
        return self._read(float(self.response.link[row])), float(self.response.link_speed[row])

    def tick(self, command: DrumCommand) -> None:
        """Apply a command for one sample, and advance the simulation."""
        self._must_go_on()
        self.drum.serve(command, self._back)
        last = min(self._first + self._steps, len(self.response.force))
        press_kernels.press_drum(self._press, self._first, last)
        self._first, self._back = last, float(self.response.contact[last - 1])

    def _read(self, link: float) -> float:
        """Return the position of the link by the potentiometer, m."""
        step = self._sensing.resolution
        return math.floor(link / step + 0.5) * step if step else link

    def _must_go_on(self) -> None:
        if self.is_over:
            raise ArgumentError(f"the press is over at {self.now:g} s, expected one in progress")


def _empty(
    hand: Hand,
    press: Intent,
    step: float,
    lead: float,
    *,
    multiple: int = 1,
    link: Link | None = None,
    cable: TipCable | None = None,
    like: Response | None = None,
) -> tuple[Response, PressArrays]:
    """Return empty arrays of a press, from *lead* s before the contact, in whole samples of *multiple* steps.

    The arrays have no drum yet. *like*: a press with the same instants.
    """
    positive("step", step, "seconds")
    zero = math.ceil(lead / (step * multiple)) * multiple if like is None else like.zero
    count = zero + math.ceil((press.loss_time + TAIL) / step) if like is None else len(like.force)
    curves, nothing, link = np.zeros((CURVES, count + 1)), np.zeros(0), link or Link()
    body = np.zeros(1, press_kernels.BODY)
    body[0] = (
        hand.stiffness, hand.damping, hand.finger_mass, hand.pad_stiffness, hand.pad_damping,
        link.mass, link.damping, link.contact_stiffness, link.contact_damping,
        *(cable.numbers(link.mass) if cable is not None else (0.0,) * 5), step, zero,
    )  # fmt: skip
    wall = np.zeros(1, press_kernels.WALL)
    drum = np.zeros(0, drum_kernels.DRUM)
    arrays = PressArrays(body, press.as_array(), wall, nothing, drum, nothing, *curves)
    return Response(hand, press, step, zero, *curves[:, :count]), arrays
