"""The C# binding on Mono: bit-identical to Python; and the component for Unity, with stand-ins."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import shapes
from compiling_c import compiler, run
from far_end import new_name
from pages import PAGES
from project import MESHES, SUPPORT
from wire import frame

import proximity
from benchmarks.digest.library import LibraryScene
from proximity import Pose, ProximityError
from proximity.clients import c_package, client_files, write_client
from proximity.core import CORE
from proximity.transport import open_publisher


def is_compiled():
    try:
        return c_package.library_path().is_file()
    except ProximityError:
        return False


has_library = pytest.mark.skipif(
    sys.platform == "win32" or not is_compiled(),
    reason="the library is compiled with the kernels, and Mono is run on POSIX systems only",
)
CLIENTS = SUPPORT / "clients"
CLIENTS_OF_LANGUAGES = Path(c_package.__file__).parent
FLAGS = ("-unsafe", "-langversion:latest", "-optimize", "-nologo", "-warn:4", "-warnaserror", "-nowarn:0649")
POSE = Pose(rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]], translation=[0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The files written by ``proximity client csharp`` and ``proximity library csharp``."""
    folder = tmp_path_factory.mktemp("csharp")
    write_client("csharp", folder)
    c_package.write_csharp_library(folder)
    return folder


def program(package, source, *options, files=("ProximityMessages", "Proximity")):
    """Build a program from a source, with warnings as errors; return the command that runs it."""
    made = package / f"{source.stem}.exe"
    mcs, mono = compiler("mcs"), compiler("mono")
    sources = [package / "Runtime" / f"{name}.cs" for name in files]
    run(mcs, *FLAGS, *options, *sources, source, f"-out:{made}")
    return [mono, made]


