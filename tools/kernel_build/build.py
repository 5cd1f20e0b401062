"""From sources to the extension module of each target."""

import importlib
import os
import platform
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from kernel_build.link import door_table, extension_name, link
from kernel_build.targets import TARGETS, Instructions, Target, door_symbol, emit_object
from proximity.native.sources import PACKAGE, sources_digest


def host_target() -> Target:
    """Return the target that this machine is; `SystemExit` where it is none."""
    name = _host_name()
    if name not in TARGETS:
        raise SystemExit(f"there is no target {name}, expected one of {', '.join(TARGETS)}")
    return TARGETS[name]


def _host_name() -> str:
    system = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}.get(platform.system(), "other")
    return f"{system}-{'x86_64' if platform.machine() == 'AMD64' else platform.machine()}"


def extension_path(target: Target, folder: Path) -> Path:
    """Return where the extension module of a target belongs: that of this machine in the folder itself."""
    is_here = target.name == _host_name()
    return (folder if is_here else folder / target.name) / extension_name(target)


def is_current(target: Target, folder: Path) -> bool:
    """Return whether a folder holds the extension of a target as the sources are now."""
    extension = extension_path(target, folder)
    return extension.is_file() and sources_digest().encode() in extension.read_bytes()


def build(targets: list[Target], folder: Path) -> list[Path]:
    """Return the extension modules of the targets; of several each is in a folder of its name."""
    digest, code = sources_digest(), _front_end()
    jobs = [(code, target, instructions) for target in targets for instructions in target.sets]
    with tempfile.TemporaryDirectory() as work, ProcessPoolExecutor(min(len(jobs), os.cpu_count() or 1)) as pool:
        objects = list(pool.map(_emit, jobs))
        made = []
        for target in targets:
            scratch = Path(work, target.name)
            scratch.mkdir()
            paths = []
            for (_, of, instructions), content in zip(jobs, objects, strict=True):
                if of is target:
                    paths.append(scratch / f"{instructions.name}.o")
                    paths[-1].write_bytes(content)
            table = scratch / "door_table.c"
            table.write_text(door_table(_doors(target), digest))
            extension = link(target, paths, table, scratch)
            final = extension_path(target, folder)
            final.parent.mkdir(parents=True, exist_ok=True)
            unfinished = final.with_suffix(".unfinished")
            unfinished.write_bytes(extension.read_bytes())
            os.replace(unfinished, final)  # who has the old one loaded keeps it
            made.append(final)
        return made


def _front_end() -> str:
    """The code of all entry points."""
    from proximity.native import jit

    jit.is_kept = False
    from kernel_build import front_end
    from proximity.native.declaration import ENTRIES

    front_end.disable_code_generation()
    for source in sorted(PACKAGE.rglob("*.py")):
        if "@entry(" in source.read_text(encoding="utf-8"):
            importlib.import_module(".".join(source.relative_to(PACKAGE.parent).with_suffix("").parts))
    return front_end.linked_doors({name: (each.compiled, each.signature) for name, each in sorted(ENTRIES.items())})


def _doors(target: Target) -> list[tuple[str, str, str]]:
    from proximity.native.declaration import ENTRIES

    return [
        (instructions.name, name, door_symbol(name, instructions))
        for instructions in target.sets
        for name in sorted(ENTRIES)
    ]


def _emit(job: tuple[str, Target, Instructions]) -> bytes:
    return emit_object(*job)


if __name__ == "__main__":
    sys.exit("see tools/build_kernels.py")
