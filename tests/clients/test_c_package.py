"""The folder written by ``proximity library c``, used from programs; and the guide's program."""

import os
import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from compiling_c import WARNINGS, c_compiler, compiler, run
from pages import PAGES
from project import MESHES, SUPPORT
from wire import frame

import proximity
from proximity import ProximityError
from proximity.clients import c_package, write_client
from proximity.core import CORE, library_in_c
from proximity.service.description import Describer

has_library = pytest.mark.skipif(
    not any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES),
    reason="the library is compiled with the kernels",
)
POINTS = ["0", "0", "0.02", "0.06", "0.02", "0.004"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The written package and a scene."""
    folder = tmp_path_factory.mktemp("program")
    c_package.write_library(folder / "engine")
    proximity.load(MESHES / "bracket.stl", units="mm").save(folder / "bracket.prox")
    return folder


def linked(folder, source, *options, tool=None):
    """Build a program from a source, with warnings as errors."""
    program = folder / f"{source.stem}_{len(list(folder.iterdir()))}"
    library = folder / "engine" / "lib"
    where = [f"-I{folder}/engine/include", f"-L{library}", "-lproximity", f"-Wl,-rpath,{library}", "-lm"]
    run(tool or c_compiler(), *WARNINGS, *options, source, "-o", program, *where)
    return program


def expected_lines():
    """Return the example's output, computed in Python."""
    scene = proximity.load(MESHES / "bracket.stl", units="mm")
    lines = []
    for at in range(0, len(POINTS), 3):
        found = scene.closest([float(word) for word in POINTS[at : at + 3]])
        where = " ".join(f"{value:.6g}" for value in found.point)
        lines.append(f"{found.signed_distance:.6g} m to {scene.parts[found.part].name}, at {where}")
    return lines


@has_library
@pytest.mark.parametrize("standard", ["c99", "c11"])
def test_examples_run_from_an_empty_folder(folder, standard):
    examples = folder / "engine" / "examples"

    distances = linked(folder, examples / "distances.c", f"-std={standard}")
    moving = linked(folder, examples / "moving.c", f"-std={standard}")

    assert run(distances, folder / "bracket.prox", *POINTS).splitlines() == expected_lines()
    steps = [float(line.split()[-2]) for line in run(moving, folder / "bracket.prox").splitlines()]
    assert len(steps) == 5 and steps == sorted(steps, reverse=True) and steps[-1] < 0.7 * steps[0]
    done = subprocess.run([distances, "none.prox", *POINTS], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        1,
        "none.prox: it cannot be opened (No such file or directory)\n",
    )


@has_library
@pytest.mark.skipif(sys.platform != "linux", reason="mailboxes are of Linux")
def test_example_of_a_mailbox_follows_a_service_that_starts_anew(folder):
    write_client("c", folder / "client")
    program = linked(folder, folder / "client" / "mailbox_receiver.c", "-std=c99")
    name = f"receiver-{os.getpid()}"
    with subprocess.Popen([program, name, "60"], stdout=subprocess.PIPE, text=True) as receiver:
        lines = receiver.stdout
        assert next(lines) == "no frame yet\n"
        for part in ("lid", "base"):
            with proximity.open_publisher(f"shm://{name}") as publisher:
                describer = Describer(["thumb"], [0.007])
                for line in lines:  # one every 100 ms
                    describer.ask()
                    labels = [part], np.array([False])
                    publisher.publish(describer.message(0, time.monotonic_ns(), lambda kept=labels: kept))
                    for _ in range(5):
                        publisher.publish(frame(time.monotonic_ns(), count=1, valid_for=900_000_000))
                    if part in line:
                        break
                assert line == f"OK; finger 0: at 50.000 mm to {part}\n"
        assert any(line == "STALE\n" for line in lines)  # the publisher closed, and no frame follows
        receiver.terminate()
    done = subprocess.run([program, "a/b", "1"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "") and done.stderr


@has_library
def test_header_is_one_of_cpp_as_well(folder):
    source = folder / "header.cpp"
    source.write_text(
        "#include <proximity.h>\nint main() { return proximity_interface() != PROXIMITY_INTERFACE; }\n"
    )

    run(linked(folder, source, "-std=c++11", tool=compiler("c++", "g++", "clang++")))


@has_library
def test_header_for_cpp_closes_scenes_and_throws(folder):
    source = SUPPORT / "clients" / "library_program.cpp"
    program = linked(folder, source, "-std=c++20", tool=compiler("c++", "g++", "clang++"))
    scene = proximity.load(MESHES / "bracket.stl", units="mm")
    points, up = np.array([[0.03, 0.01, 0.005], [0.03, 0.01, 0.002]]), np.array([[0.0, 0.0, 1.0]] * 2)
    contacts = proximity.Tracker(scene, fingers=2).tick(points, 10**9, 10**9 + 500)
    columns = (
        scene.signed_distance(points), scene.signed_distance(points), scene.contains(points).astype(int),
        scene.cast(points, up).distance, scene.closest_to_segments(points, up).distance,
        contacts["signed_distance"],
    )  # fmt: skip

    with pytest.warns(proximity.UnitsWarning) as noted:
        scene.signed_distance([0.03, 0.01, 40.0])

    lines = run(program, folder / "bracket.prox").splitlines()

    expected = [
        " ".join(["bracket", *(f"{value:.6g}" for value in row)]) for row in zip(*columns, strict=True)
    ]
    assert lines == [
        *expected,
        "there is no part named 'nothing'",
        "the scene is NULL, expected one that is open",
        str(noted[0].message),
        "3 none.prox: it cannot be opened (No such file or directory)",
    ]


@has_library
def test_header_for_cpp_without_exceptions_has_a_status(folder):
    source = folder / "status.cpp"
    source.write_text("""
#include <proximity.hpp>
int main(int, char **words)
{
    proximity::Scene none("none.prox"), scene(words[1]);
    std::array<proximity::Vector, 1> points{};
    std::array<double, 2> distances{7.0, 7.0};
    std::array<std::int64_t, 1> instants{1000000000};
    std::printf("%d %s\\n", proximity::status().code, proximity::status().sentence);
    none.signed_distance(points, std::span<double>(distances).first(1));
    std::printf("%d %g\\n", proximity::status().code, distances[0]);
    proximity::status().code = PROXIMITY_OK;
    scene.signed_distance(points, distances);
    std::printf("%s\\n", proximity::status().sentence);
    proximity::Tracker tracker(scene, 2), lost(none, 2);
    const std::size_t unfit = tracker.tick(points, instants, instants[0]).size();
    std::printf("%zu\\n", unfit + lost.tick(points, instants, 1).size());
    std::array<proximity::Vector, 2> both{};
    std::array<std::int64_t, 2> then{1000000000, 1000000000};
    std::printf("%zu\\n", tracker.tick(both, then, then[0]).size());
}
""")
    program = linked(folder, source, "-std=c++20", "-fno-exceptions", tool=compiler("c++", "g++", "clang++"))

    assert run(program, folder / "bracket.prox").splitlines() == [
        "3 none.prox: it cannot be opened (No such file or directory)",
        "1 7",
        "spans have different numbers of rows",
        "0",
        "2",
    ]


@has_library
def test_program_of_the_guide_prints_what_is_shown(folder):
    page = PAGES["guide/c-library.md"]
    code, printed = (re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL)[1] for kind in ("c", "text"))
    source = folder / "closest.c"
    source.write_text(code)
    program = linked(folder, source, "-std=c99")

    done = subprocess.run([program], cwd=folder, capture_output=True, text=True, check=True)

    assert done.stdout == printed


@has_library
def test_program_in_cpp_of_the_guide_prints_what_is_shown(folder):
    page = PAGES["guide/c-library.md"]
    code, printed = re.search(r"```cpp\n(.*?)```.*?```text\n(.*?)```", page, re.DOTALL).groups()
    source = folder / "fingertip.cpp"
    source.write_text(code)
    program = linked(folder, source, "-std=c++20", tool=compiler("c++", "g++", "clang++"))

    done = subprocess.run([program], cwd=folder, capture_output=True, text=True, check=True)

    assert done.stdout == printed


@has_library
def test_program_of_the_guide_adds_a_mesh(folder):
    code = re.search(r"as `imported.cpp`:\n\n```cpp\n(.*?)```", PAGES["guide/c-library.md"], re.DOTALL)[1]
    printed = re.search(r"\n./imported\n```\n\n```text\n(.*?)```", PAGES["guide/c-library.md"], re.DOTALL)[1]
    source = folder / "imported.cpp"
    source.write_text(code)
    program = linked(folder, source, "-std=c++20", tool=compiler("c++", "g++", "clang++"))

    assert subprocess.run([program], cwd=folder, capture_output=True, text=True, check=True).stdout == printed


@has_library
def test_example_imports_a_part_while_fingers_are_tracked(folder):
    source = folder / "engine" / "examples" / "imported.cpp"
    program = linked(folder, source, "-std=c++20", "-pthread", tool=compiler("c++", "g++", "clang++"))

    done = subprocess.run([program, MESHES / "bracket.stl"], capture_output=True, text=True, check=True)

    assert re.fullmatch(r"came within -?[\d.]+ mm of 'imported', now 1 part\n", done.stdout)


@has_library
@pytest.mark.skipif(sys.platform != "linux", reason="numbered names of libraries are of Linux")
def test_programs_need_the_numbered_library_or_none(folder):
    """Regression: a library of another interface was loaded instead of the one linked with."""
    lib, source = folder / "engine" / "lib", folder / "engine" / "examples" / "distances.c"
    shared = linked(folder, source)
    static = folder / "static"
    run(
        c_compiler(),
        *WARNINGS,
        source,
        f"-I{folder}/engine/include",
        lib / "libproximity.a",
        "-lm",
        "-o",
        static,
    )

    needed = [run(compiler("readelf"), "-d", program) for program in (shared, static)]

    header = (folder / "engine" / "include" / "proximity.h").read_text()
    assert f"#define PROXIMITY_INTERFACE {library_in_c.interface()}\n" in header
    assert f"[libproximity.so.{library_in_c.interface()}]" in needed[0] and "proximity" not in needed[1]
    assert (lib / "libproximity.so").readlink().name == f"libproximity.so.{library_in_c.interface()}"
    assert run(static, folder / "bracket.prox", *POINTS).splitlines() == expected_lines()


@has_library
@pytest.mark.skipif(not shutil.which("cmake"), reason="there is no CMake")
def test_cmake_finds_the_library(folder):
    project = folder / "project"
    project.mkdir()
    (project / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(program C)\n"
        f"find_package(proximity 99 CONFIG QUIET PATHS {folder}/engine NO_DEFAULT_PATH)\n"
        'if(proximity_FOUND)\n  message(FATAL_ERROR "version 99 was found")\nendif()\n'
        f"find_package(proximity {proximity.__version__} EXACT CONFIG REQUIRED PATHS {folder}/engine "
        "NO_DEFAULT_PATH)\n"
        "foreach(kind proximity static)\n"
        f"  add_executable(with_${{kind}} {folder}/engine/examples/moving.c)\n"
        "  target_link_libraries(with_${kind} PRIVATE proximity::${kind})\n"
        "endforeach()\n"
    )
    c_compiler()

    run("cmake", "-S", project, "-B", project / "build")
    run("cmake", "--build", project / "build")

    for kind in ("proximity", "static"):
        assert len(run(project / "build" / f"with_{kind}", folder / "bracket.prox").splitlines()) == 5


@has_library
@pytest.mark.skipif(not shutil.which("pkg-config"), reason="there is no pkg-config")
def test_pkg_config_finds_the_library(folder):
    environment = os.environ | {"PKG_CONFIG_PATH": str(folder / "engine/lib/pkgconfig")}
    words = [
        subprocess.run(
            ["pkg-config", *options, "proximity"], env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()
        for options in (["--modversion"], ["--cflags", "--libs"])
    ]

    assert words[0] == proximity.__version__ and words[1].split()[-1] == "-lproximity"


def test_package_of_python_is_no_folder_to_write_to(tmp_path):
    (tmp_path / "__init__.py").touch()

    with pytest.raises(ProximityError, match="is a package of Python, expected another folder, such as eng"):
        c_package.write_library(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["__init__.py"]


@has_library
def test_example_that_is_there_is_left_alone(folder, tmp_path):
    c_package.write_library(tmp_path)
    (tmp_path / "examples" / "moving.c").write_text("mine")

    written = c_package.write_library(tmp_path)

    assert (tmp_path / "examples" / "moving.c").read_text() == "mine"
    assert [path for path, is_written in written.items() if not is_written] == [
        str(tmp_path / "examples" / name) for name in ("distances.c", "moving.c", "imported.cpp")
    ]


def test_folder_for_windows_has_the_import_library(monkeypatch, tmp_path):
    for name in ("proximity.dll", "proximity.lib"):
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(c_package, "library_path", lambda: tmp_path / "proximity.dll")

    written = c_package.write_library(tmp_path / "package")

    lib = tmp_path / "package" / "lib"
    assert {path.name for path in lib.iterdir() if path.is_file()} == {"proximity.dll", "proximity.lib"}
    assert (lib / "proximity.lib").read_text() == "proximity.lib" and written[str(lib / "proximity.lib")]
    config = (lib / "cmake" / "proximity" / "proximity-config.cmake").read_text()
    assert 'IMPORTED_IMPLIB "${_prefix}/lib/proximity.lib"' in config


def test_library_that_was_not_compiled_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(library_in_c, "LIBRARIES", ())

    with pytest.raises(ProximityError, match="the library in C has not been compiled for this system"):
        c_package.write_library(tmp_path)


@has_library
def test_library_of_other_sources_is_not_loaded(monkeypatch):
    """Regression: with structures of other sources a loop wrote out of bounds, and the process crashed."""
    monkeypatch.setattr(library_in_c, "core_digest", lambda: "other")

    with pytest.raises(ProximityError, match="is older than the sources in proximity/core: run `py"):
        library_in_c.libraries.__wrapped__()


@has_library
@pytest.mark.skipif(sys.platform != "linux", reason="names of symbols are read as Linux has them")
def test_nothing_but_the_interface_can_be_seen():
    tool = compiler("nm")
    symbols = run(tool, "-D", "--defined-only", library_in_c.library_path()).splitlines()
    names = {line.split()[-1] for line in symbols}
    declaring = ("library/*.h", "mailbox/mailbox.c", "loop/loop.c")
    headers = "".join(path.read_text() for name in declaring for path in CORE.glob(name))

    declared = set(re.findall(r"PROXIMITY_API [^;(]*?(proximity_\w+)\(", headers))
    assert names - {"proximity_sets"} == declared and len(declared) > 20
