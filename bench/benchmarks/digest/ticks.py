"""Digests of a tracker's contact records over 100 000 ticks; instants are counted, no clock is read."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import proximity
from benchmarks.digest.scenes import bend_part, generator, hollow_ball, random_rotation, random_scene
from proximity import Pose, Scene, Tracker

PERIOD_NS = 1_000_000
WORK = "work"
"""Column of nodes and leaves visited: another search may change it without changing any answer."""
PATH_CORNERS = 5
Change = Callable[[Scene, int, np.random.Generator], None]


@dataclass(frozen=True, slots=True)
class TickCase:
    """A scene, fingers that move in it, and the settings of their tracker."""

    name: str
    make: Callable[[Path], Scene]
    finger_count: int
    tick_count: int
    settings: dict[str, Any] = field(default_factory=dict)
    has_paths: bool = False
    has_velocities: bool = False
    reach: float = 1.0  # distance of the fingers from the middle of the scene: 1 is slightly beyond its box
    change: Change | None = None  # a change of the scene before a tick


def digests_of_ticks(meshes: Path, tracker_of: Any = Tracker) -> Iterator[tuple[str, str, str]]:
    """Yield the name of each case, the digest of its records without `WORK`, and that of `WORK`.

    *tracker_of*: makes a tracker; that of the library in C cannot deform parts.
    """
    for case in CASES:
        if tracker_of is Tracker or case.change is not change_parts:
            yield f"ticks/{case.name}", *digests_of_case(case, meshes, tracker_of)


def digests_of_case(case: TickCase, meshes: Path, tracker_of: Any = Tracker) -> tuple[str, str]:
    """Return the digest of a case's records without `WORK`, and that of `WORK`."""
    rng, scene = generator(case.name), case.make(meshes)
    tracker = tracker_of(scene, fingers=case.finger_count, **case.settings)
    positions = motion(scene, case, rng)
    answers, work = hashlib.sha256(), hashlib.sha256()
    now_ns = 1_000_000_000
    for number, tips in enumerate(positions):
        if case.change is not None:
            case.change(scene, number, rng)
        now_ns += PERIOD_NS
        pose_ns = instant_of(number, now_ns)
        contacts = tracker.tick(tips, pose_ns, now_ns, **_extras(case, positions, number)).copy()
        work.update(contacts[WORK].tobytes())
        contacts[WORK] = 0
        answers.update(contacts.tobytes())
        if number % 5000 == 4999:
            tracker.reset()
    return answers.hexdigest(), work.hexdigest()


