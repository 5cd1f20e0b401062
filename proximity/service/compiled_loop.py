"""The loop of a service as a thread of compiled code, which never waits for an interpreter; for Linux.

Poses come by ``shm://`` or ``udp://`` from this machine, frames leave by the same. What it does with them is
what `Service` does, bit for bit; beside that, a pose that comes wakes it, and its frame leaves when it is
computed. Ticks for poses are half a period apart, or half a millisecond where that is less, and at least
every period a frame leaves. Python makes scenes, hands them over, describes parts and fingers, logs and
reports.
"""

import ctypes
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext, suppress
from typing import Any

import numpy as np

from proximity.errors import PublishError, ServiceError
from proximity.message import Defect, State
from proximity.message.instant_advice import FROM_FUTURE, OUT_OF_ORDER, on_backwards, on_future, on_too_old
from proximity.service.contact_source import TrackedContacts
from proximity.service.description import Describer
from proximity.service.frame_publisher import Log
from proximity.service.loop import POLL_INTERVAL, REPLACE_TIMEOUT, nanoseconds
from proximity.service.loop_memory import LoopMemory, SourceMemory, run_function
from proximity.service.mailbox_log import MailboxLog
from proximity.service.realtime import RealTime, sharp_timers
from proximity.service.report import Histogram, Report
from proximity.service.samples import LOST_HANDS
from proximity.system.time_units import NS_PER_MS
from proximity.tracker.tracker import note_answers
from proximity.transport import Counts, Inlet, Publisher
from proximity.transport.publisher import loop_end

LOGGER = logging.getLogger("proximity.service")
LOOK = 0.02
"""s between two looks of Python at the loop: for descriptions, and what is to be warned of."""
_DEFECTS = (Defect.SHORT, Defect.MAGIC, Defect.VERSION, Defect.SIZE, Defect.CHECKSUM, Defect.OLD)
_ADVICES: tuple[Callable[[int], str], ...] = (on_future, on_too_old, on_backwards, lambda _: "send nan")
_KINDS = "future", "too_old", "backwards", "lost_hands"


