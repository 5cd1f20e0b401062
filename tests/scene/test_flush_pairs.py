"""Parts with coincident faces, edges and corners, compared with counts of their unit cubes."""

import numpy as np
import pytest
from polycubes import TURNS, Polycube, depth_in, free_from, overlap, polycube

from proximity import ConnectionFlag, PartTracker, Pose, Scene, Solid
from proximity.scene.pairs import Relation

SHARING = (Relation.CROSSING, Relation.FIRST_INSIDE, Relation.SECOND_INSIDE)
AXES = np.concatenate([np.eye(3), -np.eye(3)])
ANY_TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


class Pair:
    """Two rotated and scaled polycubes in a scene; the first is displaced by multiples of half a cell."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.first, self.second = polycube(rng), polycube(rng)
        self.offset = rng.integers(-4, 5, 3) / rng.choice([1, 1, 2])
        self.turn = TURNS[rng.integers(len(TURNS))].astype(float)
        self.size = float(rng.choice([1e-3, 1.0, 64.0])) * np.linalg.norm(self.turn[0])
        self.turn /= np.linalg.norm(self.turn[0])
        self.pose = Pose(ANY_TURN * np.linalg.det(ANY_TURN), rng.normal(size=3)) if seed % 3 == 0 else Pose()
        vertices = self.first.mesh[0] + self.offset
        parts = [(vertices, self.first.mesh[1], "a"), (*self.second.mesh, "b")]
        self.scene = Scene(
            [Solid(self.size * points @ self.turn.T, faces, name=name) for points, faces, name in parts]
        )
        self.scene.move_many(["a", "b"], [self.pose, self.pose])

    def to_scene(self, axis: np.ndarray) -> np.ndarray:
        """Transform a grid axis to the scene's frame."""
        return self.pose.direction(self.turn @ axis)

    def to_grid(self, direction: np.ndarray) -> np.ndarray:
        """Transform a direction of the scene's frame to the grid's."""
        found = self.turn.T @ self.pose.inverse.direction(direction)
        return np.round(found) if np.allclose(found, np.round(found), atol=1e-9) else found


@pytest.mark.parametrize("seed", range(150))
def test_parts_cross_where_they_have_cells_in_common(seed):
    pair = Pair(seed)

    found = pair.scene.clearance("a", "b")

    assert (found.relation in SHARING) == overlap(pair.first, pair.second, pair.offset)


@pytest.mark.parametrize("seed", range(0, 150, 3))
def test_the_way_out_is_within_its_bounds(seed):
    pair = Pair(seed)
    for direction in (None, *map(pair.to_scene, AXES)):
        found = pair.scene.penetration("a", "b", direction=direction)
        true = pair.size * free_from(pair.first, pair.second, pair.offset, pair.to_grid(found.direction))
        room = 1e-9 * pair.size

        assert found.lower <= true + room
        assert true <= found.depth + room
        assert found.depth - found.lower <= 0.0101 * found.depth


@pytest.mark.parametrize("seed", range(1, 150, 3))
def test_the_deepest_point_is_where_sampled_points_say(seed):
    pair = Pair(seed)
    found = pair.scene.penetration("a", "b", direction=pair.to_scene(AXES[0]))
    spacing, true = 0.25, 0.0
    for corner in pair.second.cells:
        points = corner + np.stack(np.meshgrid(*[np.arange(0.0, 1.1, spacing)] * 3), axis=-1).reshape(-1, 3)
        depths = depth_in(pair.first, points - pair.offset), depth_in(pair.second, points)
        true = max(true, np.where(np.minimum(*depths) >= 0.0, np.maximum(*depths), 0.0).max())
    if not overlap(pair.first, pair.second, pair.offset):
        assert found.deepest == 0.0
        assert np.isnan(found.deepest_point).all()
        return

    assert found.deepest >= true * pair.size * (1.0 - 1e-9)
    assert found.deepest_lower <= (true + spacing * 0.75**0.5) * pair.size
    assert found.deepest <= found.deepest_lower * 1.0101 + 1e-6 * pair.size
    point = (pair.pose.inverse.point(found.deepest_point) @ pair.turn / pair.size)[None]
    depths = depth_in(pair.first, point - pair.offset)[0], depth_in(pair.second, point)[0]
    assert min(depths) >= 0.0
    assert max(depths) * pair.size >= found.deepest_lower * (1.0 - 1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_tracked_part_driven_in_along_flush_sides_is_never_free(seed):
    pair = Pair(3 * seed + 1)
    axis = AXES[seed % 6]
    away = free_from(pair.first, pair.second, pair.offset, -axis)
    tracker = PartTracker(pair.scene, "a", tolerance=0.05)
    for tick, step in enumerate(np.linspace(away + 0.5, away - 1.0, 61)):
        moved = -step * axis
        pose = Pose(pair.pose.rotation, pair.pose.translation + pair.size * pair.to_scene(moved))
        record = tracker.tick(pose, 10**9 + 10**6 * tick, 10**9 + 10**6 * tick)[0]
        is_sharing = overlap(pair.first, pair.second, pair.offset + moved)
        is_clear = overlap(pair.first, pair.second, pair.offset + moved, 1e-9)

        assert bool(record["flags"] & (ConnectionFlag.CROSSING | ConnectionFlag.INSIDE)) in (
            is_sharing,
            is_clear,
        )
        if is_clear:
            way = pair.to_grid(record["normal"])
            true = pair.size * free_from(pair.first, pair.second, pair.offset + moved, way)
            assert 0.0 < record["depth"] + 1e-9 * pair.size >= true
            assert record["depth_lower"] <= true + 1e-9 * pair.size


def test_cells_are_counted_as_they_are():
    one, other = (
        Polycube(np.array(cells), None) for cells in ([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [3, 0, 0]])
    )
    assert not overlap(one, other, np.array([1, 0, 0]))
    assert overlap(one, other, np.array([1.5, 0, 0]))
    assert free_from(one, other, np.zeros(3), np.array([1.0, 0, 0])) == 1.0
    assert free_from(one, other, np.array([0.5, 0, 0]), np.array([1.0, 0, 0])) == 0.5
    assert free_from(one, other, np.array([1.5, 0, 0]), np.array([1.0, 0, 0])) == 2.5
