"""The service loop: publishes the newest poses as a frame every period, and skips ticks that are too late."""

import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from proximity.checks import as_number
from proximity.errors import ServiceError
from proximity.service.clock import Clock, MonotonicClock
from proximity.service.contact_source import ContactSource
from proximity.service.description import Describer
from proximity.service.frame_builder import FrameBuilder
from proximity.service.frame_publisher import FramePublisher, Log
from proximity.service.inputs.sources import PoseInput
from proximity.service.realtime import RealTime, undisturbed
from proximity.service.report import Report
from proximity.service.samples import NewestSamples
from proximity.system.time_units import NS_PER_S
from proximity.transport import Publisher

STOPPING_FRAMES = 3
"""Frames that say STOPPING: a datagram may be lost."""
REPLACE_TIMEOUT, POLL_INTERVAL = 1.0, 1e-3
"""s, beyond a period, that a replacement is waited for; and between two looks whether it is in use."""
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-5, 10.0
"""s, of periods."""


class Service:
    """Takes poses in, has them answered, and publishes frames, every period.

    *pose_input*: where samples come from, of as many fingers. Closed at the end. *valid_for*: age of the
    oldest pose up to which a frame may be used as it is. *log*: what frames are appended to, by another
    thread. Closed at the end. *describer*: makes the messages with names of parts and fingers.
    """

    def __init__(
        self,
        contact_source: ContactSource,
        pose_input: PoseInput,
        publishers: Sequence[Publisher],
        *,
        period: float,
        valid_for: float = 0.020,
        stale_after: float = 0.100,
        clock: Clock | None = None,
        log: Log | None = None,
        real_time: RealTime | None = None,
        describer: Describer | None = None,
    ) -> None:
        self._period_ns = nanoseconds("period", period)
        self._source, self._input = contact_source, pose_input
        self._next: ContactSource | None = None
        self._retired: ContactSource | None = None  # before the last replacement
        self._has_run = False
        self._thread: int | None = None  # that the loop runs in
        self._epoch_offset = 0
        self._clock: Clock = MonotonicClock() if clock is None else clock
        self._newest = NewestSamples(
            contact_source.new_samples(), nanoseconds("stale_after", stale_after), pose_input.address
        )
        self._frame_builder = FrameBuilder(
            contact_source.count, contact_source.source, self._period_ns, nanoseconds("valid_for", valid_for)
        )
        self._frame_publisher = FramePublisher(publishers, log, len(self._frame_builder.message.data))
        self._real_time, self._describer = real_time, describer
        self._report = Report(self._period_ns)

    @property
    def report(self) -> Report:
        """Counts and times so far; the same object each time."""
        report, newest, publisher = self._report, self._newest, self._frame_publisher
        future, backwards, too_old = self._source.refused
        report.future, report.backwards = newest.future + future, newest.backwards + backwards
        report.too_old = newest.too_old + too_old
        report.publish_failures = dict(publisher.failures)
        report.log_written, report.log_lost = publisher.log_written, publisher.log_lost
        real_time = [] if self._real_time is None else self._real_time.notes
        inputs = [*self._input.notes, *newest.notes, *self._source.notes]
        report.notes = [*real_time, *inputs, *publisher.notes]
        return report

    @property
    def contact_source(self) -> ContactSource:
        """The source of contacts at present."""
        return self._source

    def run(self, *, stop: threading.Event | None = None, tick_count: int | None = None) -> Report:
        """Serve until asked to stop, or until the input is over; then say STOPPING and close everything.

        The first tick comes when everything is compiled and in memory. A service runs once.

        *stop*: ends it, when set by another thread or by a signal's handler. Returned: what was done; also
        ``report``, where another thread may look at it meanwhile.
        """
        if self._has_run:
            raise ServiceError("this service has already run and is closed: make a new one")
        self._has_run = True
        with ExitStack() as stack:
            stack.callback(self._close)
            self._rehearse()
            stack.enter_context(undisturbed())
            if self._real_time is not None:
                stack.enter_context(self._real_time)
            stack.callback(self._publish_stopping)
            self._serve(stop, tick_count)
        return self.report

    def replace(self, contact_source: ContactSource) -> None:
        """Have contacts made by another source from the next tick on: a scene was edited.

        Returns when that is done. The source before is not closed: its moves may be in use again. All that
        takes long is done in the thread of the caller.

        Notes
        -----
        Thread: any, but one at a time.
        """
        before, after = self._source, contact_source
        if after.count != before.count or after.source != before.source:
            raise ServiceError(
                f"contacts of {after.count} fingers from {after.source.name.lower()} cannot replace "
                f"those of {before.count} from {before.source.name.lower()} in a running service"
            )
        after.rehearse()
        self._next = after
        gives_up = time.monotonic() + REPLACE_TIMEOUT + 1e-9 * self._period_ns
        while self._next is after and self._is_running_elsewhere() and time.monotonic() < gives_up:
            time.sleep(POLL_INTERVAL)
        # Here, not in the loop: to free a large scene takes milliseconds.
        self._retired = None

    def _is_running_elsewhere(self) -> bool:
        return self._thread not in (None, threading.get_ident())

    def _rehearse(self) -> None:
        """Compile and touch all that a tick needs."""
        self._source.rehearse()
        newest = NewestSamples(self._source.new_samples(), 0)
        newest.start(0)
        newest.update(self._source.new_samples(), 0)
        newest.drop_stale(0)
        self._frame_builder.finish(0, 0, 0, 0, 0)

    def _serve(self, stop: threading.Event | None, tick_count: int | None) -> None:
        is_asked_to_stop = threading.Event().is_set if stop is None else stop.is_set
        self._thread = threading.get_ident()
        begin_ns = self._clock.now_ns()
        self._newest.start(begin_ns)
        self._due_ns = begin_ns + self._period_ns
        report, pose_input = self._report, self._input
        while not is_asked_to_stop() and report.ticks != tick_count and not pose_input.is_over:
            self._tick()
            self._skip_what_is_past(self._clock.now_ns())
            self._due_ns += self._period_ns

    def _tick(self) -> None:
        """Make one frame."""
        clock, report, newest = self._clock, self._report, self._newest
        frame_builder, due_ns = self._frame_builder, self._due_ns
        clock.sleep_until(due_ns)
        start_ns, begun_ns = clock.now_ns(), clock.stopwatch_ns()
        if self._next is not None:
            self._exchange_source()
        for samples in self._input.poll(start_ns):
            # Not by the start: where the system kept us from running since, new poses are after it.
            newest.update(samples, clock.now_ns())
        newest.drop_stale(start_ns)
        source = self._source
        source.fill(frame_builder.begin(), newest.samples, start_ns)
        publish_ns = clock.now_ns()
        self._skip_what_is_past(publish_ns)
        epoch = source.epoch + self._epoch_offset
        frame_builder.finish(start_ns, publish_ns, report.missed, epoch, clock.skipped_ns, source.is_late)
        self._frame_publisher.publish(frame_builder.message)
        report.compute.record(clock.stopwatch_ns() - begun_ns)
        report.lateness.record(start_ns - due_ns)
        report.ticks += 1
        report.states[frame_builder.state] += 1
        if self._describer is not None:
            self._describe(self._describer, epoch, publish_ns - clock.skipped_ns)
        self._frame_publisher.flush_log()

    def _describe(self, describer: Describer, epoch: int, now_ns: int) -> None:
        """Publish what is due of the description, behind the frame."""
        message = describer.message(epoch, now_ns, self._source.labels)
        if message is not None:
            self._frame_publisher.publish_description(message)

    def _skip_what_is_past(self, now_ns: int) -> None:
        """Go on from the last deadline that is past; those before it are missed, not made up for."""
        past = (now_ns - self._due_ns) // self._period_ns
        if past > 0:
            self._report.missed += past
            self._due_ns += past * self._period_ns

    def _exchange_source(self) -> None:
        """Use the next source; whatever epoch its scene has, that of frames grows."""
        assert self._next is not None
        epoch = self._source.epoch + self._epoch_offset
        self._retired = self._source
        self._source, self._next = self._next, None
        self._epoch_offset = epoch + 1 - self._source.epoch

    def _publish_stopping(self) -> None:
        """Publish that no frames will come any more."""
        clock = self._clock
        for _ in range(STOPPING_FRAMES):
            now_ns = clock.now_ns()
            self._frame_builder.stop(now_ns - clock.skipped_ns)
            self._frame_publisher.publish(self._frame_builder.message)
            self._frame_publisher.flush_log()
            clock.sleep_until(now_ns + self._period_ns)

    def _close(self) -> None:
        self._thread = None
        with ExitStack() as stack:
            for opened in (self._input, self._source, self._frame_publisher):
                stack.callback(opened.close)


def nanoseconds(name: str, seconds: Any) -> int:
    """Return a span of a service in nanoseconds; a `ServiceError` where it cannot be one."""
    if not SHORTEST_PERIOD <= as_number(seconds) <= LONGEST_PERIOD:
        raise ServiceError(f"{name} is {seconds!r}, expected {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g} s")
    return round(NS_PER_S * seconds)
