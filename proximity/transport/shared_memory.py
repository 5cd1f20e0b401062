"""``shm://NAME``: a mailbox in shared memory between processes of one machine, without a server.

One writer and any readers share a name. A message is copied into a ring once, and each reader copies it out
at its own pace, without waiting for others. A slow reader loses the oldest messages; a late one starts with
the newest. The message itself wakes a waiting reader. When a writer is killed, its readers continue with the
next one, which takes over the name.

The mailbox is a file in ``/dev/shm`` that only its owner may open, so all ends run as one user.
``proximity_mailbox.h`` defines its layout, and the code with which C and C++ read and write it; Python calls
the same code.
"""

import ctypes
import os
import sys
import threading
import time
from typing import Any
from urllib.parse import quote
from weakref import WeakSet

import numpy as np

from proximity.core.library_in_c import libraries
from proximity.errors import ProximityError, PublishError
from proximity.system.time_units import NS_PER_S
from proximity.transport.address import Address
from proximity.transport.link import NOTHING, wait_until

OK, NOBODY = 0, 1
"""Results of opening a mailbox, numbered as in ``proximity_mailbox.h``; the others are refusals."""
SYSTEM = 7
FIRST_BYTES = 8192
"""Initial message size: the ring holds 15, or 74 frames of five fingers. A longer one enlarges it."""
HEADER_BYTES = 128
MIN_PRIVATE, MIN_SLOT_COUNT, MAX_RING_BYTES = 64, 8, 1 << 26
"""Capacity of a private mailbox in messages, also of thousands of fingers, and in bytes."""
SLICE = 0.1
"""s: period at which a waiting thread wakes, for signals and for a manually removed file."""
_BOX, _TEXT, _WORD, _LONG = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_uint64
_TYPES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "size": (ctypes.c_int64, ()),
    "create": (_WORD, (_BOX, _TEXT, _LONG)),
    "enlarge": (_WORD, (_BOX, _LONG)),
    "write": (_WORD, (_BOX, _BOX, ctypes.c_uint32)),
    "open": (_WORD, (_BOX, _TEXT, _WORD)),
    "read": (ctypes.c_int64, (_BOX, _BOX, _LONG)),
    "has": (_WORD, (_BOX,)),
    "wait": (_WORD, (_BOX, ctypes.c_int64)),
    "is_over": (_WORD, (_BOX, _WORD)),
    "is_written": (_WORD, (_BOX,)),
    "close": (None, (_BOX,)),
    "within": (None, (_BOX, _BOX, _LONG)),
    "reason": (_TEXT, (_WORD,)),
}
_LONG_CALLS = ("create", "enlarge", "wait")


class _Functions:
    """Functions of the library available on this system, by the names in `_TYPES`."""

    def __init__(self) -> None:
        self._lets_run, self._short = libraries()

    def __getattr__(self, name: str) -> Any:
        library = self._lets_run if name in _LONG_CALLS else self._short
        function = getattr(library, f"proximity_box_{name}")
        function.restype, function.argtypes = _TYPES[name]
        setattr(self, name, function)
        return function


class _Mailbox:
    """A mailbox with the name of an address, open or not."""

    def __init__(self, address: Address) -> None:
        address.check_options()
        try:
            self._call: Any = _Functions()
            self._call.open  # noqa: B018 — not every system has it
        except (ProximityError, AttributeError) as missing:
            raise address.refuse(
                "shared memory needs Linux and the library in C that was compiled with this version "
                f"({missing}; udp:// needs neither)"
            ) from missing
        self._address = address
        self._name = quote(address.location, safe="").encode("ascii")
        self._memory = np.zeros(self._call.size(), np.uint8)
        self._box = self._memory.ctypes.data
        self._is_open = False

    def _refusal(self, outcome: int) -> PublishError:
        reason = self._call.reason(outcome).decode()
        if outcome == SYSTEM:
            reason += f" ({os.strerror(ctypes.get_errno())})"
        return self._address.refuse(reason)

    def close(self) -> None:
        """Release the memory, and a writer's name."""
        if self._is_open:
            self._is_open = False
            self._call.close(self._box)

    def __del__(self) -> None:
        if getattr(self, "_is_open", False):
            self.close()


def _address_of(array: np.ndarray) -> int:
    at: int = array.__array_interface__["data"][0]  # three times as fast as `array.ctypes.data`
    return at


class SharedMemoryOutlet(_Mailbox):
    """Writes to a mailbox, which it creates."""

    def __init__(self, address: Address) -> None:
        super().__init__(address)
        outcome = self._call.create(self._box, self._name, FIRST_BYTES)
        if outcome != OK:
            raise self._refusal(outcome)
        self._is_open = True
        _OUTLETS.add(self)

    def loop_end(self, largest: int) -> dict[str, Any]:
        """Return the data with which a service's loop sends messages of up to *largest* bytes from here."""
        if largest > FIRST_BYTES:
            self._enlarge(largest)
        return {"socket": -1, "box": self._box}

    def send(self, data: np.ndarray) -> None:
        """Copy the message into the ring; one that is longer than all before allocates another ring."""
        if not self._is_open:
            raise PublishError(f"{self._address.text}: is closed, it cannot send")
        if self._call.write(self._box, _address_of(data), len(data)):
            return
        self._enlarge(len(data))
        self._call.write(self._box, _address_of(data), len(data))

    def _enlarge(self, size: int) -> None:
        outcome = self._call.enlarge(self._box, size)
        if outcome != OK:
            raise self._refusal(outcome)