def answer(command, *words, cwd=None):
    """Run a program with the package's library; return its output."""
    library = c_package.library_path().parent
    done = subprocess.run(
        [str(word) for word in (*command, *words)], cwd=cwd, capture_output=True, text=True, check=False,
        env=os.environ | {"LD_LIBRARY_PATH": str(library), "DYLD_LIBRARY_PATH": str(library)}, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def answers(scene, points, others, **how):
    """Yield the answers to the program's queries of a scene."""
    limited = scene.closest(points, max_distance=0.01, **how)._table
    limited[0] = scene.closest(points[0], **how)._table
    yield scene.closest(points, **how)._table
    yield limited
    yield from (each(points, **how) for each in (scene.signed_distance, scene.distance, scene.contains))
    yield scene.cast(points, others, max_distance=0.2, **how)._table
    yield scene.closest_to_segments(points, others, **how)._table
    yield scene.parts[0].pose.matrix
    yield np.array(scene.bounds)


def contacts(scene, points):
    """Yield the contacts of the program's tracker, tick by tick."""
    tracker = proximity.Tracker(scene, fingers=2, radius=[0.004, 0.002])
    name = scene.parts[0].name
    for k in range(6):
        if k in (2, 4):
            tracker.ignore(1, 1, k == 2)
        if k == 3:
            scene.move(name, POSE)
        if k == 4:
            scene.set_surface(name, stiffness=700.0, damping=0.5)
        given = {
            "velocities": points[k : k + 2], "paths": points[10 + k : 14 + k].reshape(2, 2, 3),
            "bends": [0.1, 0.2], "path_bends": [0.0, 2.0],
        } if k % 2 else {}  # fmt: skip
        start = 10**9 + 10**6 * k
        yield tracker.tick(points[k : k + 2], [start, start + 500], start + 1000, **given).copy()


@has_library
def test_example_imports_a_part_while_fingers_are_tracked(package):
    command = program(package, package / "Examples~" / "Imported.cs")

    printed = answer(command, MESHES / "bracket.stl")

    assert re.fullmatch(r"came within -?[\d.]+ mm of 'imported', now 1 part\n", printed)


@has_library
def test_answers_are_those_of_python(package, tmp_path):
    scene, copy = (proximity.load(MESHES / "assembly.glb") for _ in range(2))
    hidden = scene.parts[1].name
    lower, upper = scene.bounds
    rows = np.random.default_rng(3).uniform(lower - 0.02, upper + 0.02, (2, 60, 3))
    scene.save(tmp_path / "scene.prox")
    rows.tofile(tmp_path / "rows")
    command = program(package, CLIENTS / "LibraryProgram.cs")

    lines = answer(
        command, tmp_path / "scene.prox", tmp_path / "rows", tmp_path / "told", hidden, cwd=tmp_path
    ).splitlines()

    copy.move(copy.parts[0].name, POSE, velocity=rows[0, 0])
    copy.hide(hidden)
    expected = [*answers(scene, *rows), *answers(copy, *rows), *answers(scene, *rows, ignore=hidden)]
    expected += contacts(scene, rows[0])
    assert (tmp_path / "told").read_bytes() == b"".join(np.asarray(each).tobytes() for each in expected)
    count = len(scene.parts)
    assert lines == [
        f"{count} {hidden} -1 ''",
        "3 none.prox: it cannot be opened (No such file or directory)",
        "4 it is no compiled scene; `proximity compile` makes one of files of parts",
        f"1 there is no part 7777, expected 0 to {count - 1}",
        *2 * [f"5 part '{scene.parts[0].name}': the matrix has the last row 0 0 0 0, expected 0 0 0 1"],
        "1 the scene has no parts, expected at least one: add a mesh",
        "1 not closed: there is no inside, so distances have no sign",
        "1 the scene has a part named 'lid', expected another name",
        "10 face 0 refers to vertex 9, but the mesh has 3 vertices",
        "1 lid",
        "1 an array has the wrong length, expected a row for each that is asked",
        "1 max_distance is -1, expected a length of 0 m or more",
        "1 there is no scene, no place for the tracker, or no finger",
        "collections 0",
    ]


@has_library
def test_pairs_and_ticks_of_parts_are_those_of_python(package, tmp_path):
    scene = overlapping_parts()
    scene.save(tmp_path / "scene.prox")
    asked, names = LibraryScene(tmp_path / "scene.prox"), [part.name for part in scene.parts]

    lines = answer(program(package, CLIENTS / "PairsProgram.cs"), tmp_path / "scene.prox", tmp_path / "told")

    pairs, expected = asked.closest_pairs(), []
    expected += [np.array([list(map(names.index, pair[:2])) for pair in pairs], np.int32)]
    for pair in pairs:
        ends = [*pair.point_on_first, *pair.point_on_second]
        words = pair.face_on_first, pair.face_on_second, list(proximity.Relation).index(pair.relation), 0
        expected += [np.array([pair.lower, pair.distance, *ends]), np.array(words, np.int32)]
    expected += [np.array([0, 1], np.int32)]
    for options in ({}, {"direction": [0, 0, 2], "tolerance": 0.1}):
        expected += map(np.array, scene.penetration(*names[:2], **options)[2:])
    tracker, pose = proximity.PartTracker(scene, names[1:], connections=2, tolerance=0.05), np.eye(4)
    for k in range(40):
        pose[0, 3] += 0.002
        now = 10**12 + 10**6 * k
        given = {"velocity": [1, 2, 3], "angular_velocity": [0, 0, k]} if k % 5 == 4 else {}
        expected += [tracker.tick(None if k % 5 == 3 else pose, now, now + 300, **given).copy()]
    assert (tmp_path / "told").read_bytes() == b"".join(each.tobytes() for each in expected)
    assert lines.splitlines() == [
        "collections 0",
        "an array has the wrong length, expected a row for each that is asked",
    ]


def overlapping_parts():
    """Two parts in each other, and a third."""
    return proximity.Scene(
        [
            proximity.Solid(*shapes.torus(0.05, 0.02), name="ring"),
            proximity.Solid(*shapes.sphere(0.03, 2), name="ball"),
            proximity.Solid(*shapes.cube(0.05, (0.2, 0.0, 0.0)), name="cube"),
        ]
    )


def test_functions_are_those_of_the_header():
    """Compares names and number of arguments in the texts."""
    header = "".join(path.read_text() for path in sorted((CORE / "library").glob("proximity*.h")))
    declared = {
        name: 0 if words == "void" else words.count(",") + 1
        for name, words in re.findall(r"PROXIMITY_API [^;(]*?(proximity_\w+)\(([^)]*)\);", header)
    }
    source = client_files("csharp", "client")["Runtime/Proximity.cs"]
    called = re.findall(r'\[DllImport\("proximity"\)\] [^;(]*?(proximity_\w+)\(([^)]*)\);', source)

    codes = re.findall(r"PROXIMITY_(\w+) = (\d+)", header.partition("PROXIMITY_OK = 0")[2].partition("}")[0])
    for name, number in codes:
        assert f"{name.title().replace('_', '')} = {number}" in source, name
        assert f"{name}: {number}" in (CLIENTS_OF_LANGUAGES / "wasm" / "proximity.mjs").read_text(), name
    assert len(codes) == 10
    assert len(called) == source.count("DllImport(") > 20
    for name, words in called:
        assert declared[name] == (words.count(",") + 1 if words else 0), name


# Unity


def matrix_of(quaternion):
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * axis + 2 * axis @ axis


MIRRORS = {"YAndZ": np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]), "X": np.diag([-1.0, 1, 1])}
QUARTER = [0.0, 0.5**0.5, 0.0, 0.5**0.5]
"""About Unity's upward axis: forward is rotated to the right."""


