"""Closed-loop simulation of hand and finger on a real wall, a coupled wall, or a drum.

The same hand presses on each, so that the forces compare. Times count from the contact: the instant at which
the hand's intent reaches the surface, at 0. A drum learns of the wall by distances, late and now and then;
who makes a target of them is one of `target_policies`, compiled with the loop, or any controller, asked at
every sample.
"""

import math

import numpy as np

from proximity.checks import not_negative, positive
from proximity.decaff.drum import drum_kernels
from proximity.decaff.drum.drum_command import DrumCommand
from proximity.decaff.drum.servo import SIMULATION_STEP, steps_a_sample
from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Intent
from proximity.lab.simulation import loop_kernels, press_kernels
from proximity.lab.simulation.devices import COUPLED_DEVICE, CoupledWall, Decaff, Link
from proximity.lab.simulation.hand import Hand
from proximity.lab.simulation.response import Response
from proximity.lab.simulation.target_policies import Controller, DistanceSample, Message, Target
from proximity.lab.simulation.tip_cable import TipCable

TAIL = 0.100  # s, looked at after the hand has left: forces that come late still count
LEAD = 0.005  # s, or m beyond the reach: free motion before anything happens
PHASE = 0.1  # of a period, from a coupled wall's sample to the contact; assumed


def real_wall(
    hand: Hand, press: Intent, *, like: Response | None = None, step: float = SIMULATION_STEP
) -> Response:
    """Return a press on a wall that neither moves nor pulls."""
    response = _empty(hand, press, step, LEAD) if like is None else _same_instants(hand, press, like)
    body = _body(hand, Link())
    press_kernels.press_real_wall(body, press.as_array(), response.zero, response.step, response.record)
    return response


def soft_wall(
    hand: Hand,
    press: Intent,
    stiffness: float,
    damping: float,
    *,
    like: Response | None = None,
) -> Response:
    """Return a press on a surface that gives way as a spring with a damper, without mass."""
    numbers = np.zeros(press_kernels.WALL_SIZE)
    numbers[press_kernels.WALL_STIFFNESS] = positive("stiffness", stiffness, "newtons a metre")
    numbers[press_kernels.WALL_DAMPING] = not_negative("damping", damping, "newton seconds a metre")
    response = (
        _empty(hand, press, SIMULATION_STEP, LEAD) if like is None else _same_instants(hand, press, like)
    )
    body = _body(hand, Link())
    press_kernels.press_soft_wall(
        body, press.as_array(), numbers, response.zero, response.step, response.record
    )
    return response


def coupled_wall(
    hand: Hand,
    press: Intent,
    wall: CoupledWall,
    *,
    device: Link = COUPLED_DEVICE,
    step: float = SIMULATION_STEP,
) -> Response:
    """Return a press on a traditional wall: finger and device are bound to each other by the pad."""
    steps = steps_a_sample(wall.rate, step)
    response = _empty(hand, press, 1.0 / (wall.rate * steps), LEAD)
    numbers = np.array([wall.stiffness, wall.damping, wall.resolution])
    samples = np.array([steps, round(wall.latency / response.step), round(PHASE * steps)])
    body = _body(hand, device)
    press_kernels.press_coupled_wall(
        body, press.as_array(), numbers, samples, response.zero, response.step, response.record
    )
    return response


def ideal_drum(hand: Hand, press: Intent, *, step: float = SIMULATION_STEP) -> Response:
    """Return a press on a drum that stands at the wall and does not move: what a link alone costs."""
    response = _empty(hand, press, step, LEAD)
    body = _body(hand, Link())
    loop_kernels.run_stop(body, press.as_array(), 0.0, response.zero, response.step, response.record)
    return response


def decaff(
    hand: Hand, press: Intent, glove: Decaff, target: Target | Controller = Target.TIME_STAMPED
) -> Response:
    """Return a press on a drum that is sent to where the wall is said to be."""
    loop = DecaffLoop(hand, press, glove)
    if isinstance(target, Target):
        loop.run(target)
        return loop.response
    if not callable(getattr(target, "command", None)):
        raise ArgumentError(f"target is {target!r}, expected a Target or a controller with a method command")
    while not loop.is_over:
        loop.tick(target.command(loop.distance_sample()))
    return loop.response