class CompiledService:
    """Takes poses in, has them answered, and publishes frames; as `Service`, with a loop of compiled code.

    *inlet*: where poses come from, opened at *address*. Closed at the end, as *log* is. *simulated_ns*:
    instant of a clock that stands still while a tick is computed; None: the system's.
    """

    def __init__(
        self,
        contact_source: TrackedContacts,
        inlet: Inlet,
        address: str,
        publishers: Sequence[Publisher],
        *,
        period: float,
        valid_for: float = 0.020,
        stale_after: float = 0.100,
        log: Log | None = None,
        real_time: RealTime | None = None,
        describer: Describer | None = None,
        simulated_ns: int | None = None,
    ) -> None:
        if contact_source.moves is not None or contact_source.changes is not None:
            raise ServiceError('service.loop is "compiled", which takes no moves and no changes of parts')
        self._run_loop = run_function()
        self._memory, self._address = LoopMemory(contact_source.count), address
        self._loop: Any = self._memory.loop
        self._inlet, self._publishers = inlet, list(publishers)
        if not 0 < len(self._publishers) <= len(self._memory.outputs):
            raise ServiceError(
                f"{len(publishers)} addresses to publish at, expected 1 to {len(self._memory.outputs)}"
            )
        _fill(self._memory.input, _end_of(inlet, address))
        for output, publisher in zip(self._memory.outputs, self._publishers, strict=False):
            _fill(output, loop_end(publisher, len(self._memory.message.data)))
        self._loop.output_count = len(self._publishers)
        for name, seconds in (("period", period), ("valid_for", valid_for), ("stale_after", stale_after)):
            self._loop[f"{name}_ns"] = nanoseconds(name, seconds)
        self._loop.is_simulated, self._loop.simulated_ns = simulated_ns is not None, simulated_ns or 0
        self._log = None if log is None else MailboxLog(log, len(self._memory.message.data))
        self._loop.log = 0 if self._log is None else self._log.writer
        self._real_time, self._describer = real_time, describer
        self._source = contact_source
        self._used: SourceMemory | None = None
        self._kept: list[SourceMemory | None] = []
        self._has_run = self._is_running = False
        self._warned: set[str] = set()
        self._outcome = 0

    @property
    def contact_source(self) -> TrackedContacts:
        """The source of contacts at present."""
        return self._source

    @property
    def report(self) -> Report:
        """Counts and times so far."""
        loop = self._loop
        report = Report(int(loop.period_ns), int(loop.ticks), int(loop.missed))
        report.compute, report.lateness = _histogram(loop.compute), _histogram(loop.lateness)
        report.states = {state: int(loop.states[state]) for state in State}
        report.future, report.backwards, report.too_old = (
            int(loop.future),
            int(loop.backwards),
            int(loop.too_old),
        )
        sent = list(zip(self._publishers, self._memory.outputs, strict=False))
        report.publish_failures = {publisher.address: int(each["failures"]) for publisher, each in sent}
        if self._log is not None:
            report.log_written, report.log_lost = self._log.written, self._log.failed + self._log.lost
        report.notes = [] if self._real_time is None else list(self._real_time.notes)
        report.notes += [*self._input_notes(), *self._source.notes]
        report.notes += [
            f"{publisher.address}: {each['failures']} frames were not published, first: "
            f"{os.strerror(int(each['first_failure']))}"
            for publisher, each in sent
            if each["failures"]
        ]
        report.notes += [] if self._log is None else self._log.notes
        return report

    def run(self, *, stop: threading.Event | None = None, tick_count: int | None = None) -> Report:
        """Serve until asked to stop; then say STOPPING and close everything. A service runs once."""
        with ExitStack() as stack:
            stack.callback(self._close)
            self.begin()
            self._loop.ticks_wanted = -1 if tick_count is None else tick_count
            worker = threading.Thread(target=self._work, name="loop", daemon=True)
            self._is_running = True
            worker.start()
            stack.callback(self._end, worker)
            while worker.is_alive():
                if stop is not None and stop.is_set():
                    self._loop.stop = 1
                self._look()
                worker.join(LOOK)
        if self._outcome:
            raise ServiceError(
                "the system has no timer for the loop, or the processor not the kernels' instructions"
            )
        return self.report

    def begin(self) -> None:
        """Compile and touch all that a tick needs, and hand the scene over."""
        if self._has_run:
            raise ServiceError("this service has already run and is closed: make a new one")
        self._has_run = True
        self._source.rehearse()
        self._used = SourceMemory(self._source, self._memory)
        self._loop.source = self._used.address

    def advance(self, ticks: int) -> None:
        """Make so many ticks more, in this thread: for a clock that stands."""
        self._loop.ticks_wanted = int(self._loop.ticks) + ticks
        self._outcome = self._run_loop(ctypes.c_void_p(self._memory.address))

    def replace(self, contact_source: TrackedContacts) -> None:
        """Have contacts made by another source from the next tick on; returns when that is done.

        Notes
        -----
        Thread: any, but one at a time.
        """
        if contact_source.count != self._source.count:
            raise ServiceError(
                f"contacts of {contact_source.count} fingers cannot replace those of {self._source.count} in "
                "a running service"
            )
        contact_source.rehearse()
        if not self._has_run:
            self._source = contact_source
            return
        following, loop = SourceMemory(contact_source, self._memory), self._loop
        loop.next = following.address
        gives_up = time.monotonic() + REPLACE_TIMEOUT + 1e-9 * float(loop.period_ns)
        while loop.next and self._is_running and time.monotonic() < gives_up:
            time.sleep(POLL_INTERVAL)
        before, self._used, self._source = self._used, following, contact_source
        if loop.next:  # it has not come to it: what it uses has to stay
            self._kept.append(before)
        del before  # here, not in the loop: to free a large scene takes milliseconds

    def _work(self) -> None:
        """Run the loop, in a thread of its own."""
        try:
            with sharp_timers(), self._real_time or nullcontext():
                address = ctypes.c_void_p(self._memory.address)
                self._outcome = self._run_loop(address)
                if not self._outcome and not self._loop.stop:  # all ticks are made: it has not said STOPPING
                    self._loop.stop = 1
                    self._run_loop(address)
        finally:
            self._is_running = False

    def _end(self, worker: threading.Thread) -> None:
        self._loop.stop = 1
        worker.join()

    def _look(self) -> None:
        """Have described what is due of the description, and warn of what is new."""
        loop = self._loop
        if self._describer is not None and loop.ticks and not loop.pending and not loop.next:
            message = self._describer.message(int(loop.epoch), time.monotonic_ns(), self._source.labels)
            if message is not None:
                loop.pending_size = len(message.data)
                loop.pending = message.data.ctypes.data
        if self._used is not None and self._used.record["answers"][0]:
            with suppress(ValueError, IndexError):  # the loop writes contacts meanwhile: at the next look
                note_answers(self._source.tracker, int(self._used.record["answers"][0]))
        too_old = f"poses older than {loop.stale_after_ns / NS_PER_MS:g} ms"
        whats = FROM_FUTURE, too_old, OUT_OF_ORDER, LOST_HANDS
        advices: tuple[Callable[[int], str], ...] = (
            on_future,
            on_too_old,
            on_backwards,
            lambda _: "send nan",
        )
        for kind, what, advice, off_ns in zip(
            _KINDS, whats, advices, loop.first_off_ns.tolist(), strict=True
        ):
            if loop[kind]:
                self._warn(kind, f"{self._address}: {what} are not used ({advice(off_ns)})")
        for publisher, output in zip(self._publishers, self._memory.outputs, strict=False):
            if output["failures"]:
                reason = os.strerror(int(output["first_failure"]))
                self._warn(publisher.address, f"a frame cannot be published: {publisher.address}: {reason}")

    def _warn(self, kind: str, sentence: str) -> None:
        if kind not in self._warned:
            self._warned.add(kind)
            LOGGER.warning("%s", sentence)

    def _input_notes(self) -> list[str]:
        taken = self._memory.input
        flawed = {
            defect: int(taken["flawed"][k + 1]) for k, defect in enumerate(_DEFECTS) if taken["flawed"][k + 1]
        }
        names = "received", "lost", "sessions", "refused", "unverified"
        counts = Counts(**{name: int(taken[name]) for name in names}, flawed=Counter(flawed))
        notes = []
        if taken["unserved"]:
            notes.append(f"{self._address}: {taken['unserved']} poses of fingers that are not served")
        if counts.lost or counts.unused:
            notes.append(f"{self._address}: {counts}")
        if taken["failures"]:
            notes.append(f"receiving failed {taken['failures']} times")
        if self._loop.lost_hands:
            notes.append(f"{self._address}: {self._loop.lost_hands} {LOST_HANDS} are not used")
        return notes

    def _close(self) -> None:
        with ExitStack() as stack:
            closing: tuple[Any, ...] = (self._inlet, self._source, *self._publishers)
            for opened in closing:
                stack.callback(opened.close)
            if self._log is not None:
                stack.callback(self._log.close, int(self._memory.outputs[0]["sequences"][0]))


def _end_of(inlet: Inlet, address: str) -> dict[str, Any]:
    end = getattr(inlet, "loop_end", None)
    if end is None:
        raise PublishError(
            f"{address}: a compiled loop takes poses by shm:// and udp:// "
            '(expected one of these, or service.loop = "python")'
        )
    return dict(end())


def _fill(record: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        record[name] = value


def _histogram(times: Any) -> Histogram:
    return Histogram.of(int(times["count"]), int(times["max_ns"]), np.asarray(times["bins"]).tolist())
