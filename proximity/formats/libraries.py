"""Libraries that read a file in a process of their own, within limits of time and memory.

Damaged files can crash them or take hours, and what they print can only be caught by exchanging file
descriptors, which would swallow what other threads print.
"""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proximity.formats import worker


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a library ended, and what it made."""

    returncode: int  # negative: the signal that it crashed by
    printed: str
    output: bytes  # empty where nothing was written

    @property
    def is_over_limit(self) -> bool:
        """Whether it took too much time or memory."""
        return self.returncode == worker.TOO_MUCH

    @property
    def is_missing(self) -> bool:
        """Whether it cannot be imported."""
        return self.returncode == worker.NOT_INSTALLED


def run_library(task: str, data: bytes, *, seconds: int, byte_count: int, **settings: Any) -> Outcome:
    """Have one of `worker.TASKS` read *data*; raise OSError if the system has no room for it."""
    with tempfile.TemporaryDirectory(prefix="proximity-") as folder:
        source, target, log = (Path(folder, name) for name in ("input", "output", "log"))
        source.write_bytes(data)
        limits = {"task": task, "folder": folder, "seconds": seconds, "bytes": byte_count}
        paths = {"path": sys.path, "input": str(source), "output": str(target)}  # imports as in this process
        with log.open("wb") as output:
            returncode = _run(json.dumps(limits | paths | settings).encode() + b"\n", output.fileno())
        made = target.read_bytes() if target.exists() else b""
        return Outcome(returncode, log.read_text("utf-8", "replace"), made)


def _run(settings: bytes, output: int) -> int:
    """Run the worker; it sees the end of the pipe when this process ends, however that comes."""
    inner, outer = os.pipe()
    try:
        os.write(outer, settings)
        # No -m: the worker imports nothing of ours. Threads of BLAS would use up its memory.
        command = [sys.executable, "-P", worker.__file__]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.run(
            command, stdin=inner, stdout=output, stderr=subprocess.STDOUT, check=False, env=environment
        ).returncode
    finally:
        os.close(inner)
        os.close(outer)
