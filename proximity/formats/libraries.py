"""Run libraries that read files in a separate process, with limits of time and memory.

Damaged files can crash them or take hours. Their output can only be captured by exchanging file descriptors,
which in this process would swallow the output of other threads.
"""

import json
import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proximity.formats import worker

_LARGE_BYTES = 1 << 24
"""Size of an input after which the process ends to free memory. Importing the library again is then
comparatively cheap."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Exit code, printed text and output of a library."""

    returncode: int  # code of `worker`, or the negative signal that ended it
    printed: str
    output: bytes  # empty if there is none


class Library:
    """A process that performs one of `worker.TASKS` repeatedly. The first call starts it.

    *seconds*: time limit of one call.
    """

    def __init__(self, task: str, seconds: int, byte_count: int) -> None:
        self._limits = {"task": task, "seconds": seconds, "bytes": byte_count}
        self._process: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def run(self, data: bytes, **settings: Any) -> Outcome:
        """Run the task on *data*. Raise OSError if the disk has not enough space for its files."""
        self._folder = self._folder or tempfile.TemporaryDirectory(prefix="proximity-")
        folder = Path(self._folder.name)
        process = self._process = self._process or self._started(folder)
        source, target, log = (folder / name for name in ("input", "output", "log"))
        source.write_bytes(data)
        printed_before = log.stat().st_size
        request = {"input": str(source), "output": str(target), **settings}
        assert process.stdin is not None and process.stdout is not None, "they are pipes"
        with suppress(BrokenPipeError):  # the process has ended, and its exit code gives the reason
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        answer = process.stdout.readline()
        made = target.read_bytes() if target.exists() else b""
        printed = log.read_bytes()[printed_before:].decode("utf-8", "replace")
        target.unlink(missing_ok=True)
        outcome = Outcome(int(answer) if answer else process.wait(), printed, made)
        if not answer or len(data) > _LARGE_BYTES:
            self.close()
        return outcome

    def _started(self, folder: Path) -> "subprocess.Popen[bytes]":
        """Start the worker process.

        The worker detects the end of this process by the end of the pipe.
        """
        # No -m: the worker must not import this package. Threads of BLAS would use up its memory.
        command = [sys.executable, "-P", worker.__file__]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        with (folder / "log").open("wb") as log:
            pipe = subprocess.PIPE
            process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=log, env=environment)
        first = {**self._limits, "folder": str(folder), "path": sys.path}  # same paths as here
        assert process.stdin is not None, "it is a pipe"
        process.stdin.write(json.dumps(first).encode() + b"\n")
        return process

    def close(self) -> None:
        """End the process, if it runs, and remove its folder."""
        if self._process is not None:
            with suppress(BrokenPipeError), self._process:
                pass  # the exit closes the pipes and waits
        if self._folder is not None:
            self._folder.cleanup()
        self._process = self._folder = None

    def __enter__(self) -> "Library":
        return self

    def __exit__(self, *unused: object) -> None:
        self.close()


def run_library(task: str, data: bytes, *, seconds: int, byte_count: int, **settings: Any) -> Outcome:
    """Run one of `worker.TASKS` once on *data*.

    Raise OSError if the disk has not enough space for its files.
    """
    with Library(task, seconds, byte_count) as library:
        return library.run(data, **settings)
