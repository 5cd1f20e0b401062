"""Single ticks, motion by motion, with pytest-benchmark: ``python -m pytest bench/bench_ticks.py``.

The scenes and motions of `ticks.py`, which is the one to judge by: it keeps every tick, thread time apart.
Rivals know no ticks: beside a hand they tell five signed distances at the same places, and nothing else.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import tick_cases as scenes
import tick_motions as motions
from agreement import TOLERANCE, compare
from tick_crowds import HONEST_SKIN, SKIN_RADIUS, SKIN_SETTINGS
from tick_hands import FARTHEST

import cases
import rivals
from proximity import ContactFlag, Scene, Tracker

TICKS = 2_000
PERIOD_NS = 1_000_000
RIVALS = ("FCPW", "Open3D", "Warp", "libigl", "trimesh")
SLOW = "trimesh"  # beside one hand only
HANDS = ("generated", *motions.HAND_NAMES)
GROUNDS = {
    "plate": lambda sizes: scenes.plate(sizes.plate),
    "freeform": lambda sizes: scenes.freeform(sizes.freeform),
}
CAVITY_RADII = np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2])  # m
CAVITY_SPEEDS = {"at rest": 0.0, "slow": 0.02, "fast": 0.2}  # m/s


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where fingers go in a scene, and what is done before each tick."""

    scene: Scene
    positions: np.ndarray  # (T, N, 3)
    radius: float = scenes.RADIUS
    settings: dict | None = None
    before: Callable[[int], object] = lambda _: None

    def tracker(self):
        """A tracker for it."""
        return Tracker(
            self.scene, fingers=self.positions.shape[1], radius=self.radius, **(self.settings or {})
        )


def _moving(sizes):
    scene = scenes.many_parts(sizes)
    motion = motions.moving_parts(scene, sizes.moving_count, TICKS)

    def move(k):
        k %= TICKS
        scene.move_many(motion.names, motion.poses[k], motion.velocities[k], motion.angular_velocities[k])

    return Motion(scene, motions.wandering_hands(scene, TICKS), before=move)


def _skin(sizes):
    scene = scenes.scene_of(scenes.freeform(sizes.skin_ground, 0.3))
    positions = motions.skin_motion(scene, sizes.skin_count)
    return Motion(scene, positions, SKIN_RADIUS, SKIN_SETTINGS[HONEST_SKIN])


def _cavity(sizes, speed):
    return Motion(_cavity_scene(sizes), motions.cavity_motion(CAVITY_RADII, TICKS, speed))


@cache
def _cavity_scene(sizes):
    return scenes.scene_of(scenes.cavity(sizes))


CROWDS = {
    "parts/wandering hands, 1 of 10 parts moves": _moving,
    "freeform/skin of many points": _skin,
    **{f"cavity/{name}": lambda sizes, v=speed: _cavity(sizes, v) for name, speed in CAVITY_SPEEDS.items()},
}


@pytest.fixture
def sizes(is_small):
    return scenes.SMALL if is_small else scenes.FULL


@pytest.fixture
def hand_motion(made, sizes, leave_out):
    """A call that gives the motion of a hand's whole ticks over a ground."""

    def give(ground, hand_name, rise=0.0):
        if ("tick", ground) not in made:
            mesh = GROUNDS[ground](sizes)
            made["tick", ground] = mesh, scenes.scene_of(mesh)
        _, scene = made["tick", ground]
        hand = next((hand for hand in motions.hands() if hand.name.startswith(hand_name)), None)
        if hand is None:
            leave_out(f"{hand_name}.csv", "the recording is not here (shared/data/hands beside the project)")
        positions = motions.ticks_of(hand, scene) + np.array([0.0, 0.0, rise])
        return Motion(scene, np.ascontiguousarray(positions[~np.isnan(positions).any(axis=(1, 2))][:TICKS]))

    return give


ROWS = [
    pytest.param(ground, hand, name, id=f"{ground}/{hand}-{name}")
    for ground in GROUNDS
    for hand in HANDS
    for name in (kind.name for kind in rivals.CONTENDERS if kind.name in ("proximity", *RIVALS))
    if hand == "generated" or name != SLOW
]


@pytest.mark.parametrize(("ground", "hand_name", "name"), ROWS)
def test_tick_of_a_hand(timed, made, hand_motion, contender, ground, hand_name, name):
    motion = hand_motion(ground, hand_name)
    mesh, scene = made["tick", ground]
    group = f"tick, {ground}/{hand_name}, {len(mesh[1]):,} faces, 5 fingers"
    if name == "proximity":
        check_ticks(motion)
        timed("proximity, a whole tick", group, **_ticks(motion))
        return
    asked = contender(name, f"tick {ground}", mesh)
    count = 50 if asked.query_limit else len(motion.positions)
    places = motion.positions[:: max(1, len(motion.positions) // count)]
    case = cases.Case(ground, *mesh, places[:20].reshape(-1, 3))
    answers = asked.signed_distance(case.points).answer()
    found = compare(case, answers, scene.signed_distance(case.points), "proximity", name)
    told = f" ({found.off_count + found.wrong_sign_count} of {found.checked_count} wrong)"
    tasks = itertools.cycle([asked.signed_distance(place).run for place in places])
    wrong = told if found.off_count + found.wrong_sign_count else ""
    timed(f"{name} {asked.version}, five distances alone{wrong}", group, lambda: next(tasks)())


@pytest.mark.parametrize("ground", GROUNDS)
def test_tick_beyond_the_working_range(timed, hand_motion, ground):
    motion = hand_motion(ground, "generated", FARTHEST)
    faces = sum(part.solid.mesh.face_count for part in motion.scene.parts)
    group = f"tick, {ground}/generated, {FARTHEST} m above, {faces:,} faces, 5 fingers"
    timed("proximity, a whole tick", group, **_ticks(motion))


@pytest.mark.parametrize("name", CROWDS)
def test_tick_of_a_crowd(timed, sizes, name):
    motion = CROWDS[name](sizes)
    faces = sum(part.solid.mesh.face_count for part in motion.scene.parts)
    check_ticks(motion)
    group = f"tick, {name}, {faces:,} faces, {motion.positions.shape[1]:,} fingers"
    timed("proximity, a whole tick", group, **_ticks(motion))


def check_ticks(motion, count=10):
    """The bounds of some ticks hold, and what is exact is."""
    tracker = motion.tracker()
    for k in range(count):
        motion.before(k)
        contacts = tracker.tick(motion.positions[k], k * PERIOD_NS, (k + 1) * PERIOD_NS)
        true = motion.scene.signed_distance(motion.positions[k]) - motion.radius
        room = TOLERANCE * max(1.0, np.abs(true).max())
        assert (contacts["lower"] <= true + room).all() and (true <= contacts["upper"] + room).all()
        is_exact = (contacts["flags"] & ContactFlag.EXACT) != 0
        assert np.abs(contacts["signed_distance"] - true)[is_exact].max(initial=0.0) <= room


def _ticks(motion):
    """The call that is timed and its arguments; what moves, moves between two calls."""
    tracker, number = motion.tracker(), itertools.count()

    def arguments():
        k = next(number)
        motion.before(k)
        place = motion.positions[k % len(motion.positions)]
        return (place, k * PERIOD_NS, (k + 1) * PERIOD_NS), {}

    return {"run": tracker.tick, "arguments": arguments}
