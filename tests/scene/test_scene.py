"""Scenes: the minimum over the parts, at any poses."""

import re
from dataclasses import replace

import judging
import numpy as np
import pytest
import shapes
from scene_parts import KINDS, part_of, some_parts

import oracle
from proximity.errors import PoseError, SceneError
from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

QUARTER = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def expected_of(parts, points):
    """Signed distances of every part (P, N), by the oracle in the part's own frame."""
    answers = []
    for part in parts:
        own = part.pose.inverse.point(points)
        mesh = part.solid.mesh
        answers.append(judging.signed_distance(mesh.vertices, mesh.faces, own))
    return np.array(answers)


def assert_is_the_smallest_over_parts(scene, points):
    """Compare signed distance, containment and unsigned distance with the oracle's results per part."""
    each = expected_of(scene.parts, points)
    # Poses are applied in double precision, which rounds coordinates once more.
    room = 1e-12 * np.abs(each).max() + 4e-15 * max(np.abs(points).max(), 1.0)
    hit = scene.closest(points)
    assert np.abs(hit.signed_distance - each.min(axis=0)).max() <= room
    assert judging.same_bits(scene.signed_distance(points), hit.signed_distance)
    assert np.abs(scene.distance(points) - np.abs(each).min(axis=0)).max() <= room
    is_clear = np.abs(each).min(axis=0) > room
    assert np.array_equal(scene.contains(points)[is_clear], (each < 0.0).any(axis=0)[is_clear])
    chosen = each[hit.part, np.arange(len(points))]
    assert np.abs(chosen - each.min(axis=0)).max() <= room
    return hit


@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "shifted"])
@pytest.mark.parametrize("count", [1, 9, 40])
def test_answer_is_the_smallest_over_parts(count, is_turned):
    parts = some_parts(count, is_turned=is_turned)
    scene = Scene(parts)
    rng = np.random.default_rng(2)
    point_count = 100
    around = rng.uniform(-1.2, 1.2, (point_count, 3)) * (2.0 * count ** (1.0 / 3.0) + 1.0)
    # Include points near surfaces: a point of a part, slightly displaced.
    chosen = rng.integers(count, size=point_count)
    near = np.array(
        [parts[row].pose.point(parts[row].solid.mesh.vertices[[0, 1, 2]].mean(axis=0)) for row in chosen]
    )
    near += rng.choice([0.0, 1e-9, 1e-3], (point_count, 1)) * rng.normal(size=(point_count, 3))
    assert_is_the_smallest_over_parts(scene, np.concatenate([around, near]))


@pytest.mark.parametrize("count", [3, 64])
def test_answer_holds_together_in_the_frame_of_the_scene(count):
    scene = Scene(some_parts(count))
    points = np.random.default_rng(3).uniform(-8.0, 8.0, (300, 3))
    hit = scene.closest(points)
    for row, part in enumerate(scene.parts):
        of_part = hit.part == row
        if of_part.any():
            one = scene.closest(points[of_part])
            world = part.pose.point(part.solid.mesh.vertices)
            judging.assert_answer_holds_together(one, world, part.solid.mesh.faces, points[of_part])


@pytest.mark.parametrize("count", [9])
def test_scene_answers_to_the_bit_what_the_nearest_part_does(count):
    """The identity pose needs no conversion, so that no rounding may occur."""
    rng = np.random.default_rng(4)
    solids = [
        Solid(*shapes.moved(KINDS[row % 4](), rng.uniform(-6.0, 6.0, 3)), name=f"{row}")
        for row in range(count)
    ]
    points = rng.uniform(-7.0, 7.0, (200, 3))
    alone = np.array([solid.signed_distance(points) for solid in solids])
    hit = Scene(solids).closest(points)
    assert np.array_equal(hit.signed_distance, alone.min(axis=0))
    assert np.array_equal(hit.part, alone.argmin(axis=0))


