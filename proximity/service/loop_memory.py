"""Memory that Python shares with the compiled loop, which are its records and the arrays they point to."""

import ctypes
import weakref
from contextlib import suppress
from typing import Any

import numpy as np

from proximity.checks import as_number
from proximity.core import loop_records
from proximity.core.library_in_c import libraries
from proximity.errors import ProximityError, ServiceError
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES
from proximity.mesh.part_memory import aligned_empty
from proximity.message import (
    CONTACT,
    FRAME,
    MAX_RECORDS,
    MEASURED,
    MEASUREMENT,
    PATH_CORNERS,
    PATH_POSES,
    Message,
)
from proximity.native.mode import IS_AHEAD, MODE
from proximity.scene.model.assembly import Model
from proximity.service.contact_source import METRES_A_BEND, ContactSource, TrackedContacts
from proximity.service.finger_kernels import LOST
from proximity.service.samples import NEVER_NS, FingerPoses, Measurements
from proximity.service.sensed_contacts import SensedContacts
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import arrays_after, arrays_of, note_answers
from proximity.transport import forget
from proximity.transport.udp import MAX_DATAGRAM

SHORTEST_PERIOD, MAX_PERIOD = 1e-5, 10.0
"""Minimum and maximum period, s."""


def run_function() -> Any:
    """Return the compiled function that runs the loop. It releases the interpreter lock."""
    if not IS_AHEAD:
        raise ServiceError("the service needs compiled kernels: run `python tools/build_kernels.py`")
    try:
        return libraries()[0].proximity_loop_run
    except ProximityError as failure:
        raise ServiceError(f"a service needs the library in C: {failure}") from failure


def given_size(count: int) -> int:
    """Return the size in bytes of a message with contacts that are computed outside the loop."""
    return int(loop_records.CONTACTS.itemsize) + count * CONTACT.itemsize


def words_of(arrays: Any) -> np.ndarray:
    """Return the address and the shape of each array, in the layout of kernels."""
    return np.array([word for each in arrays for word in (each.ctypes.data, *each.shape)], np.int64)


def nanoseconds(name: str, seconds: Any) -> int:
    """Return a duration of a service in nanoseconds. Raise `ServiceError` if it is out of range."""
    if not SHORTEST_PERIOD <= as_number(seconds) <= MAX_PERIOD:
        raise ServiceError(f"{name} is {seconds!r}, expected {SHORTEST_PERIOD:g} to {MAX_PERIOD:g} s")
    return round(NS_PER_S * seconds)


def fill(record: Any, values: dict[str, Any]) -> None:
    """Write the given fields of a structure."""
    for name, value in values.items():
        record[name] = value


def _copied(array: np.ndarray) -> np.ndarray:
    """Return a copy of an array that is aligned to a cache line."""
    copy = aligned_empty(array.size, array.dtype.type)
    copy[:] = array
    return copy


