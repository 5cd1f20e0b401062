"""The C library: bit-identical to Python, through all changes of a scene, and memory-safe."""

import concurrent.futures
import ctypes
import dataclasses
import functools
import itertools
import json
import os
import subprocess
import sys

import mutated_scenes
import numpy as np
import pytest
import shapes
from project import IMPORT_PATHS, MESHES, ROOT, TRIALS

import proximity
from benchmarks.digest import queries, scenes, ticks
from benchmarks.digest.library import LibraryScene, LibraryTracker, Paths, through_library
from proximity import (
    ArgumentError,
    MeshFormatError,
    NotWatertightError,
    Pose,
    PoseError,
    ProximityError,
    Relation,
    Scene,
    Solid,
)
from proximity.core import CORE, library_in_c
from proximity.errors import FileVersionError
from proximity.native import IS_AHEAD, mode
from proximity.scene.queries import checked_query
from proximity.scene.saved import archive, compiled_scene

pytestmark = [
    pytest.mark.filterwarnings("ignore::proximity.UnitsWarning"),  # some points are far away on purpose
    pytest.mark.skipif(
        not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
        reason="the library is compiled with the kernels",
    ),
]
SETS = mode.extension().usable_instructions() if IS_AHEAD else []


def answers(asked, seed=5, count=300):
    """Return the answers to all queries, as bytes, and the error for a scene without an inside."""
    rng = np.random.default_rng(seed)
    lower, upper = asked.bounds
    points = rng.uniform(lower - 0.02, np.minimum(upper, lower + 0.4) + 0.02, (count, 3))
    told = [np.array(asked.bounds).tobytes()]
    for rows in (points, points[:5]):
        told += [
            asked.closest(rows)._table.tobytes(),
            asked.closest(rows, max_distance=0.01)._table.tobytes(),
            asked.distance(rows).tobytes(),
            asked.signed_distance(rows).tobytes(),
            asked.cast(rows, rows[::-1] + 0.01)._table.tobytes(),
            asked.cast_distance(rows, rows[::-1] + 0.01).tobytes(),
            asked.closest_to_segments(rows, rows[::-1])._table.tobytes(),
        ]
        try:
            told.append(asked.contains(rows).tobytes())
        except NotWatertightError:
            told.append("no inside")
    return told


# Queries


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize("name", ["bracket.stl", "assembly.glb", "torus.ply"])
def test_digests_of_files_are_those_of_python(name, instructions):
    scene = proximity.load(MESHES / name)
    triangles = queries.triangles_of(scene)
    opened = through_library(scene, instructions)

    assert opened.instructions == instructions
    assert dict(queries.digests_of(name, opened, triangles, 2000, 1)) == dict(
        queries.digests_of(name, scene, triangles, 2000, 1)
    )


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize(("part_count", "size", "offset"), scenes.RANDOM_SCENES)
def test_digests_of_scenes_are_those_of_python(part_count, size, offset, instructions):
    rng = scenes.generator(f"{part_count}")
    scene = scenes.random_scene(rng, part_count, size, offset)
    scenes.change_scene(scene, rng, size)
    triangles = queries.triangles_of(scene)
    opened = through_library(scene, instructions)

    assert dict(queries.digests_of("scene", opened, triangles, 1000, 1)) == dict(
        queries.digests_of("scene", scene, triangles, 1000, 1)
    )


def test_large_batches_of_rays_and_points_are_cut_as_nobody_notices(monkeypatch):
    """Rays are sorted if the scene has a megabyte or more."""
    scene = proximity.Scene([proximity.Solid(*shapes.torus(0.1, 0.03, 150, 80), name="torus")])
    opened = through_library(scene)
    assert scene.snapshot().reals.nbytes > 1 << 20

    assert answers(opened, count=5000) == answers(scene, count=5000)


@pytest.mark.parametrize("make", mutated_scenes.SCENES.values(), ids=mutated_scenes.SCENES)
def test_parts_and_their_poses_are_told(make):
    scene = make()
    opened = through_library(scene)

    assert opened.names == [part.name for part in scene.parts]
    for part in scene.parts:
        assert opened.pose(part.name).tobytes() == np.ascontiguousarray(part.pose.matrix).tobytes()
    assert answers(opened) == answers(scene)


def test_names_may_be_any_text():
    name = 'über "zwei"\n\udcff 😀\\'
    scene = proximity.Scene([proximity.Part(name, *_of_part(shapes.cube()))])

    assert through_library(scene).names == [name]


