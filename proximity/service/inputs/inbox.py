"""Inbox of a service, which checks and counts each message without raising an error in the loop."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from proximity.message import Kind, parts_of
from proximity.transport import MessageReader, open_inlet
from proximity.transport.publisher_clock import ForeignClock

LOGGER = logging.getLogger("proximity.service")
FARTHEST_NS = 2**62
"""Maximum difference of two clocks, which is 146 years. Instants of a more distant clock do not fit into 64
bits."""


class Inbox:
    """Reads the valid messages at an address.

    *is_timed*: whether the messages contain instants. If so, messages of another machine are used only after
    its clock is known.
    """

    def __init__(
        self,
        address: str,
        kinds: Sequence[Kind],
        clock: Callable[[], int] = time.monotonic_ns,
        *,
        is_timed: bool = True,
    ) -> None:
        self.address = address
        self._inlet = open_inlet(address)
        self._reader = MessageReader(self._inlet, kinds, clock)
        self._foreign = ForeignClock() if is_timed and not self._inlet.shares_clock else None
        self._has_warned_of_key = False
        self._failures = 0
        self._first_failure = ""
        self._left_out: dict[str, int] = {}

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost, refused or not used."""
        counts = self._reader.counts
        notes = [f"{self.address}: {count} {what}" for what, count in list(self._left_out.items())]
        if counts.lost or counts.unused:
            notes.append(f"{self.address}: {counts}")
        if self._failures:
            notes.append(f"receiving failed {self._failures} times, first: {self._first_failure}")
        return notes

    def messages(self) -> Iterator[tuple[Kind, np.ndarray, int]]:
        """Yield each arrived message, oldest first, as kind, records and clock offset.

        The offset, ns, converts instants of the sender's clock to this one. The records are overwritten by
        the next message.
        """
        try:
            for kind, data, now_ns in self._reader.messages():
                header, records = parts_of(data, kind)
                if self._foreign is None:
                    yield kind, records, 0
                    continue
                is_new_run = self._reader.is_new_run
                self._foreign.arrived(int(header["send_ns"]), now_ns, is_new_run=is_new_run, kind=kind.magic)
                # Until a clock is seen to advance, the messages may be old ones sent again.
                if self._foreign.is_certain:
                    yield from self._on_our_clock(kind, records, now_ns - self._foreign.theirs(now_ns))
            if self._reader.counts.unverified and not self._has_warned_of_key:
                self._has_warned_of_key = True
                LOGGER.warning(
                    "%s: a message is not verified by the key (expected that of its sender)", self.address
                )
        except OSError as failure:
            self._failures += 1
            if self._failures == 1:
                self._first_failure = str(failure)
                LOGGER.warning("receiving failed: %s", failure)

    def _on_our_clock(
        self, kind: Kind, records: np.ndarray, offset_ns: int
    ) -> Iterator[tuple[Kind, np.ndarray, int]]:
        if abs(offset_ns) <= FARTHEST_NS:
            yield kind, records, offset_ns
        else:
            self.leave_out("messages with an impossible time", 1)

    def wait(self, timeout: float) -> None:
        """Wait until a message may have arrived, or for *timeout* seconds."""
        try:
            self._inlet.wait(timeout)
        except OSError:  # the failure is counted when messages are read
            time.sleep(timeout)

    def loop_end(self) -> dict[str, Any] | None:
        """Return the data with which the loop can receive here itself, or None if only Python can."""
        end = getattr(self._inlet, "loop_end", None)
        return None if end is None else end()

    def leave_out(self, what: str, count: int, why: str = "", *, says: str = "") -> None:
        """Count parts of a message that are not used, and log the first occurrence.

        *says*: text for the log instead of *what* and *why*.
        """
        if what not in self._left_out:
            LOGGER.warning("%s: %s", self.address, says or f"{what} are not used{why and f' ({why})'}")
        self._left_out[what] = self._left_out.get(what, 0) + count

    def close(self) -> None:
        """Close the address."""
        self._inlet.close()
