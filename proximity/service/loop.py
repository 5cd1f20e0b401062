"""Service loop, a thread of compiled code that publishes the newest poses as a frame.

An arriving pose wakes the loop, which sends its frame as soon as it is computed. Ticks for poses are at least
half a period apart, or half a millisecond if that is less. A frame is sent at least every period.

On Linux the loop itself receives poses from ``shm://`` and ``udp://`` of this machine and sends frames to
such addresses. Python threads serve all other addresses. The loop itself also plays recordings. Contacts of
tracked parts also come from a Python thread. No tick waits for Python.
"""

import ctypes
import logging
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from typing import Any

from proximity.errors import ServiceError
from proximity.message import Source
from proximity.service.clock import Clock, SkippingClock
from proximity.service.contact_source import ContactSource
from proximity.service.description import Describer
from proximity.service.frame_log import FrameLogThread, Log
from proximity.service.inputs.sources import PolledInput, PoseInput
from proximity.service.loop_ends import FrameBridge, PoseBridge, Worker
from proximity.service.loop_memory import (
    LoopMemory,
    SourceMemory,
    fill,
    nanoseconds,
    run_function,
)
from proximity.service.loop_parts import ContactBridge, LoopSources
from proximity.service.loop_watch import LoopWatch
from proximity.service.realtime import RealTime, undisturbed
from proximity.service.report import Report
from proximity.service.samples import NewestSamples
from proximity.transport import Publisher, forget
from proximity.transport.publisher import numbering, outlet_of
from proximity.transport.shared_memory import PrivateMailbox

LOGGER = logging.getLogger("proximity.service")
LOOK = 0.02
"""Time between two checks of the loop by Python, for descriptions and warnings, s."""
OPENS_ENDS = sys.platform == "linux"
"""True if the loop supports mailboxes and sockets of this system. Otherwise threads serve all addresses."""