def _of_part(mesh):
    solid = proximity.Solid(*mesh)
    return solid, Pose(), np.arange(solid.mesh.face_count, dtype=np.int32)


# Changes


def crowd(count=20):
    """Return a scene of tori at random positions."""
    places = np.random.default_rng(1).uniform(-0.1, 0.1, (count, 3))
    return proximity.Scene(
        [
            proximity.Solid(*shapes.moved(shapes.torus(0.02, 0.006), place), name=f"part {row}")
            for row, place in enumerate(places)
        ]
    )


@pytest.mark.parametrize("count", [1, 2, 20])
@pytest.mark.parametrize("instructions", SETS)
def test_scene_that_moves_hides_and_shows_answers_as_python_does(count, instructions):
    scene = crowd(count)
    opened = through_library(scene, instructions)
    rng = np.random.default_rng(count)
    names = [part.name for part in scene.parts]

    for step in range(60):
        chosen = list(rng.choice(names, min(count, 1 + step % 5), replace=False))
        reach = 40.0 if step % 20 == 19 else 0.1  # outside the scene's frame
        poses = [Pose(shapes.rotation(step + k), rng.uniform(-reach, reach, 3)) for k in range(len(chosen))]
        velocities = rng.normal(size=(len(chosen), 3))
        scene.move_many(chosen, poses, velocities)
        opened.move_many(chosen, [pose.matrix for pose in poses], velocities)
        if step % 4 == 3 and count > 1:
            for each in (scene, opened):
                each.hide(names[step % count])
        if step % 8 == 7:
            for each in (scene, opened):
                each.show(names[step % count])
                each.show(names[(step - 4) % count])
        assert answers(opened, step, 60) == answers(scene, step, 60)


def test_part_that_moved_in_python_moves_on_in_c():
    scene = crowd()
    scene.move_many(["part 3", "part 4"], [Pose(shapes.rotation(1), (0.1, 0.0, 0.0))] * 2)
    scene.hide("part 5")
    opened = through_library(scene)

    for each in (scene, opened):
        each.show("part 5")
    pose = Pose(shapes.rotation(7), (0.0, 0.2, 0.0))
    scene.move("part 3", pose)
    opened.move_many(["part 3"], [pose.matrix])

    assert answers(opened) == answers(scene)


def test_parts_that_were_far_away_when_the_trees_were_made_come_together():
    """Trees over them then exceed their space: each part is traversed separately."""
    solid = proximity.Solid(*shapes.sphere(0.02, 4))
    rows = np.arange(solid.mesh.face_count, dtype=np.int32)
    places = np.random.default_rng(3).uniform(-100.0, 100.0, (12, 3))
    parts = [
        proximity.Part(str(k), solid, Pose(translation=place), rows, is_hidden=k > 1)
        for k, place in enumerate(places)
    ]
    scene = proximity.Scene(parts)
    opened = through_library(scene)

    for k in range(12):
        for each in (scene, opened):
            each.show(str(k))
        assert answers(opened, k) == answers(scene, k)


def test_rotation_in_single_precision_is_taken_as_the_nearest():
    scene = crowd(3)
    opened = through_library(scene)
    rough = np.eye(4, dtype=np.float32)
    rough[:3, :3] = shapes.rotation(2)

    opened.move_many(["part 1"], [rough])

    turn = opened.pose("part 1")[:3, :3]
    assert np.abs(turn @ turn.T - np.eye(3)).max() < 4e-16 * 8
    assert np.abs(turn - rough[:3, :3]).max() < 1e-6


# Tracker


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize("case", [case for case in ticks.CASES if case.change is not ticks.change_parts],
                         ids=lambda case: case.name)  # fmt: skip