def motion(scene: Scene, case: TickCase, rng: np.random.Generator) -> np.ndarray:
    """Return fingers that swing through a scene; at times one is lost, rests, or jumps, (T, N, 3) m."""
    lower, upper = scene.bounds
    finger_count, tick_count = case.finger_count, case.tick_count
    middle, reach = 0.5 * (lower + upper), case.reach * (0.5 * (upper - lower) + 0.02)
    t = 1e-9 * PERIOD_NS * np.arange(tick_count)[:, None, None]
    rates, phases = rng.uniform(0.3, 4.0, (2, finger_count, 3)), rng.uniform(0.0, 6.0, (2, finger_count, 3))
    swing = 0.8 * np.sin(rates[0] * t + phases[0]) + 0.3 * np.sin(3.0 * rates[1] * t + phases[1])
    positions = middle + reach * swing
    for finger in range(finger_count):
        for _ in range(max(1, tick_count // 3000)):
            first, length = rng.integers(0, tick_count), rng.integers(1, 60)
            positions[first : first + length, finger] = np.nan
        still, jump = rng.integers(0, tick_count, 2)
        positions[still : still + 100, finger] = positions[still, finger]
        positions[jump : jump + 20, finger] += 0.05
    return positions


def instant_of(number: int, now_ns: int) -> int:
    """Return the instant of a pose: mostly the last period, sometimes the same again, older, or long ago."""
    if number % 7 == 3:
        return now_ns - 2 * PERIOD_NS
    if number % 501 == 500:
        return now_ns - 80 * PERIOD_NS
    return now_ns - PERIOD_NS


def _extras(case: TickCase, positions: np.ndarray, number: int) -> dict[str, Any]:
    """Return velocities and paths of a tick, from the motion itself."""
    found: dict[str, Any] = {}
    later = positions[min(number + 1, len(positions) - 1)]
    if case.has_velocities and number % 3:
        found["velocities"] = (later - positions[number]) / (1e-9 * PERIOD_NS)
    if case.has_paths and number % 11:
        share = np.linspace(-0.5, 1.0, PATH_CORNERS)[:, None]
        toward = np.array([0.01, -0.02, -0.04]) * share + np.array([0.0, 0.01, 0.0]) * share * share
        found["paths"] = positions[number][:, None] + toward
        if number % 2:
            found["path_bends"] = np.array([0.0, 0.2, 0.5, 0.7, 1.0])
            found["bends"] = np.full(len(later), 0.33 + 0.1 * np.sin(0.01 * number))
    return found


def move_parts(scene: Scene, number: int, rng: np.random.Generator) -> None:
    """Move every fifth part, with velocities; most ticks."""
    if number % 4 == 3:
        return
    parts = scene.parts[::5]
    angle = 0.002 * number
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    swing = np.array([0.0, 0.0, 1e-4 * np.cos(0.01 * number)])
    poses = [Pose(turn, part.pose.translation + swing) for part in parts]
    velocities = np.tile(swing / (1e-9 * PERIOD_NS), (len(parts), 1))
    scene.move_many(
        [part.name for part in parts], poses, velocities, np.tile([0.0, 0.0, 2.0], (len(parts), 1))
    )


def change_parts(scene: Scene, number: int, rng: np.random.Generator) -> None:
    """Every 50 ticks hide, show, deform or move one of the parts, or change its surface."""
    if number % 50:
        return
    names = [part.name for part in scene.parts]
    name, turn = names[number // 50 % len(names)], number // 50 % 5
    if turn == 0:
        scene.hide(name)
    elif turn == 1:
        scene.show(names[(number // 50 - 1) % len(names)])
    elif turn == 2:
        bend_part(scene, name, 0.002, 80.0)
    elif turn == 3:
        scene.move(name, Pose(random_rotation(rng), scene.part(name).pose.translation))
    else:
        scene.set_surface(name, stiffness=float(rng.uniform(100.0, 2000.0)), damping=0.5)


def _file(name: str) -> Callable[[Path], Scene]:
    return lambda meshes: proximity.load(meshes / name)


def _hollow(_: Path) -> Scene:
    return hollow_ball(0.1)


def _parts(part_count: int) -> Callable[[Path], Scene]:
    return lambda _: random_scene(generator(f"{part_count} parts"), part_count, 0.04)


CASES = (
    TickCase("bracket, 1 finger", _file("bracket.stl"), 1, 20_000),
    TickCase("bracket, 5 fingers", _file("bracket.stl"), 5, 20_000, {"latency": 0.004}),
    TickCase("gear, 5 fingers, budget 8", _file("gear.stl"), 5, 15_000, {"budget": 8}, has_velocities=True),
    TickCase("assembly, 5 fingers, paths", _file("assembly.glb"), 5, 12_000, has_paths=True),
    TickCase("30 parts moving, 5 fingers, paths", _parts(30), 5, 12_000, has_paths=True, change=move_parts),
    TickCase("30 parts changing, 5 fingers", _parts(31), 5, 8_000, has_velocities=True, change=change_parts),
    TickCase(
        "60 parts moving, 1 finger, budget 12", _parts(60), 1, 6_000, {"budget": 12}, change=move_parts
    ),
    TickCase("bracket, 300 fingers, tolerance 5 %", _file("bracket.stl"), 300, 2_000, {"tolerance": 0.05}),
    TickCase(
        "30 parts moving, 200 fingers, short range", _parts(30), 200, 1_000,
        {"tolerance": 0.05, "working_range": 0.02, "horizon": 0.01}, change=move_parts,
    ),
    TickCase("hollow ball, 5 fingers, all", _hollow, 5, 500, {"budget": 10**6}, reach=0.05),
    TickCase("hollow ball, 5 fingers", _hollow, 5, 3_500, {"radius": 0.0}, reach=0.05),
)  # fmt: skip
"""100 000 ticks in all."""