def test_solid_answers_the_same_after_it_joined_a_scene():
    """A scene copies the arrays of its parts into its own memory, which the parts then share."""
    solid, points = Solid(*shapes.torus()), np.random.default_rng(5).uniform(-3.0, 3.0, (100, 3))
    before = solid.closest(points)
    first = Scene([solid, Solid(*shapes.cube(), name="other")])
    second = Scene([part_of(shapes.cube(), "other"), solid])
    assert judging.same_bits(solid.closest(points), before)
    assert judging.same_bits(first.distance(points), second.distance(points))


def cube(name, size=1.0, center=None):
    return Solid(*(shapes.cube(size) if center is None else shapes.cube(size, center)), name=name)


def sheet(height):
    return Solid(*shapes.moved(shapes.grid(1, 1), (0.0, 0.0, height)), name="sheet")


PLACED, ROWS = Solid(*shapes.cube()), np.arange(12, dtype=np.int32)
INNER, OUTER, NESTED = cube("inner", 0.5, (0, 0, 0)), cube("outer", 4.0, (0, 0, 0)), [[0, 0, 0.3], [0, 0, 0]]
BESIDE = Solid(*shapes.moved(shapes.cube(), (1.0, 0.0, 0.0)), name="right")
OVERLAPPING = Solid(*shapes.moved(shapes.cube(), (0.5, 0, 0)), name="b")
SMALL_SCENES = {  # parts; points; signed distances; the part of each; whether distances are signed
    "one solid in several places": (
        [Part(f"{x}", PLACED, Pose(translation=(x, 0.0, 0.0)), ROWS) for x in (0.0, 3.0, 6.0)],
        [[0.5, 0.5, 0.5], [3.5, 0.5, 0.25], [8.0, 0.5, 0.5]], [-0.5, -0.25, 1.0], [0, 1, 2], True),
    # The sign is per part: a flattened file would have a double wall there, and half its signs wrong.
    "parts that touch, whose common face is the surface": (
        [cube("left"), BESIDE], [[1.0 - 2**-30, 0.5, 0.5], [1.0, 0.5, 0.5], [1.0 + 2**-30, 0.5, 0.5]],
        [-(2**-30), 0.0, -(2**-30)], [0, 0, 1], True),
    "parts that overlap, of which the deepest counts": (
        [cube("a"), OVERLAPPING], [[0.6, 0.5, 0.5], [0.9, 0.5, 0.5], [0.75, 0.5, 0.5]], [-0.4, -0.4, -0.25],
        [0, 1, 0], True),
    "part within a part, which does not hide the depth": ([INNER, OUTER], NESTED, [-1.7, -2.0], [1, 1], True),
    "part around a part": ([OUTER, INNER], NESTED, [-1.7, -2.0], [0, 0], True),
    "sheet that counts with its distance": (
        [sheet(2.0), cube("cube")], [[0.5, 0.5, 1.9], [0.5, 0.5, 1.2], [0.5, 0.5, 0.9], [0.5, 0.5, 2.5]],
        [0.1, 0.2, -0.1, 0.5], [0, 1, 1, 0], [False, True, True, False]),
    "sheet within a part": ([sheet(0.5), cube("cube", 4.0, (0, 0, 0))], [[0.5, 0.5, 0.6]], [-1.4], [1], True),
}  # fmt: skip


@pytest.mark.parametrize("name", SMALL_SCENES)
def test_small_scene_answers_as_is_known(name):
    parts, points, signed, rows, is_signed = SMALL_SCENES[name]
    scene = Scene(parts)
    hit = scene.closest(points)
    assert hit.signed_distance.tolist() == pytest.approx(signed, rel=1e-12)
    assert hit.part.tolist() == rows
    assert np.array_equal(hit.is_signed, np.broadcast_to(is_signed, len(points)))
    assert judging.same_bits(scene.signed_distance(points), hit.signed_distance)
    assert np.array_equal(scene.contains(points), (hit.signed_distance < 0.0) & hit.is_signed)
    if np.all(is_signed):
        more = np.random.default_rng(8).uniform(-0.5, 2.5, (400, 3))
        assert_is_the_smallest_over_parts(scene, more)


