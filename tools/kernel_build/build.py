"""From sources to the extension module of each target."""

import gc
import importlib.util
import os
import sys
import tempfile
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

from llvmlite import binding

from kernel_build import front_end, kept_code
from kernel_build.link import entry_table, link, link_library
from kernel_build.objects import emit_object
from kernel_build.state import library_digest, sources_digest
from kernel_build.targets import (
    Instructions,
    Target,
    host_target,
    module_path,
    target_folder,
    wrapper_symbol,
)
from kernel_build.wasm import link_module
from proximity.native.declaration import ENTRIES
from proximity.native.sources import PACKAGE

GROUPS = (
    ("kernels.scene.queries.point_queries",),
    ("kernels.tree", "kernels.mesh", "kernels.bodies", "kernels.sign", "kernels.geometry"),
    ("kernels.tracking", "kernels.scene.queries.segment_queries"),
    ("",),
)
"""Modules, by prefixes of their names, whose entry points share much code: groups of similar duration."""
RARELY = 200_000, 50, 100
"""Thresholds of the garbage collector: by default it takes a tenth of the time, and finds little."""


def build(targets: list[Target], folder: Path, *, every_set: bool) -> list[Path]:
    """Build the extension module of each target in its folder, and the library next to it; return the paths.

    Only for the best set of instructions of this machine, or of browsers, unless *every_set*.
    """
    sets = {target.name: target.sets if every_set else usable_sets(target)[-1:] for target in targets}
    process_count = min(len(GROUPS), os.cpu_count() or 1)
    groups = [tuple(range(first, len(GROUPS), process_count)) for first in range(process_count)]
    compiled = _compile_groups(groups, targets, sets)
    digest = sources_digest()
    made = []
    for target in targets:
        objects = [
            CompiledGroup(instructions, entries, content[target.name, instructions.name])
            for instructions in sets[target.name]
            for entries, content in compiled
        ]
        if not target.is_web:
            made += _linked(target, objects, digest, target_folder(target, folder))
        else:
            made += [_linked_module(target, objects, each, folder) for each in sets[target.name]]
    _remove_old_modules(folder)
    return made


def _remove_old_modules(folder: Path) -> None:
    """Remove modules for browsers of other sources: they are compiled on demand."""
    for path in folder.glob("proximity.*.wasm"):
        if library_digest().encode() not in path.read_bytes():
            path.unlink()


def usable_sets(target: Target) -> tuple[Instructions, ...]:
    """Return the sets of instructions of a target that this machine has; all for another system's."""
    if target.name != host_target().name:
        return target.sets
    features = binding.get_host_cpu_features()
    return tuple(each for each in target.sets if all(features.get(name) for name in each.needs))


class CompiledGroup(NamedTuple):
    """Compiled entry points of one group, for one set of instructions."""

    instructions: Instructions
    entries: list[str]  # see `entry_table`
    content: bytes  # an object file

    @property
    def names(self) -> list[str]:
        """Names of the entry points."""
        return [each.partition("|")[0] for each in self.entries]


def _compile_groups(
    groups: list[tuple[int, ...]], targets: list[Target], sets: dict[str, tuple[Instructions, ...]]
) -> list[tuple[list[str], dict[tuple[str, str], bytes]]]:
    """Return the entry points of groups, as for `entry_table`, and the objects by target and set.

    One process per group of groups; each object is another task, as modules differ in size.
    """
    with ProcessPoolExecutor(len(groups)) as pool:
        codes = [pool.submit(_code_of_groups, each) for each in groups]
        objects: dict[Future[tuple[list[str], str]], dict[tuple[str, str], Future[bytes]]] = {}
        for made in as_completed(codes):
            objects[made] = {
                (target.name, instructions.name): pool.submit(_object, made.result()[1], target, instructions)
                for target in targets
                for instructions in sets[target.name]
            }
        return [
            (made.result()[0], {key: content.result() for key, content in objects[made].items()})
            for made in codes
        ]


def _object(code: str, target: Target, instructions: Instructions) -> bytes:
    """Return the object file of code, kept or new."""
    content = kept_code.read_object(code, target, instructions)
    if content is None:
        content = emit_object(code, target, instructions)
        kept_code.write_object(code, target, instructions, content)
    return content


def _code_of_groups(groups: tuple[int, ...]) -> tuple[list[str], str]:
    """Return entry points in groups, and their LLVM code: kept, or new, which is kept."""
    if kept := kept_code.read(groups):
        return kept
    gc.set_threshold(*RARELY)
    front_end.disable_code_generation()
    for source in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(source.relative_to(PACKAGE.parent).with_suffix("").parts)
        if _group_of(name) in groups and "@entry(" in source.read_text(encoding="utf-8"):
            _load(name, source)
    own = [
        each for _, each in sorted(ENTRIES.items()) if _group_of(each.compiled.py_func.__module__) in groups
    ]
    code = front_end.linked_wrappers({each.name: (each.compiled, each.signature) for each in own})
    entries = [f"{each.name}|{each.rows_with_gil}|{each.signature.text}" for each in own]
    kept_code.write(groups, entries, code)
    return entries, code


def _group_of(module: str) -> int:
    """Return the number of the group of a module: the first with a matching prefix."""
    name = module.removeprefix("proximity.")
    return next(k for k, beginnings in enumerate(GROUPS) if name.startswith(beginnings))


def _load(name: str, source: Path) -> None:
    """Import a module without its packages, which import more than kernels need."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, source)
        assert spec is not None and spec.loader is not None, f"{source} can be loaded"
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])


def _linked(target: Target, objects: list[CompiledGroup], digest: str, place: Path) -> list[Path]:
    """Link a target's objects to its extension module, if it has one, and to its library."""
    with tempfile.TemporaryDirectory() as scratch:
        files = []
        for number, each in enumerate(objects):
            files.append(Path(scratch, f"{each.instructions.name}-{number}.o"))
            files[-1].write_bytes(each.content)
        table = Path(scratch, "entry_table.c")
        wrappers = [
            (each.instructions.name, name, wrapper_symbol(name, each.instructions))
            for each in objects
            for name in each.names
        ]
        entries = dict.fromkeys(entry for each in objects for entry in each.entries)
        table.write_text(entry_table(wrappers, list(entries), digest), encoding="utf-8")
        made = []
        if target.extension:
            extension = link(target, files, table, Path(scratch))
            made.append(_placed(extension, place / target.extension))
        library = link_library(target, files, wrappers, library_digest(), Path(scratch))
        made.append(_placed(library, place / target.library))
        if target.static_library:
            made.append(_placed(library.with_name(target.static_library), place / target.static_library))
        if target.import_library:
            made.append(_placed(library.with_name(target.import_library), place / target.import_library))
        return made


def _linked_module(
    target: Target, objects: list[CompiledGroup], instructions: Instructions, folder: Path
) -> Path:
    """Link the objects of one set of instructions to a module for browsers; return its path."""
    own = [each for each in objects if each.instructions == instructions]
    with tempfile.TemporaryDirectory() as scratch:
        files = [Path(scratch, f"{number}.o") for number in range(len(own))]
        for path, each in zip(files, own, strict=True):
            path.write_bytes(each.content)
        symbols = [
            (instructions.name, name, wrapper_symbol(name, instructions))
            for each in own
            for name in each.names
        ]
        module = link_module(target, files, symbols, library_digest(), Path(scratch))
        return _placed(module, module_path(instructions, folder))


def _placed(made: Path, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_bytes(made.read_bytes())
    os.replace(unfinished, path)  # a process that has loaded the old one keeps it
    return path
