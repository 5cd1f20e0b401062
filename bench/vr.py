"""Measure whole VR applications, from the pose of a hand to its distances: ``python bench/vr.py``.

Tori of 3 k, 100 k and 1 M faces, 90 and 120 Hz, five and ten fingers, still and moving: each is varied by
itself from ten fingers at 90 Hz over 100 k faces. *native* publishes poses and subscribes to frames, *page*
is what ``proximity view`` runs, without drawing. Beside them other libraries answer the distances of the
same hand, in the place of the tick: what a sample of 1 ms would hold with them.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.rivals.fcpw import Fcpw
from benchmarks.rivals.open3d import Open3D
from benchmarks.rivals.ours import Proximity
from benchmarks.rivals.registry import available
from benchmarks.rivals.trimesh import Trimesh
from benchmarks.support import threads
from benchmarks.support.machine import describe_machine
from benchmarks.support.output import open_console, print_machine, table_of, write_json
from benchmarks.support.project import PROJECT
from proximity.certificate.vr_application import PATHS, RADIUS, VrCase, VrRow, measure
from proximity.recording import read_recording
from proximity.scene.scene import Scene
from proximity.tracker.replay import fitted_pose

SECTIONS = {3_000: (60, 25), 100_000: (360, 139), 1_000_000: (1100, 455)}  # of tori, about so many faces
BASE, BASE_FACES = VrCase(), 100_000
MOST_S = 4.0  # that one library is timed with one part
HEADINGS = (
    "application", "faces", "poses, Hz", "fingers", "moving", "p50, ms", "p99", "p99.9", "of a frame",
    "tick p50, µs", "of 1 ms", "service", "bridge",
)  # fmt: skip
LIBRARY_HEADINGS = ("library", "question", "faces", "p50, µs", "p99", "of 1 ms")
RIVALS = (Proximity, Open3D, Fcpw, Trimesh)


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write; the exit code is 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="that each application runs")
    parser.add_argument("--small", action="store_true", help="only check that everything runs")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write everything to OUT")
    options = parser.parse_args(arguments)
    seconds = 0.5 if options.small else options.seconds
    console = open_console()
    machine = describe_machine(threads.UNLIMITED)
    print_machine(console, machine)
    hand = read_recording(PROJECT / "meshes" / "hand.csv")
    rows, others = [], []
    with tempfile.TemporaryDirectory(prefix="proximity_vr_") as folder:
        files = {faces: _torus(Path(folder), faces) for faces in SECTIONS}
        for faces, case in _cases(small=options.small):
            for path in PATHS:
                rows.append(
                    measure([files[faces]], replace(case, path=path, seconds=seconds), hand, units="m")
                )
        for faces in (3_000,) if options.small else SECTIONS:
            others += _libraries(files[faces], hand, min(seconds, MOST_S))
    console.print(_table(rows))
    console.print(_libraries_table(others))
    if options.json:
        known = [
            {key: None if value != value else value for key, value in asdict(row).items()} for row in rows
        ]
        write_json(options.json, machine, rows=known, others=others)
    return 0


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


def _libraries(file: str, hand, seconds: float) -> list[dict]:
    """What the distances of ten fingers take of a tick, with each library; µs."""
    mesh = trimesh.load(file)
    scene = Scene.from_mesh(mesh.vertices, mesh.faces)
    recording = hand.resampled(1.0 / BASE.pose_rate_hz)
    tips = recording.placed(fitted_pose(scene, recording, RADIUS)).positions
    tips = np.tile(tips[~np.isnan(tips).any(axis=(1, 2))], (1, 2, 1))[:, : BASE.finger_count]
    found = []
    for contender in available(RIVALS)[0]:
        contender.build(mesh.vertices, mesh.faces)
        question = "signed_distance" if "signed_distance" in contender.questions else "distance"
        times, ends = [], time.monotonic() + seconds
        for row in range(10**6):
            task = getattr(contender, question)(np.ascontiguousarray(tips[row % len(tips)]))
            begin = time.perf_counter()
            task.run()
            times.append(time.perf_counter() - begin)
            if time.monotonic() > ends and row >= 20:
                break
        p50, p99 = 1e6 * np.percentile(times, [50, 99])
        found.append(
            {
                "library": contender.name,
                "faces": len(mesh.faces),
                "question": question,
                "p50": p50,
                "p99": p99,
            }
        )
    return found


def _table(rows: list[VrRow]):
    table = table_of("Applications", HEADINGS)
    for row in rows:
        times = (row.motion_to_distance_p50, row.motion_to_distance_p99, row.motion_to_distance_p999)
        table.add_row(
            row.case.path, f"{row.face_count:,}", f"{row.case.pose_rate_hz:g}", f"{row.case.finger_count}",
            "yes" if row.case.is_moving else "", *(f"{1e3 * each:.2f}" for each in times),
            f"{row.frame_share:.0%}", f"{1e6 * row.tick_p50:.0f}", f"{row.sample_share:.1%}",
            f"{row.service_share:.2f}", f"{row.bridge_share:.2f}",
        )  # fmt: skip
    return table


def _libraries_table(others: list[dict]):
    table = table_of("Ten fingers in the place of the tick", LIBRARY_HEADINGS, left=2)
    for each in others:
        figures = f"{each['p50']:.1f}", f"{each['p99']:.1f}", f"{each['p50'] / 1e3:.1%}"
        table.add_row(each["library"], each["question"], f"{each['faces']:,}", *figures)
    return table


if __name__ == "__main__":
    sys.exit(main())
