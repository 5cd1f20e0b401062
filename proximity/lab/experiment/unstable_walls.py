"""Coupled walls of a design that shake: known before anybody presses on them."""

from proximity.lab.experiment.design import Condition, Design, Task
from proximity.lab.experiment.display import interval_of
from proximity.lab.experiment.observers import DISTANCE_RATE
from proximity.lab.experiment.plan import is_compared
from proximity.lab.simulation.devices import CoupledWall
from proximity.lab.simulation.hand import Hand
from proximity.lab.simulation.simulated_press import Wall
from proximity.lab.stability.coupled_limit import rests_on


def unstable_walls(design: Design) -> list[str]:
    """Return a sentence for each task on a coupled wall that shakes under a simulated hand."""
    return [
        sentence
        for task in design.tasks
        for condition in design.conditions
        if condition.wall is Wall.COUPLED and is_compared(design, task, condition.name)
        if (sentence := _said_of(task, condition))
    ]


def _said_of(task: Task, condition: Condition) -> str:
    """A sentence about the surfaces of a condition in a task that shake; empty: all are stable."""
    levels = {0.0, *task.levels, *([task.catch_level] if task.catch or task.practice else [])}
    hand, shaking = Hand(), []
    for level in sorted(levels):
        interval = interval_of(task, condition, level)
        gain = interval.gain if interval.stiffness is None else interval.stiffness
        wall = CoupledWall(gain, interval.damping, DISTANCE_RATE, interval.latency)
        if not rests_on(hand, wall):
            shaking.append(wall)
    if not shaking:
        return ""
    first = shaking[0]
    return (
        f"{condition.name} in {task.name} is unstable at {first.stiffness:g} N/m with "
        f"{first.damping:g} N s/m, {1e3 * first.latency:g} ms late at {first.rate:g} Hz, under a simulated "
        "hand: it shakes, and limits may end its trials"
    )
