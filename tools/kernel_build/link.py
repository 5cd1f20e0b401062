"""Objects and C sources to one extension module, by the compiler and linker in the package ``ziglang``."""

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy

from core_tables import tables_header, tables_source
from kernel_build.state import ROOT, core_digest, digest_in_c
from kernel_build.targets import Target
from kernel_build.windows import python_library
from proximity.core import CORE
from proximity.core.library_in_c import interface
from proximity.decaff.controller.records import controller_header
from proximity.message.c_header import header_text
from proximity.native.declaration import C_CODE

HEADERS = Path(__file__).resolve().parent / "headers"
PYTHON = CORE / "cpython"
CONTROLLER = ROOT / "proximity" / "decaff" / "controller"
RECEIVER = CORE / "receiver" / "receiver_entries.c"
LIBRARY = [CORE / name for name in ("library", "loop", "mailbox")]
_BIONIC = ["-D__errno_location=__errno", "-U__linux__", "-fno-builtin", "-mno-outline-atomics", "-fPIC"]
"""Options for Android: names in its C library that differ from the headers here. There is no shared memory
and no loop, as on other systems without Linux."""
_COMPILE = ["-std=c11", "-Wall", "-Wextra", "-fvisibility=hidden", "-fno-sanitize=all", "-g0"]


def link(target: Target, objects: list[Path], table: Path, folder: Path) -> Path:
    """Return the extension module."""
    extension = folder / target.extension
    (folder / "proximity_message.h").write_text(header_text(), encoding="ascii")
    (folder / "decaff_controller.h").write_text(controller_header(), encoding="ascii")
    sources = [table, *sorted(PYTHON.glob("*.c")), *CONTROLLER.glob("*.c"), RECEIVER]
    compiled = [_compiled(target, source, folder, *_headers(target)) for source in sources]
    files = map(str, [*compiled, *objects])
    zig(target, folder, "-shared", "-s", "-o", str(extension), *files, *_system(target, compiled, folder))
    return extension


def link_library(
    target: Target, objects: list[Path], wrappers: list[tuple[str, str, str]], digest: str, folder: Path
) -> Path:
    """Return the C library of the same objects, next to its static and import libraries, if any."""
    library = folder / target.library
    files = [*library_objects(target, wrappers, digest, folder), *objects]
    name = [f"-Wl,-soname,{target.library}.{interface()}"] if target.name.startswith("linux") else []
    if _is_android(target):
        name = [
            f"-Wl,-soname,{target.library}",
            "-nostdlib",
            "-Wl,-z,max-page-size=16384",
            "-Wl,--no-as-needed",
            *map(str, _named_libraries(target, folder)),
        ]
    if target.import_library:
        name = [f"-Wl,--out-implib,{folder / target.import_library}"]
    zig(target, folder, "-shared", "-s", *name, "-o", str(library), *map(str, files), *_mathematics(target))
    if target.static_library:
        run_zig(target, folder, "ar", "rcs", str(folder / target.static_library), *map(str, files))
    return library


def library_objects(
    target: Target, wrappers: list[tuple[str, str, str]], digest: str, folder: Path
) -> list[Path]:
    """Return the objects of the library's C files, and of the table of *wrappers*."""
    sets: dict[str, dict[str, str]] = {}
    for instructions, name, symbol in wrappers:
        sets.setdefault(instructions, {})[name] = symbol
    (folder / "proximity_message.h").write_text(header_text(), encoding="ascii")
    (folder / "core_tables.h").write_text(tables_header(), encoding="ascii")
    table = folder / "core_tables.c"
    table.write_text(tables_source(sets.items(), digest, core_digest()), encoding="ascii")
    options = ["-DPROXIMITY_BUILDS", "-D_GNU_SOURCE", *(f"-I{each}" for each in (*LIBRARY, PYTHON))]
    options += _BIONIC if _is_android(target) else []
    sources = [
        table,
        *(source for each in LIBRARY for source in sorted(each.glob("*.c"))),
        PYTHON / "runtime.c",
        PYTHON / "processor.c",
    ]
    return [_compiled(target, source, folder, *options) for source in sources]