def test_ticks_are_those_of_python(case, instructions):
    """Bounds, predictions, times to contact, and the work per tick."""
    shorter = dataclasses.replace(case, tick_count=600 // max(1, case.finger_count // 50))
    tracker_of = functools.partial(LibraryTracker, instructions=instructions)

    assert ticks.digests_of_case(shorter, MESHES, tracker_of) == ticks.digests_of_case(shorter, MESHES)


def hide_and_show(scene, number, rng):
    """Hide, show and move parts now and then."""
    names = [part.name for part in scene.parts]
    if number % 20 == 5:
        scene.hide(names[number // 20 % len(names)])
    if number % 20 == 15:
        scene.show(names[number // 20 % len(names)])
        scene.move(names[0], Pose(shapes.rotation(number), rng.uniform(-0.1, 0.1, 3)))


def test_ticks_among_parts_that_hide_are_those_of_python():
    case = ticks.TickCase("hiding", lambda _: crowd(12), 5, 400, has_paths=True, change=hide_and_show)

    assert ticks.digests_of_case(case, MESHES, LibraryTracker) == ticks.digests_of_case(case, MESHES)


def test_surface_of_a_part_is_in_contacts_as_in_python():
    scene = crowd(2)
    tracker, python = LibraryTracker(scene, fingers=1), proximity.Tracker(scene, fingers=1)
    opened = tracker._scene

    def set_surface(part, *numbers):
        opened.call("set_surface", opened._scene, part, *map(ctypes.c_double, numbers))

    for k, numbers in enumerate([(700.0, 0.5), (0.0, 0.0), (20.0, 0.0)]):
        set_surface(0, *numbers)
        stiffness, damping = numbers
        scene.set_surface("part 0", stiffness=stiffness or None, damping=damping)
        for name in ("part 0", "part 1"):
            at, instant = [scene.part(name).pose.translation], 10**9 + 10**6 * k
            assert tracker.tick(at, instant, instant).tobytes() == python.tick(at, instant, instant).tobytes()
    for numbers in [(-1.0, 0.0), (np.inf, 0.0), (0.0, 0.5), (5.0, np.nan)]:
        with pytest.raises(ArgumentError, match="expected numbers above 0, or 0 and 0 of a rigid part"):
            set_surface(1, *numbers)
    with pytest.raises(ArgumentError, match="there is no part 2, expected 0 to 1"):
        set_surface(2, 1.0, 0.0)


def test_settings_and_ticks_that_cannot_be_used_are_told():
    scene = crowd(2)
    for name, value, told in (
        ("radius", 7.0, "radius is not 0 to 0.1 m: was it meant in millimetres?"),
        ("latency", 20.0, "latency is not 0 to 1 s"),
        ("working_range", 120.0, "working_range is not 0 to 10 m"),
        ("tolerance", -1.0, "tolerance is not a share"),
        ("horizon", 0.0, "horizon is not a positive number"),
        ("max_speed", np.nan, "max_speed or max_acceleration is not"),
        ("budget", 0, "budget is not a positive number"),
    ):
        with pytest.raises(ArgumentError, match=told):
            LibraryTracker(scene, **{name: value})
    tracker = LibraryTracker(scene, fingers=2)
    points = np.zeros((2, 3))
    with pytest.raises(ArgumentError, match="an instant is beyond"):
        tracker.tick(points, 2**63 - 1, 10**9)
    with pytest.raises(ArgumentError, match="path_bends do not increase"):
        tracker.tick(points, 10**9, 10**9, paths=np.zeros((2, 3, 3)), path_bends=[0.0, 1.0, 1.0])
    with pytest.raises(ArgumentError, match="paths have less than two corners"):
        tracker.tick(points, 10**9, 10**9, paths=np.zeros((2, 1, 3)))
    instants = np.full(2, 10**9)
    for count in (2**16 + 1, 2**62):  # their size in bytes overflows
        paths = Paths(points.ctypes.data, count)
        addresses = [ctypes.c_void_p(each.ctypes.data) for each in (points, instants, tracker.contacts)]
        with pytest.raises(ArgumentError, match=r"paths have more than 2\^16 corners"):
            tracker._scene.call(
                "tick", tracker._tracker, *addresses[:2], ctypes.c_int64(10**9), None, ctypes.byref(paths),
                addresses[2],
            )  # fmt: skip


# Bytes and threads


def test_bytes_stay_as_they_are(tmp_path):
    scene = crowd()
    scene.save(tmp_path / "crowd.prox")
    content = np.fromfile(tmp_path / "crowd.prox", np.uint8)
    before = content.copy()
    content.flags.writeable = False
    opened = LibraryScene(content)

    for each in (scene, opened):
        each.hide("part 2")
    scene.move("part 1", Pose(translation=(0.1, 0.2, 0.3)))
    opened.move_many(["part 1"], [Pose(translation=(0.1, 0.2, 0.3)).matrix])

    assert answers(opened) == answers(scene)
    assert (content == before).all() and (tmp_path / "crowd.prox").read_bytes() == before.tobytes()
    with pytest.raises(ArgumentError, match="do not lie at a multiple of 8"):
        LibraryScene(np.r_[np.zeros(1, np.uint8), content][1:])


def test_file_that_is_open_stays_as_it_is(tmp_path):
    scene = crowd()
    path = tmp_path / "crowd.prox"
    scene.save(path)
    before = path.read_bytes()
    opened = LibraryScene(path)
    opened.move_many(["part 1"], [Pose(translation=(0.1, 0.2, 0.3)).matrix])
    opened.close()

    assert path.read_bytes() == before


def test_eight_threads_ask_one_scene():
    scene = proximity.load(MESHES / "assembly.glb")
    opened = through_library(scene)
    expected = [answers(scene, seed, 500) for seed in range(8)]

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            assert list(pool.map(lambda seed: answers(opened, seed, 500), range(8))) == expected


# Errors


def refusal(open_with, path):
    with pytest.raises(MeshFormatError) as told:
        open_with(path)
    return str(told.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:30],
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: b"solid" + data[5:],
        lambda data: data[:40] + b"x" + data[41:],
        lambda data: data[:12] + b"\7" + data[13:],
        lambda data: data[:100] + bytes([data[100] ^ 1]) + data[101:],
        lambda data: data[:-5000] + bytes([data[-5000] ^ 64]) + data[-4999:],
        lambda data: data[:8] + data[8:12][::-1] + data[12:],
    ],
)
def test_damaged_file_is_refused_as_in_python(damage, tmp_path):
    path = tmp_path / "cell.prox"
    mutated_scenes.cell().save(path)
    path.write_bytes(damage(path.read_bytes()))

    assert refusal(LibraryScene, path).split("; ")[0] == refusal(proximity.load, path).split("; ")[0]


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ((archive, "FORMAT_VERSION", 1), f"it has format version 1, expected {archive.FORMAT_VERSION}"),
        (
            (compiled_scene, "LAYOUT", compiled_scene.LAYOUT | {"NODE_STRIDE": 80}),
            f"it was saved by version 0.0.9, expected {proximity.__version__}: the layout of trees differs",
        ),
    ],
)
def test_file_of_another_version_is_an_error_of_its_own_that_names_both(changed, told, tmp_path, monkeypatch):
    path = tmp_path / "cell.prox"
    with monkeypatch.context() as other:
        other.setattr(*changed)
        other.setattr(proximity, "__version__", "0.0.9")
        mutated_scenes.cell().save(path)

    for open_with in (LibraryScene, proximity.load):
        with pytest.raises(FileVersionError) as error:
            open_with(path)
        assert str(error.value).startswith(f"{path}: {told}")
        assert str(error.value).endswith("; save the scene again with this version")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("cell", 500), ("crowd", 250), ("alone", 100), ("bodies", 150)])
