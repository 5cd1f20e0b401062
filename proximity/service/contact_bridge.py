"""Contacts that only Python can make: a thread beside the loop, which reads them as messages."""

import threading
import time

import numpy as np

from proximity.core import loop_records
from proximity.message import CONTACT
from proximity.service.clock import Clock
from proximity.service.inputs.sources import PolledInput
from proximity.service.loop_ends import APART, Worker
from proximity.service.loop_memory import SourceMemory, given_size
from proximity.service.loop_parts import LoopSources
from proximity.service.samples import NewestSamples
from proximity.transport import forget
from proximity.transport.shared_memory import PrivateMailbox


class ContactBridge(Worker):
    """Makes the contacts of sources that answer in Python, and puts them into a mailbox that the loop reads.

    In every period, and when samples or moves come. *clock*: drives the loop; None: the system's does.
    """

    def __init__(
        self,
        pose_input: PolledInput,
        newest: NewestSamples,
        sources: LoopSources,
        count: int,
        clock: Clock | None,
        period_ns: int,
    ) -> None:
        super().__init__()
        self._input, self._newest, self._sources, self._clock = pose_input, newest, sources, clock
        self._period = 1e-9 * period_ns
        self._woken = threading.Event()
        self._data = np.zeros(given_size(count), np.uint8)
        self._header = self._data[: -count * CONTACT.itemsize].view(loop_records.CONTACTS)
        self._contacts = self._data[-count * CONTACT.itemsize :].view(CONTACT)
        self._forget()
        self._mailbox = PrivateMailbox(len(self._data))
        self.reader = self._mailbox.reader

    def poll(self, now_ns: int) -> None:
        """Make contacts of what is known, and put them in."""
        source, newest, clock = self._sources.latest, self._newest, self._clock
        for samples in self._input.poll(now_ns):
            # Not by the start: where the system kept us from running since, new poses are after it.
            newest.update(samples, time.monotonic_ns() if clock is None else clock.now_ns())
        newest.drop_stale(now_ns)
        try:
            source.contacts.fill(self._contacts, newest.samples, now_ns)
        except BaseException:
            self._forget()  # the last frames tell nothing of this
            self._send(source, now_ns)
            raise
        self._send(source, now_ns)

    def wake(self) -> None:
        """Have contacts made at once, though there is no new sample."""
        self._woken.set()

    def close(self) -> None:
        """End the thread."""
        self._woken.set()
        super().close()

    def _forget(self) -> None:
        forget(self._contacts)
        self._contacts["finger"] = np.arange(len(self._contacts))

    def _send(self, source: SourceMemory, now_ns: int) -> None:
        header, clock = self._header, self._clock
        header["source"], header["epoch"] = source.address, source.contacts.epoch
        header["is_late"] = source.contacts.is_late
        header["spent_ns"] = 0 if clock is None else clock.now_ns() - now_ns
        self._mailbox.send(self._data)

    def _work(self) -> None:
        if hasattr(self._input, "wait"):
            self._input.wait(self._period)
        else:
            self._woken.wait(self._period)
            self._woken.clear()
        self.poll(time.monotonic_ns())
        time.sleep(APART)
