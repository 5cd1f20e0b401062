"""From sources to the extension module of each target."""

import importlib.util
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from kernel_build import front_end
from kernel_build.link import entry_table, link
from kernel_build.objects import emit_object
from kernel_build.state import sources_digest
from kernel_build.targets import Instructions, Target, extension_path, wrapper_symbol
from proximity.native.declaration import ENTRIES, Entry
from proximity.native.sources import PACKAGE


def build(targets: list[Target], folder: Path) -> list[Path]:
    """Make the extension module of each target, at its `extension_path` in a folder; return the paths."""
    digest, code = sources_digest(), _front_end()
    jobs = [(code, target, instructions) for target in targets for instructions in target.sets]
    with ProcessPoolExecutor(min(len(jobs), os.cpu_count() or 1)) as pool:
        objects = list(pool.map(_emit, jobs))
    made = []
    for target in targets:
        own = [
            (instructions, content)
            for (_, of, instructions), content in zip(jobs, objects, strict=True)
            if of is target
        ]
        made.append(_linked(target, own, digest, extension_path(target, folder)))
    return made


def _front_end() -> str:
    """The code of all entry points."""
    front_end.disable_code_generation()
    for source in sorted(PACKAGE.rglob("*.py")):
        if "@entry(" in source.read_text(encoding="utf-8"):
            _load(".".join(source.relative_to(PACKAGE.parent).with_suffix("").parts), source)
    return front_end.linked_wrappers({name: (each.compiled, each.signature) for name, each in _entries()})


def _load(name: str, source: Path) -> None:
    """Import a module without the packages that it is in: they import what kernels do not need."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, source)
        assert spec is not None and spec.loader is not None, f"{source} can be loaded"
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])


def _entries() -> list[tuple[str, Entry]]:
    return sorted(ENTRIES.items())


def _emit(job: tuple[str, Target, Instructions]) -> bytes:
    return emit_object(*job)


def _linked(target: Target, objects: list[tuple[Instructions, bytes]], digest: str, path: Path) -> Path:
    """Link a target's objects to its extension module at a path; return the path."""
    with tempfile.TemporaryDirectory() as scratch:
        files = []
        for instructions, content in objects:
            files.append(Path(scratch, f"{instructions.name}.o"))
            files[-1].write_bytes(content)
        table = Path(scratch, "entry_table.c")
        wrappers = [
            (instructions.name, name, wrapper_symbol(name, instructions))
            for instructions, _ in objects
            for name, _ in _entries()
        ]
        table.write_text(entry_table(wrappers, digest), encoding="utf-8")
        made = link(target, files, table, Path(scratch))
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".unfinished")
        unfinished.write_bytes(made.read_bytes())
        os.replace(unfinished, path)  # whoever has loaded the old one keeps it
    return path
