"""``iox2://NAME``: shared memory between processes of one machine, without a server, by iceoryx2.

A message is copied into shared memory once, and every subscriber reads it there. One publisher and up to 16
subscribers share a name. Nobody waits for anybody: who reads too seldom loses the oldest messages. A late
subscriber gets the latest message as soon as the publisher sends its next one. When publisher or subscriber
are killed, the other goes on; a publisher that is started anew is received by those that were there before.
One gap is left in iceoryx2 0.10: whose partner is killed in the very microseconds in which it makes the
connection may hang, until anybody opens or closes an ``iox2`` address.

Programs in other languages open the publish-subscribe service ``proximity/NAME`` with slices of uint8.

Thread: an end may be used by any thread, but by one at a time. Signals are left to Python. iceoryx2 prints
errors only, or what the environment variable IOX2_LOG_LEVEL says.
"""

import ctypes
import os
from functools import cache
from pathlib import Path
from typing import Any

import iceoryx2
import numpy as np

from proximity.errors import PublishError
from proximity.transport.address import Address
from proximity.transport.iceoryx_names import (
    BUFFER,
    create_end,
    open_service,
    remove_unfinished_memory,
)
from proximity.transport.link import NOTHING, wait_until

FIRST_BYTES = 8192
"""Bytes of a message at first: a frame of 24 fingers. A longer message makes room for its like."""
SPARE = 3
"""Messages in memory for each subscriber, beside the one that it reads: one that died leaves some behind."""

SHARED_MEMORY = Path("/dev/shm")
"""Where Linux has it."""

iceoryx2.set_log_level_from_env_or(iceoryx2.LogLevel.Error)


class IceoryxOutlet:
    """Copies messages into shared memory."""

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._text = address.text
        self._node, self._service = open_service(address, "publisher")
        builder = self._service.publisher_builder().initial_max_slice_len(FIRST_BYTES).max_loaned_samples(1)
        builder = builder.allocation_strategy(iceoryx2.AllocationStrategy.PowerOfTwo)
        builder = builder.override_sample_preallocation(_most_in_memory(self._service))
        self._publisher = create_end(builder.create, address, self._node, self._service, "publisher")
        try:
            _claim_memory(self._publisher)
        except OSError as failure:
            self.close()
            raise address.refuse(
                f"there is no room for messages in {SHARED_MEMORY} ({failure.strerror}); expected 1.1 MB"
            ) from None

    def send(self, data: np.ndarray) -> None:
        """Copy the message to where the subscribers read it; never waits."""
        if self._publisher is None:
            raise PublishError(f"{self._text}: was closed, nothing can be sent")
        size = len(data)
        try:
            sample = _loan(self._publisher, size)
            # 0.4 us; ctypes.memmove takes 0.9 and lets another thread have the interpreter meanwhile.
            _block(size).from_address(sample.payload_ptr).raw = data
            _finish(sample).send()
        except (iceoryx2.LoanError, iceoryx2.SendError) as failure:
            raise PublishError(f"{self._text}: cannot send {size} bytes ({failure})") from failure

    def close(self) -> None:
        """Leave; the name is free."""
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            remove_unfinished_memory()
            publisher.delete()
        self._service = self._node = None


class IceoryxInlet:
    """Reads messages in shared memory."""

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._text = address.text
        self._node, self._service = open_service(address, "subscriber")
        create = self._service.subscriber_builder().buffer_size(BUFFER).create
        self._subscriber = create_end(create, address, self._node, self._service, "subscriber")

    def receive(self, buffer: np.ndarray) -> int:
        """Take the oldest message of the buffer."""
        if self._subscriber is None:
            return NOTHING
        try:
            sample = self._subscriber.receive()
        except iceoryx2.ReceiveError as failure:
            raise PublishError(f"{self._text}: cannot receive ({failure})") from failure
        if sample is None:
            return NOTHING
        size: int = sample.header.number_of_elements
        taken = min(size, len(buffer))
        buffer.data[:taken] = ctypes.string_at(sample.payload_ptr, taken)
        sample.delete()
        return size

    def wait(self, timeout: float) -> bool:
        """Look again and again; to be woken would cost the publisher 5 us a message.

        Measured at 1 kHz on two shared cores, from sending to here: 97 us and 11 % of a core; woken by an
        event of iceoryx2 53 us and 4 %; who never sleeps sees it after 33 us.
        """
        return wait_until(self._has_messages, timeout)

    def close(self) -> None:
        """Leave; another subscriber may come."""
        subscriber, self._subscriber = self._subscriber, None
        if subscriber is not None:
            remove_unfinished_memory()
            subscriber.delete()
        self._service = self._node = None

    def _has_messages(self) -> bool:
        try:
            return self._subscriber is not None and bool(self._subscriber.has_samples())
        except iceoryx2.ConnectionFailure as failure:
            raise PublishError(f"{self._text}: cannot receive ({failure})") from failure


# What the public methods call after they have checked, each time, of which type the payload is: 1 us of 4.
_loan = getattr(iceoryx2.Publisher, "__loan_slice_uninit", iceoryx2.Publisher.loan_slice_uninit)
_finish = getattr(iceoryx2.SampleMutUninit, "__assume_init", iceoryx2.SampleMutUninit.assume_init)

open_outlet = IceoryxOutlet
open_inlet = IceoryxInlet


def _most_in_memory(service: Any) -> int:
    """Largest number of messages at once; iceoryx2 0.10 aborts the process when there are more.

    All buffers hold the same latest messages. By itself iceoryx2 reckons with a buffer of its own for each
    subscriber: eight times as much memory, which real-time processes lock.
    """
    agreed = service.static_config
    latest = max(agreed.subscriber_max_buffer_size, agreed.history_size)
    return int(latest + agreed.max_subscribers * (agreed.subscriber_max_borrowed_samples + SPARE))


def _claim_memory(publisher: Any) -> None:
    """Have the system give the memory of hands' messages now, not when it is first written to.

    Who finds none left then is killed (SIGBUS). Of messages longer than `FIRST_ROOM` that remains so: their
    like would need 128 times their size, of which no more than a few are used where subscribers read.
    """
    for file in SHARED_MEMORY.glob(f"*_{publisher.id.value}__0.data"):  # as iceoryx2 0.10 names it on Linux
        with file.open("r+b") as opened:
            os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)


@cache
def _block(size: int) -> Any:
    """The type of that many bytes. To make one takes 20 us, and ctypes forgets those that nobody holds."""
    return ctypes.c_char * size
