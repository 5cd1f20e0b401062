"""Axes of growth: faces, parts, points of a call, distance, and the worst positions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.growth import inputs
from benchmarks.growth.samples import Curve, sizes_that_fit, time_builds, time_each, time_ticks
from benchmarks.growth.work import work_of_points, work_of_rays
from benchmarks.queries.cases import FINGERS
from benchmarks.ticks import motions
from benchmarks.ticks.scenes import PERIOD_NS, RADIUS, scene_of
from proximity import Scene, Tracker

FIVE_POINTS, FIVE_RAYS = "five signed points", "five rays"
ON_SURFACE = 1e-6  # of the diagonal
MOVING_SHARE = 10  # number of parts per moving one
ONE_MESH = 100_000  # faces, for the other axes
KEPT_SHARE = 0.9  # a point counts if its distance is at least this share of the wanted one
MIN_POINTS = 50
MIN_BATCHES = 5
BRACKET = "bracket", "% of the distance"
BRACKET_INSIDE = "finger inside a full ball", *BRACKET


@dataclass(frozen=True, slots=True)
class GrowthSizes:
    """Ends of the axes, and numbers of samples."""

    faces: tuple[int, ...]
    parts: tuple[int, ...]
    points: tuple[int, ...]
    distances: tuple[float, ...]  # of the diagonal
    balls: tuple[int, ...]  # subdivisions of an icosahedron's faces
    budgets: tuple[int, ...]
    ticks: int
    calls: int
    exact_calls: int  # at the centre of a ball, where each takes long


def _thirds(first: int, last: int) -> tuple[int, ...]:
    """10^first, 3 · 10^first, 10^(first + 1), … 10^last."""
    return (*(step * 10**power for power in range(first, last) for step in (1, 3)), 10**last)


def _decades(first: int, last: int, steps: int) -> tuple[float, ...]:
    return tuple(np.logspace(first, last, steps * (last - first) + 1).tolist())


FULL = GrowthSizes(
    faces=_thirds(3, 7),
    parts=_thirds(0, 3),
    points=_thirds(0, 5),
    distances=_decades(-6, 1, 2),
    balls=(3, 4, 5, 6, 7, 8),
    budgets=(100, 200, 500, 1000, 2000, 5000, 10_000),
    ticks=4000,
    calls=2000,
    exact_calls=15,
)
QUICK = GrowthSizes(
    faces=_thirds(3, 5),
    parts=(1, 10, 30, 100, 300),
    points=_thirds(0, 4),
    distances=_decades(-6, 1, 1),
    balls=(3, 4, 5, 6),
    budgets=(100, 200, 500, 1000),
    ticks=1000,
    calls=300,
    exact_calls=20,
)
SMALL = GrowthSizes((300, 600, 1200), (1, 3), (1, 64), (1e-3, 1.0), (1, 2), (50, 500), 30, 10, 3)
"""Sizes for the smoke test, whose figures are meaningless."""


def measure_faces(sizes: GrowthSizes) -> Curve:
    """Measure one part with growing numbers of faces: ticks, points, rays, building, memory."""
    curve, hand = Curve("faces"), None
    for size in sizes_that_fit(curve, sizes.faces):
        mesh = inputs.ring(size)
        count = len(mesh[1])
        scene, built = time_builds(lambda mesh=mesh: scene_of(mesh))
        hand = inputs.recorded_hand(mesh)[: sizes.ticks] if hand is None else hand
        _add_ticks(curve, "tick of five fingers", count, scene, hand)
        _add_points(curve, f"{FIVE_POINTS}, near", count, scene, inputs.near(mesh, sizes.calls))
        points, normals = inputs.on_surface(mesh, FINGERS * sizes.calls, seed=5)
        points += ON_SURFACE * inputs.diagonal(mesh) * normals
        _add_points(curve, f"{FIVE_POINTS}, on the surface", count, scene, inputs.fives(points))
        _add_rays(curve, FIVE_RAYS, count, scene, *inputs.rays(mesh, sizes.calls))
        curve.add("solid and scene", "building", "s", count, built / 1e9)
        curve.add("scene", "memory", "bytes", count, np.array([scene.memory_bytes]))
    return curve


def measure_parts(sizes: GrowthSizes) -> Curve:
    """Measure growing numbers of parts around a hand: at rest, and a tenth moved before each tick."""
    curve = Curve("parts")
    for count in sizes.parts:
        scene = inputs.lattice(count)
        hand = inputs.wandering_hand(scene, sizes.ticks)
        _add_ticks(curve, "tick, all at rest", count, scene, hand)
        calls = np.ascontiguousarray(hand[:: max(1, len(hand) // sizes.calls)])
        curve.add_time(FIVE_POINTS, count, time_each(_calls(scene.signed_distance, calls)))
        curve.add_work(FIVE_POINTS, count, work_of_points(scene, calls).sum(axis=1))
        directions = np.roll(calls, 1, axis=1) - calls
        curve.add_time(FIVE_RAYS, count, time_each(_calls(scene.cast, calls, directions)))

        motion = motions.moving_parts(scene, max(1, count // MOVING_SHARE), len(hand))
        move = _mover(scene, motion)
        _add_ticks(curve, "tick, 10 % moving", count, scene, hand, move)
        moves = [lambda k=k, move=move: move(k) for k in range(len(calls))]
        curve.add_time("move_many of 10 %", count, time_each(moves))
    return curve


def measure_points(sizes: GrowthSizes) -> Curve:
    """Measure growing numbers of points or rays in one call, at one part."""
    curve = Curve("points")
    mesh = inputs.ring(min(ONE_MESH, sizes.faces[-1]))
    scene = scene_of(mesh)
    total = max(sizes.calls, 2 * sizes.points[-1])
    points = inputs.near(mesh, -(-total // FINGERS)).reshape(-1, 3)
    origins, directions = (each.reshape(-1, 3) for each in inputs.rays(mesh, -(-total // FINGERS)))
    for count in sizes.points:
        calls = range(max(MIN_BATCHES, min(sizes.calls, total // count)))
        rows = [np.arange(k * count, (k + 1) * count) % total for k in calls]
        asked = {
            "signed_distance": _calls(scene.signed_distance, [points[own] for own in rows]),
            "closest": _calls(scene.closest, [points[own] for own in rows]),
            "cast": _calls(scene.cast, [origins[own] for own in rows], [directions[own] for own in rows]),
        }
        for series, each in asked.items():
            nanoseconds = time_each(each)
            curve.add_time(series, count, nanoseconds)
            curve.add(series, "time a point", "µs", count, nanoseconds / 1e3 / count)
    return curve


def measure_distance(sizes: GrowthSizes) -> Curve:
    """Measure points at growing distances, outside and inside; fingers there, their track kept or not."""
    curve = Curve("distance")
    mesh = inputs.ring(min(ONE_MESH, sizes.faces[-1]))
    scene = scene_of(mesh)
    for side, sign in (("outside", 1.0), ("inside", -1.0)):
        for share in sizes.distances:
            wanted = share * inputs.diagonal(mesh)
            points, normals = inputs.on_surface(mesh, 2 * FINGERS * sizes.calls, seed=7)
            points += sign * wanted * normals
            points = points[sign * scene.signed_distance(points) >= KEPT_SHARE * wanted][
                : FINGERS * sizes.calls
            ]
            if len(points) < MIN_POINTS:
                curve.left_out.append(
                    f"Distances from {share:.2g} diagonals on {side} are left out: "
                    f"only {len(points)} of the points are that far from the surface."
                )
                break
            hands = inputs.fives(points)
            _add_points(curve, f"{FIVE_POINTS}, {side}", share, scene, hands)
            if sign > 0.0:
                _add_tracks(curve, share, scene, hands)
    return curve


def measure_centre(sizes: GrowthSizes) -> Curve:
    """Measure the centre of a ball, equally far from all faces: an exact point, and a finger."""
    curve, points = Curve("centre"), _about_centre(sizes.calls)
    exact = points[: sizes.exact_calls]
    for subdivisions in sizes.balls:
        mesh = inputs.hollow_ball(subdivisions)
        count, scene = len(mesh[1]), scene_of(mesh)
        curve.add_time("exact signed_distance", count, time_each(_calls(scene.signed_distance, exact)))
        curve.add_work("exact signed_distance", count, work_of_points(scene, exact))
        _add_bracket(curve, "finger, default budget", count, *_bracket(scene, points))
        inside = scene_of(inputs.ball(subdivisions))
        _, _, widths = _bracket(inside, exact)
        curve.add(*BRACKET_INSIDE, count, 100.0 * widths)
    return curve


def measure_budget(sizes: GrowthSizes) -> Curve:
    """Measure the centre of the largest hollow ball, with growing budgets: the cost of certainty."""
    curve = Curve("budget")
    scene = scene_of(inputs.hollow_ball(sizes.balls[-1]))
    for budget in sizes.budgets:
        points = _about_centre(max(sizes.exact_calls, sizes.calls // 10))
        found = _bracket(scene, points, budget)
        _add_bracket(curve, "finger in the centre of a hollow ball", budget, *found)
    return curve


MEASURES: dict[str, Callable[[GrowthSizes], Curve]] = {
    "faces": measure_faces,
    "parts": measure_parts,
    "points": measure_points,
    "distance": measure_distance,
    "centre": measure_centre,
    "budget": measure_budget,
}


def _calls(ask, *arrays):
    """Return a call for each row of arrays."""
    return [lambda rows=rows: ask(*rows) for rows in zip(*arrays, strict=True)]


def _add_points(curve, series, x, scene, hands):
    curve.add_time(series, x, time_each(_calls(scene.signed_distance, hands)))
    curve.add_work(series, x, work_of_points(scene, hands).sum(axis=1))


def _add_rays(curve, series, x, scene, origins, directions):
    curve.add_time(series, x, time_each(_calls(scene.cast, origins, directions)))
    curve.add_work(series, x, work_of_rays(scene, origins, directions)[0].sum(axis=1))


def _add_ticks(curve, series, x, scene, hand, before=None):
    nanoseconds, work = time_ticks(scene, hand, before, radius=RADIUS)
    curve.add_time(series, x, nanoseconds)
    curve.add_work(series, x, work)


def _mover(scene: Scene, motion: motions.PartMotion) -> Callable[[int], None]:
    def move(k: int) -> None:
        k %= len(motion.poses)
        scene.move_many(motion.names, motion.poses[k], motion.velocities[k], motion.angular_velocities[k])

    return move


def _add_tracks(curve, share, scene, hands):
    """Add ticks of hands at rest: the first of a track, and the fourth."""
    tracker, first, fourth = Tracker(scene, radius=RADIUS), [], []
    for hand in hands:
        tracker.reset()
        calls = [
            lambda k=k, hand=hand: tracker.tick(hand, k * PERIOD_NS, (k + 1) * PERIOD_NS) for k in range(4)
        ]
        for k, call in enumerate(calls):
            call()
            if k == 0:
                first.append(tracker.contacts["work"].sum())
        fourth.append(tracker.contacts["work"].sum())
    curve.add_work("tick, nothing known", share, np.array(first))
    curve.add_work("tick, track kept", share, np.array(fourth))


def _about_centre(count: int) -> np.ndarray:
    """Return points within rounding error of a ball's centre, relative to its surface, (count, 3)."""
    return np.random.default_rng(9).normal(0.0, 1e-6 * inputs.BALL_RADIUS, (count, 3))


def _bracket(scene, points, budget=None):
    """Return times (ns), work, and widths of brackets as shares of the distance, of first ticks."""
    tracker = Tracker(scene, fingers=1, radius=0.0, budget=budget)
    calls, found = [], []
    for point in points:
        tracker.reset()
        contact = tracker.tick(point[None], 0, PERIOD_NS)[0]
        found.append((contact["work"], (contact["upper"] - contact["lower"]) / abs(contact["lower"])))
        calls.append(lambda point=point: (tracker.reset(), tracker.tick(point[None], 0, PERIOD_NS)))
    work, widths = np.array(found).T
    return time_each(calls), work, widths


def _add_bracket(curve, series, x, nanoseconds, work, widths):
    curve.add_time(series, x, nanoseconds)
    curve.add_work(series, x, work)
    curve.add(series, *BRACKET, x, 100.0 * widths)
