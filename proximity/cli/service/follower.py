"""Follow a service and show its frames: on a screen, as ``watch`` and ``demo`` do, or as values for JSON."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum, IntFlag
from typing import Any

from rich.console import ConsoleDimensions, RenderableType
from rich.text import Text

from proximity.cli.service.watch_view import Seen, line, picture
from proximity.cli.tables import Screen
from proximity.message import ContactFlag, Mode, Source, State, Surface
from proximity.transport import Reading, Subscriber

HEADER_FIELDS = (
    "session", "sequence", "pose_ns", "start_ns", "publish_ns", "valid_until_ns", "period_ns", "epoch",
    "missed",
)  # fmt: skip
NAMED: dict[str, type[IntEnum]] = {"mode": Mode, "surface": Surface, "source": Source}
GATHER_S = 0.005
RATE_OVER_S = 1.0
SAMPLED_EVERY_S = 0.05
OTHER_LINES = 9  # of a terminal, beside the fingers


class Follower:
    """The newest reading of a subscriber, and how fast frames come.

    *gather*: that frames are let come before they are looked at: to wake for each takes a third of a core at
    1 kHz.
    """

    def __init__(
        self, subscriber: Subscriber, *, gather: float = GATHER_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._subscriber = subscriber
        self._gather = gather
        self._clock = clock
        self._came_at = clock()
        self._samples = deque([(self._came_at, 0)])  # instant, frames received until then

    def look(self, timeout: float) -> tuple[Reading, Seen]:
        """Wait for new frames and return what is known.

        *timeout*: how long to wait at most, where none comes.
        """
        time.sleep(self._gather)
        reading = self._subscriber.wait(timeout)
        now, counts = self._clock(), self._subscriber.counts
        if reading.is_new:
            self._came_at = now
        return reading, Seen(
            self._subscriber.address,
            counts,
            self._rate(now, counts.received),
            now - self._came_at,
            self._subscriber.part_names,
        )

    def _rate(self, now: float, received: int) -> float:
        samples = self._samples
        if now - samples[-1][0] >= SAMPLED_EVERY_S:
            samples.append((now, received))
        while len(samples) > 1 and now - samples[1][0] >= RATE_OVER_S:
            samples.popleft()
        then, before = samples[0]
        return (received - before) / (now - then) if now - then >= SAMPLED_EVERY_S else 0.0


def show(screen: Screen, reading: Reading, seen: Seen, drums: Sequence[Text] | None = None) -> None:
    """Show a reading if it is time for it.

    *drums*: what a controller does with each finger, where one runs beside.
    """

    def drawn(size: ConsoleDimensions) -> RenderableType:
        rows = max(1, size.height - OTHER_LINES)
        return picture(reading, seen, width=size.width, row_count=rows, drums=drums)

    screen.show(lambda: line(reading, seen), drawn)


def frame_document(frame: Any, part_names: Sequence[str]) -> dict[str, Any]:
    """Return a frame as plain values: fields of its header, and of the contact of each finger.

    *part_names*: of the parts that ``part`` counts; empty where they are not known, then ``part_name`` is
    null.
    """
    header = frame["header"]
    return {
        "state": _name(State, header["state"]),
        **{field: header[field].item() for field in HEADER_FIELDS},
        "fingers": [_finger(contact, part_names) for contact in frame["contacts"]],
    }


def _finger(contact: Any, part_names: Sequence[str]) -> dict[str, Any]:
    assert contact.dtype.names is not None
    fields = {field: contact[field].tolist() for field in contact.dtype.names}
    fields |= {field: _name(kind, fields[field]) for field, kind in NAMED.items()}
    part = fields["part"]
    return fields | {
        "flags": list(_names(ContactFlag, fields["flags"])),
        "force_is_valid": bool(fields["force_is_valid"]),
        "part_name": part_names[part] if 0 <= part < len(part_names) else None,
    }


def _name(kind: type[IntEnum], number: Any) -> str:
    """The name of a member; the number where a newer publisher has one that is not known here."""
    return kind(number).name.lower() if number in set(kind) else str(number)


def _names(kind: type[IntFlag], bits: int) -> Iterable[str]:
    return (str(flag.name).lower() for flag in kind if bits & flag)