class DecaffLoop:
    """A glove with a drum, a sample of its servo at a time, for controllers outside compiled code."""

    response: Response  # filled as far as the loop has come
    drive: np.ndarray  # of drum and servo, as of `drum_kernels`; a study may change what is demanded

    def __init__(self, hand: Hand, press: Intent, glove: Decaff) -> None:
        steps = steps_a_sample(glove.servo.rate)
        lead = press.lead(glove.sensing.reach + LEAD)
        self.response = _empty(hand, press, glove.servo.period / steps, lead, multiple=steps)
        self._steps, self._first, self._back = steps, 0, 0.0
        self._body, self._press = _body(hand, glove.link, glove.cable), press.as_array()
        self._resolution = glove.sensing.resolution
        self._drum, self._servo = glove.drum.as_array(), glove.servo.as_array()
        self._sensing, self._holding = glove.sensing.as_array(), glove.holding.as_array()
        self._noise = glove.sensing.noises(self.response.record.shape[1] * self.response.step)
        self.drive = glove.drum.drive(self.response.step)
        self._command = np.zeros(drum_kernels.COMMAND_SIZE)
        self._message = np.zeros(loop_kernels.MESSAGE_SIZE)
        drum_kernels.rest_drum(self._drum, self.drive, glove.holding.retracted)
        loop_kernels.start_record(self._press, self.response.zero, self.response.step, self.response.record)

    @property
    def is_over(self) -> bool:
        """Whether the press has come to its end."""
        return self._first >= self.response.record.shape[1]

    @property
    def now(self) -> float:
        """Seconds from the contact."""
        return (self._first - self.response.zero) * self.response.step

    def distance_sample(self) -> DistanceSample:
        """Return what a controller knows at this sample."""
        self._must_go_on()
        response, row = self.response, self._first
        loop_kernels.read_message(
            self._sensing, self._noise, row, response.zero, response.step, response.record, self._message
        )
        at, link, speed, distance = (float(number) for number in self._message)
        return DistanceSample(
            self.now,
            self._read(float(response.link[row])),
            float(response.record[press_kernels.RECORD_LINK_SPEED, row]),
            float(response.finger_speed[row]),
            float(self.drive[drum_kernels.DRIVE_POSITION]),
            self._back,
            float(self.drive[drum_kernels.DRIVE_DEMANDED]),
            float(self.drive[drum_kernels.DRIVE_APPLIED]),
            Message(at, link, speed, distance) if at > -math.inf else None,
        )

    def row(self, time: float) -> int:
        """Return the row of the record that is nearest to an instant, of those that are filled."""
        last = min(self._first, self.response.record.shape[1] - 1)
        return min(max(self.response.zero + round(time / self.response.step), 0), last)

    def link_at(self, time: float) -> tuple[float, float]:
        """Return where the link was by the potentiometer, m, and how fast, m/s."""
        row, record = self.row(time), self.response.record
        link, speed = (
            float(record[i, row]) for i in (press_kernels.RECORD_LINK, press_kernels.RECORD_LINK_SPEED)
        )
        return self._read(link), speed

    def tick(self, command: DrumCommand) -> None:
        """Serve a command for one sample, and move everything by it."""
        self._must_go_on()
        response = self.response
        command.write(self._command)
        drum_kernels.serve(self._drum, self._servo, self.drive, self._command, self._back)
        last = min(self._first + self._steps, response.record.shape[1])
        self._back = loop_kernels.advance_plant(
            self._body,
            self._press,
            self._drum,
            self.drive,
            self._first,
            last,
            response.zero,
            response.step,
            response.record,
        )
        self._first = last

    def run(self, target: Target) -> None:
        """Go through the whole press with one of the four readings, in compiled code."""
        if self._first > 0:
            raise ArgumentError(f"the press is at {self.now:g} s, expected one that has not begun")
        response = self.response
        loop_kernels.run_loop(
            int(target),
            self._body,
            self._press,
            self._drum,
            self._servo,
            self.drive,
            self._sensing,
            self._noise,
            self._holding,
            self._steps,
            response.zero,
            response.record,
        )
        self._first = response.record.shape[1]

    def _read(self, link: float) -> float:
        """Position of the link as the potentiometer has it, m."""
        return math.floor(link / self._resolution + 0.5) * self._resolution if self._resolution else link

    def _must_go_on(self) -> None:
        if self.is_over:
            raise ArgumentError(f"the press is over at {self.now:g} s, expected one that goes on")


def _body(hand: Hand, link: Link, cable: TipCable | None = None) -> np.ndarray:
    body = np.zeros(press_kernels.BODY_SIZE)
    body[press_kernels.BODY_HAND_STIFFNESS], body[press_kernels.BODY_HAND_DAMPING] = (
        hand.stiffness,
        hand.damping,
    )
    body[press_kernels.BODY_FINGER_MASS] = hand.finger_mass
    body[press_kernels.BODY_PAD_STIFFNESS], body[press_kernels.BODY_PAD_DAMPING] = (
        hand.pad_stiffness,
        hand.pad_damping,
    )
    body[press_kernels.BODY_LINK_MASS], body[press_kernels.BODY_LINK_DAMPING] = link.mass, link.damping
    body[press_kernels.BODY_CONTACT_STIFFNESS] = link.contact_stiffness
    body[press_kernels.BODY_CONTACT_DAMPING] = link.contact_damping
    if cable is not None:
        body[press_kernels.BODY_CABLE_STIFFNESS] = cable.stiffness
        body[press_kernels.BODY_CABLE_DAMPING] = cable.damping(link.mass)
        body[press_kernels.BODY_PLAY] = cable.play
        body[press_kernels.BODY_CAPSTAN], body[press_kernels.BODY_DRAG] = cable.capstan, cable.drag
    return body


def _empty(hand: Hand, press: Intent, step: float, lead: float, multiple: int = 1) -> Response:
    """Room for a press: *lead* seconds before the contact, in whole samples of *multiple* steps."""
    positive("step", step, "seconds")
    zero = math.ceil(lead / (step * multiple)) * multiple
    count = zero + math.ceil((press.loss_time + TAIL) / step)
    return Response(hand, press, step, zero, np.zeros((press_kernels.RECORD_SIZE, count)))


def _same_instants(hand: Hand, press: Intent, like: Response) -> Response:
    return Response(hand, press, like.step, like.zero, np.zeros_like(like.record))
