"""The memory that Python shares with the loop of compiled code: its structures, and the arrays they name.

``bindings/c/loop/loop.h`` is the one description of the structures; here it is read.
"""

import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from proximity.checks import as_number
from proximity.errors import ProximityError, ServiceError
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES
from proximity.message import FRAME, MAX_RECORDS, PATH_CORNERS, PATH_POSES, Message
from proximity.native.mode import IS_AHEAD, MODE
from proximity.scene.model.assembly import Model
from proximity.service.contact_source import METRES_A_BEND, ContactSource, TrackedContacts
from proximity.service.finger_kernels import LOST
from proximity.service.samples import NEVER_NS, FingerPoses
from proximity.system.library_in_c import libraries
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import Tracker, arrays_of, note_answers
from proximity.transport import forget
from proximity.transport.udp import LARGEST_DATAGRAM

HEADER = Path(__file__).parent.parent / "bindings" / "c" / "loop" / "loop.h"
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-5, 10.0
"""s, of periods."""
_STRUCTURE = re.compile(r"typedef struct (\w+) \{\n(.*?)\n\} \1;", re.DOTALL)
_DECLARATION = re.compile(r"(?m)^    (\w+) ([\w\[\], ]+);")
_DEFINED = re.compile(r"#define (\w+) (\d+)")


@cache
def structures() -> dict[str, np.dtype]:
    """Structures of the header by their names."""
    text = HEADER.read_text(encoding="ascii")
    lengths = dict(_DEFINED.findall(text))
    kinds: dict[str, Any] = {"int64_t": "<i8", "uint64_t": "<u8", "double": "<f8"}
    for name, body in _STRUCTURE.findall(text):
        fields: list[Any] = []
        for kind, declared in _DECLARATION.findall(body):
            for each in declared.split(", "):
                field, _, length = each.removesuffix("]").partition("[")
                shape = (int(lengths.get(length, length)),) if length else ()
                fields.append((field, kinds[kind], shape))
        kinds[name] = np.dtype(fields)
    return kinds


def defined(name: str) -> int:
    """A number that the header defines."""
    return int(dict(_DEFINED.findall(HEADER.read_text(encoding="ascii")))[name])


def run_function() -> Any:
    """The function that runs the loop; other threads of Python run meanwhile."""
    try:
        lets_run, _ = libraries()
        is_same = lets_run.proximity_loop_size() == structures()["Loop"].itemsize
    except (ProximityError, OSError, AttributeError):
        is_same = False
    if not is_same:
        raise ServiceError(
            "a service needs the library in C that was compiled with this version: wheels have it, and so "
            "has a checkout after `python -m pip install -e .`, which fetches the compiler (ziglang)"
        )
    return lets_run.proximity_loop_run


def answers_in_c(contacts: ContactSource) -> bool:
    """Whether the loop ticks a source by itself: it has a tracker, and the kernels are compiled."""
    return IS_AHEAD and contacts.is_ticked_by_loop


def words_of(arrays: Any) -> np.ndarray:
    """Address and lengths of each array, as kernels take them."""
    return np.array([word for each in arrays for word in (each.ctypes.data, *each.shape)], np.int64)


def nanoseconds(name: str, seconds: Any) -> int:
    """Return a span of a service in nanoseconds; a `ServiceError` where it cannot be one."""
    if not SHORTEST_PERIOD <= as_number(seconds) <= LONGEST_PERIOD:
        raise ServiceError(f"{name} is {seconds!r}, expected {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g} s")
    return round(NS_PER_S * seconds)


def fill(record: Any, values: dict[str, Any]) -> None:
    """Write fields of a structure."""
    for name, value in values.items():
        record[name] = value