def test_direction_and_limit_are_those_of_the_part_that_counts():
    """The deepest part is farther than the limit, which leaves no result although another surface is near."""
    scene, point = Scene([INNER, OUTER]), (0.0, 0.0, 0.3)
    hit = scene.closest(point)
    assert hit.gradient.tolist() == [0.0, 0.0, 1.0]
    assert scene.distance(point) == pytest.approx(0.05, rel=1e-12)
    # It would be 1.7 m here, different from the scene's distance.
    assert not hasattr(hit, "distance")
    assert scene.closest(point, max_distance=1.0).signed_distance == np.inf
    assert scene.closest(point, max_distance=1.75).signed_distance == -1.7
    above = Scene([sheet(2.0), cube("cube")]).closest((0.5, 0.5, 1.9))
    assert above.gradient.tolist() == [0.0, 0.0, -1.0]


def test_every_part_that_holds_a_point_is_asked_for_its_depth():
    """Sign grids find the parts that contain a point; a missed part makes the result too shallow."""
    solids = [
        Solid(shapes.torus()[0] @ shapes.rotation(row).T + 0.2 * row, shapes.torus()[1], name=f"{row}")
        for row in range(5)
    ]
    points = np.random.default_rng(18).uniform(-2.5, 3.0, (50_000, 3))
    points[0] = np.array([-0.89539459701725, -0.6308599334735035, 1.3446167969181748]) + 0.4
    alone = np.array([solid.signed_distance(points) for solid in solids])
    signed = Scene(solids).signed_distance(points)
    assert (np.abs(signed - alone.min(axis=0)) <= 4e-15).all()


@pytest.mark.parametrize("count", [2, 20])
def test_ties_go_to_the_lowest_part(count):
    parts = [Solid(*shapes.cube(), name=f"{row}") for row in range(count)]
    points = np.random.default_rng(10).uniform(-1.0, 2.0, (200, 3))
    hit = Scene(parts).closest(points)
    assert (hit.part == 0).all()
    assert judging.same_bits(hit.signed_distance, parts[0].signed_distance(points))


def test_scenes_that_share_a_solid_move_apart():
    solid = Solid(*shapes.cube(), name="cube")
    first, second = Scene([solid]), Scene([solid])
    first.move("cube", Pose(translation=(5.0, 0.0, 0.0)))
    assert first.distance((6.5, 0.5, 0.5)) == 0.5
    assert second.distance((6.5, 0.5, 0.5)) == 5.5
    assert solid.distance((6.5, 0.5, 0.5)) == 5.5
    assert first.part("cube").pose.translation.tolist() == [5.0, 0.0, 0.0]


def test_one_part_far_from_its_own_origin_is_found_when_turned():
    """Regression: its box was placed as if the part were not rotated, and no point was inside."""
    scene = Scene([part_of(shapes.moved(shapes.cube(), (100.0, 0.0, 0.0)), pose=Pose(QUARTER))])
    centre = (-0.5, 100.5, 0.5)
    assert scene.signed_distance(centre) == -0.5
    assert scene.contains(centre)
    scene.move("part", Pose(QUARTER, (0.0, -100.0, 0.0)))
    assert scene.contains((-0.5, 0.5, 0.5))
    assert not scene.contains(centre)


def test_bounds_hold_the_turned_parts():
    scene = Scene([part_of(shapes.cube(), pose=Pose(QUARTER, (10.0, 0.0, 0.0)))])
    assert [corner.tolist() for corner in scene.bounds] == [[9.0, 0.0, 0.0], [10.0, 1.0, 1.0]]