_OUTLETS: WeakSet[SharedMemoryOutlet] = WeakSet()


def _close_inherited() -> None:
    """Release mailboxes, and their names, to the parent process after a fork."""
    for outlet in list(_OUTLETS):
        outlet.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_inherited)


class SharedMemoryInlet(_Mailbox):
    """Reads a mailbox once it exists, and the next one after it was closed.

    One thread may wait while another receives.
    """

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address: Address) -> None:
        super().__init__(address)
        self._lock = threading.Lock()  # the memory is not released while a thread waits in it
        self._is_closed = False
        self._is_next = 0  # whether all messages of the next mailbox are new: this reader was here first
        self._looked = 0.0  # time of the last check of the name
        self._follow()
        self._is_next = 1

    @property
    def is_written(self) -> bool:
        """True if a live process has the mailbox open for writing."""
        return self._is_open and bool(self._call.is_written(self._box))

    def loop_end(self) -> dict[str, Any]:
        """Return the data with which a service's loop receives here."""
        self._text = ctypes.create_string_buffer(self._name)
        return {"socket": -1, "box": self._box, "name": ctypes.addressof(self._text), "looked_ns": 1}

    def receive(self, buffer: np.ndarray) -> int:
        """Copy the next message of the ring."""
        if self._is_closed or (not self._is_open and not self._follow()):
            return NOTHING
        size: int = self._call.read(self._box, _address_of(buffer), len(buffer))
        if size == NOTHING and self._is_over() and self._follow():
            size = self._call.read(self._box, _address_of(buffer), len(buffer))
        return size

    def wait(self, timeout: float) -> bool:
        """Wait for a wake-up by the mailbox; without one, poll."""
        ends = time.monotonic() + timeout
        while True:
            left = min(ends - time.monotonic(), SLICE)
            if self._is_closed or self._has_messages() or left <= 0.0:
                return not self._is_closed and self._has_messages()
            with self._lock:
                was_open = self._is_open
                if was_open:
                    self._call.wait(self._box, time.monotonic_ns() + round(NS_PER_S * left))
            if not was_open:
                wait_until(self._has_messages, left)

    def close(self) -> None:
        """Close the mailbox."""
        self._is_closed = True
        with self._lock:
            super().close()

    def _has_messages(self) -> bool:
        if not self._is_open and not self._follow():
            return False
        return bool(self._call.has(self._box)) or (
            self._is_over() and self._follow() and bool(self._call.has(self._box))
        )

    def _is_over(self) -> bool:
        """Return whether no more messages will come; checks the file's name at intervals."""
        now = time.monotonic()
        looks = now - self._looked > SLICE
        if looks:
            self._looked = now
        return bool(self._call.is_over(self._box, looks))

    def _follow(self) -> bool:
        """Open the present mailbox of that name; return whether there is one."""
        with self._lock:
            if self._is_open:
                super().close()
            outcome = self._call.open(self._box, self._name, self._is_next)
            if outcome not in (OK, NOBODY):
                raise self._refusal(outcome)
            self._is_open = outcome == OK
            return self._is_open


class PrivateMailbox:
    """A mailbox without a file or a name, between the loop of a service and a thread; on any system.

    *size*: of the messages, for a capacity of at least some dozens. *most*: maximum bytes of all of them.
    """

    def __init__(self, size: int, count: int = MIN_PRIVATE, most: int = MAX_RING_BYTES) -> None:
        self._call: Any = _Functions()
        needed = max(min(count * (size + 32), most), MIN_SLOT_COUNT * (size + 32))
        ring = 1 << (needed - 1).bit_length()
        self._memory = np.zeros(HEADER_BYTES + ring, np.uint8)
        self._memory.fill(0)  # here, and not page by page in the loop
        self._writer, self._reader = np.zeros((2, self._call.size()), np.uint8)
        for box in (self._writer, self._reader):
            self._call.within(box.ctypes.data, self._memory.ctypes.data, ring)

    @property
    def writer(self) -> int:
        """Address of the writer's end."""
        return int(self._writer.ctypes.data)

    @property
    def reader(self) -> int:
        """Address of the reader's end."""
        return int(self._reader.ctypes.data)

    def send(self, data: np.ndarray) -> None:
        """Write a message, and wake its reader."""
        self._call.write(self.writer, _address_of(data), len(data))

    def receive(self, buffer: np.ndarray) -> int:
        """Copy the next message."""
        size: int = self._call.read(self.reader, _address_of(buffer), len(buffer))
        return size

    def wait(self, timeout: float) -> bool:
        """Wait until a message is present, or for *timeout* seconds; return whether one is."""
        if not sys.platform.startswith("linux"):
            return wait_until(lambda: bool(self._call.has(self.reader)), timeout)
        return bool(self._call.wait(self.reader, time.monotonic_ns() + round(NS_PER_S * timeout)))

    def close(self) -> None:
        """No-op: its memory is released with the object."""


open_outlet = SharedMemoryOutlet
open_inlet = SharedMemoryInlet
