"""Simulated participants: a hand that presses, and answers by the felt force.

Without `felt_noise` in the design they answer by a psychometric function with lapses. An answer depends only
on the design's seed, the slot and the number of the trial: an interrupted visit continues as an uninterrupted
one.
"""

import math
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np

from proximity.decaff.controller.controller import FingerController
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.lab.experiment.design import Design, Kind
from proximity.lab.experiment.display import FRAME, Interval, Presentation, interval_of, stopped_by_force
from proximity.lab.experiment.plan import Text, Trial
from proximity.lab.experiment.psychometric import Shape, probability
from proximity.lab.experiment.visit import SIMULATED
from proximity.lab.simulation.closed_loop import Response, coupled_wall, decaff, real_wall, soft_wall
from proximity.lab.simulation.devices import CoupledWall, Decaff, Hand
from proximity.lab.simulation.frame_readers import ControllerInLoop
from proximity.lab.simulation.simulated_press import Wall
from proximity.lab.simulation.sweeps import with_latency
from proximity.lab.stability import rests_on

DISTANCE_RATE = 1000.0  # Hz, of forces and of distances
FRAME_PERIOD = 1e-3  # s
DEEP = 0.9  # of the deepest position, at which a finger rests
FASTER = (-1, 0, 1)  # speeds of a hand, in the observers' deviation of them: few, so that presses are shared


class Observer:
    """One simulated participant: it answers, and its hand presses.

    *seed*: of the answers, with the design's; another seed is another participant in the same slot.
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

    def consents(self, text: str) -> bool:
        """Agree."""
        return True

    def read(self, text: Text) -> None:
        """Continue."""

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Choose a speed for the hand."""
        self._speed = np.random.default_rng([*self._seeds, 3 + 2 * trial.number, interval])

    def present(self, interval: Interval, limit_force: float, limit_seconds: float) -> Presentation:
        """Press on a surface."""
        noise = 1.0 + self._design.observers.speed_noise * float(self._speed.choice(FASTER))
        frames = _pressed(interval._replace(speed=interval.speed * noise))
        return cut_at_limits(frames, limit_force, limit_seconds)

    def answer(self, trial: Trial, felt: Sequence[Presentation]) -> int:
        """Answer by the frames, or by the design's thresholds without frames or noise."""
        rng = np.random.default_rng([*self._seeds, 2 + 2 * trial.number])
        noise = self._design.observers.felt_noise
        if noise > 0.0 and felt:
            impressions = [_impression(trial.task.kind, one) + noise * rng.standard_normal() for one in felt]
            return int(np.argmax(impressions)) + 1
        if not trial.odd:
            return int(rng.integers(2)) + 1
        return trial.odd if rng.random() < self._probability(trial) else 3 - trial.odd

    def explain(self, why: str) -> None:
        """Continue."""

    def _probability(self, trial: Trial) -> float:
        """Return the probability of the right answer to a trial."""
        if trial.task.kind is Kind.REAL:
            return trial.condition.correct
        shape = Shape(self._design.observers.width, self._design.observers.lapse)
        above = math.log10(trial.level) - self.thresholds[trial.condition.name]
        return float(probability(np.array(above), shape))


def cut_at_limits(frames: np.ndarray, limit_force: float, limit_seconds: float) -> Presentation:
    """Return (N,) FRAME until a limit is exceeded."""
    above = np.flatnonzero(~(frames["force"] <= limit_force))
    if len(above):
        force = float(frames["force"][above[0]])
        return Presentation(frames[: above[0]], stopped_by_force(force, limit_force))
    return Presentation(frames[frames["time"] - frames["time"][0] <= limit_seconds])


def unstable_walls(design: Design) -> list[str]:
    """Return a sentence for each task on a coupled wall that is unstable under a simulated hand."""
    found = []
    for task in design.tasks:
        for condition in (one for one in design.compared(task) if one.wall is Wall.COUPLED):
            walls = (_coupled(interval_of(task, condition, level)) for level in (0.0, *task.levels))
            first = next((wall for wall in walls if not rests_on(Hand(), wall)), None)
            if first is not None:
                found.append(
                    f"{condition.name} in {task.name} is unstable at {first.stiffness:g} N/m with "
                    f"{first.damping:g} N s/m, {1e3 * first.latency:g} ms late at {first.rate:g} Hz, under a "
                    "simulated hand: it shakes, and limits may end its trials"
                )
    return found


def _impression(kind: Kind, shown: Presentation) -> float:
    """Return the logarithm of the felt stiffness, or of the hardness if the real wall is sought.

    Stiffness is force over displacement of the finger at its deepest; hardness the steepest rise of the force
    over the speed of the approaching finger (the rate-hardness of Lawrence and others, 2000).
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
    """Return the frames of a press; equal presses are simulated once."""
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
