"""Simulated participants: a hand that presses, and answers by what it feels.

For tests of the analysis, and for planning, they answer by a psychometric function with lapses instead.

What an observer does in a trial depends on the design's seed, its slot and the number of the trial alone: a
session that goes on after a crash is the same as one that went through.
"""

import math
from functools import cache, lru_cache
from typing import Any

import numpy as np
from scipy.special import ndtr

from proximity.decaff.controller.controller import FingerController
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.lab.experiment.design import SIMULATED, Design, Kind, Question
from proximity.lab.experiment.display import (
    FRAME,
    Interval,
    Presentation,
    Trial,
    interval_of,
    stopped_by_force,
)
from proximity.lab.experiment.plan import SIGMAS_OF_WIDTH, Stage, Text, is_compared
from proximity.lab.simulation.closed_loop import Response, coupled_wall, decaff, real_wall, soft_wall
from proximity.lab.simulation.devices import CoupledWall, Decaff, Hand
from proximity.lab.simulation.frame_readers import ControllerInLoop
from proximity.lab.simulation.simulated_press import Wall
from proximity.lab.simulation.sweeps import with_latency
from proximity.lab.stability import rests_on

DISTANCE_RATE = 1000.0  # Hz, of forces and of distances
FRAME_PERIOD = 1e-3  # s
DEEP = 0.9  # of the deepest position: there a finger rests
FASTER = (-1, 0, 1)  # speeds of a hand, in the observers' deviation of them: few, so that presses are shared


class Observer:
    """One simulated participant: it answers, and its hand presses.

    *seed*: of the answers, with the design's; another one is another participant in the same place.
    """

    name = SIMULATED

    def __init__(self, design: Design, slot: int, seed: int = 0) -> None:
        self._design, self._seeds = design, [design.seed, seed, slot, 1]
        rng = np.random.default_rng([*self._seeds, 0])
        expected, count = design.observers, len(design.conditions)
        shift = expected.spread * rng.standard_normal()
        shifts = shift + expected.interaction * rng.standard_normal(count)
        self.thresholds = {
            one.name: math.log10(one.threshold) + float(by)
            for one, by in zip(design.conditions, shifts, strict=True)
        }
        """log10 of the true threshold on each condition."""
        self._speed = np.random.default_rng([*self._seeds, 1])

    def read(self, text: Text) -> bool:
        """Agree to everything."""
        return True

    def choose(self, question: Question) -> Any:
        """Choose the first answer, or the middle of the range."""
        return question.choices[0] if question.choices else sum(question.range) / 2.0

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Choose a speed for the hand."""
        self._speed = np.random.default_rng([*self._seeds, 3 + 2 * trial.planned.number, interval])

    def present(self, interval: Interval, limit_force: float, limit_seconds: float) -> Presentation:
        """Press on a surface."""
        noise = 1.0 + self._design.observers.speed_noise * float(self._speed.choice(FASTER))
        frames = _pressed(interval._replace(speed=interval.speed * noise))
        return cut_at_limits(frames, limit_force, limit_seconds)

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Answer by what was felt; by the design's thresholds where nothing was, or it has no noise of it."""
        rng = np.random.default_rng([*self._seeds, 2 + 2 * trial.planned.number])
        if trial.task.kind is Kind.RATING:
            noise = self._design.observers.rating_noise * rng.standard_normal()
            return round(10.0 ** (math.log10(trial.intervals[0].spring) + noise), 1)
        if len(trial.intervals) < 2:
            return None
        noise = self._design.observers.felt_noise
        if noise > 0.0 and felt:
            impressions = [_impression(trial.task.kind, one) + noise * rng.standard_normal() for one in felt]
            return int(np.argmax(impressions)) + 1
        right = trial.planned.odd + 1
        return right if rng.random() < self._probability(trial) else 3 - right

    def explain(self, why: str) -> None:
        """Go on."""

    def _probability(self, trial: Trial) -> float:
        """Probability of the right answer to a trial of two intervals."""
        planned, expected = trial.planned, self._design.observers
        if trial.task.kind is Kind.REAL:
            return self._design.condition(planned.condition).correct
        if planned.stage is Stage.CATCH:
            return 1.0 - expected.lapse
        sigma = expected.width / SIGMAS_OF_WIDTH
        share = float(ndtr((math.log10(trial.level) - self.thresholds[planned.condition]) / sigma))
        return 0.5 + (0.5 - expected.lapse) * share


