"""Clearances over whole motions: formulas, fine stepping as the reference, and the first touch."""

import numpy as np
import pytest
import shapes

from proximity import ArgumentError, Motion, Pose, Scene, SceneError, Solid

STEPS = 400


def scene_of(*boxes):
    """Boxes, each given by two corners, named a, b, …"""
    return Scene([Solid(*shapes.box(*box), name=name) for name, box in zip("abcdef", boxes, strict=False)])


def fine(scene, part, poses, others=None):
    """The distance of a part at each pose, of a copy of the scene."""
    copy = Scene(
        [Solid(each.solid.mesh.vertices, each.solid.mesh.faces, name=each.name) for each in scene.parts]
    )
    for each in scene.parts:
        copy.move(each.name, each.pose)
    found = []
    for pose in poses:
        copy.move(part, pose)
        pairs = copy.closest_pairs(of=part)
        found.append(min(pair.distance for pair in pairs if others is None or {*pair[:2]} & {*others}))
    return np.array(found)


def test_slide_past_a_box_comes_as_near_as_the_formula_says():
    scene = scene_of(([0, 0, 0], [1, 1, 1]), ([-3, 1.25, 0], [-2, 2.25, 1]))

    found = scene.clearance_along("b", Motion.slide([2, 0, 0], 0.0, 6.0))

    assert found.distance == pytest.approx(0.25, abs=1e-12)
    assert 0.25 * 0.95 - 1e-5 <= found.lower <= 0.25
    assert 1.0 <= found.position <= 5.0 and found.first_touch is None and found.is_complete
    assert (found.nearest.first, found.nearest.second) == ("b", "a")
    assert scene.part("b").pose.matrix.tolist() == np.eye(4).tolist()


def test_hinge_turns_counter_clockwise_and_touches_where_the_formula_says():
    # A bar along x from the origin meets a wall at x = 1 … when its end, at radius 2, comes to that x.
    scene = scene_of(([0, -0.0, 0], [2, 0.001, 1]), ([-1.0, 1.0, 0], [2.5, 1.5, 1]))

    found = scene.clearance_along("a", Motion.hinge([0, 0, 0], [0, 0, 1], 0.0, 1.5))

    free, touches = found.first_touch
    # The corner (2, 0.001) reaches y = 1.
    angle = np.arcsin(1.0 / np.hypot(2.0, 0.001)) - np.arctan2(0.001, 2.0)
    assert free <= angle <= touches + 1e-12
    assert touches - free < 1e-4 and found.distance == found.lower == 0.0


def test_path_through_poses_is_measured_between_them():
    """A part that passes through a wall between two poses: no sampled pose of the user touches it."""
    scene = scene_of(([-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]), ([1.999, -3, -3], [2.0, 3, 3]))
    poses = [Pose(None, [0, 0, 0]), Pose(None, [4, 0, 0])]

    found = scene.clearance_along("a", Motion.through(poses, [10.0, 14.0]))

    free, touches = found.first_touch
    assert free <= 10.0 + 1.499 <= touches <= free + 1e-4
    assert min(fine(scene, "a", poses)) > 1.0


def random_motion(random, scene, part):
    """A motion of any kind, and its pose at a share of it."""
    begin = scene.part(part).pose
    kind = random.integers(3)
    if kind == 0:
        direction = random.normal(size=3)
        first, last = random.uniform(-1.0, 1.0, 2)
        along = direction / np.linalg.norm(direction)
        return Motion.slide(direction, first, last), lambda share: Pose(
            begin.rotation, begin.translation + (first + share * (last - first)) * along
        )
    if kind == 1:
        point, axis = random.uniform(-1, 1, 3), random.normal(size=3)
        first, last = random.uniform(-4.0, 4.0, 2)

        def turned(share):
            turn = rotation_about(axis, first + share * (last - first))
            return Pose(turn @ begin.rotation, point + turn @ (begin.translation - point))

        return Motion.hinge(point, axis, first, last), turned
    poses = [Pose(shapes.rotation(int(random.integers(1000))), random.uniform(-1, 1, 3)) for _ in range(3)]
    motion = Motion.through(poses)
    corners = scene.part(part).solid.mesh.vertices
    spans = motion.spans(begin, 0.5 * (corners.min(axis=0) + corners.max(axis=0)))
    return motion, lambda share: spans[int(share >= 0.5)].pose_at(2.0 * share)