def test_changed_file_is_refused_or_answers(name, count, tmp_path):
    """Python refuses every file that the library refuses; it reads less of it. Crashes end a subprocess."""
    command = [sys.executable, TRIALS / "mutated_library.py", name, "0", str(count), tmp_path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([*IMPORT_PATHS, str(ROOT / "bench")])}

    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280)

    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (outcomes[-1:], done.stderr)
    assert len(outcomes) == count
    assert [line for line in outcomes if line[2] not in ("refused", "answered")] == []
    assert {line[2] for line in outcomes} == {"refused", "answered"}


def test_what_cannot_be_done_is_told(tmp_path):
    opened = through_library(crowd(3))
    sheet = through_library(proximity.Scene([proximity.Solid(*shapes.grid(2, 2))]))
    point = np.zeros((1, 3))

    with pytest.raises(ProximityError, match=r"none\.prox: it cannot be opened \(No such file"):
        LibraryScene(tmp_path / "none.prox")
    with pytest.raises(ProximityError, match="there are no instructions v9 that the library"):
        opened.call("use_instructions", opened._scene, b"v9")
    with pytest.raises(ArgumentError, match="there is no part -1, expected 0 to 2"):
        opened.hide("nobody")
    with pytest.raises(ArgumentError, match="max_distance is -1, expected a length of 0 m or more"):
        opened.closest(point, max_distance=-1.0)
    with pytest.raises(ArgumentError, match="max_distance is nan"):
        opened.closest(point, max_distance=np.nan)
    with pytest.raises(ArgumentError, match="direction 2 is zero"):
        opened.cast(np.zeros((4, 3)), [[1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]])
    with pytest.raises(NotWatertightError, match="no part has an inside"):
        sheet.contains(point)
    assert answers(opened) == answers(crowd(3))  # unchanged by the errors


