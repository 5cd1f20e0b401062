"""Report on a running loop and issue its warnings."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from proximity.message import State
from proximity.message.instant_advice import FROM_FUTURE, OUT_OF_ORDER, on_backwards, on_future, on_too_old
from proximity.service.contact_source import ContactSource
from proximity.service.inputs.sources import PoseInput
from proximity.service.loop_ends import FrameBridge
from proximity.service.loop_memory import LoopMemory
from proximity.service.report import Histogram, Report
from proximity.service.samples import LOST_HANDS, NewestSamples, on_lost
from proximity.system.time_units import NS_PER_MS
from proximity.transport import Counts, Publisher

LOGGER = logging.getLogger("proximity.service")


class LoopWatch:
    """Reports on a loop while it runs, and issues one warning for each kind of problem.

    *address*: address of the poses. *bridges*: threads that serve publishers, by the publishers' numbers.
    """

    def __init__(
        self,
        memory: LoopMemory,
        address: str,
        publishers: Sequence[Publisher],
        bridges: Mapping[int, FrameBridge],
    ) -> None:
        self._memory, self._address = memory, address
        self._publishers, self._bridges = publishers, bridges
        self._warned: set[str] = set()

    def report(self, pose_input: PoseInput, newest: NewestSamples | None, source: ContactSource) -> Report:
        """Return a report with counts and times until now."""
        loop: Any = self._memory.loop
        report = Report(int(loop.period_ns), int(loop.ticks), int(loop.missed))
        report.compute, report.lateness = _histogram(loop.compute), _histogram(loop.lateness)
        report.states = {state: int(loop.states[state]) for state in State}
        others = [source.refused] if newest is None else [source.refused, newest.refused]
        own = int(loop.future), int(loop.backwards), int(loop.too_old)
        report.future, report.backwards, report.too_old = map(sum, zip(own, *others, strict=True))
        report.notes = self._direct_notes() if self._memory.is_direct else list(pose_input.notes)
        if loop.lost_hands:
            report.notes.append(f"{self._address}: {loop.lost_hands} {LOST_HANDS} are not used")
        report.notes += [*([] if newest is None else newest.notes), *source.notes]
        for number, publisher in enumerate(self._publishers):
            count, first = self._failures_of(number)
            report.publish_failures[publisher.address] = count
            if first:
                report.notes.append(f"{publisher.address}: {count} frames were not published, first: {first}")
        report.notes += [note for bridge in self._bridges.values() for note in bridge.notes]
        return report

    def warn(self) -> None:
        """Issue warnings of kinds that have not been issued before."""
        loop: Any = self._memory.loop
        too_old = f"poses older than {loop.stale_after_ns / NS_PER_MS:g} ms"
        kinds: tuple[tuple[str, str, Callable[[int], str]], ...] = (
            ("future", FROM_FUTURE, on_future),
            ("too_old", too_old, on_too_old),
            ("backwards", OUT_OF_ORDER, on_backwards),
            ("lost_hands", LOST_HANDS, on_lost),
        )
        for (kind, what, advice), off_ns in zip(kinds, loop.first_off_ns.tolist(), strict=True):
            if loop[kind]:
                self._warn_once(kind, f"{self._address}: {what} are not used ({advice(off_ns)})")
        if self._memory.input["unverified"]:
            sentence = "a message is not verified by the key (expected that of its sender)"
            self._warn_once("key", f"{self._address}: {sentence}")
        for number, publisher in enumerate(self._publishers):
            first = self._failures_of(number)[1]
            if first and number not in self._bridges:
                self._warn_once(
                    publisher.address, f"a frame cannot be published: {publisher.address}: {first}"
                )

    def _failures_of(self, number: int) -> tuple[int, str]:
        """Return the number of unsent frames of a publisher, and the reason of the first failure or ""."""
        bridge = self._bridges.get(number)
        if bridge is not None:
            return bridge.failures, bridge.first_failure
        output = self._memory.outputs[number]
        first = os.strerror(int(output["first_failure"])) if output["failures"] else ""
        return int(output["failures"]), first

    def _warn_once(self, kind: str, sentence: str) -> None:
        if kind not in self._warned:
            self._warned.add(kind)
            LOGGER.warning("%s", sentence)

    def _direct_notes(self) -> list[str]:
        """Return sentences on messages that the loop received directly and did not use."""
        taken, address = self._memory.input, self._address
        counts = Counts.of(taken["receiver"], int(taken["refused"]), int(taken["unverified"]))
        notes = []
        if taken["unserved"]:
            notes.append(f"{address}: {taken['unserved']} poses of fingers that are not served")
        if counts.lost or counts.unused:
            notes.append(f"{address}: {counts}")
        if taken["failures"]:
            notes.append(f"receiving failed {taken['failures']} times")
        return notes


def _histogram(times: Any) -> Histogram:
    return Histogram.of(int(times["count"]), int(times["max_ns"]), np.asarray(times["bins"]).tolist())
