"""Opening a compiled scene, and deforming a part between ticks."""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.support.project import TEMPORARY_PREFIX, environment
from benchmarks.support.verdicts import Verdict, at_least
from benchmarks.ticks import scenes
from benchmarks.ticks.timing import TickLog, TickRow, figures_of, row_of, time_calls
from proximity import Scene, Solid

OPEN_ROUNDS, DEFORM_ROUNDS = 10, 5
MAX_OPEN_MS = 50.0
OPEN = """
import sys, time
import proximity, proximity.scene.loader, proximity.scene.scene, proximity.scene.saved.compiled_scene
start = time.perf_counter_ns()
scene = proximity.load(sys.argv[1])
opened = time.perf_counter_ns()
scene.signed_distance([0.0, 0.0, 0.0])
print(opened - start, time.perf_counter_ns() - opened)
"""


def measure_open(options) -> list[TickRow]:
    """Open a compiled scene in new processes that have imported all modules; its pages are in memory."""
    scene = scenes.scene_of(scenes.freeform(options.sizes.skin_ground, 0.3))
    opened, asked = [], []
    rounds = 1 if options.small else OPEN_ROUNDS
    with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX) as folder:
        path = Path(folder) / "cell.prox"
        scene.save(path)
        size = path.stat().st_size
        for _ in range(rounds):
            done = subprocess.run(
                [sys.executable, "-c", OPEN, str(path)],
                capture_output=True,
                text=True,
                env=environment(),
                check=True,
            )
            first, second = map(int, done.stdout.split())
            opened.append(first)
            asked.append(second)
    median = statistics.median(opened) / 1e6
    verdict = Verdict(
        f"open: median of {rounds} processes at most {MAX_OPEN_MS:g} ms",
        f"{median:.1f} ms",
        median <= MAX_OPEN_MS,
    )
    remark = (
        f"{size / 2**20:.0f} MiB; the first question after it {statistics.median(asked) / 1e6:.1f} ms, "
        "kernels read from the disk included"
    )
    log = TickLog(wall_ns=opened)
    return [_row("open", scene, log, (verdict,), (remark,))]


def measure_deform(options) -> list[TickRow]:
    """Deform a part, compared with building it again."""
    vertices, faces = scenes.plate(options.sizes.large_plate)
    scene = scenes.scene_of((vertices, faces))
    refits, builds, ratios = TickLog(), TickLog(), []
    for number in range(DEFORM_ROUNDS + 1):
        bent = vertices.copy()
        bent[:, 2] += 1e-3 * (number + 1) * np.sin(20.0 * vertices[:, 0])
        if number == 0:
            scene.deform("part", bent)  # the first also allocates
            continue
        time_calls([lambda bent=bent: scene.deform("part", bent)], refits)
        time_calls([lambda bent=bent: Scene([Solid(bent, faces, name="part")])], builds)
        ratios.append(builds.wall_ns[-1] / refits.wall_ns[-1])
        time.sleep(0)  # other processes may have the core between rounds
    verdict = at_least(
        "deform: new corners against a new part",
        10.0,
        float(np.median(ratios)),
        f" ({min(ratios):.0f} to {max(ratios):.0f})",
    )
    return [
        row_of("deform: scene.deform", scene, 0, refits, verdicts=[verdict]),
        row_of("deform: a new part and scene", scene, 0, builds),
    ]


def _row(case, scene, log, verdicts, remarks):
    faces = scenes.face_count(scene)
    wall = figures_of(np.array(log.wall_ns))
    return TickRow(
        case, len(scene.parts), faces, 0, len(log.wall_ns), None, wall, verdicts=verdicts, remarks=remarks
    )
