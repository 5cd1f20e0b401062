"""Measure VR applications, from the pose of a hand to its distances: ``python bench/vr.py [FILE ...]``.

*native* publishes poses and subscribes to frames, *page* does the work of a page of ``proximity serve
--web``. With files of parts, both run with these at 90 and 120 Hz for five and ten fingers. Without, with
tori of 3 k, 100 k and 1 M faces, 90 and 120 Hz, five and ten fingers, still and moving: each is varied
separately from ten fingers at 90 Hz over 100 k faces. The native application is then also run with other
libraries' signed distances instead of ours.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path

import trimesh

from benchmarks.rivals.fcpw import Fcpw
from benchmarks.rivals.open3d import Open3D
from benchmarks.rivals.registry import available
from benchmarks.rivals.trimesh import Trimesh
from benchmarks.service.vr_application import HEADINGS, PATHS, RADIUS, Serving, VrCase, VrRow, measure
from benchmarks.support import threads
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import open_console, print_machine, table_of, write_json
from benchmarks.support.project import BENCH, PROJECT, environment
from proximity.recording import Recording, read_recording
from proximity.web.running_page import Addresses

SECTIONS = {3_000: (60, 25), 100_000: (360, 139), 1_000_000: (1100, 455)}  # of tori, by number of faces
BASE, BASE_FACES = VrCase(), 100_000
POSE_RATES_HZ, FINGER_COUNTS = (90.0, 120.0), (5, 10)
RIVALS = (Open3D, Fcpw, Trimesh)


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write; the exit code is 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*", metavar="FILE", help="parts to measure with, instead of tori")
    parser.add_argument("--units", default="mm", help="of the files, where they do not say; mm")
    parser.add_argument("--recording", type=Path, metavar="CSV", help="of a hand, instead of the sample")
    parser.add_argument("--seconds", type=float, default=10.0, help="that each application runs")
    parser.add_argument("--small", action="store_true", help="smoke test")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all results to OUT")
    options = parser.parse_args(arguments)
    seconds = 0.5 if options.small else options.seconds
    console = open_console()
    machine = describe_machine(threads.UNLIMITED)
    print_machine(console, machine)
    hand = read_recording(options.recording or PROJECT / "meshes" / "hand.csv")
    if options.files:
        rows, others = _of_files(options.files, hand, seconds, options.units), []
    else:
        rows, others = _of_tori(hand, seconds, small=options.small)
    console.print(_table("Applications, ticks at 1 kHz", [(row.cells[0], row) for row in rows]))
    if others:
        with_libraries = [(each["library"], VrRow.of(each["row"])) for each in others]
        console.print(_table("The native one with the distances of other libraries", with_libraries))
    if options.json:
        write_json(options.json, machine, rows=rows, others=others)
    return 0


def _of_files(files: list[str], hand: Recording, seconds: float, units: str) -> list[VrRow]:
    """Run both applications with parts of the user."""
    cases = product(PATHS, POSE_RATES_HZ, FINGER_COUNTS)
    return [measure(files, VrCase(*case, seconds=seconds), hand, units=units) for case in cases]


def _of_tori(hand: Recording, seconds: float, *, small: bool) -> tuple[list[VrRow], list[dict]]:
    """Run both applications with tori, and the native one with the distances of other libraries."""
    rows: list[VrRow] = []
    others: list[dict] = []
    with tempfile.TemporaryDirectory(prefix="proximity_vr_") as folder:
        files = {faces: _torus(Path(folder), faces) for faces in SECTIONS}
        for faces, case in _cases(small=small):
            for path in PATHS:
                case = replace(case, path=path, seconds=seconds)
                rows.append(measure([files[faces]], case, hand, units="m"))
        for contender in available(RIVALS)[0]:
            for faces in (3_000,) if small else SECTIONS:
                serving = _serving(contender.name, files[faces])
                case = replace(BASE, seconds=seconds)
                row = measure([files[faces]], case, hand, units="m", serving=serving)
                others.append({"library": contender.name, "row": asdict(row)})
    return rows, others


def _cases(*, small: bool) -> list[tuple[int, VrCase]]:
    if small:
        return [(3_000, BASE)]
    return [
        (3_000, BASE),
        (BASE_FACES, BASE),
        (1_000_000, BASE),
        (BASE_FACES, replace(BASE, finger_count=5)),
        (BASE_FACES, replace(BASE, pose_rate_hz=120.0)),
        (BASE_FACES, replace(BASE, is_moving=True)),
    ]


def _torus(folder: Path, faces: int) -> str:
    major, minor = SECTIONS[faces]
    path = folder / f"torus_{faces}.stl"
    trimesh.creation.torus(0.05, 0.02, major_sections=major, minor_sections=minor).export(path)
    return str(path)


def _serving(library: str, file: str) -> Serving:
    """Serve with the distances of a library."""

    @contextmanager
    def serve(_: Path, addresses: Addresses, case: VrCase) -> Iterator[int]:
        words = [library, file, addresses.frames, addresses.poses]
        words += ["--fingers", str(case.finger_count), "--radius", str(RADIUS)]
        command = [sys.executable, "-m", "benchmarks.service.library_service", *words]
        with subprocess.Popen(
            command, cwd=BENCH, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None and process.stdin is not None
            if process.stdout.readline() != "begun\n":
                raise RuntimeError(f"the service of {library} has ended")
            yield process.pid
            process.stdin.close()
            process.stdout.read()

    return serve


def _table(title: str, rows: list[tuple[str, VrRow]]):
    table = table_of(title, HEADINGS)
    for name, row in rows:
        table.add_row(name, *row.cells[1:])
    return table


if __name__ == "__main__":
    sys.exit(main())