def rotation_about(axis, angle):
    """By quaternions, where the engine has Rodrigues' formula."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return Pose.from_quaternion([*(np.sin(angle / 2) * axis), np.cos(angle / 2)]).rotation


@pytest.mark.parametrize("seed", range(40))
def test_bounds_hold_against_fine_steps(seed):
    random = np.random.default_rng(seed)
    vertices, faces = shapes.octahedron(0.4)
    scene = Scene(
        [
            Solid(vertices, faces, name="a"),
            Solid(*shapes.cube(0.6), name="b"),
            Solid(*shapes.torus(0.6, 0.1, 12, 6), name="c"),
        ]
    )
    scene.move("a", Pose(shapes.rotation(seed), random.uniform(-1, 1, 3)))
    scene.move("c", Pose(shapes.rotation(seed + 1), random.uniform(-1.5, 1.5, 3)))
    motion, pose_at = random_motion(random, scene, "a")

    found = scene.clearance_along("a", motion)

    shares = np.linspace(0.0, 1.0, STEPS + 1)
    stepped = fine(scene, "a", [pose_at(share) for share in shares])
    assert found.lower <= stepped.min() + 1e-12
    assert found.is_complete and found.lower >= 0.95 * found.distance - 2e-5
    positions = motion.first + shares * (motion.last - motion.first)
    order = np.argsort(found.positions)
    nearest = np.interp(positions, found.positions[order], found.distances[order])
    for k, position in enumerate(found.positions):
        share = (position - motion.first) / (motion.last - motion.first)
        if k % 10 == 0:
            assert found.distances[k] == pytest.approx(fine(scene, "a", [pose_at(share)])[0], abs=1e-9)
    assert nearest.min() >= found.distance
    for k, bound in enumerate(found.bounds):
        low, high = sorted(found.positions[k : k + 2])
        within = (positions >= low) & (positions <= high)
        assert not within.any() or stepped[within].min() >= bound - 1e-12
    if found.first_touch is None:
        assert found.distance > 0.0
    else:
        sense = np.sign(motion.last - motion.first)
        free, touches = found.first_touch
        before = sense * positions < sense * free
        assert not before.any() or stepped[before].min() > 0.0
        share = (touches - motion.first) / (motion.last - motion.first)
        assert fine(scene, "a", [pose_at(share)])[0] == 0.0


def test_gap_along_an_axis_is_that_of_the_formula():
    scene = scene_of(([0, 0, 0], [1, 1, 1]), ([0.5, 0.5, 3], [1.5, 1.5, 4]), ([5, 0, 0], [6, 1, 1]))

    for first, second, direction, expected in (
        ("a", "b", [0, 0, 2], 2.0),
        ("b", "a", [0, 0, -1], 2.0),
        ("a", "c", [1, 0, 0], 4.0),
        ("a", "b", [0, 0, -1], np.inf),  # it moves away
        ("a", "c", [0, 0, 1], np.inf),  # it passes
        ("a", "b", [0.0, 0.2, 1.0], 2.0 * np.hypot(0.2, 1.0)),
    ):
        found = scene.gap(first, second, direction)
        assert found.lower <= expected <= found.distance
        assert found.lower == pytest.approx(expected, abs=1e-4)
        assert (found.first, found.second) == (first, second)
        assert np.linalg.norm(found.direction) == pytest.approx(1.0)


def test_gap_of_parts_that_overlap_is_the_way_back():
    scene = scene_of(([0, 0, 0], [1, 1, 1]), ([0.7, 0.1, 0.1], [2, 0.9, 0.9]), ([1, 0, 3], [2, 1, 4]))

    found = scene.gap("a", "b", [1, 0, 0])

    assert found.lower <= -0.3 <= found.distance
    assert found.distance == pytest.approx(-0.3, rel=0.02)
    scene.move("c", Pose(None, [-1, 0, -2]))
    touching = scene.gap("a", "c", [0, 0, 1])
    assert touching.distance == touching.lower == 0.0
    with pytest.raises(SceneError, match="gap of 'a' to itself"):
        scene.gap("a", 0, [1, 0, 0])
    with pytest.raises(ArgumentError, match="direction is"):
        scene.gap("a", "b", [0, 0, 0])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, 2.0, np.pi - 1e-9, np.pi])
def test_a_path_ends_at_its_poses(angle):
    random = np.random.default_rng(7)
    for axis in (*np.eye(3), *random.normal(size=(20, 3))):
        begin = Pose(shapes.rotation(3), random.normal(size=3))
        finish = Pose(rotation_about(axis, angle) @ begin.rotation, random.normal(size=3))

        (span,) = Motion.through([begin, finish]).spans(begin, random.normal(size=3))

        for position, pose in ((0.0, begin), (1.0, finish)):
            np.testing.assert_allclose(span.pose_at(position).matrix, pose.matrix, atol=1e-14)
        half = span.pose_at(0.5).rotation @ begin.rotation.T
        np.testing.assert_allclose(half @ half, finish.rotation @ begin.rotation.T, atol=1e-14)


def test_other_parts_are_those_that_are_named_and_visible():
    scene = scene_of(([0, 0, 0], [1, 1, 1]), ([0, 0, 1], [1, 1, 2]), ([0, 0, 2.5], [1, 1, 3]))
    slide = Motion.slide([1, 0, 0], 0.0, 0.5)

    assert scene.clearance_along("b", slide).nearest.second == "a"
    assert scene.clearance_along("b", slide, others=["c"]).distance == pytest.approx(0.5)
    scene.hide("a")
    assert scene.clearance_along("b", slide).nearest.second == "c"
    with pytest.raises(SceneError, match="no other visible part to measure 'b' to"):
        scene.clearance_along("b", slide, others=["a"])


def test_search_ends_as_soon_as_a_limit_is_decided():
    scene = scene_of(([0, 0, 0], [1, 1, 1]), ([-3, 1.02, 0], [-2, 2, 1]))
    slide = Motion.slide([1, 0, 0], 0.0, 6.0)

    whole = scene.clearance_along("b", slide)
    decided = scene.clearance_along("b", slide, below=0.5)

    assert decided.distance < 0.5 and len(decided.positions) < len(whole.positions)
    assert scene.clearance_along("b", slide, below=0.015).lower >= 0.015


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Motion.hinge([0, 0], [0, 0, 1], 0, 1), r"point is \[0, 0\], expected three finite numbers"),
        (
            lambda: Motion.hinge([0, 0, 0], [0, 0, 0], 0, 1),
            r"axis is \[0, 0, 0\], expected three numbers, not all",
        ),
        (lambda: Motion.slide([0, 0, 1], 1, 1), "from 1 to 1, expected two finite numbers that differ"),
        (lambda: Motion.slide([0, 0, 1], 0, np.inf), "expected two finite numbers"),
        (lambda: Motion.through([Pose()]), "expected two objects of type Pose or more"),
        (lambda: Motion.through([Pose(), Pose()], [1, 1]), "expected 2 ascending numbers"),
    ],
)
def test_motion_that_is_none_is_refused(make, message):
    with pytest.raises(ArgumentError, match=message):
        make()
