"""Show whether a change altered any answer: ``python bench/digest.py --out before.json``.

Afterwards ``python bench/digest.py --against before.json`` names the cases that differ.

Prints a line a case, and a total: SHA-256 over the raw bytes of the answers to every query, of the sample
parts, of the parts in ``shared/data/cad`` next to the project, of random scenes, and of a tracker over 100
000 ticks. Inputs are seeded and no clock is read, so that two runs on one machine agree, with any number of
workers. The nodes and leaves that ticks visit (``work`` in their records) are hashed separately: another
search may change them without changing an answer. Other processors, NumPy or numba may round differently:
compare runs of one machine. With ``--library`` scenes are saved, and answered by the library in C.
"""

import argparse
import hashlib
import json
import shlex
import sys
import time
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import proximity
from benchmarks.digest import queries, scenes, ticks
from benchmarks.digest.library import LibraryTracker, through_library
from benchmarks.digest.library_program import through_program
from benchmarks.support.project import MESHES, SHARED_PARTS
from proximity import Tracker

PART_FILES = {".stl", ".ply", ".glb", ".gltf", ".obj", ".off", ".3mf", ".step", ".stp"}
SCENE_POINTS, SOLID_POINTS, MAX_SOLIDS = 8000, 400, 6
WORK_CASE = "/work"


def main(arguments: list[str] | None = None) -> int:
    """Print the digests; the exit code is 1 if *--against* finds a case whose answers differ."""
    options = _parse(arguments)
    warnings.simplefilter("ignore", proximity.UnitsWarning)  # some points are far away on purpose
    proximity.warm_up()
    started, found = time.perf_counter(), {}
    for name, digest in digests(options):
        found[name] = digest
        print(f"{digest[:16]}  {name}", flush=True)
    document = {"total": total_of(found), "cases": found}
    print(f"{document['total']}  total of {len(found)} cases, {time.perf_counter() - started:.0f} s")
    if options.out:
        options.out.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    if not options.against:
        return 0
    return compare(json.loads(options.against.read_text(encoding="utf-8"))["cases"], found)


def digests(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield the name and the digest of each case."""
    folders = [MESHES] if options.without_cad else [MESHES, options.cad]
    if not folders[-1].is_dir():
        print(f"{folders.pop()} is not here: its parts are left out")
    for folder in folders:
        for path in sorted(path for path in folder.iterdir() if path.suffix.lower() in PART_FILES):
            yield from _of_file(f"{folder.name}/{path.name}", path, options)
    yield from _of_random_scenes(options)
    if options.program:
        return
    is_python = options.library is None
    tracker_of = Tracker if is_python else partial(LibraryTracker, instructions=options.library)
    for name, answers, work in ticks.digests_of_ticks(MESHES, tracker_of):
        yield name, answers
        yield f"{name}{WORK_CASE}", work


def total_of(found: dict[str, str]) -> str:
    """Return the digest of the digests of answers, in order, without the work of ticks."""
    lines = [f"{name} {digest}" for name, digest in found.items() if not name.endswith(WORK_CASE)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def compare(before: dict[str, str], now: dict[str, str]) -> int:
    """Print differing and missing cases; return 1 if answers differ or no case is common."""
    both = [name for name in now if name in before]
    different = [name for name in both if before[name] != now[name]]
    lacking = sorted(before.keys() ^ now.keys())
    for name in different:
        print(f"{'work differs' if name.endswith(WORK_CASE) else 'ANSWERS DIFFER'}: {name}")
    if lacking:
        print(f"not compared: {len(lacking)} cases that only one of the runs has, the first is {lacking[0]}")
    wrong = [name for name in different if not name.endswith(WORK_CASE)]
    work_count = len(different) - len(wrong)
    print(f"{len(both)} cases compared: {len(wrong)} with other answers, {work_count} with other work")
    return 1 if wrong or not both else 0


def _of_file(name: str, path: Path, options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield a file as a scene, that scene saved and opened again, and its solids; or the error of loading."""
    try:
        scene = proximity.load(path)
    except proximity.ProximityError as error:
        yield name, hashlib.sha256(type(error).__name__.encode()).hexdigest()
        return
    triangles = queries.triangles_of(scene)
    yield from queries.digests_of(name, _asked(scene, options), triangles, SCENE_POINTS, options.workers)
    saved = _asked(scenes.open_saved(scene), options)
    yield from queries.digests_of(f"{name} saved", saved, triangles, SOLID_POINTS, options.workers)
    for part in scene.parts[:MAX_SOLIDS] if options.library is None and not options.program else ():
        solid = part.solid
        solid_name = f"{name} solid {part.name}"
        triangles = queries.triangles_of(solid)
        yield from queries.digests_of(solid_name, solid, triangles, SOLID_POINTS, options.workers)


def _asked(scene: proximity.Scene, options: argparse.Namespace) -> Any:
    """Return the scene to query: itself, the library's, or a linked program's."""
    if options.program:
        return through_program(scene, shlex.split(options.program))
    return scene if options.library is None else through_library(scene, options.library)


def _of_random_scenes(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield each random scene as made, and after parts were deformed, moved and hidden."""
    for part_count, size, offset in scenes.RANDOM_SCENES:
        name = f"random/{part_count} parts of {size:g} m"
        rng = scenes.generator(name)
        scene = scenes.random_scene(rng, part_count, size, offset)
        triangles = queries.triangles_of(scene)
        yield from queries.digests_of(name, _asked(scene, options), triangles, SCENE_POINTS, options.workers)
        scenes.change_scene(scene, rng, size)
        triangles = queries.triangles_of(scene)
        asked = _asked(scene, options)
        yield from queries.digests_of(f"{name} changed", asked, triangles, SCENE_POINTS, options.workers)


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the digests to FILE")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with the digests in FILE")
    parser.add_argument(
        "--library", nargs="?", const="", metavar="SET", help="query the library in C, with these sets"
    )
    parser.add_argument("--program", metavar="COMMAND", help="ask library_server.c, started by this command")
    parser.add_argument("--workers", type=int, default=1, help="threads of large calls")
    parser.add_argument("--cad", type=Path, default=SHARED_PARTS, metavar="FOLDER", help="more parts")
    parser.add_argument("--without-cad", action="store_true", help="the sample parts alone")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
