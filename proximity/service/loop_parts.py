"""Pass moves and changes of parts to the loop. Threads next to the loop read them.

Poses and motions of parts are a table with a row for each part. The loop switches to a newer table at the
start of a tick, and extrapolates parts to the instant of the newest pose. If the parts change, the loop gets
another source: copies of the scene's arrays that only the loop uses from then on. Contacts that only Python
can compute also come from a thread, as messages.
"""

import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from proximity.core import loop_records
from proximity.message import CONTACT
from proximity.service.clock import Clock
from proximity.service.contact_source import ContactSource, TrackedContacts
from proximity.service.inputs.part_prediction import ReportedMotion, VisibleParts, write_motions
from proximity.service.inputs.sources import PolledInput
from proximity.service.loop_ends import APART, Worker
from proximity.service.loop_memory import LoopMemory, SourceMemory, given_size
from proximity.service.realtime import RealTime
from proximity.service.samples import NewestSamples
from proximity.transport import forget
from proximity.transport.shared_memory import PrivateMailbox

REPLACE_TIMEOUT, POLL_INTERVAL = 1.0, 1e-3
"""Maximum wait for a replacement in addition to a period, and time between two checks whether it is in use,
s."""
LOOK = 0.02
"""Time between two checks for parts that are no longer reported, s."""


class LoopSources:
    """The contact sources that a loop uses one after the other, and the motions of their parts."""

    def __init__(self, memory: LoopMemory) -> None:
        self._memory, self._loop = memory, memory.loop
        self._lock = threading.RLock()  # protects the published sources
        self._used: dict[int, SourceMemory] = {}  # sources that the loop may use, by address
        self._latest: SourceMemory | None = None  # the source passed to the loop last
        self._visible: VisibleParts | None = None  # parts of the latest source
        self._report_count = 0
        self._threads: list[_PartThread] = []
        self.failure: BaseException | None = None  # exception that ended a thread

    @property
    def has_begun(self) -> bool:
        """True if the loop has a source."""
        return bool(self._loop.source)

    @property
    def latest(self) -> SourceMemory:
        """Source that was passed to the loop last."""
        assert self._latest is not None, "the loop has begun"
        return self._latest

    @property
    def current(self) -> SourceMemory:
        """The source that the loop uses."""
        return self._used[int(self._loop.source)]

    def begin(self, contacts: ContactSource) -> None:
        """Pass the first source to the loop."""
        self._hand_over(SourceMemory(contacts, self._memory))
        self._loop.source, self._loop.next = self._loop.next, 0

    def replace(self, contacts: ContactSource) -> None:
        """Pass another source to the loop, which uses it from the next tick on."""
        with self._lock:
            self._hand_over(SourceMemory(contacts, self._memory))

    def wait_until_used(self, is_running: Any) -> None:
        """Wait until the loop uses the latest source. Return immediately if the loop does not run."""
        gives_up = time.monotonic() + REPLACE_TIMEOUT + 1e-9 * float(self._loop.period_ns)
        while self._loop.next and is_running() and time.monotonic() < gives_up:
            time.sleep(POLL_INTERVAL)
        with self._lock:
            self._forget_unused()

    def start(self, real_time: RealTime | None) -> None:
        """Start the threads that read moves and changes."""
        contacts = self.current.contacts
        if isinstance(contacts, TrackedContacts) and self.current.has_scene:
            inputs = [each for each in (contacts.moves, contacts.changes) if each is not None]
            self._threads = [_PartThread(self, each) for each in inputs or (None,)]
            for thread in self._threads:
                thread.start(real_time)

    def poll(self) -> None:
        """Read arrived moves and changes, and pass the result to the loop."""
        with self._lock:
            now_ns = self._now_ns()
            latest = self._latest
            assert latest is not None, "the loop has begun"
            contacts = latest.contacts
            if not latest.has_scene or not isinstance(contacts, TrackedContacts):
                return
            scene = contacts.tracker.scene
            if contacts.changes is not None:
                contacts.changes.apply(scene)
            moved = {} if contacts.moves is None else contacts.moves.take(scene, now_ns)
            if latest.is_outdated:
                if not self._loop.next:  # otherwise a source not yet seen by the loop would be renumbered
                    self._hand_over(SourceMemory(contacts, self._memory, latest))
            elif moved:
                self._report(moved)
            if contacts.moves is not None and self._visible is not None:
                contacts.moves.note_silence(self._visible.names, now_ns)

    def note(self) -> None:
        """Update the notes of trackers and inputs from the results of the loop."""
        self.current.note_answers()

    def close(self) -> None:
        """End the threads."""
        for thread in self._threads:
            thread.close()
            self.failure = self.failure or thread.failure

    def _now_ns(self) -> int:
        return int(self._loop.simulated_ns) if self._loop.is_simulated else time.monotonic_ns()

    def _hand_over(self, following: SourceMemory) -> None:
        """Pass a source to the loop, with its parts at their reported poses."""
        contacts, self._latest, self._visible = following.contacts, following, None
        self._used[following.address] = following
        if following.has_scene and isinstance(contacts, TrackedContacts):
            scene = contacts.tracker.scene
            self._visible = VisibleParts(scene)
            if contacts.moves is not None:
                contacts.moves.take(scene, self._now_ns())
                self._report(contacts.moves.reported())
        self._loop.next = following.address
        self._forget_unused()

    def _forget_unused(self) -> None:
        # Here, not in the loop: freeing a large scene takes milliseconds.
        assert self._latest is not None, "the loop has begun"
        kept = int(self._loop.next), int(self._loop.source), self._latest.address
        for address in [address for address in self._used if address not in kept]:
            del self._used[address]

    def _report(self, moves: Mapping[str, ReportedMotion]) -> None:
        """Pass the reported motions of parts to the loop."""
        latest, visible = self._latest, self._visible
        assert latest is not None and visible is not None, "there are parts"
        present = {name: motion for name, motion in moves.items() if name in visible.names}
        if present:
            self._report_count += 1
            write_motions(latest.motions, visible, present, self._report_count)
            latest.publish_motions()


class _PartThread(Worker):
    """Thread that polls the sources when moves or changes arrive at an input.

    Without an input, another thread edits the parts, and the sources are polled regularly.
    """

    def __init__(self, sources: LoopSources, part_input: Any) -> None:
        super().__init__()
        self._sources, self._input = sources, part_input

    def _work(self) -> None:
        if self._input is not None:
            self._input.wait(LOOK)
        self._sources.poll()
        time.sleep(APART)


class ContactBridge(Worker):
    """Thread that computes contacts of sources in Python and puts them into a mailbox read by the loop.

    It computes contacts in every period, and when samples or moves arrive. *clock*: clock that drives the
    loop; None: the system clock.
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
        """Compute contacts from the newest samples, and put them into the mailbox."""
        source, newest, clock = self._sources.latest, self._newest, self._clock
        for samples in self._input.poll(now_ns):
            # Not *now_ns*: if the system suspended this thread since, new poses are later.
            newest.update(samples, time.monotonic_ns() if clock is None else clock.now_ns())
        newest.drop_stale(now_ns)
        try:
            source.contacts.fill(self._contacts, newest.samples, now_ns)
        except BaseException:
            self._forget()  # the stored contacts may belong to another source
            self._send(source, now_ns)
            raise
        self._send(source, now_ns)

    def wake(self) -> None:
        """Compute contacts immediately, without a new sample."""
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