class SourceMemory:
    """A source of contacts as the loop takes it; kept as long as that may use it."""

    def __init__(self, contacts: ContactSource, memory: "LoopMemory") -> None:
        self.contacts, self._memory = contacts, memory
        self.record = np.zeros(1, structures()["LoopSource"])
        self._fields: Any = self.record[0]
        self._model: Model | None = None
        self._epoch = -1  # of the scene when the tracker's arrays were looked at
        if isinstance(contacts, TrackedContacts) and answers_in_c(contacts):
            contacts.tracker.write_to(memory.message.records)
            self._bends = np.zeros((contacts.count, ESTIMATES), ESTIMATE)
            self._fields["bend_motions"] = self._bends.ctypes.data
            self.look(contacts.tracker)
        self.say_epoch()

    @property
    def address(self) -> int:
        """Where its record is."""
        return int(self.record.ctypes.data)

    def note_answers(self) -> None:
        """Have the tracker note what ticks have answered about poses."""
        if self._fields["answers"] and isinstance(self.contacts, TrackedContacts):
            with suppress(ValueError, IndexError):  # the loop writes contacts meanwhile: the next time
                note_answers(self.contacts.tracker, int(self._fields["answers"]))

    def look(self, tracker: Tracker) -> None:
        """Have the next tick see parts where they are now."""
        model = tracker.scene.snapshot()
        if model is self._model:
            return
        if model.epoch != self._epoch:  # with other parts the tracker has other arrays
            model, self._arrays = arrays_of(tracker, *self._memory.optional)
            self._words, self._epoch = words_of(self._arrays), model.epoch
            self._fields["tracker"] = self._words.ctypes.data
        self._model = model
        self._model_words = words_of((model.reals, model.words, model.frames, model.parts))
        self._fields["model"], self._fields["is_moved"] = self._model_words.ctypes.data, True

    def say_epoch(self) -> int:
        """Have the next frame say of which epoch the source's answers are; that epoch."""
        self._fields["epoch"] = epoch = self.contacts.epoch
        return epoch


class LoopMemory:
    """All that a loop of so many fingers reads and writes, allocated beforehand."""

    is_direct = False  # whether the loop receives poses by itself

    def __init__(self, count: int) -> None:
        self.message = Message(FRAME, count)
        forget(self.message.records)
        self.message.records["finger"] = np.arange(count)
        self.poses = FingerPoses(count)
        velocities, bends = np.full((count, 3), np.nan), np.full(count, np.nan)
        paths = np.full((count, PATH_CORNERS, 3), np.nan)
        self.optional = velocities, paths, np.linspace(0.0, 1.0, PATH_CORNERS), bends
        rows = max(count, MAX_RECORDS)
        self._name = np.frombuffer(MODE.encode() + b"\0", np.uint8)
        self._arrays = {
            "instructions": self._name,
            "frame": self.message.data,
            "pose_ns": self.poses.pose_ns,
            "positions": self.poses.positions,
            "refused_ns": np.full(count, NEVER_NS),
            "row_of": np.arange(count),
            "velocities": velocities,
            "paths": paths,
            "bends": bends,
            "given_ns": np.zeros(rows, np.int64),
            "given": np.zeros((rows, 3)),
            "fingers": np.zeros(rows, np.int64),
            "defects": np.zeros(rows, np.uint8),
            "datagram": np.zeros(LARGEST_DATAGRAM, np.uint8),
        }
        self._received = np.zeros(PATH_POSES.size(MAX_RECORDS) + 8, np.uint8)
        self.record = np.zeros(1, structures()["Loop"])
        self.loop: Any = self.record.view(np.recarray)[0]
        self.loop.count, self.loop.ticks_wanted = count, -1
        self.loop.lost_hand, self.loop.metres_a_bend = LOST, METRES_A_BEND
        for name, array in self._arrays.items():
            self.loop[name] = array.ctypes.data
        self.input, self.outputs = self.loop.input, self.loop.outputs
        self.input["message"], self.input["longest"] = self._received.ctypes.data, len(self._received)
        self.input["socket"] = -1

    @property
    def address(self) -> int:
        """Where the structure is."""
        return int(self.record.ctypes.data)
