"""Processes in which libraries read files that could crash them, or take unlimited time and memory.

A guard starts a worker that runs the library. Both are started by path and import nothing from this package.
Lines on standard input are JSON: first the settings of all tasks, then those of each task. The worker answers
each task with a line that contains its exit code. When the input ends, because the other process ends or is
killed, the guard ends the worker and removes its folder. A thread of the worker could not do this, because a
library may hold the interpreter's lock.
"""

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import traceback
from contextlib import suppress
from typing import Any

FAILED, NOT_INSTALLED, TOO_MUCH = 1, 3, 4
"""Exit codes for an exception, which is printed, for a library that cannot be imported, and for an exceeded
limit."""
_PR_SET_PDEATHSIG = 1  # from <sys/prctl.h>


def guard() -> int:
    """Run the worker within the time limit. Return the exit code."""
    line = sys.stdin.readline()
    settings, is_over = json.loads(line), threading.Event()
    command = [sys.executable, "-P", __file__, "work"]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, bufsize=1)
    assert child.stdin is not None, "it is a pipe"
    child.stdin.write(line)
    threading.Thread(target=_pass_on, args=(child, settings["seconds"], is_over), daemon=True).start()
    code = child.wait()
    if is_over.is_set():
        shutil.rmtree(settings["folder"], ignore_errors=True)
        return 1
    if code < 0 and -code not in (signal.SIGXCPU, signal.SIGKILL):
        with suppress(OSError):
            os.kill(os.getpid(), -code)  # end with the same signal
    return TOO_MUCH if code < 0 else code


def _pass_on(child: "subprocess.Popen[str]", seconds: float, is_over: threading.Event) -> None:
    """Pass tasks to the worker, and kill it if a task takes too long or the input ends."""
    assert child.stdin is not None, "it is a pipe"
    timer = threading.Timer(0.0, child.kill)
    for line in sys.stdin:
        timer.cancel()
        timer = threading.Timer(seconds, child.kill)
        timer.daemon = True
        timer.start()
        with suppress(OSError):
            child.stdin.write(line)
    is_over.set()
    child.kill()


def work() -> int:
    """Run tasks until the input ends. Return the exit code."""
    settings = json.loads(sys.stdin.readline())
    sys.path[:] = settings["path"]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python's handler would wait for the end of the work
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # redirects the output of libraries
    for line in sys.stdin:
        _limit(settings["seconds"], settings["bytes"])
        code = _done(TASKS[settings["task"]], json.loads(line))
        sys.stdout.flush()
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)  # output of C code
        print(code, file=answers, flush=True)
    return 0


def _done(task: Any, settings: dict[str, Any]) -> int:
    try:
        return int(task(settings))
    except ImportError:
        return NOT_INSTALLED
    except MemoryError:
        return TOO_MUCH
    except Exception:  # continue: the next file may be valid, and importing the library again takes long
        traceback.print_exc()
        return FAILED


def _limit(seconds: int, byte_count: int) -> None:
    """Limit processor time and memory, as far as the system permits.

    The time counts from now. On Linux the worker also ends with the guard.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if sys.platform != "win32":
        import resource

        end = int(time.process_time()) + seconds
        limits: list[tuple[Any, int, int]] = [
            (resource.RLIMIT_CORE, 0, 0),
            (resource.RLIMIT_CPU, end, resource.getrlimit(resource.RLIMIT_CPU)[1]),
            (resource.RLIMIT_DATA, byte_count, byte_count),
        ]
        for kind, soft, hard in limits:
            with suppress(OSError, ValueError):  # a lower limit is set already
                resource.setrlimit(kind, (soft, hard))


def _convert_step(settings: dict[str, Any]) -> int:
    """Convert STEP to GLB, in which every triangle has the number of its CAD face."""
    import cascadio

    return cascadio.step_to_glb(
        settings["input"],
        settings["output"],
        tol_linear=settings["tol_linear"],
        tol_angular=settings["tol_angular"],
        include_brep=True,
    )


def _load_by_trimesh(settings: dict[str, Any]) -> int:
    """Read a file of a *kind* that trimesh knows. Write its vertices and faces."""
    import numpy as np
    import trimesh

    with open(settings["input"], "rb") as file:
        mesh = trimesh.load_mesh(file, file_type=settings["kind"], process=False)
    with open(settings["output"], "wb") as target:
        np.savez(target, vertices=mesh.vertices, faces=mesh.faces)
    return 0


def _unpack_draco(settings: dict[str, Any]) -> int:
    """Unpack Draco streams and write their faces and positions.

    The input has an array with the identifiers of positions, then the bytes of each stream.
    """
    import DracoPy
    import numpy as np

    with open(settings["input"], "rb") as source, open(settings["output"], "wb") as target:
        for position_id in np.load(source):
            mesh = DracoPy.decode(np.load(source).tobytes())
            (points,) = [a["data"] for a in mesh.attributes if a["unique_id"] == position_id]
            for array in (mesh.faces, points):
                np.save(target, np.ascontiguousarray(array))
    return 0


TASKS = {"step": _convert_step, "trimesh": _load_by_trimesh, "draco": _unpack_draco}

if __name__ == "__main__":
    os._exit(work() if sys.argv[1:] else guard())  # a thread may hold standard input
