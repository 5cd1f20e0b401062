"""Processes in which libraries read files that could crash them, or take unlimited time and memory.

A guard, and below it a worker that runs the library. Started by path, they import nothing from this package.
Lines on standard input are JSON: first the settings of all tasks, then those of each task, which a line with
its code answers. When the input ends, because the other process ends or is killed, the guard ends the work
and removes its folder. A library may hold the interpreter's lock, so that a thread of its process could not
do this.
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
"""Codes: an exception, which is printed; the library cannot be imported; a limit was exceeded."""
_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def guard() -> int:
    """Run the work within the limits; return the exit code."""
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
            os.kill(os.getpid(), -code)  # the same end
    return TOO_MUCH if code < 0 else code


def _pass_on(child: "subprocess.Popen[str]", seconds: float, is_over: threading.Event) -> None:
    """Pass on tasks, each with its time, until the other end of the pipe is closed; end the work then."""
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
    """Run tasks until the input ends; return the exit code."""
    settings = json.loads(sys.stdin.readline())
    sys.path[:] = settings["path"]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python's would wait for the end of the work
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of libraries
    for line in sys.stdin:
        _limit(settings["seconds"], settings["bytes"])
        code = _done(TASKS[settings["task"]], json.loads(line))
        sys.stdout.flush()
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)  # output of C
        print(code, file=answers, flush=True)
    return 0


def _done(task: Any, settings: dict[str, Any]) -> int:
    try:
        return int(task(settings))
    except ImportError:
        return NOT_INSTALLED
    except MemoryError:
        return TOO_MUCH
    except Exception:  # the next file may be sound, and importing the library takes longer than to read it
        traceback.print_exc()
        return FAILED


def _limit(seconds: int, byte_count: int) -> None:
    """Limit the processor time from now on and the memory, and end with the guard, as far as possible."""
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
            with suppress(OSError, ValueError):  # a lower one is set already
                resource.setrlimit(kind, (soft, hard))


def _convert_step(settings: dict[str, Any]) -> int:
    """Convert STEP to GLB; *include_brep*: every triangle names its CAD face."""
    import cascadio

    return cascadio.step_to_glb(
        settings["input"],
        settings["output"],
        tol_linear=settings["tol_linear"],
        tol_angular=settings["tol_angular"],
        include_brep=True,
    )


def _load_by_trimesh(settings: dict[str, Any]) -> int:
    """Read a file of a *kind* that trimesh knows; write its vertices and faces."""
    import numpy as np
    import trimesh

    with open(settings["input"], "rb") as file:
        mesh = trimesh.load_mesh(file, file_type=settings["kind"], process=False)
    with open(settings["output"], "wb") as target:
        np.savez(target, vertices=mesh.vertices, faces=mesh.faces)
    return 0


def _unpack_draco(settings: dict[str, Any]) -> int:
    """Unpack streams: identifiers of positions, then equally many byte arrays; write faces and positions."""
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
