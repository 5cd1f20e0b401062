"""Build frames: contacts, times, and a state that says how far to trust them (docs/reference/messages.md)."""

import numpy as np

from proximity.kernels.contact_record import CONTACT_RECORD
from proximity.message import FRAME, PREFIX, Message, Source, State
from proximity.message.envelope import PREFIX_FIELDS
from proximity.message.fields import struct_of
from proximity.message.frame import FRAME_FIELDS
from proximity.service import finger_kernels
from proximity.transport import forget

_HEADER = struct_of(FRAME_FIELDS[len(PREFIX_FIELDS) :])
"""The header behind the prefix: packed at once in 0.2 µs, where nine fields of an array take 2 µs."""


class FrameBuilder:
    """The frame of a service: contacts are written into its records, then its header is finished, each tick.

    *period_ns*, *valid_for_ns*: between ticks; how long after its oldest pose a frame may be used as it is.
    """

    message: Message
    contacts: np.ndarray  # (N,) CONTACT, the records of the message
    state: State  # of the frame that was made last
    tracked: int  # fingers that are tracked in it

    def __init__(self, count: int, source: Source, period_ns: int, valid_for_ns: int) -> None:
        self.message = Message(FRAME, count)
        self.contacts = self.message.records
        self.source = int(source)
        self.state = State.STARTING
        self.tracked = 0
        self._count = count
        self._period_ns, self._valid_for_ns = period_ns, valid_for_ns
        self._has_started = False
        self._missed = 0  # as the last frame reported
        self._epoch = 0
        self._is_filled = False  # whether a tick has written all its contacts
        self._clear()
        self._header_buffer = memoryview(self.message.data)  # type: ignore[arg-type]
        self._records = self.contacts.view(np.ndarray).view(CONTACT_RECORD)

    def begin(self) -> np.ndarray:
        """Return the records for the contacts of a tick; until `finish` they are not those of one instant."""
        self._is_filled = False
        return self.contacts

    def finish(
        self, start_ns: int, publish_ns: int, missed: int, epoch: int, skipped_ns: int, is_late: bool = False
    ) -> None:
        """Write the header.

        *skipped_ns*: by which these times are ahead of those that subscribers read. *is_late*: whether of
        what the contacts were made of something is too old already.
        """
        oldest_ns, tracked, uncertain = finger_kernels.overview(self._records)
        self.tracked, self._is_filled = tracked, True
        pose_ns = oldest_ns if tracked else start_ns
        valid_until_ns = pose_ns + self._valid_for_ns
        self._has_started |= tracked > 0
        if not tracked:
            self.state = State.STALE if self._has_started else State.STARTING
        elif missed != self._missed or publish_ns > valid_until_ns or is_late:
            self.state = State.LATE
        elif tracked < self._count or uncertain:
            self.state = State.DEGRADED
        else:
            self.state = State.OK
        self._missed, self._epoch = missed, epoch
        if skipped_ns:
            for column in ("pose_ns", "predicted_ns"):
                self.contacts[column] -= skipped_ns
        self._write(pose_ns - skipped_ns, start_ns - skipped_ns, publish_ns - skipped_ns)

    def stop(self, now_ns: int) -> None:
        """Make the last frame one that says that no others will come; nothing of a failed tick is in it."""
        self.state = State.STOPPING
        if not self._is_filled:
            self._clear()
        pose_ns = int(self.message.header["pose_ns"]) or now_ns
        self._write(pose_ns, now_ns, now_ns)

    def _clear(self) -> None:
        forget(self.contacts)
        self.contacts["finger"] = np.arange(self._count)

    def _write(self, pose_ns: int, start_ns: int, publish_ns: int) -> None:
        _HEADER.pack_into(
            self._header_buffer,
            PREFIX.itemsize,
            pose_ns,
            start_ns,
            publish_ns,
            pose_ns + self._valid_for_ns,
            self._period_ns,
            self._epoch,
            self._missed,
            self._count,
            self.state,
            self.source,
        )