class SourceMemory:
    """A source of contacts in the loop's layout. It must exist while the loop may use it.

    *before*: memory of the same source with the previous parts of its scene.
    """

    def __init__(
        self, contacts: ContactSource, memory: "LoopMemory", before: "SourceMemory | None" = None
    ) -> None:
        self.contacts = contacts
        self.record = np.zeros(1, loop_records.SOURCE)
        self._fields: Any = self.record[0]
        self.labels = lambda: contacts.labels()
        self.has_scene = False  # whether the loop has separate arrays, in which it moves parts
        if isinstance(contacts, TrackedContacts) and contacts.is_ticked_by_loop:
            self._set_tracker(contacts, memory, before)
        elif isinstance(contacts, SensedContacts) and contacts.is_ticked_by_loop:
            self._set_sensor(contacts)
        self._fields["epoch"] = contacts.epoch

    @property
    def address(self) -> int:
        """Address of the source's record."""
        return int(self.record.ctypes.data)

    def note_answers(self) -> None:
        """Update the tracker's notes on poses from the results of the ticks."""
        if self._fields["answers"] and isinstance(self.contacts, TrackedContacts):
            with suppress(ValueError, IndexError):  # a race with the loop: the next call updates the notes
                note_answers(self.contacts.tracker, int(self._fields["answers"]))

    def _set_tracker(
        self, contacts: TrackedContacts, memory: "LoopMemory", before: "SourceMemory | None"
    ) -> None:
        """Set the tracker and the scene that the ticks use."""
        tracker, fields = contacts.tracker, self._fields
        if before is None:
            tracker.write_to(memory.message.records)
            self._bends = np.zeros((contacts.count, ESTIMATES), ESTIMATE)
            model, self._arrays = arrays_of(tracker, *memory.optional)
        else:
            self._bends, model = before._bends, tracker.scene.snapshot()
            self._arrays, self._rows_after = arrays_after(tracker, model)
            fields["is_edited"], fields["rows_after"] = True, self._rows_after.ctypes.data
        self._words = words_of(self._arrays)
        fields["tracker"], fields["bend_motions"] = self._words.ctypes.data, self._bends.ctypes.data
        fields["is_moved"] = True
        names, is_hidden = model.names, model.parts["is_hidden"][: len(model.names)] != 0
        self.labels = lambda: (names, is_hidden)
        self._model = model.reals, model.words, model.frames, model.parts
        if contacts.takes_changes:
            self._set_scene(contacts, model)
        self._model_words = words_of(self._model)
        fields["model"] = self._model_words.ctypes.data

    def _set_sensor(self, sensor: SensedContacts) -> None:
        """Set the sensor whose measured distances the ticks convert to contacts."""
        self._sensor = np.zeros(1, loop_records.SENSOR)
        for name in ("motions", "error_sums", "unknown"):
            self._sensor[name] = getattr(sensor, name).ctypes.data
        for name in ("latency_ns", "horizon", "max_speed", "max_acceleration"):
            self._sensor[name] = getattr(sensor, name)
        self._fields["sensor"] = self._sensor.ctypes.data

    def _set_scene(self, contacts: TrackedContacts, model: Model) -> None:
        """Copy the arrays of the scene that other threads may change, for use by the loop only."""
        self.has_scene, self._scene = True, contacts.tracker.scene
        self._is_edited_elsewhere = contacts.moves is contacts.changes is None
        self._epoch, self._snapshot = model.epoch, weakref.ref(model)
        is_deformed = self._is_edited_elsewhere or contacts.changes is not None
        reals = _copied(model.reals) if is_deformed else model.reals
        self._model = reals, _copied(model.words), model.frames.copy(), model.parts.copy()
        count, fields = len(model.names), self._fields
        self._model_words = words_of(self._model)
        _, short = libraries()
        over, close = short.proximity_loop_scene, short.proximity_close
        over.restype, over.argtypes, close.argtypes = ctypes.c_void_p, (ctypes.c_void_p,), (ctypes.c_void_p,)
        fields["scene"] = over(self._model_words.ctypes.data)
        weakref.finalize(self, close, int(fields["scene"]))
        self._tables = np.zeros((3, count), loop_records.MOTION)
        self.motions = np.zeros(count, self._tables.dtype)  # reported motions to publish
        self._moved: dict[str, np.ndarray] = {name: np.zeros(count, np.int64) for name in ("applied", "rows")}
        widths = {"matrices": 16, "velocities": 3, "turnings": 3}
        self._moved |= {name: np.zeros((count, width)) for name, width in widths.items()}
        for name, array in self._moved.items():
            fields[name] = array.ctypes.data

    @property
    def is_outdated(self) -> bool:
        """Whether the scene now has other parts than this memory."""
        model = self._scene.snapshot()
        is_moved = self._is_edited_elsewhere and model is not self._snapshot()
        return is_moved or model.epoch != self._epoch

    def publish_motions(self) -> None:
        """Pass a copy of `motions` to the loop, which uses it from its next tick on."""
        fields = self._fields
        # Read in this order: if the loop switches tables in between, the one in use is still not written to.
        following, in_use = int(fields["next_motions"]), int(fields["motions"])
        table = next(each for each in self._tables if each.ctypes.data not in (following, in_use))
        table[:] = self.motions
        fields["next_motions"] = table.ctypes.data


class LoopMemory:
    """Input and output of a loop for *count* fingers, in memory allocated in advance."""

    is_direct = False  # whether the loop itself receives poses

    def __init__(self, count: int, *, is_measured: bool = False) -> None:
        self.message = Message(FRAME, count)
        forget(self.message.records)
        self.message.records["finger"] = np.arange(count)
        self._samples = Measurements(count) if is_measured else FingerPoses(count)
        velocities, bends = np.full((count, 3), np.nan), np.full(count, np.nan)
        paths = np.full((count, PATH_CORNERS, 3), np.nan)
        self.optional = velocities, paths, np.linspace(0.0, 1.0, PATH_CORNERS), bends
        rows = max(count, MAX_RECORDS)
        self._name = np.frombuffer(MODE.encode() + b"\0", np.uint8)
        self._arrays = {
            "instructions": self._name,
            "frame": self.message.data,
            "pose_ns": self._samples.pose_ns,
            "positions": self._samples.values,
            "measured": np.zeros(count, MEASUREMENT),
            "refused_ns": np.full(count, NEVER_NS),
            "row_of": np.arange(count),
            "velocities": velocities,
            "paths": paths,
            "bends": bends,
            "given_ns": np.zeros(rows, np.int64),
            "given": np.zeros((rows, 3)),
            "fingers": np.zeros(rows, np.int64),
            "defects": np.zeros(rows, np.uint8),
            "datagram": np.zeros(MAX_DATAGRAM, np.uint8),
        }
        longest = PATH_POSES.size(MAX_RECORDS), MEASURED.size(MAX_RECORDS), given_size(count)
        self._received = np.zeros(max(longest) + 8, np.uint8)
        self.record = np.zeros(1, loop_records.LOOP)
        self.loop: Any = self.record.view(np.recarray)[0]
        self.loop.count, self.loop.ticks_wanted = count, -1
        self.loop.width = self._samples.values.shape[1]
        self.loop.lost_hand, self.loop.metres_a_bend = LOST, METRES_A_BEND
        for name, array in self._arrays.items():
            self.loop[name] = array.ctypes.data
        self.input, self.outputs = self.loop.input, self.loop.outputs
        self.input["message"], self.input["longest"] = self._received.ctypes.data, len(self._received)
        self.input["socket"], self.input["is_measured"] = -1, is_measured

    @property
    def address(self) -> int:
        """Address of the loop's structure."""
        return int(self.record.ctypes.data)
