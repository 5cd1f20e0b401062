"""A received frame: unpacked once, and checked for values that are impossible."""

from typing import Any

import numpy as np

from proximity.message import CONTACT, FRAME, Defect, Mode, Source, State, Surface, parts_of
from proximity.message.contact import TRACKED_BIT, UNIT_ERROR
from proximity.message.envelope import MAX_FUTURE_NS, PREFIX_FIELDS
from proximity.message.fields import struct_of
from proximity.message.frame import FRAME_FIELDS

LONGEST_VALID_NS = 1_000_000_000
"""After its oldest pose no frame is valid for longer, whatever it says."""
ORDERED = (
    ("lower", "signed_distance"),
    ("signed_distance", "upper"),
    ("predicted_lower", "predicted_upper"),
    ("predicted_distance", "predicted_distance"),  # only that it is a number
    ("time_to_contact_lower", "time_to_contact"),
)
"""Of a tracked finger: the first is not above the second, and none is nan. The position is finite, too."""

CONTACT_WORDS = CONTACT.itemsize // 8
_COLUMN = {name: CONTACT.fields[name][1] // 8 for name in CONTACT.names or ()}  # type: ignore[index]
_POSITION = [_COLUMN["position"] + axis for axis in range(3)]
_LEAST, _MOST = CONTACT_WORDS, CONTACT_WORDS + 1  # behind the columns: bounds of finite numbers
_LEFT = [_COLUMN[left] for left, _ in ORDERED] + _POSITION + [_LEAST] * 3
_RIGHT = [_COLUMN[right] for _, right in ORDERED] + [_MOST] * 3 + _POSITION
_KINDS = frozenset(
    surface | mode << 8 | source << 16 | force_is_valid << 24
    for surface in Surface
    for mode in Mode
    for source in Source
    for force_is_valid in (0, 1)
)
"""What the last four bytes of a contact may be: surface, mode, source and force_is_valid."""
# As arrays: of a number, NumPy would make one at each comparison, which takes longer than to compare.
_SHORTEST_SQ, _LONGEST_SQ = np.array((1.0 - UNIT_ERROR) ** 2), np.array((1.0 + UNIT_ERROR) ** 2)
_MOST_NS = 2**61
"""Of instants, on any clock: 73 years. Sums of a few must be numbers of 64 bits as well."""
_MOST_SOURCE = int(max(Source))
_STATES = {int(state): state for state in State}
_INSTANTS = slice(len(PREFIX_FIELDS), len(PREFIX_FIELDS) + 4)  # pose_ns, start_ns, publish_ns, valid_until_ns
_unpack_header = struct_of(FRAME_FIELDS).unpack_from


class ReceivedFrame:
    """A buffer for a frame of so many contacts, and what was decoded of it."""

    header: Any  # FRAME_HEADER, read-only
    contacts: np.ndarray  # (count,) CONTACT, read-only
    state: State
    pose_ns: int
    publish_ns: int
    expires_ns: int  # up to then the frame is valid

    def __init__(self, count: int) -> None:
        self.count = count
        self.state = State.STALE
        self.pose_ns = self.publish_ns = self.expires_ns = 0
        size = FRAME.size(count)
        self._buffer = np.zeros(size + 16, np.uint8)
        self._data = self._buffer[:size]
        shown = self._data.view()
        shown.flags.writeable = False
        header, self.contacts = parts_of(shown, FRAME)
        self.header = header[()]  # a view, as of all structured scalars
        self._allocate_columns()

    def _allocate_columns(self) -> None:
        """The columns that are looked at, and room for what is found: NumPy is slow at making arrays."""
        count, records = self.count, self._data[FRAME.header_size :]
        self._reals = self._buffer[FRAME.header_size :].view("<f8")
        self._reals[-2:] = np.finfo(float).min, np.finfo(float).max
        self._left_at, self._right_at = _flat_columns(_LEFT, count), _flat_columns(_RIGHT, count)
        self._left, self._right = np.empty((2, count, len(_LEFT)))
        self._is_ordered = np.empty((count, len(_LEFT)), bool)
        self._normals = self.contacts["normal"]
        self._length_sq = np.empty(count)
        self._pose_ns = self.contacts["pose_ns"]
        self._oldest_ns, self._newest_ns = np.zeros((), np.int64), np.zeros((), np.int64)
        self._is_off = np.empty((4, count), bool)
        self._is_short, self._is_long, self._is_older, self._is_newer = self._is_off
        self._kinds = records.view("<u4").reshape(count, 2 * CONTACT_WORDS)[:, -1]

    def decode(self, data: np.ndarray, now_ns: int | None) -> Defect | None:
        """Copy a frame and return what is wrong with it, or None; one with a defect is not to be used."""
        self._data[:] = data
        numbers = _unpack_header(self._data.data)
        self.pose_ns, _, self.publish_ns, valid_until_ns = numbers[_INSTANTS]
        state, source = numbers[-2:]
        if state not in _STATES or source > _MOST_SOURCE:
            return Defect.CONTENT
        self.state = _STATES[state]
        self.expires_ns = min(valid_until_ns, self.pose_ns + LONGEST_VALID_NS)
        latest = min((self.publish_ns if now_ns is None else now_ns) + MAX_FUTURE_NS, _MOST_NS)
        if max(self.pose_ns, self.publish_ns) > latest:
            return Defect.FUTURE
        if min(self.pose_ns, self.publish_ns) < 0:
            return Defect.CONTENT
        return self._content_defect(latest)

    def _content_defect(self, latest: int) -> Defect | None:
        """Whether what is said of the fingers cannot be."""
        if not _KINDS.issuperset(self._kinds.tolist()):
            return Defect.CONTENT
        self._reals.take(self._left_at, None, self._left, "clip")
        self._reals.take(self._right_at, None, self._right, "clip")
        np.less_equal(self._left, self._right, self._is_ordered)
        np.einsum("ij,ij->i", self._normals, self._normals, out=self._length_sq)
        np.less(self._length_sq, _SHORTEST_SQ, self._is_short)  # nan, no normal, is neither
        np.greater(self._length_sq, _LONGEST_SQ, self._is_long)
        self._oldest_ns[()], self._newest_ns[()] = self.pose_ns, latest
        np.less(self._pose_ns, self._oldest_ns, self._is_older)
        np.greater(self._pose_ns, self._newest_ns, self._is_newer)
        if np.count_nonzero(self._is_ordered) == self._is_ordered.size and not np.count_nonzero(self._is_off):
            return None
        return self._defect_of_some()

    def _defect_of_some(self) -> Defect | None:
        """Whether what is unsound may be: the place that a sensor does not know, or a finger not tracked."""
        contacts, pairs = self.contacts, len(ORDERED)
        is_placed = self._is_ordered[:, pairs:].all(axis=1)
        is_placed |= (contacts["source"] != Source.GEOMETRY) & np.isnan(contacts["position"]).any(axis=1)
        makes_sense = self._is_ordered[:, :pairs].all(axis=1) & is_placed & ~self._is_off.any(axis=0)
        is_tracked = (contacts["flags"] & TRACKED_BIT) != 0
        return None if (makes_sense | ~is_tracked).all() else Defect.CONTENT


def _flat_columns(columns: list[int], count: int) -> np.ndarray:
    """Flat indices of columns of each row; columns that must be finite are taken from the last row."""
    flat = np.arange(count)[:, np.newaxis] * CONTACT_WORDS + columns
    behind = np.array(columns) >= CONTACT_WORDS
    flat[:, behind] = (count - 1) * CONTACT_WORDS + np.array(columns)[behind]
    return flat