def unity_program(package):
    names = [f"Proximity{name}" for name in ("Messages", "Client", "Hand")]
    names += [f"Proximity{name}" for name in ("", "Axes", "Distance")]
    return program(package, CLIENTS / "Unity.cs", "-define:UNITY_5_3_OR_NEWER", files=names)


def test_components_compile_against_names_of_unity(package):
    """Unity is replaced by stand-ins for the members used."""
    unity_program(package)


@has_library
@pytest.mark.parametrize("mirror", MIRRORS)
def test_component_shows_the_distance_to_a_concave_part(package, tmp_path, mirror):
    scene = proximity.Scene([proximity.Solid(*shapes.torus(0.05, 0.01), name="ring")])
    scene.save(tmp_path / "bracket.prox")
    rng, flip, command = np.random.default_rng(5), MIRRORS[mirror], unity_program(package)
    for _ in range(3):
        at, origin, mover = rng.uniform(-0.1, 0.1, (3, 7)).astype(np.float32)
        words = [f"{word:.9g}" for word in np.concatenate([at, unit(origin), unit(mover)])]

        note, label, *told, last = answer(command, tmp_path, mirror, "ring", *words).splitlines()

        world, turn = np.array(origin[:3], float), matrix_of(origin[3:])
        local = turn.T @ (mover[:3] - world)
        pose = Pose(flip @ turn.T @ matrix_of(mover[3:]) @ flip, flip @ local)
        scene.move("ring", pose)
        found = scene.closest(flip @ turn.T @ (at[:3] - world))
        nearest, normal = (np.array([float(word) for word in line.split()]) for line in told)
        assert np.abs(nearest - (turn @ flip @ found.point + world)).max() < 1e-6
        assert np.abs(normal - turn @ flip @ found.gradient).max() < 1e-4
        assert last.split()[1] == "ring" and abs(float(last.split()[0]) - found.signed_distance) < 1e-6
        assert note == 'bracket.prox has no part named "Cube (1)": it is not moved (expected one of ring)'
        assert label == f"{1e3 * float(last.split()[0]):.2f} mm to ring"


def unit(pose):
    pose[3:] /= np.linalg.norm(pose[3:])
    return pose


@has_library
@pytest.mark.parametrize(("mirror", "ahead"), [("YAndZ", [0.0, 0.1, 0.0]), ("X", [0.0, 0.0, 0.1])])
def test_part_turns_as_its_object_does(package, tmp_path, mirror, ahead):
    """A needle pointing forward in Unity, rotated about the upward axis there, points to the right."""
    needle = shapes.box(np.full(3, -0.001), np.array(ahead) + 0.001)
    proximity.Scene([proximity.Solid(*needle, name="needle")]).save(tmp_path / "bracket.prox")
    words = [0.2, 0, 0, 0, 0, 0, 1, *[0] * 6, 1, *[0] * 3, *QUARTER]

    told = answer(unity_program(package), tmp_path, mirror, "needle", *words).splitlines()

    assert np.abs(np.subtract([float(word) for word in told[2].split()], [0.1, 0, 0])).max() < 2e-3


# The guide


@has_library
def test_program_of_the_guide_prints_what_is_shown(package, tmp_path):
    page = PAGES["guide/c-library.md"]
    code, printed = re.search(r"```csharp\n(.*?)```.*?```text\n(.*?)```", page, re.DOTALL).groups()
    source = package / "Closest.cs"
    source.write_text(code)
    proximity.load(MESHES / "bracket.stl", units="mm").save(tmp_path / "bracket.prox")

    assert code.count("\n") <= 30
    assert answer(program(package, source), cwd=tmp_path) == printed


@has_library
@pytest.mark.skipif(sys.platform != "linux", reason="mailboxes are of Linux")
def test_frames_are_read_in_shared_memory(package, request):
    """Of one publisher and its successor, bit-identical."""
    command = program(
        package, CLIENTS / "Mailbox.cs", files=("ProximityMessages", "ProximityClient", "ProximityMailbox")
    )
    name, library = new_name(), c_package.library_path().parent
    reader = subprocess.Popen(
        [str(word) for word in (*command, name, 6)], stdout=subprocess.PIPE, text=True,
        env=os.environ | {"LD_LIBRARY_PATH": str(library)},
    )  # fmt: skip
    request.addfinalizer(reader.stdout.close)
    request.addfinalizer(reader.kill)
    assert reader.stdout.readline() == "open\n"
    for lift in (0.1, 0.2):
        with open_publisher(f"shm://{name}") as publisher:
            for number in range(3):
                publisher.publish(
                    frame(time.monotonic_ns(), 1, distance=lift + number / 3.0, valid_for=10**9)
                )
                sequence, distance = reader.stdout.readline().split()
                assert (int(sequence), float(distance)) == (number, lift + number / 3.0)
    assert reader.stdout.readline() == "2\n"
    assert reader.wait(60) == 0
