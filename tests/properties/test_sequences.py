"""Random sequences of changes to scenes that share solids: every result is correct after each step.

Each sequence follows from one seed. The reference is the oracle on separate copies of the meshes.
"""

import copy
import pickle
from dataclasses import dataclass, replace

import judging
import numpy as np
import pytest
import shapes
from scene_parts import part_of, some_pose

import oracle
import proximity
from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

MESHES = [shapes.tetrahedron(), shapes.cube(), shapes.hollow_cube(), shapes.sphere(0.7, 2), shapes.grid(2, 1)]
STEPS = 30
FINGERS = 4
MANY = 9  # snapshots kept, as by slow queries of other threads: more than a scene has copies
BUDGETS = (3, 40, 10**6)


@dataclass(frozen=True)
class Shape:
    """The expected state of a part."""

    vertices: np.ndarray
    faces: np.ndarray
    pose: Pose
    is_hidden: bool = False

    @property
    def corners(self):
        return self.pose.point(self.vertices)

    def signed_distance(self, points):
        if len(self.faces) == 4 and not np.ptp(self.vertices[:, 2]):  # a sheet has no inside
            return oracle.closest(self.corners, self.faces, points).distance
        return judging.signed_distance(self.corners, self.faces, points)


class Cell:
    """A scene, its expected state, and its trackers."""

    def __init__(self, scene, known, rng):
        self.scene, self.known, self.rng, self.held = scene, known, rng, []
        self.trackers = [
            Tracker(scene, fingers=FINGERS, radius=0.1, budget=budget, working_range=reach)
            for budget, reach in zip(BUDGETS, (10.0, 0.5, 2.0), strict=True)
        ]

    def step(self, folder):
        """Apply a random change; return a copy of the scene if the change is copying."""
        rng, scene, known = self.rng, self.scene, self.known
        name = str(rng.choice(list(known)))
        shape, kind = known[name], int(rng.integers(10))
        if kind <= 2:
            known[name] = replace(shape, pose=some_pose(rng, 10.0 ** rng.uniform(0.0, 3.0)))
            scene.move(name, known[name].pose)
        elif kind == 3:
            (scene.show if shape.is_hidden else scene.hide)(name)
            known[name] = replace(shape, is_hidden=not shape.is_hidden)
        elif kind == 4 and len(known) > 1:
            solid = scene.part(name).solid
            scene.remove(name)
            del known[name]
            _assert_is_still(solid, shape)
        elif kind == 5 and len(known) < 9:
            part = replace(scene.part(name), name=f"part {rng.integers(10**9)}", pose=some_pose(rng, 2.0))
            scene.add(part)
            known[part.name] = replace(shape, pose=part.pose)
        elif kind <= 7:
            solid = scene.part(name).solid
            vertices = shape.vertices * 10.0 ** rng.uniform(-1.0, 1.0, 3) + rng.normal(size=3)
            scene.deform(name, vertices)
            known[name] = replace(shape, vertices=vertices)
            _assert_is_still(solid, shape)
        elif kind == 8:
            for _ in range(MANY):
                known[name] = replace(shape, pose=some_pose(rng, 2.0))
                scene.move(name, known[name].pose)
                self.held.append(scene.snapshot())
            self.held = self.held if rng.random() < 0.5 else []
        else:
            return Cell(self._copied(folder), dict(known), rng)
        return None

    def _copied(self, folder):
        way = int(self.rng.integers(3))
        if way == 0:
            return copy.copy(self.scene)
        if way == 1:
            return pickle.loads(pickle.dumps(self.scene))
        self.scene.save(folder / "cell.prox")
        return proximity.load(folder / "cell.prox")

    def judge(self, step):
        """Query the scene and tick the trackers."""
        rng = self.rng
        shapes_here = list(self.known.values())
        assert [part.name for part in self.scene.parts] == list(self.known)
        seen = [shape for shape in shapes_here if not shape.is_hidden]
        places = [rng.choice(rng.choice(shapes_here).corners) for _ in range(FINGERS)]
        points = np.array(places) + rng.normal(size=(FINGERS, 3)) * 10.0 ** rng.uniform(
            -3.0, 1.5, (FINGERS, 1)
        )
        true = np.min([shape.signed_distance(points) for shape in seen] or [np.full(FINGERS, np.inf)], axis=0)
        room = judging.allowance(
            true if seen else 0.0,
            points,
            *(shape.vertices for shape in shapes_here),
            *(shape.pose.translation for shape in shapes_here),
        )
        hit = self.scene.closest(points)
        assert judging.is_near(hit.signed_distance, true, room).all()
        assert judging.is_near(self.scene.signed_distance(points), true, room).all()
        self._judge_surface(hit.part, hit.face_id, hit.point, room)
        for tracker in self.trackers:
            told = tracker.tick(points, step * 10**6, step * 10**6)
            self._judge_surface(told["part"], told["face"], told["point_on_part"], room)
            assert (told["lower"] - room <= true - 0.1).all() and (true - 0.1 <= told["upper"] + room).all()
            is_exact = (told["flags"] & int(ContactFlag.EXACT)) != 0
            assert judging.is_near(told["signed_distance"], true - 0.1, room)[is_exact].all()

    def _judge_surface(self, parts, faces, points, room):
        """Check that points lie on the reported faces of visible parts."""
        room = np.broadcast_to(room, len(points))
        for row in np.flatnonzero(parts >= 0):
            shape = list(self.known.values())[parts[row]]
            assert not shape.is_hidden
            off = oracle.closest(shape.corners, shape.faces[[faces[row]]], points[row]).distance
            assert off <= room[row]


def _assert_is_still(solid, shape):
    """Check that a solid detached from its part keeps its shape."""
    points = shape.vertices[:5] + np.array([0.1, -0.2, 0.3])
    judging.assert_distance_is_right(solid.distance(points), shape.vertices, shape.faces, points)


@pytest.mark.parametrize("seed", range(5))
def test_any_sequence_of_changes_leaves_every_answer_true(seed, tmp_path):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    meshes = [MESHES[row] for row in rng.integers(0, len(MESHES), count)]
    parts = [part_of(mesh, f"part {row}", some_pose(rng, 2.0)) for row, mesh in enumerate(meshes)]
    known = {part.name: Shape(part.solid.mesh.vertices, part.solid.mesh.faces, part.pose) for part in parts}
    cells = [Cell(Scene(parts), known, rng)]
    for step in range(STEPS):
        made = cells[rng.integers(len(cells))].step(tmp_path)
        if made is not None:
            cells = [*cells[-2:], made]
        cells[rng.integers(len(cells))].judge(step)