def matrix_with(row, column, number):
    matrix = np.eye(4)
    matrix[row, column] = number
    return matrix


@pytest.mark.parametrize(
    ("matrix", "speed", "words"),
    [
        (np.diag([25.4, 25.4, 25.4, 1.0]), None, "the matrix scales by 25.4, expected 1: a part keeps its"),
        (
            np.diag([1.0, 1.0, 2.0, 1.0]),
            None,
            r"scales or shears \(its axes are 1, 1 and 2 long\), expected a",
        ),
        (
            matrix_with(0, 1, 0.3),
            None,
            r"scales or shears \(its axes are 1, 1.04\d* and 1 long\), expected a",
        ),
        (np.diag([1.0, 1.0, -1.0, 1.0]), None, r"the matrix mirrors \(determinant -1\), expected \+1"),
        (matrix_with(2, 3, np.nan), None, "the matrix has numbers that are not finite"),
        (matrix_with(3, 0, 0.1), None, "is column by column, expected row by row, with the translation at 3"),
        (2.0 * np.eye(4), None, "the matrix has the last row 0 0 0 2, expected 0 0 0 1"),
        (matrix_with(0, 3, 1e150), None, r"the matrix leads 1e\+150 m away, expected at most 2.5e\+149 m"),
        (np.eye(4), [np.inf, 0, 0], "a velocity is not finite"),
        (np.eye(4), [1e10, 0, 0], r"or the velocity is above 1e\+09 m/s or rad/s"),
    ],
)
def test_pose_that_cannot_be_used_names_part_and_cause(matrix, speed, words):
    opened, before = through_library(crowd(3)), answers(crowd(3))

    with pytest.raises(PoseError, match=f"^part 'part 1': .*{words}"):
        opened.move_many(
            ["part 0", "part 1"], [np.eye(4), matrix], None if speed is None else [np.zeros(3), speed]
        )
    assert answers(opened) == before


def bits_of(clearance):
    return [np.asarray(each).tobytes() if not isinstance(each, str) else each for each in clearance]


@pytest.mark.parametrize("instructions", SETS)
def test_pairs_of_parts_are_as_far_apart_as_in_python(instructions):
    rng = np.random.default_rng(7)
    solids = [
        Solid(*shapes.torus(0.05, 0.02), name="torus"),
        Solid(*shapes.sphere(0.03, 2), name="sphere"),
        Solid(*shapes.cube(0.4, (0.0, 0.0, 0.0)), name="around"),
        Solid(*shapes.cube(0.01), name="cube"),
    ]
    scene, seen = Scene(solids), set()
    asked = through_library(scene, instructions)
    for _ in range(20):
        poses = [Pose(shapes.rotation(rng.integers(100)), rng.normal(size=3) * 0.1) for _ in solids]
        scene.move_many([each.name for each in solids], poses)
        asked.move_many([each.name for each in solids], [pose.matrix for pose in poses])
        for first, second in itertools.permutations((each.name for each in solids), 2):
            for limits in ({}, {"tolerance": 0.1}, {"budget": 20}):
                found = asked.clearance(first, second, **limits)
                assert bits_of(found) == bits_of(scene.clearance(first, second, **limits))
                seen.add(found.relation)
    assert seen >= {Relation.APART, Relation.CROSSING, Relation.FIRST_INSIDE, Relation.SECOND_INSIDE}


def test_pairs_that_cannot_be_measured_are_told():
    scene = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1, (0.3, 0, 0)), name="b")])
    asked = through_library(scene)

    assert asked.clearance("a", "b", max_distance=0.1).distance == np.inf
    for names, limits in ((("a", "a"), {}), (("a", "c"), {}), (("a", "b"), {"max_distance": -1.0})):
        with pytest.raises(ArgumentError, match="expected"):
            asked.clearance(*names, **limits)


def test_blocks_are_sorted_as_in_python():
    source = (CORE / "library" / "questions.c").read_text(encoding="ascii")

    assert "BLOCK = 1 << 20" in source and checked_query.BLOCK == 1 << 20