class Service:
    """Receives poses, computes contacts, and publishes frames, every period and when poses arrive.

    *pose_input*: source of samples for all fingers, closed at the end. *valid_for*: maximum age of the oldest
    pose at which the distances of a frame may be used unchanged. *clock*: clock that drives the loop tick by
    tick; None: the system clock. *log*: log to which another thread appends the frames, closed at the end.
    *describer*: makes the messages with names of parts and fingers. *counts_processor*: whether ticks are
    timed by processor time.
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
        counts_processor: bool = False,
    ) -> None:
        self._run_loop = run_function()
        is_measured = contact_source.source is Source.TELEOPERATION
        self._memory = LoopMemory(contact_source.count, is_measured=is_measured)
        self._loop: Any = self._memory.loop
        self._source, self._input, self._publishers = contact_source, pose_input, list(publishers)
        self._clock, self._real_time, self._describer = clock, real_time, describer
        for name, seconds in (("period", period), ("valid_for", valid_for), ("stale_after", stale_after)):
            self._loop[f"{name}_ns"] = nanoseconds(name, seconds)
        self._memory.message.header["source"] = contact_source.source
        self._loop.is_simulated, self._loop.is_ahead = clock is not None, isinstance(clock, SkippingClock)
        self._loop.counts_processor = counts_processor
        self._loop.is_coarse = time.get_clock_info("monotonic").implementation.startswith("GetTickCount")
        self._sources = LoopSources(self._memory)
        self._log = None if log is None else FrameLogThread(log, len(self._memory.message.data))
        self._loop.log = 0 if self._log is None else self._log.writer
        self._set_input(contact_source, pose_input)
        self._set_outputs()
        self._watch = LoopWatch(self._memory, pose_input.address, self._publishers, self._bridges)
        self._has_run = self._is_running = False
        self._thread: int | None = None  # identifier of the loop's thread
        self._failure: BaseException | None = None
        self._outcome = 0

    def _set_input(self, contact_source: ContactSource, pose_input: PoseInput) -> None:
        """Connect the source of poses to the loop itself or to a thread."""
        period_ns, stale_after_ns = int(self._loop.period_ns), int(self._loop.stale_after_ns)
        self._bridge: PoseBridge | ContactBridge | None = None  # None: the loop receives or plays poses
        self._newest: NewestSamples | None = None  # None unless Python computes contacts
        if contact_source.is_ticked_by_loop:
            end = getattr(pose_input, "loop_end", lambda: None)() if OPENS_ENDS else None
            recording = getattr(pose_input, "loop_recording", lambda: None)()
            if recording is not None:
                fill(self._loop.recording, recording)
                self._empty = PrivateMailbox(1)  # mailbox on which the loop waits for its ticks
                self._memory.input["box"] = self._empty.reader
                return
            if end is not None:
                fill(self._memory.input, end)
                self._memory.is_direct = True
                return
        if not isinstance(pose_input, PolledInput):
            raise ServiceError(f"{pose_input.address}: recorded poses are for contacts that the loop makes")
        if contact_source.is_ticked_by_loop:
            self._bridge = PoseBridge(pose_input, contact_source.count, period_ns)
            self._loop.is_polled = not self._bridge.waits
        else:
            self._newest = NewestSamples(contact_source.new_samples(), stale_after_ns, pose_input.address)
            self._bridge = ContactBridge(
                pose_input, self._newest, self._sources, contact_source.count, self._clock, period_ns
            )
            self._loop.is_given = True
        self._memory.input["box"] = self._bridge.reader

    def wake(self) -> None:
        """Compute contacts immediately if Python computes them."""
        if isinstance(self._bridge, ContactBridge):
            self._bridge.wake()

    def _set_outputs(self) -> None:
        """Connect each publisher to the loop itself or to a thread."""
        outputs, size = self._memory.outputs, len(self._memory.message.data)
        if len(self._publishers) > len(outputs):
            raise ServiceError(f"{len(self._publishers)} addresses, expected {len(outputs)} at most")
        self._bridges: dict[int, FrameBridge] = {}
        for number, publisher in enumerate(self._publishers):
            end = getattr(outlet_of(publisher), "loop_end", None)
            if end is None or not OPENS_ENDS:
                self._bridges[number] = bridge = FrameBridge(publisher, size)
                values: dict[str, Any] = {"socket": -1, "box": bridge.writer}
            else:
                values = end(size)
            fill(outputs[number], {**numbering(publisher), **values})
        if not self._publishers:  # frames are numbered for the log only
            fill(outputs[0], {"socket": -1, "session": time.time_ns()})
        self._loop.output_count = max(len(self._publishers), 1)

    @property
    def contact_source(self) -> ContactSource:
        """Source of contacts in use at present."""
        return self._sources.current.contacts if self._sources.has_begun else self._source

    @property
    def report(self) -> Report:
        """Report with counts and times until now."""
        report = self._watch.report(self._input, self._newest, self.contact_source)
        if self._log is not None:
            report.log_written, report.log_lost = self._log.written, self._log.failed + self._log.lost
            report.notes += self._log.notes
        if self._real_time is not None:
            report.notes[:0] = self._real_time.notes
        return report

    def run(self, *, stop: threading.Event | None = None, tick_count: int | None = None) -> Report:
        """Serve until *stop* is set or the input ends. Then publish STOPPING and close all resources.

        The first tick comes when all code is compiled and in memory. A service runs only once.

        *stop*: event that another thread or a signal handler sets. Return the report, which other threads can
        also read as ``report`` during the run.
        """
        if self._has_run:
            raise ServiceError("this service has already run and is closed: create a new one")
        self._has_run = True
        asks_to_stop = (lambda: False) if stop is None else stop.is_set
        with ExitStack() as stack:
            stack.callback(self._close)
            self._source.rehearse()
            self._begin()
            self._loop.ticks_wanted = -1 if tick_count is None else tick_count
            if self._clock is not None:
                self._drive(self._clock, asks_to_stop)
            else:
                self._run_beside(asks_to_stop)
        if self._failure is not None:
            raise self._failure
        if self._outcome:
            raise ServiceError(
                "the system has no timer for the loop, or the processor not the kernels' instructions"
            )
        return self.report

    def step(self, now_ns: int) -> None:
        """Run one tick at an instant of the driving clock. It is an alternative to `run`."""
        if not self._sources.has_begun:
            self._begin()
            self._advance(0)
        self._loop.due_ns = self._loop.simulated_ns = now_ns
        self._advance(1)
        if self._failure is not None:
            raise self._failure

    def replace(self, contact_source: ContactSource) -> None:
        """Replace the source of contacts from the next tick on, as after an edit of the scene.

        The call returns when the new source is in use. The previous source is not closed, because both may
        share an input of moves. Slow work is done in the calling thread.

        Notes
        -----
        Thread: any, but one at a time.
        """
        before, after = self.contact_source, contact_source
        if after.count != before.count or after.source != before.source:
            raise ServiceError(
                f"contacts of {after.count} fingers from {after.source.name.lower()} cannot replace "
                f"those of {before.count} from {before.source.name.lower()} in a running service"
            )
        after.rehearse()
        if not self._sources.has_begun:
            self._source = after
            return
        self._sources.replace(after)
        self._sources.wait_until_used(self._is_running_elsewhere)

    def _is_running_elsewhere(self) -> bool:
        return self._is_running and self._thread != threading.get_ident()

    def _begin(self) -> None:
        """Pass the first source of contacts to the loop."""
        now_ns = time.monotonic_ns() if self._clock is None else self._clock.now_ns()
        self._loop.simulated_ns = now_ns
        self._sources.begin(self._source)
        if self._newest is not None:
            self._newest.start(now_ns)

    def _run_beside(self, asks_to_stop: Callable[[], bool]) -> None:
        """Run the loop in a separate thread and watch it from this one."""
        workers: list[Worker | LoopSources] = [*self._bridges.values(), self._sources]
        if self._bridge is not None:
            workers.append(self._bridge)
        for each in workers:
            each.start(self._real_time)
        worker = threading.Thread(target=self._work, name="loop", daemon=True)
        self._is_running = True
        worker.start()
        try:
            while worker.is_alive():
                if asks_to_stop() or self._input.is_over or any(each.failure for each in workers):
                    self._loop.stop = 1
                self._look()
                worker.join(LOOK)
        finally:
            self._loop.stop = 1
            worker.join()
            failures = (each.failure for each in workers)
            self._failure = self._failure or next(filter(None, failures), None)

    def _work(self) -> None:
        """Run the loop. This is the work of its thread."""
        self._thread = threading.get_ident()
        try:
            with undisturbed(), self._real_time or nullcontext():
                self._call()
                if not self._loop.stop:  # all ticks are done, but STOPPING has not been published
                    self._loop.stop = 1
                    self._call()
        except BaseException as failure:
            self._failure = failure
        finally:
            self._is_running = False

    def _call(self) -> None:
        self._outcome = self._run_loop(ctypes.c_void_p(self._memory.address))

    def _drive(self, clock: Clock, asks_to_stop: Callable[[], bool]) -> None:
        """Run the ticks one by one in this thread, with a clock other than the system clock."""
        loop, wanted = self._loop, int(self._loop.ticks_wanted)
        self._is_running, self._thread = True, threading.get_ident()
        with undisturbed(), self._real_time or nullcontext():
            self._advance(0)
            while not (loop.stop or asks_to_stop() or loop.ticks == wanted or self._is_played()):
                clock.sleep_until(int(loop.due_ns))
                loop.simulated_ns = clock.now_ns()
                try:
                    self._advance(1)
                except BaseException as failure:
                    self._failure = failure
                    forget(self._memory.message.records)
                    break
            if not loop.stop:
                loop.stop = 1
                self._advance(0)
        self._is_running = False

    def _is_played(self) -> bool:
        """Return whether the input has ended, so that no more poses will come."""
        return self._input.is_over or bool(self._loop.recording["is_over"])

    def _advance(self, ticks: int) -> None:
        """Run *ticks* more ticks and the Python work that belongs to them."""
        if ticks and self._bridge is not None:
            self._bridge.poll(int(self._loop.simulated_ns))
        if ticks:
            self._sources.poll()
        if ticks and self._loop.is_given and not self._loop.next:
            latest = self._sources.latest
            self._describe(int(latest.contacts.epoch) + int(self._loop.epoch_offset), latest)
        self._loop.ticks_wanted = int(self._loop.ticks) + ticks
        self._call()
        self._look()
        for bridge in self._bridges.values():
            bridge.send_all()

    def _describe(self, epoch: int, source: SourceMemory) -> None:
        """Publish a message of the description after the next frame, if one is due."""
        loop = self._loop
        if self._describer is not None and not loop.pending:
            clock = self._clock
            now_ns = time.monotonic_ns() if clock is None else clock.now_ns() - clock.skipped_ns
            message = self._describer.message(epoch, now_ns, source.labels)
            if message is not None:
                loop.pending_size, loop.pending = len(message.data), message.data.ctypes.data

    def _look(self) -> None:
        """Publish a message of the description if one is due, and issue new warnings."""
        loop, source = self._loop, self._sources.current
        epoch = int(loop.epoch)
        is_due = not self._loop.is_given
        if not is_due and self._clock is None:  # its thread may already use other parts
            is_due = source.contacts.epoch + int(loop.epoch_offset) == epoch
        if loop.ticks and not loop.next and is_due:
            self._describe(epoch, source)
        if not self._loop.is_given:
            self._sources.note()
        self._watch.warn()

    def _close(self) -> None:
        published = [int(output["sequences"][0]) for output in self._memory.outputs]
        with ExitStack() as stack:
            closing: tuple[Any, ...] = (self._input, self.contact_source, *self._publishers)
            for opened in closing:
                stack.callback(opened.close)
            if self._log is not None:
                stack.callback(self._log.close, published[0])
            for number, bridge in self._bridges.items():
                stack.callback(bridge.send_rest, published[number])
            if self._bridge is not None:
                stack.callback(self._bridge.close)
            stack.callback(self._sources.close)
