"""Objects and C sources to one extension module, by the compiler and linker in the package ``ziglang``."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy

from kernel_build.targets import Target

NATIVE = Path(__file__).resolve().parent / "native"
_FLAGS = [
    "-O2", "-std=c11", "-Wall", "-Wextra", "-Werror=implicit-function-declaration", "-fvisibility=hidden",
    "-fno-sanitize=all", "-ffile-prefix-map=.=", "-g0",
]  # fmt: skip


def compiler_command() -> list[str]:
    """Return the command of the C compiler."""
    return [sys.executable, "-m", "ziglang", "cc"]


def link(target: Target, objects: list[Path], table: Path, folder: Path) -> Path:
    """Return the extension module.

    Parameters
    ----------
    target : Target
        The system.
    objects : list of Path
        Compiled doors, an object for each set of instructions.
    table : Path
        C source of `door_table`.
    folder : Path
        For what is made.
    """
    extension = folder / target.extension
    command = [
        *compiler_command(), "-target", target.zig, "-shared", *_FLAGS,
        *_headers(target), f"-I{NATIVE}", "-o", str(extension),
        str(table), *map(str, sorted(NATIVE.glob("*.c"))), *map(str, objects), *_system(target), "-s",
    ]  # fmt: skip
    cache = str(folder / "zig")
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"linking for {target.name} failed:\n{done.stderr}")
    return extension


def door_table(doors: list[tuple[str, str, str]], digest: str) -> str:
    """Return the C source of the table of doors.

    Parameters
    ----------
    doors : list of tuple of str
        Of each the set of instructions, the name, and the symbol.
    digest : str
        Of the sources.
    """
    lines = ['#include "door.h"', ""]
    lines += [f"extern int {symbol}(void **, void **, int64_t);" for _, _, symbol in doors]
    lines += ["", "const NamedDoor named_doors[] = {"]
    lines += [f'    {{"{instructions}", "{name}", {symbol}}},' for instructions, name, symbol in doors]
    lines += ["    {NULL, NULL, NULL}};", f'const char sources_digest[] = "{digest}";', ""]
    return "\n".join(lines)


def _headers(target: Target) -> list[str]:
    return [f"-I{sysconfig.get_paths()['include']}", f"-I{numpy.get_include()}"]


def _system(target: Target) -> list[str]:
    """What else the linker has to be given on a system."""
    if target.name.startswith("linux"):
        return ["-lm"]
    if target.name.startswith("macos"):
        return ["-undefined", "dynamic_lookup"]
    return []
