"""The library's C sources other than kernels, under the system compiler's sanitizers."""

import os
import subprocess

import mutated_scenes
import pytest
from compiling_c import c_compiler
from project import SUPPORT

from proximity.core import CORE, library_in_c
from proximity.message.c_header import header_text
from proximity.native import IS_AHEAD

OPTIONS = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-D_GNU_SOURCE"]
NO_SETS = "const InstructionSet proximity_sets[] = {\n    {NULL, {NULL}}};"
pytestmark = pytest.mark.skipif(
    not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
    reason="the library is compiled with the kernels",
)


def prepare(folder, program):
    """Copy the library's sources into a folder, with its kernels from the built library."""
    from core_tables import tables_header, tables_source

    (folder / "core_tables.h").write_text(tables_header())
    (folder / "proximity_message.h").write_text(header_text())
    tables = tables_source([], "")
    assert NO_SETS in tables
    (folder / "core_tables.c").write_text(tables.replace(NO_SETS, ""))
    names = ("library/*.[ch]", "mailbox/*.[ch]", "cpython/runtime.c", "cpython/processor.c", "cpython/*.h")
    own = [source for name in names for source in CORE.glob(name)]
    clients = [SUPPORT / "clients" / name for name in ("library_sets.c", program)]
    for source in [*own, *clients]:
        text = source.read_text()
        (folder / source.name).write_text(
            text.replace("extern const InstructionSet", "extern InstructionSet")
        )


def built(folder, program, options):
    """Build a program with the library's sources; skip if the compiler has no such sanitizers."""
    prepare(folder, program)
    files = ["-o", folder / "driver", *folder.glob("*.c"), "-lm", "-ldl", "-pthread"]
    command = [c_compiler(), *options, f"-I{folder}", *files]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if "asan" in done.stderr or "tsan" in done.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert done.returncode == 0, done.stderr
    return folder / "driver"


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    """Build a program that opens files, changes them, and uses their scenes."""
    return built(tmp_path_factory.mktemp("driver"), "library_driver.c", OPTIONS)


def printed(driver, paths):
    done = subprocess.run(
        [driver, *paths],
        env=os.environ | {"LIBRARY": str(library_in_c.library_path())},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def opened_and_refused(driver, paths):
    return tuple(map(int, printed(driver, paths).split()))


@pytest.mark.slow
def test_a_thread_that_posts_and_one_that_ticks_have_no_race(tmp_path):
    program = built(tmp_path, "posting_driver.c", ["-g", "-O1", "-fsanitize=thread", "-D_GNU_SOURCE"])
    mutated_scenes.SCENES["crowd"]().save(tmp_path / "crowd.prox")

    ticks, *reached = printed(program, [tmp_path / "crowd.prox"]).split()

    assert int(ticks) > 3000 and sorted(reached) == ["0.099999", "0.100000"]


@pytest.mark.slow
def test_scenes_of_meshes_lose_and_overrun_nothing(tmp_path):
    program = built(tmp_path, "meshes_driver.c", OPTIONS)

    added, refused = opened_and_refused(program, [])

    assert added > 50 and refused > 10


@pytest.mark.slow
def test_sanitizers_find_nothing(driver, tmp_path):
    paths = [tmp_path / f"{name}.prox" for name in mutated_scenes.SCENES]
    for path in paths:
        mutated_scenes.SCENES[path.stem]().save(path)

    opened, refused = opened_and_refused(driver, paths)

    assert opened >= 2 * len(paths) and refused > 100 * len(paths)


@pytest.mark.slow
@pytest.mark.parametrize("digits", [19, 20, 60])
def test_number_of_many_digits_is_refused_before_it_overflows(driver, digits, tmp_path):
    path = tmp_path / "alone.prox"
    mutated_scenes.alone().save(path)
    mutated_scenes.rewrite_text(path, b'"offset":', b'"offset":' + b"9" * digits)

    assert opened_and_refused(driver, [path])[0] == 0
