"""The processes that convert a STEP file: a guard, and below it one that runs cascadio.

Started by path, they import nothing of this package. The first line on standard input has the settings as
JSON. Its end says that who asked is gone, killed perhaps: then the guard ends the conversion and removes its
folder. cascadio holds the interpreter's lock, so that a thread beside it could not do that.
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

NO_CASCADIO, TOO_MUCH = 3, 4
"""Exit codes: cascadio cannot be imported; a limit was passed."""
_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def guard() -> int:
    """Have a file converted within the limits; return the exit code."""
    line = sys.stdin.readline()
    settings = json.loads(line)
    command = [sys.executable, "-P", __file__, "convert"]
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


def convert() -> int:
    """Convert one file; return the exit code."""
    settings = json.loads(sys.stdin.readline())
    sys.path[:] = settings["path"]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python's own would wait for the end of the conversion
    _limit(settings["seconds"], settings["bytes"])
    try:
        import cascadio
    except ImportError:
        return NO_CASCADIO
    try:
        # include_brep: every triangle says which CAD face it belongs to
        return cascadio.step_to_glb(
            settings["step"],
            settings["glb"],
            tol_linear=settings["tol_linear"],
            tol_angular=settings["tol_angular"],
            include_brep=True,
        )
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


if __name__ == "__main__":
    sys.exit(convert() if sys.argv[1:] else guard())