def _is_android(target: Target) -> bool:
    return target.name.startswith("android")


def _named_libraries(target: Target, folder: Path) -> list[Path]:
    """Return stubs of system libraries by name: symbols are resolved when the library is loaded."""
    made = [folder / f"named-{name}.so" for name in ("libc", "libm")]
    (folder / "named.c").write_text("")
    for path in made:
        soname = f"-Wl,-soname,{path.name.removeprefix('named-')}"
        zig(target, folder, "-shared", "-nostdlib", soname, "-o", str(path), str(folder / "named.c"))
    return made


def _compiled(target: Target, source: Path, folder: Path, *options: str) -> Path:
    made = folder / f"{source.stem}.o"
    level = "-Os" if target.is_web else "-O2"  # a module for browsers is loaded over a network
    zig(target, folder, level, *_COMPILE, *options, f"-I{folder}", "-c", str(source), "-o", str(made))
    return made


def _mathematics(target: Target) -> list[str]:
    return ["-lm"] if target.name.startswith("linux") else []


def entry_table(wrappers: list[tuple[str, str, str]], entries: list[str], digest: str) -> str:
    """Return the C source of the table of wrappers, and of the entry points' data for Python.

    *entries*: name, rows with the interpreter locked, and signature of each, separated by strokes.
    """
    lines = ['#include "entry_points.h"', ""]
    wrappers = [*wrappers, *((C_CODE, name, name) for name in _functions_in_c())]
    lines += [f"extern int {symbol}(void **, void **, int64_t);" for _, _, symbol in wrappers]
    lines += ["", "const NamedEntry named_entries[] = {"]
    lines += [f'    {{"{instructions}", "{name}", {symbol}}},' for instructions, name, symbol in wrappers]
    lines += ["    {NULL, NULL, NULL}};", f'const char sources_digest[] = "{digest}";']
    lines += ["const char entry_signatures[] =", *(f'    "{each}\\n"' for each in entries), "    ;"]
    sets = dict.fromkeys(instructions for instructions, _, _ in wrappers)
    lines += [f'__attribute__((used)) static const char {name}[] = "for {name}";' for name in sets]
    lines += [f'const char digest_in_c[] = "{digest_in_c()}";', ""]
    return "\n".join(lines)


def _functions_in_c() -> list[str]:
    """Return the names of the entry points written in C."""
    text = "".join(
        path.read_text(encoding="ascii") for path in (CONTROLLER / "controller_entries.c", RECEIVER)
    )
    return re.findall(r"^int (\w+)\(void \*\*unused, void \*\*no_error, int64_t words\)", text, re.MULTILINE)


def zig(target: Target, folder: Path, *options: str) -> None:
    """Run the compiler for a target; `SystemExit` with its message on failure."""
    run_zig(target, folder, "cc", "-target", target.zig, *options)


def run_zig(target: Target, folder: Path, *words: str) -> None:
    """Run a tool of the package ``ziglang``, as `zig` does the compiler."""
    cache = str(folder / "zig")
    done = subprocess.run(
        [sys.executable, "-m", "ziglang", *words],
        env=os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"the extension for {target.name} could not be made:\n{done.stderr}")


def _headers(target: Target) -> list[str]:
    """Return the options for headers; those of Python and NumPy are replaced for other systems."""
    own = HEADERS / target.name.split("-")[0]
    config = own / "pyconfig.h"
    python = sysconfig.get_paths()["include"]
    folders = [*([own] if own.is_dir() else []), python, numpy.get_include()]
    first = ["-include", str(config)] if config.is_file() else []
    # Debian's pyconfig.h includes that of the architecture, next to the folder of Python's headers.
    last = ["-idirafter", str(Path(python).parent)]
    return first + [f"-I{folder}" for folder in (PYTHON, CONTROLLER, *folders)] + last


def _system(target: Target, compiled: list[Path], folder: Path) -> list[str]:
    """Return the linker's options for a system."""
    if target.name.startswith("linux"):
        return _mathematics(target)
    if target.name.startswith("macos"):
        return ["-undefined", "dynamic_lookup"]
    return [str(python_library(compiled, folder))]
