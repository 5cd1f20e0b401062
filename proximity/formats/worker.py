"""The processes in which libraries read what could crash them, or take time and memory without end.

A guard, and below it one that runs the library. Started by path, they import nothing of this package. The
first line on standard input has the settings as JSON. Its end says that who asked is gone, killed perhaps:
then the guard ends the work and removes its folder. A library may hold the interpreter's lock, so that a
thread beside it could not do that.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from typing import Any

NOT_INSTALLED, TOO_MUCH = 3, 4
"""Exit codes: the library cannot be imported; a limit was passed."""
_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def guard() -> int:
    """Have the work done within the limits; return the exit code."""
    line = sys.stdin.readline()
    settings = json.loads(line)
    command = [sys.executable, "-P", __file__, "work"]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
    assert child.stdin is not None, "it is a pipe"
    child.stdin.write(line)
    child.stdin.close()
    threading.Thread(target=_end_when_orphaned, args=(child, settings["folder"]), daemon=True).start()
    try:
        code = child.wait(settings["seconds"])
    except subprocess.TimeoutExpired:
        child.kill()
        return TOO_MUCH
    if code < 0 and -code not in (signal.SIGXCPU, signal.SIGKILL):
        with suppress(OSError):
            os.kill(os.getpid(), -code)  # as it ended
    return TOO_MUCH if code < 0 else code


def _end_when_orphaned(child: "subprocess.Popen[str]", folder: str) -> None:
    """Wait until the other end of the pipe is closed."""
    sys.stdin.read()
    child.kill()
    child.wait()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def work() -> int:
    """Read one file; return the exit code."""
    settings = json.loads(sys.stdin.readline())
    sys.path[:] = settings["path"]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python's own would wait for the end of the work
    _limit(settings["seconds"], settings["bytes"])
    try:
        return TASKS[settings["task"]](settings)
    except ImportError:
        return NOT_INSTALLED
    except MemoryError:
        return TOO_MUCH


def _limit(seconds: int, byte_count: int) -> None:
    """Limit time of all processors and memory, and end with the guard, as far as the system can."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if sys.platform != "win32":
        import resource

        limits: list[tuple[Any, int]] = [
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, seconds),
            (resource.RLIMIT_DATA, byte_count),
        ]
        for kind, limit in limits:
            with suppress(OSError, ValueError):  # a lower one is set already
                resource.setrlimit(kind, (limit, limit))


def _convert_step(settings: dict[str, Any]) -> int:
    """Convert STEP to GLB; *include_brep*: every triangle says which CAD face it belongs to."""
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
    """Unpack streams: identifiers of positions, then as many arrays of bytes; write faces and positions."""
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
    sys.exit(work() if sys.argv[1:] else guard())