@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "shifted"])
@pytest.mark.parametrize("count", [1, 9])
def test_scene_far_from_the_origin_is_as_exact(count, is_turned):
    """At 10 km coordinates have a resolution of 2e-12 m, the only difference allowed."""
    offset = np.array([10_000.0, -7_000.0, 3_000.0])
    near = some_parts(count, is_turned=is_turned)
    far = [
        Part(
            part.name, part.solid, Pose(part.pose.rotation, part.pose.translation + offset), part.source_faces
        )
        for part in near
    ]
    points = offset + np.random.default_rng(12).uniform(-4.0, 4.0, (200, 3))
    assert_is_the_smallest_over_parts(Scene(far), points)


def test_mesh_far_from_the_origin_is_as_exact():
    """The file's own coordinates are large; offset by a power of two, they are not rounded."""
    offset = np.array([8192.0, -4096.0, 16384.0])
    vertices, faces = shapes.octahedron()
    vertices = np.round(vertices * 1024.0) / 1024.0
    points = np.round(np.random.default_rng(13).uniform(-3.0, 3.0, (300, 3)) * 2**20) / 2**20
    far, near = Solid(vertices + offset, faces), Solid(vertices, faces)
    assert judging.same_bits(far.signed_distance(points + offset), near.signed_distance(points))
    scene = Scene([far, Solid(vertices + offset + 64.0, faces, name="other")])
    assert judging.same_bits(scene.signed_distance(points + offset), near.signed_distance(points))


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e60])
def test_parts_of_any_size_are_as_exact(size):
    vertices, faces = shapes.sphere(radius=size, subdivisions=1)
    scene = Scene([Solid(vertices, faces, name="a"), Solid(vertices + 3.0 * size, faces, name="b")])
    points = size * np.random.default_rng(14).uniform(-2.0, 5.0, (200, 3))
    signed = scene.signed_distance(points)
    each = [judging.signed_distance(solid.solid.mesh.vertices, faces, points) for solid in scene.parts]
    assert (np.abs(signed - np.min(each, axis=0)) <= judging.allowance(signed, size)).all()


@pytest.mark.parametrize("sizes", [(1.0, 1e60), (1e60, 1e-9)])
def test_tiny_and_huge_parts_are_together_in_one_scene(sizes):
    solids = [Solid(*shapes.cube(size, (2.0 * size, 0.0, 0.0)), name=f"{size}") for size in sizes]
    points = np.array([[2.0 * size, 0.25 * size * k, 0.0] for size in sizes for k in (0, 1, 3, 9)])
    signed = Scene(solids).signed_distance(points)
    expected = np.min([oracle.box(points, *solid.bounds) for solid in solids], axis=0)
    assert (np.abs(signed - expected) <= 1e-12 * np.abs(expected)).all()


@pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")
@pytest.mark.parametrize("far", [1e3, 1e20, 1e90])
def test_points_far_away_are_as_exact(far):
    scene = Scene([Solid(*shapes.cube(), name="cube"), Solid(*shapes.cube(1e-9, (3, 0, 0)), name="grain")])
    point = np.array([far, 2.0 * far, -far])
    assert scene.signed_distance(point) == pytest.approx(oracle.box(point, (0, 0, 0), (1, 1, 1)), rel=1e-12)
    assert scene.part("cube").solid.signed_distance(point) == pytest.approx(
        oracle.box(point, (0, 0, 0), (1, 1, 1)), rel=1e-12
    )
    assert not scene.contains(point)


def test_parts_keep_names_poses_and_order():
    scene = Scene([part_of(shapes.cube(), "lid"), Solid(*shapes.tetrahedron(), name="base")])
    assert [part.name for part in scene.parts] == ["lid", "base"]
    assert scene.part("base").pose.is_identity
    assert scene.part("base").source_faces.tolist() == [0, 1, 2, 3]
    assert scene.report is None
    assert repr(scene) == "Scene(2 parts, 16 faces)"
    assert repr(scene.part("lid")) == "Part('lid', 12 faces)"
    assert scene.memory_bytes > 0


