"""Outputs of a service: a log, and publishers of which some may fail while others go on."""

import logging
import time
from collections.abc import Sequence
from contextlib import ExitStack

from proximity.errors import PublishError
from proximity.message import Message
from proximity.service.log_writer import Log, LogWriter
from proximity.transport import Publisher

LOGGER = logging.getLogger("proximity.service")


class Outgoing:
    """Hands each frame to all publishers, and to the log as the first of them has sealed it."""

    failures: dict[str, int]  # frames that an address did not take

    def __init__(self, publishers: Sequence[Publisher], log: Log | None, size: int) -> None:
        self.failures = {publisher.address: 0 for publisher in publishers}
        self._publishers = [(publisher.publish, publisher) for publisher in publishers]
        self._first_failures: dict[str, str] = {}
        self._undescribed: dict[str, str] = {}
        self._log = None if log is None else LogWriter(log, size)
        self._session, self._unsent = time.time_ns(), 0  # of a log alone

    @property
    def log_written(self) -> int:
        """Frames that the log has."""
        return 0 if self._log is None else self._log.written

    @property
    def log_lost(self) -> int:
        """Frames that it should have, and has not."""
        return 0 if self._log is None else self._log.failed + self._log.lost

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not published or logged, and why."""
        notes = [
            f"{address}: {self.failures[address]} frames were not published, first: {failure}"
            for address, failure in list(self._first_failures.items())
        ]
        notes += [
            f"{address}: names of parts and fingers were not published, first: {failure}"
            for address, failure in list(self._undescribed.items())
        ]
        return notes + ([] if self._log is None else self._log.notes)

    def hand_out(self, message: Message) -> None:
        """Publish a frame, and keep it for the log."""
        log = self._log
        if log is not None and not self._publishers:
            # A log alone: numbered as a publisher would.
            log.put(message.seal(self._session, self._unsent))
            self._unsent += 1
        for publish, publisher in self._publishers:
            try:
                publish(message)
            except PublishError as failure:
                self._count(publisher.address, failure)
            if log is not None:
                log.put(message.data)
                log = None

    def describe(self, message: Message) -> None:
        """Publish a message of the description: it is kept nowhere, and sent again within a second."""
        for publish, publisher in self._publishers:
            try:
                publish(message)
            except PublishError as failure:
                if publisher.address not in self._first_failures:  # with frames it is counted
                    self._undescribed.setdefault(publisher.address, str(failure))

    def settle(self) -> None:
        """Have the log written: when nothing else is to be done for a while."""
        if self._log is not None:
            self._log.wake()

    def close(self) -> None:
        """Close publishers and log."""
        with ExitStack() as stack:
            for _, publisher in self._publishers:
                stack.callback(publisher.close)
            if self._log is not None:
                stack.callback(self._log.close)

    def _count(self, address: str, failure: PublishError) -> None:
        self.failures[address] += 1
        if address not in self._first_failures:
            self._first_failures[address] = str(failure)
            LOGGER.warning("a frame cannot be published: %s", failure)
