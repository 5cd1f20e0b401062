"""Run a service in a separate process and control it from the parent process.

The child process is ``python -m proximity serve --json``. It writes JSON documents to standard output, one
per line: one when the first frame is published, and its report at the end. It stops when it reads a line from
standard input or when the input ends, which also happens if the parent dies.
"""

import json
import logging
import os
import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import TracebackType
from typing import Any

from proximity.errors import ServiceError
from proximity.service.hosting.announcements import guarded
from proximity.service.hosting.scene_service import checked_seconds

BEGIN_TIMEOUT = 600.0
"""Maximum wait for the first frame, s. Large parts may have to be read, and kernels compiled once, which
takes two minutes, or more on a busy machine."""
STOP_TIMEOUT = 10.0
"""Maximum wait for the end, s. The last frames, the last blocks of the log, and an edit may be in
progress."""
KEPT_LINES = 40
"""Number of stored lines of the child's output, among them the reason why it ended."""
SPOKEN_BY = "proximity: "
EXIT_UNUSABLE = 2
OPTIONS = {"rate_hz": "--rate", "publish": "--publish", "log": "--log"}
SWITCHES = {"real_time": ("--no-realtime", "--realtime")}
LOGGER = logging.getLogger("proximity.hosting")


class RunningService:
    """A service in a separate process.

    It is created by `start_service` and stops at the end of a ``with`` block. It also stops when this process
    ends. ``beginning`` is the report with its first frame: ``publish``, ``rate_hz``, ``finger_count``,
    ``part_names`` (in the order of a contact's ``part``), ``face_count``, ``pid``, ``notes`` and more.

    Parameters
    ----------
    command : list of str
        Command line of the process.
    path : str
        Scene file, for messages.
    say : callable
        Called with the messages of the service, by another thread.
    timeout : float, s
        Longest wait for the first frame.
    """

    beginning: dict[str, Any]  # publish, rate_hz, finger_count, part_names, face_count, pid, notes

    def __init__(self, command: list[str], path: str, say: Callable[[str], None], timeout: float) -> None:
        # Guarded: if this reader ended, the service would block as soon as the pipe is full.
        self._path, self._say = path, guarded(say)
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._reported: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._report: dict[str, Any] | None = None
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(
                    filter(None, sys.path)
                ),  # the modules that this process imports
                "PYTHONIOENCODING": "utf-8",
            },
        )
        self._readers = [
            threading.Thread(target=read, name="service", daemon=True)
            for read in (self._read_report, self._read_lines)
        ]
        for reader in self._readers:
            reader.start()
        try:
            self.beginning = self._wait_for_begin(timeout)
        except BaseException:
            self._process.kill()
            self._clean_up()
            raise

    @property
    def is_running(self) -> bool:
        """Whether the process is serving. It ends after a recording that is not repeated."""
        return self._process.poll() is None

    def stop(self, timeout: float = STOP_TIMEOUT) -> dict[str, Any]:
        """Stop the service and wait until it has ended. Stopping again has no effect.

        Parameters
        ----------
        timeout : float, s
            Longest wait; then the process is killed.

        Returns
        -------
        dict
            The report: ``ticks``, ``missed``, ``compute``, ``lateness``, ``states``,
            ``publish_failures``, ``notes`` and more, as ``proximity serve --json`` writes it.

        Raises
        ------
        ServiceError
            If the service failed or did not end in time, or if *timeout* is not a number of 0 or more.
        """
        timeout = checked_seconds("timeout", timeout)
        with suppress(OSError, ValueError):  # the process has ended already, or its failure was reported
            assert self._process.stdin is not None
            self._process.stdin.write("stop\n")
            self._process.stdin.close()
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired as late:
            self._process.kill()
            raise ServiceError(
                f"{self._path}: the service did not stop within {timeout:g} s: killed"
            ) from late
        finally:
            self._clean_up()
        if self._report is None:
            raise self._failure(code)
        return self._report

    def __enter__(self) -> "RunningService":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # The error raised within the block takes precedence.
        with suppress(*(() if kind is None else (ServiceError,))):
            self.stop()

    def __repr__(self) -> str:
        state = "running" if self.is_running else "ended"
        return f"RunningService({self._path!r}, process {self._process.pid}, {state})"

    def _wait_for_begin(self, timeout: float) -> dict[str, Any]:
        try:
            reported = self._reported.get(timeout=timeout)
        except queue.Empty:
            raise ServiceError(
                f"{self._path}: the service has published no frame within {timeout:g} s: killed"
            ) from None
        if reported is None:
            raise self._failure(self._process.wait())
        return reported

    def _failure(self, code: int) -> ServiceError:
        """Return an error with the reason why the child ended, which is its last message."""
        self._readers[1].join(1.0)
        sentences = [line for line in self._lines if line.startswith(SPOKEN_BY)]
        if code == EXIT_UNUSABLE and sentences:
            return ServiceError(sentences[-1].removeprefix(SPOKEN_BY))
        last = self._lines[-1] if self._lines else "it printed nothing"
        return ServiceError(f"{self._path}: the service has failed with exit code {code}: {last}")

    def _read_report(self) -> None:
        """Read the two documents on the child's standard output, at the start and at the end."""
        try:
            for line in self._process.stdout or ():
                if not line.startswith("{"):  # exceptions of other origin
                    continue
                reported = json.loads(line)
                if reported.pop("event") == "begun":
                    self._reported.put(reported)
                else:
                    self._report = reported
        finally:
            self._reported.put(None)  # ends any wait for it

    def _read_lines(self) -> None:
        for line in self._process.stderr or ():
            line = line.rstrip()
            self._lines.append(line)
            if line.startswith(SPOKEN_BY):
                self._say(line.removeprefix(SPOKEN_BY))

    def _clean_up(self) -> None:
        self._process.wait()
        for reader in self._readers:
            reader.join(1.0)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()


