"""A scene file served in this process."""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from proximity.checks import not_negative, whole
from proximity.service import Report, Request, Service
from proximity.service.config import SceneFile, override, read_scene_file
from proximity.service.hosting.announcements import guarded, warnings_of_loop_to
from proximity.service.hosting.scene_changes import PartChanger, SceneReloader
from proximity.service.hosting.service_assembly import ServiceSetup, make_service
from proximity.system.stop_signals import stopped_by_signals

LOOK_S = 0.5
"""Time between two checks for edits of the scene file."""
BEGIN_LOOK_S = 0.005
"""Time between two checks for the first frame."""
ANNOUNCE_AFTER_S = 2.0
"""Maximum wait for an edit in progress at the end: a large part may take minutes."""
LOGGER = logging.getLogger("proximity.hosting")


@dataclass(frozen=True, slots=True, eq=False)
class Beginning:
    """Facts about the service at its first frame."""

    settings: SceneFile  # as served, with overrides
    finger_count: int
    part_names: tuple[str, ...]  # in the order of a contact's ``part``; none for measured distances
    face_count: int
    notes: tuple[str, ...]  # sentences: settings granted and refused by the system, oddities of the input


def serve(
    path: str | os.PathLike[str],
    *,
    stop: threading.Event | None = None,
    tick_count: int | None = None,
    seconds: float | None = None,
    say: Callable[[str], None] | None = None,
    begun: Callable[[Beginning], None] | None = None,
    **overrides: Any,
) -> Report:
    """Serve a scene file in this process until stopped; ``meshes/demo.toml`` explains such files.

    While it serves, an edit of the file or of a file of its parts takes effect between two ticks. An
    invalid edit is reported, and the previous scene stays in use.

    Parameters
    ----------
    path : path
        Scene file.
    stop : threading.Event
        Ends the service when set. In the main thread Ctrl-C and SIGTERM end it as well.
    tick_count : int
        Number of ticks to run; None: no limit.
    seconds : float, s
        Time to run after the first frame; None: no limit.
    say : callable
        Called with messages by other threads: edits that took effect or were refused, and failures.
        Default: they are logged as warnings of "proximity.hosting".
    begun : callable
        Called by another thread when the first frame is published.
    overrides
        Values that replace those of the file's [service]: ``publish``, ``rate_hz``, ``log``, ``real_time``,
        … None: as in the file.

    Returns
    -------
    Report
        Number of ticks, how late and how long they were, and failures.

    Raises
    ------
    ServiceError
        If the file cannot be used; the message names the line. If *tick_count* or *seconds* is out of
        range.
    PublishError
        If an address cannot be opened.
    RecordingError
        If the log cannot be written.

    Notes
    -----
    Thread: the calling thread ticks. Other threads of this process that hold the interpreter lock delay it;
    `start_service` uses a separate process.
    """
    if tick_count is not None:
        whole("tick_count", tick_count, 0)
    seconds = None if seconds is None else checked_seconds("seconds", seconds)
    settings = override(read_scene_file(path), overrides)
    made = make_service(settings)
    stop = threading.Event() if stop is None else stop
    say = None if say is None else guarded(say)
    beside = _Beside(made, settings, overrides, stop, seconds, say or LOGGER.warning, begun)
    failures: list[BaseException] = []
    with warnings_of_loop_to(say), beside.running(), stopped_by_signals(stop), _running(made, stop, failures):
        report = made.service.run(stop=stop, tick_count=tick_count)
    beside.raise_failure()
    if failures:
        raise failures[0]
    for entry, service in zip(settings.held, made.held, strict=True):
        held = service.report
        report.notes.append(
            f"held part {', '.join(entry.part)}: {held.ticks} ticks, {held.missed} missed, "
            f"computing: {held.compute}"
        )
        report.notes += held.notes
        report.publish_failures |= held.publish_failures
    return report


@contextmanager
def _running(made: ServiceSetup, stop: threading.Event, failures: list[BaseException]) -> Iterator[None]:
    """Run the services of tracked parts during the block; a failure of one stops all."""
    is_over = threading.Event()

    def run(service: Service) -> None:
        try:
            service.run(stop=is_over)
        except BaseException as failure:
            failures.append(failure)
            stop.set()

    threads = [
        threading.Thread(target=run, args=(service,), name="held part", daemon=True) for service in made.held
    ]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        is_over.set()
        for thread in threads:
            thread.join()


def checked_seconds(name: str, value: Any) -> float:
    """Return a duration, s, that threads can wait for: inf becomes the maximum, some centuries."""
    seconds = not_negative(name, value, "seconds", may_be_infinite=True)
    return min(seconds, threading.TIMEOUT_MAX)


class _Beside:
    """Thread next to the loop: announces the start, adds and removes parts, watches for edits, ends the loop.

    It is created before the loop requests priority and a core from the system: threads inherit these.
    """

    def __init__(
        self,
        made: ServiceSetup,
        settings: SceneFile,
        overrides: dict[str, Any],
        stop: threading.Event,
        seconds: float | None,
        say: Callable[[str], None],
        begun: Callable[[Beginning], None] | None,
    ) -> None:
        self._made, self._settings, self._stop = made, settings, stop
        self._seconds, self._begun = seconds, begun
        self._reloader = SceneReloader(made, settings, overrides, say)
        self._changer = PartChanger(made.service, lambda: self._reloader.settings)
        changes = made.changes
        self._requests: SimpleQueue[Request | None] = SimpleQueue() if changes is None else changes.requests
        self._over = threading.Event()
        self._timer: threading.Timer | None = None
        self._failure: BaseException | None = None

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run during the block."""
        thread = threading.Thread(target=self._run, name="beside the loop", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._requests.put(None)  # wakes it
            thread.join(ANNOUNCE_AFTER_S)
            if self._timer is not None:
                self._timer.cancel()

    def raise_failure(self) -> None:
        """Raise the exception of the caller's function."""
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            self._wait_for_begin()
        except BaseException as failure:
            self._failure = failure
            self._stop.set()
            return
        if self._seconds is not None:
            # In another thread: an edit of a large part may take minutes.
            self._timer = threading.Timer(self._seconds, self._stop.set)
            self._timer.daemon = True
            self._timer.start()
        look_at = time.monotonic() + LOOK_S
        while not self._over.is_set():
            with suppress(Empty):
                request = self._requests.get(timeout=max(look_at - time.monotonic(), 0.0))
                if request is not None:
                    self._changer.carry_out(request)
            if time.monotonic() >= look_at and not self._over.is_set():
                self._reloader.look()
                look_at = time.monotonic() + LOOK_S

    def _wait_for_begin(self) -> None:
        service = self._made.service
        while not service.report.ticks and not self._over.wait(BEGIN_LOOK_S):
            pass
        report = service.report
        if self._begun is None or not report.ticks:
            return
        parts = () if self._made.scene is None else self._made.scene.parts
        self._begun(
            Beginning(
                settings=self._settings,
                finger_count=self._made.count,
                part_names=tuple(part.name for part in parts),
                face_count=sum(part.solid.mesh.face_count for part in parts),
                notes=(
                    *self._made.files.notes,
                    *report.notes,
                    *(
                        f"held part {', '.join(entry.part)}: connections to {', '.join(entry.publish)}"
                        for entry in self._settings.held
                    ),
                ),
            )
        )
