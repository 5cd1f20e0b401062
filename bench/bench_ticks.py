"""Single ticks, with pytest-benchmark: ``python -m pytest bench/bench_ticks.py``.

The cases of `ticks.py`, which is the one to judge by: it keeps every tick, and thread time apart. This
follows medians from commit to commit.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import tick_cases as scenes
import tick_motions as motions
from tick_crowds import HONEST_SKIN, SKIN_RADIUS, SKIN_SETTINGS

from proximity import Tracker

ROUNDS = 2_000
SKIN_ROUNDS = 200


@dataclass(frozen=True, slots=True, eq=False)
class TickCase:
    """A tracker and where its fingers go."""

    tracker: Tracker
    positions: np.ndarray  # (T, N, 3)
    before: Callable[[int], None] = lambda _: None
    rounds: int = ROUNDS


def _hand(mesh):
    scene = scenes.scene_of(mesh)
    return TickCase(Tracker(scene, radius=scenes.RADIUS), motions.ticks_of(next(motions.hands()), scene))


def _moving():
    scene = scenes.many_parts(scenes.FULL)
    motion = motions.moving_parts(scene, scenes.FULL.moving_count, ROUNDS)
    positions = motions.wandering_hands(scene, ROUNDS)

    def before(k):
        k %= ROUNDS
        scene.move_many(motion.names, motion.poses[k], motion.velocities[k], motion.angular_velocities[k])

    return TickCase(Tracker(scene, fingers=positions.shape[1], radius=scenes.RADIUS), positions, before)


def _skin():
    scene = scenes.scene_of(scenes.freeform(scenes.FULL.skin_ground, 0.3))
    positions = motions.skin_motion(scene, scenes.FULL.skin_count)
    settings = SKIN_SETTINGS[HONEST_SKIN]
    tracker = Tracker(scene, fingers=positions.shape[1], radius=SKIN_RADIUS, **settings)
    return TickCase(tracker, positions, rounds=SKIN_ROUNDS)


def _cavity():
    scene = scenes.scene_of(scenes.cavity(scenes.FULL))
    positions = motions.cavity_motion(np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2]), ROUNDS, 0.02)
    return TickCase(Tracker(scene, radius=scenes.RADIUS), positions)


CASES = {
    "fingers/plate": lambda: _hand(scenes.plate(scenes.FULL.plate)),
    "fingers/freeform": lambda: _hand(scenes.freeform(scenes.FULL.freeform)),
    "moving": _moving,
    "skin": _skin,
    "cavity": _cavity,
}


@cache
def made(name):
    """The case *name*, made once."""
    return CASES[name]()


@pytest.mark.parametrize("name", CASES)
def test_tick(benchmark, name):
    case = made(name)
    number = itertools.count()

    def arguments():
        k = next(number)
        case.before(k)
        return (case.positions[k % len(case.positions)], k * 1_000_000, (k + 1) * 1_000_000), {}

    benchmark.group = f"tick, {name}, {len(case.tracker.contacts)} fingers"
    benchmark.pedantic(case.tracker.tick, setup=arguments, rounds=case.rounds, warmup_rounds=20)
