"""Show readings of a service for ``watch`` and ``demo``, as a table for a terminal or a line of text."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.cells import cell_len
from rich.console import ConsoleDimensions, Group, RenderableType
from rich.text import Text

from proximity.cli.output import counted
from proximity.cli.service.finger_view import (
    FLAG_LETTERS,
    MAX_BAR,
    MIN_BAR,
    finger_cells,
    finger_words,
    is_tracked,
    ruler,
)
from proximity.cli.tables import Column, Drawn, FittingTable, Screen
from proximity.message import Defect, Source, State
from proximity.transport import Counts, Reading, Subscriber

NS_IN_MS = 1e6
NS_IN_S = 1e9
GATHER_S = 0.005
RATE_OVER_S = 1.0
SAMPLED_EVERY_S = 0.05
OTHER_LINES = 9  # lines of a terminal besides those of the fingers
TWO_HANDS = 10  # fingers: thumb to little finger of the left hand, then of the right
LINE_FINGERS = 8  # number of fingers reported in a line of text

STATE_STYLES = {
    State.STARTING: "black on cyan",
    State.OK: "black on green",
    State.DEGRADED: "black on yellow",
    State.LATE: "black on bright_yellow",
    State.STALE: "bold white on red",
    State.STOPPING: "black on magenta",
}
MEANINGS = {
    State.STARTING: "no valid poses yet; the terminal of the service names the rejected ones",
    State.OK: "every finger is tracked, and in time",
    State.LATE: "ticks were missed or poses are old: only the bounds hold, and they widen",
    State.STOPPING: "the service is stopping",
}
HELD_MEANINGS = {
    State.STARTING: "no pose of the held part has arrived yet",
    State.OK: "the held part is tracked, and in time",
    State.DEGRADED: "in time; only bounds of a connection are known",
    State.LATE: "ticks were missed or poses are old: only the bounds hold, and they widen",
    State.STOPPING: "the service is stopping",
}
FLAGS = f"Flags: {', '.join(f'{letter} {word}' for letter, word in FLAG_LETTERS.values())}"
BARS = "Bars: █ certainly free, ▒ between the bounds, ◆ predicted, » farther"
MAX_NAME_CELLS = 16
"""Maximum width of the name of a part. Longer names are truncated."""
COLUMNS = (
    Column("finger", "finger", True, width=6),
    Column("part", "part", True, width=4),
    Column("distance mm", "distance mm", True, width=13),
    Column("bar", Drawn(ruler, MIN_BAR, MAX_BAR), False, legend=BARS),
    Column("touch in", "touch in", True, width=8),
    Column("closing", "closing", True, width=9),
    Column("mode", "mode", False, width=8),
    Column("flags", "flags", False, width=12, legend=FLAGS),
)
DRUM = Column("drum", "drum", False, width=20)
DISPENSABLE = ("flags", "mode", "closing", "part")  # omitted in this order for a longer bar


@dataclass(frozen=True, slots=True)
class Seen:
    """Values that are shown together with a reading."""

    address: str
    counts: Counts
    rate_hz: float  # rate of frames over the last second
    silent_s: float  # time since the last frame, or else since the start
    part_names: tuple[str, ...] = ()  # empty if unknown; then parts are shown by their numbers
    finger_names: tuple[str, ...] = ()  # or names of connections of a held part; empty if unknown


class Follower:
    """Reads the newest frame of a subscriber and measures the frame rate.

    *gather*: time to wait for several frames, s, since waking for each takes a third of a core at 1 kHz.
    """

    def __init__(
        self, subscriber: Subscriber, *, gather: float = GATHER_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._subscriber = subscriber
        self._gather = gather
        self._clock = clock
        self._came_at = clock()
        self._samples = deque([(self._came_at, 0)])  # instant, and number of frames received until then

    def look(self, timeout: float) -> tuple[Reading, Seen]:
        """Wait up to *timeout* for new frames. Return the newest reading and the values to show with it."""
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
            self._subscriber.finger_names,
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
    """Show a reading if the display is due for an update.

    *drums*: state of the drum of each finger; None without a controller.
    """

    def drawn(size: ConsoleDimensions) -> RenderableType:
        return picture(reading, seen, row_count=max(1, size.height - OTHER_LINES), drums=drums)

    screen.show(lambda: line(reading, seen), drawn)


def picture(
    reading: Reading, seen: Seen, *, row_count: int, drums: Sequence[Text] | None = None
) -> RenderableType:
    """Return the display of a reading for a terminal.

    *drums*: state of the drum of each finger; None without a controller.
    """
    if not len(reading.contacts):
        return headline(reading, seen)
    rows = nearest(reading.contacts, row_count)
    shown = [finger_cells(reading.contacts[row], seen.part_names) for row in rows]
    columns = [each._replace(cells=[cells[each.name] for cells in shown]) for each in COLUMNS]
    columns[0] = columns[0]._replace(title="held" if _is_held(reading) else "finger")
    longest = max(map(cell_len, seen.part_names), default=0)
    columns[1] = columns[1]._replace(width=min(max(longest, len("part")), MAX_NAME_CELLS))
    if drums is not None:
        # The controller may not have received its first frame yet.
        words = [drums[row] if row < len(drums) else Text("") for row in rows]
        columns.append(DRUM._replace(cells=words))
    hidden = len(reading.contacts) - len(rows)
    more = [Text(f"and {hidden} more, farther away", "dim")] if hidden else []
    return Group(headline(reading, seen), FittingTable(columns, DISPENSABLE, gap=1, below=more))


def headline(reading: Reading, seen: Seen) -> Group:
    """Return the two lines above the table, with the state, its meaning and the figures."""
    style = STATE_STYLES[reading.state]
    badge, meaning = f" {reading.state.name} ", _meaning(reading, seen)
    state: RenderableType = Text.assemble((badge, style), f"  {meaning}")
    if reading.state is State.STALE:  # a whole line, since the table below is outdated
        state = Drawn(lambda width: Text(f"{badge} {meaning}".ljust(width), style))
    return Group(state, Text(f"{seen.address}  {',  '.join(_figures(reading, seen))}"))


def line(reading: Reading, seen: Seen) -> str:
    """Return a reading as one line of text, for outputs that are not terminals."""
    head = f"{time.strftime('%H:%M:%S')} {reading.state.name}: {', '.join(_figures(reading, seen))}"
    if reading.state is State.STALE:
        return f"{head}; {_meaning(reading, seen)}"
    rows = nearest(reading.contacts, LINE_FINGERS)
    hidden = len(reading.contacts) - len(rows)
    fingers = [finger_words(reading.contacts[row], seen.part_names) for row in rows]
    return "; ".join([head, *fingers, *([f"and {hidden} more"] if hidden else [])])


def nearest(contacts: np.ndarray, count: int) -> list[int]:
    """Return the rows of the *count* nearest fingers in the order of the frame.

    *contacts*: (N,) CONTACT.
    """
    lower = np.where(is_tracked(contacts), contacts["lower"], np.inf)
    return sorted(np.argsort(lower, kind="stable")[:count].tolist())


def _lacking(contacts: np.ndarray) -> str:
    """Return the reason why a frame is DEGRADED, which most often is a hand out of sight."""
    tracked = is_tracked(contacts)
    lost = int((~tracked).sum())
    if not lost:
        return "in time; a finger is near with bounds only"
    if len(tracked) == TWO_HANDS and lost == TWO_HANDS // 2:
        for hand, is_seen in zip(("right", "left"), (tracked[:5], tracked[5:]), strict=True):
            if is_seen.all():
                return f"in time; the {hand} hand is not seen"
    return f"in time; {lost} of {counted(len(tracked), 'finger')} {'is' if lost == 1 else 'are'} not tracked"


def _is_held(reading: Reading) -> bool:
    """Return whether the contacts of a frame are those of a held part, not of fingers."""
    return reading.header is not None and reading.header["source"] == Source.HELD


def _meaning(reading: Reading, seen: Seen) -> str:
    if _is_held(reading) and reading.state is not State.STALE:
        return HELD_MEANINGS[reading.state]
    if reading.state is State.DEGRADED:
        return _lacking(reading.contacts)
    if reading.state is not State.STALE:
        return MEANINGS[reading.state]
    if seen.counts.unverified and seen.rate_hz == 0.0:
        return f"messages are not verified by the key of {seen.address}, expected the publisher's key"
    if reading.header is None and seen.counts.flawed[Defect.SIZE]:
        return "messages have another length than declared: if they have a key, add ?key=FILE here as well"
    if reading.header is None:
        return f"no frame from {seen.address} yet, for {seen.silent_s:.1f} s"
    if _is_held(reading) and seen.rate_hz > 0.0:
        return "no new pose of the held part: its distances are unknown"
    if reading.header["state"] == State.STALE and seen.rate_hz > 0.0:
        return "the service has no new valid poses: all distances are unknown"
    return f"no frame for {seen.silent_s:.1f} s: all distances are unknown"


def _figures(reading: Reading, seen: Seen) -> list[str]:
    counts, header = seen.counts, reading.header
    reported = [f"{seen.rate_hz:.0f} Hz"]
    if _is_held(reading) and seen.finger_names:
        reported.insert(0, f"held: {seen.finger_names[0].removesuffix(' 1')}")
    # A frame without a pose has no age: its header contains the instant of the tick.
    if header is not None and header["state"] not in (State.STARTING, State.STALE):
        reported.append(f"age {_duration(reading.age_ns)}")
    reported += [f"{counts.lost} lost", f"{counts.unused} refused"]
    if header is not None:
        since = time.strftime("%H:%M:%S", time.localtime(int(header["session"]) / NS_IN_S))
        reported += [f"{header['missed']} ticks missed", f"epoch {header['epoch']}", f"session of {since}"]
    return reported


def _duration(ns: int) -> str:
    return f"{ns / NS_IN_MS:.1f} ms" if ns < NS_IN_S else f"{ns / NS_IN_S:.1f} s"