LID = Part("cube", Solid(*shapes.cube()), Pose(), ROWS, repairs=None)


@pytest.mark.parametrize(
    ("parts", "options", "message"),
    [
        ([], {}, "a scene has no parts, expected at least one"),
        ([1], {}, "a scene is made of Part and Solid, not of int"),
        (Solid(*shapes.cube()), {}, "a scene is made of a list of parts, not of one Solid"),
        ([part_of(shapes.cube(), ["lid"])], {}, "part 0 is named ['lid'], expected text"),
        ([Part("lid", shapes.cube(), Pose(), np.arange(3))], {},
         "part 'lid' holds a tuple, expected a Solid"),
        ([cube("base"), cube("lid"), cube("lid")], {},
         "parts 1 and 2 are both named 'lid', expected names that differ"),
        ([LID], {}, "repairs of part 'cube' are None, expected Repairs"),
        ([cube("cube")], {"report": 3}, "report is 3, expected a LoadReport, or None"),
    ],
)  # fmt: skip
def test_what_is_no_scene_is_refused(parts, options, message):
    with pytest.raises(SceneError, match=f"^{re.escape(message)}$"):
        Scene(parts, **options)


def test_part_that_is_too_far_off_is_refused_wherever_it_comes_in():
    # Regression: only moved parts were refused; other distances were wrong.
    scene = Scene(some_parts(2))
    far = replace(scene.parts[1], name="far", pose=Pose(translation=(0.0, 1e200, 0.0)))
    for come_in in (lambda: Scene([far]), lambda: scene.add(far)):
        with pytest.raises(
            PoseError, match=r"^part 'far' would be moved by 1e\+200 m, which is farther than"
        ):
            come_in()
    assert len(scene.parts) == 2


def test_part_that_is_not_there_is_named_with_those_that_are():
    few, many = Scene(some_parts(2)), Scene(some_parts(12))
    for ask in (few.part, lambda name: few.move(name, Pose())):
        for name in ("lid", None, 3, ["part 0"]):
            expected = f"no part is named {name!r}; the scene has 'part 0', 'part 1'"
            with pytest.raises(SceneError, match=f"^{re.escape(expected)}$"):
                ask(name)
    with pytest.raises(SceneError, match=r"^no part is named 'lid'; .*, 'part 9' and 2 more$"):
        many.part("lid")


def test_mesh_of_several_bodies_becomes_parts_that_lead_back():
    bodies = [
        shapes.cube(),
        shapes.moved(shapes.octahedron(), (5.0, 0.0, 0.0)),
        shapes.hollow_cube(center=(0, 9, 0)),
    ]
    vertices, faces = shapes.soup(*shapes.join(*bodies))
    order = np.random.default_rng(16).permutation(len(faces))
    faces = faces[order]
    scene = Scene.from_mesh(vertices, faces, name="toy")
    assert len(scene.parts) == 3
    assert sorted(part.name for part in scene.parts) == ["toy.1", "toy.2", "toy.3"]
    rows = np.concatenate([part.source_faces for part in scene.parts])
    assert sorted(rows.tolist()) == list(range(len(faces)))
    for part in scene.parts:
        mesh = part.solid.mesh
        assert part.solid.is_watertight
        given = vertices[faces[part.source_faces]]
        for row in range(mesh.face_count):
            own = {tuple(corner) for corner in mesh.vertices[mesh.faces[row]]}
            assert own == {tuple(corner) for corner in given[row]}
    points = np.random.default_rng(17).uniform(-2.0, 10.0, (200, 3))
    hit = assert_is_the_smallest_over_parts(scene, points)
    for point, part, face, distance in zip(points, hit.part, hit.face_id, hit.signed_distance, strict=True):
        source = scene.parts[part].source_faces[face]
        alone = oracle.closest(vertices, faces[source : source + 1], point).distance
        assert alone == pytest.approx(abs(distance), rel=1e-12, abs=1e-14)