def cut_at_limits(frames: np.ndarray, limit_force: float, limit_seconds: float) -> Presentation:
    """Return (N,) FRAME until a limit is passed."""
    above = np.flatnonzero(~(frames["force"] <= limit_force))
    if len(above):
        force = float(frames["force"][above[0]])
        return Presentation(frames[: above[0]], stopped_by_force(force, limit_force))
    return Presentation(frames[frames["time"] - frames["time"][0] <= limit_seconds])


def unstable_walls(design: Design) -> list[str]:
    """Return a sentence for each task on a coupled wall that shakes under a simulated hand."""
    found = []
    for task in design.tasks:
        for condition in design.conditions:
            if condition.wall is not Wall.COUPLED or not is_compared(design, task, condition.name):
                continue
            levels = {0.0, *task.levels, *([task.catch_level] if task.catch or task.practice else [])}
            walls = (_coupled(interval_of(task, condition, level)) for level in sorted(levels))
            first = next((wall for wall in walls if not rests_on(Hand(), wall)), None)
            if first is not None:
                found.append(
                    f"{condition.name} in {task.name} is unstable at {first.stiffness:g} N/m with "
                    f"{first.damping:g} N s/m, {1e3 * first.latency:g} ms late at {first.rate:g} Hz, under a "
                    "simulated hand: it shakes, and limits may end its trials"
                )
    return found


def _impression(kind: Kind, shown: Presentation) -> float:
    """Logarithm of the stiffness that a hand feels, or, where the real wall is sought, of the hardness.

    Stiffness is force over the way of the finger where it is deepest; hardness the steepest rise of the force
    over the speed of the finger as it comes (the rate-hardness of Lawrence and others, 2000).
    """
    time, finger, force = (shown.frames[name].astype(np.float64) for name in ("time", "finger", "force"))
    if not (force > 0.0).any() or not finger.max() > 0.0:
        return -math.inf
    if kind is Kind.REAL:
        rises, speeds = np.diff(force) / np.diff(time), np.diff(finger) / np.diff(time)
        return math.log(float(rises.max()) / float(speeds[max(0, int(np.argmax(finger >= 0.0)) - 1)]))
    is_deep = finger >= DEEP * finger.max()
    return math.log(float(force[is_deep].mean()) / float(finger[is_deep].mean()))


@lru_cache(maxsize=2000)
def _pressed(interval: Interval) -> np.ndarray:
    """Frames of a press; the same one is simulated once."""
    response = _response(interval)
    every = max(1, round(FRAME_PERIOD / response.step))
    frames = np.zeros(len(response.times[::every]), FRAME)
    frames["time"], frames["force"] = response.times[::every], response.force[::every]
    frames["finger"], frames["wall"] = response.finger[::every], response.thimble[::every]
    frames.flags.writeable = False
    return frames


def _response(interval: Interval) -> Response:
    hand = Hand()
    press, stiffness, damping = hand.press(interval.speed), interval.stiffness, interval.damping
    if interval.wall is Wall.REAL:
        return real_wall(hand, press) if stiffness is None else soft_wall(hand, press, stiffness, damping)
    if interval.wall is Wall.COUPLED:
        return coupled_wall(hand, press, _coupled(interval))
    path = _finger_path()
    surface = None if stiffness is None else (stiffness, damping)
    controller = ControllerInLoop(FingerController(path, SERVO_RATE), path, surface)
    return decaff(hand, press, with_latency(Decaff(), interval.latency, DISTANCE_RATE), controller)


def _coupled(interval: Interval) -> CoupledWall:
    return CoupledWall(interval.spring, interval.damping, DISTANCE_RATE, interval.latency)


@cache
def _finger_path() -> FingerPath:
    return FingerPath(Glove())
