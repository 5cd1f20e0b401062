"""A received frame, which is decoded once and checked for impossible values."""

from typing import Any

import numpy as np

from proximity.core.library_in_c import receiver_in_c
from proximity.core.receiver_state import MAX_VALID_NS
from proximity.message import FRAME, Defect, State, parts_of
from proximity.message.contact import Contacts
from proximity.message.envelope import PREFIX_FIELDS
from proximity.message.fields import struct_of
from proximity.message.frame import FRAME_FIELDS

_DEFECTS = (None, *Defect)
_STATES = tuple(State)
_INSTANTS = slice(len(PREFIX_FIELDS), len(PREFIX_FIELDS) + 4)  # pose_ns, start_ns, publish_ns, valid_until_ns
_unpack_header = struct_of(FRAME_FIELDS).unpack_from


class ReceivedFrame:
    """Buffer for a frame of *count* contacts, and its decoded fields."""

    header: Any  # FRAME_HEADER, read-only
    contacts: Contacts  # (count,) CONTACT, read-only
    state: State
    pose_ns: int
    publish_ns: int
    expires_ns: int  # end of the frame's validity

    def __init__(self, count: int) -> None:
        self.count = count
        self.state = State.STALE
        self.pose_ns = self.publish_ns = self.expires_ns = 0
        self._data = np.zeros(FRAME.size(count), np.uint8)
        shown = self._data.view()
        shown.flags.writeable = False
        header, contacts = parts_of(shown, FRAME)
        self.contacts = contacts.view(Contacts)
        self.header = header[()]  # a view, like every structured scalar
        self._content_flaw = receiver_in_c("content_flaw")

    def decode(self, data: np.ndarray, now_ns: int | None) -> Defect | None:
        """Copy a frame and decode it. Return its defect, or None if it can be used."""
        self._data[:] = data
        numbers = _unpack_header(self._data.data)
        self.pose_ns, _, self.publish_ns, valid_until_ns = numbers[_INSTANTS]
        defect = _DEFECTS[self._content_flaw(self._data, self.publish_ns if now_ns is None else now_ns)]
        if defect is None:
            self.state = _STATES[numbers[-2]]
            self.expires_ns = min(valid_until_ns, self.pose_ns + MAX_VALID_NS)
        return defect
