"""Compiling everything before it is needed.

Kernels are compiled for this very processor when first called, and kept on disk; loading them takes a
fraction of a second. A program that must not wait later calls `warm_up` first.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from llvmlite import binding

from proximity.kernels.code_cache import COMPLETE
from proximity.kernels.compiler import CompiledCall, cache_folder
from proximity.kernels.ray.ray_order import ray_order
from proximity.pose import Pose
from proximity.scene.queries import line_queries, point_queries
from proximity.scene.queries.batches import worker_count
from proximity.scene.saved.compiled_scene import read_scene
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

MOST_HELPERS = 3
"""Processes beside this one that are of use."""
_HELP = "from proximity.tracker.warm_up import _settle; _settle({first})"


def _mark() -> Path:
    """The file that says that all is compiled, for these sources and this kind of processor."""
    return cache_folder() / (COMPLETE + binding.get_host_cpu_name())


def kernels_are_cached() -> bool:
    """Return whether `warm_up` has kept all kernels on disk, so that nothing waits for a compiler."""
    try:
        return _mark().exists()
    except OSError:
        return False


def warm_up(*, workers: int = 1) -> None:
    """Compile or load every kernel: some minutes the first time on a machine, later less than a second.

    Parameters
    ----------
    workers : int
        Processes that compile side by side; -1 for all cores. More than one start ``sys.executable``, which
        must be a Python with this package, and not a program that Python is embedded in.

    Raises
    ------
    QueryError
        If *workers* is no number of processes.
    """
    count = worker_count(workers, "processes")
    with _helpers(0 if kernels_are_cached() else count - 1):
        _ask_everything()
    with suppress(OSError):  # where nothing can be kept the next process compiles anew
        _mark().touch()


@contextmanager
def _helpers(count: int) -> Iterator[None]:
    """Have other processes compile from the end what this one comes to last."""
    jobs = len(_calls())
    started: list[subprocess.Popen[bytes]] = []
    try:
        for k in range(min(count, MOST_HELPERS)):
            code = _HELP.format(first=k * jobs // MOST_HELPERS)
            nowhere = subprocess.DEVNULL
            started.append(
                subprocess.Popen([sys.executable, "-c", code], stdin=nowhere, stdout=nowhere, stderr=nowhere)
            )
        yield
    finally:
        for helper in started:
            helper.kill()
            helper.wait()


def _calls() -> list[CompiledCall]:
    """What Python calls with few rows, and the tick, in the reverse of the order in which they are asked."""
    from proximity.tracker import tracker  # most that ask whether kernels are there tick nothing

    modules = (tracker, point_queries, line_queries)
    return [
        call
        for module in modules
        for call in reversed(vars(module).values())
        if isinstance(call, CompiledCall)
    ]


def _settle(first: int) -> None:
    """Compile all that is called, from the *first* on; each process begins elsewhere."""
    calls = _calls()
    for call in calls[first:] + calls[:first]:
        call.settle()


def _ask_everything() -> None:
    first = Solid(_CORNERS, _FACES, name="first")
    second = Part(
        "second", Solid(_CORNERS, _FACES), Pose(translation=(2.0, 0.0, 0.0)), np.arange(4, dtype=np.int32)
    )
    points = np.linspace(-1.0, 3.0, 192).reshape(64, 3)
    Scene.from_mesh(_CORNERS, _FACES)
    scene = Scene([first, second])
    scene.deform("second", 2.0 * _CORNERS)
    with TemporaryDirectory() as folder:  # what opens it has kernels of its own
        scene.save(Path(folder, "cell.prox"))
        read_scene(Path(folder, "cell.prox"))
    ray_order(first.snapshot().handle, points, points + 1.5)  # which only larger models ask for
    for asked in (first, scene):
        for rows in (points, points[:2]):  # many and few have kernels of their own
            asked.closest(rows)
            asked.signed_distance(rows)
            asked.distance(rows)
            asked.contains(rows)
            asked.cast(rows, rows + 1.5)
            asked.cast_distance(rows, rows + 1.5)
            asked.closest_to_segments(rows, rows + 0.1)
        if isinstance(asked, Scene):
            asked.move_many(["second"], [Pose(translation=(2.0, 1.0, 0.0))])
            asked.closest(points)
            _tick(asked)


def _tick(scene: Scene) -> None:
    """Tick with and without what a caller may know besides poses."""
    from proximity.tracker.tracker import Tracker  # most that ask whether kernels are there tick nothing

    tracker = Tracker(scene, fingers=2)
    tips = np.array([[0.3, 0.3, 0.5], [2.1, 1.1, 0.1]])
    for now_ns in (0, 1_000_000, 2_000_000):
        tracker.tick(tips, now_ns, now_ns)
        tracker.tick(tips, now_ns, now_ns, velocities=-tips, paths=np.stack((tips, 0.5 * tips), axis=1))