def start_service(
    path: str | os.PathLike[str],
    *,
    timeout: float = BEGIN_TIMEOUT,
    say: Callable[[str], None] | None = None,
    **overrides: Any,
) -> RunningService:
    """Serve a scene file in a separate process. Return when its first frame is published.

    The process ends when this one ends, for any reason.

    Parameters
    ----------
    path : path
        Scene file; ``meshes/demo.toml`` explains its keys. It may be edited while it is served.
    timeout : float, s
        Longest wait for the first frame, before which parts are read and kernels may be compiled once.
    say : callable
        Called with messages by another thread: edits that took effect or were refused, and failures.
        Default: they are logged as warnings of "proximity.hosting".
    overrides
        Values that replace those of the file's [service]: ``publish``, ``rate_hz``, ``log``, ``real_time``,
        ``loop``. None keeps the value of the file.

    Returns
    -------
    RunningService
        The service, which must be stopped or used in a ``with`` block.

    Raises
    ------
    ServiceError
        If the file, an address, an override or *timeout* cannot be used, or if no frame comes in time; the
        message says why.
    """
    timeout = checked_seconds("timeout", timeout)
    name = os.fsdecode(path)
    command = [sys.executable, "-P", "-m", "proximity", "serve", name, "--json", "--until-stdin"]
    return RunningService(
        command + list(_options(overrides)), name, LOGGER.warning if say is None else say, timeout
    )


def _options(overrides: dict[str, Any]) -> Iterator[str]:
    """Yield the command-line options that correspond to the overrides."""
    for key, value in overrides.items():
        if value is None:
            continue
        if key in SWITCHES:
            yield SWITCHES[key][bool(value)]
        elif key in OPTIONS:
            for one in value if isinstance(value, list | tuple) else (value,):
                yield from (OPTIONS[key], str(one))
        else:
            known = ", ".join((*OPTIONS, *SWITCHES))
            raise ServiceError(f"{key} can only be set in the scene file, expected {known}")
