"""Single ticks, motion by motion, with pytest-benchmark: ``python -m pytest bench -k ticks``.

The scenes and motions of `ticks.py`, whose figures count: it keeps the thread time of every tick. Rivals have
no ticks: they answer five signed distances at the same positions only.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from benchmarks.queries import cases
from benchmarks.queries.agreement import TOLERANCE, compare
from benchmarks.rivals import registry
from benchmarks.ticks import motions, scenes
from benchmarks.ticks.crowds import JUDGED_SKIN, SKIN_RADIUS, SKIN_SETTINGS
from benchmarks.ticks.hands import OUT_OF_RANGE
from proximity import ContactFlag, Scene, Tracker

TICKS = 2_000
RIVALS = ("FCPW", "Open3D", "Warp", "libigl", "trimesh")
SLOW = "trimesh"  # with one hand only
HANDS = ("generated", *motions.HAND_NAMES)
SURFACES = {
    "plate": lambda sizes: scenes.plate(sizes.plate),
    "freeform": lambda sizes: scenes.freeform(sizes.freeform),
}
CAVITY_RADII = np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2])  # m
CAVITY_SPEEDS = {"at rest": 0.0, "slow": 0.02, "fast": 0.2}  # m/s


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Positions of fingers in a scene, and a call to make before each tick."""

    scene: Scene
    positions: np.ndarray  # (T, N, 3)
    radius: float = scenes.RADIUS
    settings: dict | None = None
    before: Callable[[int], object] = lambda _: None

    def tracker(self):
        """Return a new tracker for this motion."""
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
    return Motion(scene, positions, SKIN_RADIUS, SKIN_SETTINGS[JUDGED_SKIN])


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
    """Return a call for the motion of a hand's whole ticks over a surface."""

    def give(surface, hand_name, rise=0.0):
        if ("tick", surface) not in made:
            mesh = SURFACES[surface](sizes)
            made["tick", surface] = mesh, scenes.scene_of(mesh)
        _, scene = made["tick", surface]
        hand = next((hand for hand in motions.hands() if hand.name.startswith(hand_name)), None)
        if hand is None:
            leave_out(f"{hand_name}.csv", "the recording is not here (shared/data/hands beside the project)")
        positions = motions.ticks_of(hand, scene) + np.array([0.0, 0.0, rise])
        return Motion(scene, np.ascontiguousarray(positions[~np.isnan(positions).any(axis=(1, 2))][:TICKS]))

    return give


ROWS = [
    pytest.param(surface, hand, name, id=f"{surface}/{hand}-{name}")
    for surface in SURFACES
    for hand in HANDS
    for name in (kind.name for kind in registry.CONTENDERS if kind.name in ("proximity", *RIVALS))
    if hand == "generated" or name != SLOW
]


@pytest.mark.parametrize(("surface", "hand_name", "name"), ROWS)
def test_tick_of_a_hand(timed, made, hand_motion, contender, surface, hand_name, name):
    motion = hand_motion(surface, hand_name)
    mesh, scene = made["tick", surface]
    group = f"tick, {surface}/{hand_name}, {len(mesh[1]):,} faces, 5 fingers"
    if name == "proximity":
        check_ticks(motion)
        timed("proximity, a whole tick", group, **_ticks(motion))
        return
    asked = contender(name, f"tick {surface}", mesh)
    count = 50 if asked.query_limit else len(motion.positions)
    positions = motion.positions[:: max(1, len(motion.positions) // count)]
    case = cases.Case(surface, *mesh, positions[:20].reshape(-1, 3))
    answers = asked.signed_distance(case.points).answer()
    found = compare(case, answers, scene.signed_distance(case.points), "proximity", name)
    remark = f" ({found.off_count + found.wrong_sign_count} of {found.checked_count} wrong)"
    tasks = itertools.cycle([asked.signed_distance(tips).run for tips in positions])
    remark = remark if found.off_count + found.wrong_sign_count else ""
    timed(f"{name} {asked.version}, five distances alone{remark}", group, lambda: next(tasks)())


@pytest.mark.parametrize("surface", SURFACES)
def test_tick_beyond_the_working_range(timed, hand_motion, surface):
    motion = hand_motion(surface, "generated", OUT_OF_RANGE)
    faces = scenes.face_count(motion.scene)
    group = f"tick, {surface}/generated, {OUT_OF_RANGE} m above, {faces:,} faces, 5 fingers"
    timed("proximity, a whole tick", group, **_ticks(motion))


@pytest.mark.parametrize("name", CROWDS)
def test_tick_of_a_crowd(timed, sizes, name):
    motion = CROWDS[name](sizes)
    faces = scenes.face_count(motion.scene)
    check_ticks(motion)
    group = f"tick, {name}, {faces:,} faces, {motion.positions.shape[1]:,} fingers"
    timed("proximity, a whole tick", group, **_ticks(motion))


def check_ticks(motion, count=10):
    """Compare the bounds of some ticks, and their exact values, with exact distances."""
    tracker = motion.tracker()
    for k in range(count):
        motion.before(k)
        contacts = tracker.tick(motion.positions[k], k * scenes.PERIOD_NS, (k + 1) * scenes.PERIOD_NS)
        true = motion.scene.signed_distance(motion.positions[k]) - motion.radius
        tolerance = TOLERANCE * max(1.0, np.abs(true).max())
        assert (contacts["lower"] <= true + tolerance).all() and (true <= contacts["upper"] + tolerance).all()
        is_exact = (contacts["flags"] & ContactFlag.EXACT) != 0
        assert np.abs(contacts["signed_distance"] - true)[is_exact].max(initial=0.0) <= tolerance


def _ticks(motion):
    """Return the timed call of a service, and its arguments; parts move between two calls."""
    tracker, number = motion.tracker(), itertools.count()
    instants = np.zeros(len(tracker.contacts), np.int64)

    def arguments():
        k = next(number)
        motion.before(k)
        tips = np.ascontiguousarray(motion.positions[k % len(motion.positions)])
        instants.fill(k * scenes.PERIOD_NS)
        return (tips, instants, (k + 1) * scenes.PERIOD_NS), {}

    return {"run": tracker.advance, "arguments": arguments}
