"""Display of ``proximity demo``, which shows the hand and its drums, and at the end a summary.

The headline rates all frames of the last second. An untracked finger is one that is lost in the recording,
since the demo has no other input.
"""

import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from proximity.cli.output import MM_PER_M, counted
from proximity.cli.service.finger_view import TOUCH_STYLE, filled, is_tracked
from proximity.cli.tables import Column, Drawn, FittingTable
from proximity.decaff.controller.settings import Limits
from proximity.message import State
from proximity.system.time_units import MS_PER_S, S_PER_NS
from proximity.transport import Reading

if TYPE_CHECKING:
    from proximity.cli.device.drum_loop import DrumThread
    from proximity.cli.service.watch_view import Seen

MIN_IN_TIME, FAIR_IN_TIME = 0.99, 0.9
"""Minimum shares of frames that are rated as in time and as mostly in time."""
FARTHEST_TOUCH = 1e-3
"""Maximum distance between the predicted and the actual touch, m. It is the threshold of a fingertip,
assumed."""
FORESEEN_S = 0.010
"""Time before a touch at which its prediction is judged, s. A drum needs it for the last millimetres,
assumed."""
WINDOW_S, SILENT_S = 1.0, 0.3
SCALE_MM, MIN_BAR = 60.0, 8  # length of a bar in mm, and its minimum number of cells
COLUMNS = (
    Column("finger", "finger", False, width=7),
    Column("bar", f"0 to {SCALE_MM:.0f} mm", False),
    Column("mm", "mm", True, width=6),
    Column("touch in", "touch in", True, width=8),
    Column("finger mm", "finger mm", True, width=9),
    Column("drum mm", "drum mm", True, width=7),
    Column("drum", "drum", False, width=18),
)
NEXT = (
    ("proximity query part.stl 30 10 5", "distance of a point from your part"),
    ("proximity view part.stl", "your part and a hand in the browser"),
    ("proximity serve --help", "this service, for your own controller"),
)


class LastSecond:
    """Numbers of received and due frames of the last second."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, int, int]] = deque()

    def add(self, now: float, reading: Reading, seen: "Seen") -> None:
        """Count the received and due frames until *now*, s."""
        came = seen.counts.received
        missed = 0 if reading.header is None else int(reading.header["missed"])
        self._samples.append((now, came, came + seen.counts.lost + missed))
        while now - self._samples[0][0] > WINDOW_S and len(self._samples) > 2:
            self._samples.popleft()

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of received and due frames of the last second."""
        (_, came, due), (_, came_now, due_now) = self._samples[0], self._samples[-1]
        return came_now - came, due_now - due


class TouchWatch:
    """Measures distances between predicted and actual touches.

    The thread of the controllers adds each reading.
    """

    def __init__(self) -> None:
        self.touches, self.farthest = 0, 0.0  # number of touches, and the largest distance, m
        self._predicted: dict[int, deque[tuple[int, int, float]]] = {}
        self._was_free: set[int] = set()

    def add(self, reading: Reading) -> None:
        """Store the predictions of a reading, and compare its touches with earlier ones."""
        if not reading.is_new or not reading.is_valid:
            return
        for contact in reading.contacts[is_tracked(reading.contacts)]:
            finger, pose_ns, left_s = (
                contact[name].item() for name in ("finger", "pose_ns", "time_to_contact")
            )
            if contact["signed_distance"] > 0.0:
                self._was_free.add(finger)
                if math.isfinite(left_s):
                    kept = self._predicted.setdefault(finger, deque(maxlen=64))
                    kept.append(
                        (pose_ns, pose_ns + round(left_s / S_PER_NS), float(contact["approach_speed"]))
                    )
            elif finger in self._was_free:
                self._was_free.discard(finger)
                self._compare(self._predicted.pop(finger, deque()), contact)

    def _compare(self, predicted: "deque[tuple[int, int, float]]", contact: Any) -> None:
        """Compare a touch with the prediction that was made `FORESEEN_S` before it."""
        touched_ns = int(contact["pose_ns"])
        before = [each for each in predicted if S_PER_NS * (touched_ns - each[0]) >= FORESEEN_S]
        if not before:
            return
        _, foreseen_ns, speed = before[-1]
        self.touches += 1
        gap = speed * S_PER_NS * (touched_ns - foreseen_ns) + float(contact["signed_distance"])
        self.farthest = max(self.farthest, abs(gap))


def picture(reading: Reading, seen: "Seen", last: LastSecond, drums: "DrumThread") -> RenderableType:
    """Return the display of a reading for a terminal."""
    if not len(reading.contacts) or _is_outdated(reading, seen):
        return headline(seen, last)
    words, rows = drums.reported(), []
    for row, contact in enumerate(reading.contacts):
        cells = {"finger": _name(row, seen.finger_names), **_cells(contact)}
        if row < len(words):
            finger = drums.bench.fingers[row]
            cells["finger mm"] = f"{MM_PER_M * finger.path.position(finger.bend):.1f}"
            cells["drum mm"], cells["drum"] = f"{MM_PER_M * finger.plant.position:.1f}", words[row]
        rows.append(cells)
    columns = [each._replace(cells=[cells.get(each.name, "") for cells in rows]) for each in COLUMNS]
    return Group(
        headline(seen, last), _what_comes(reading, seen.finger_names), FittingTable(columns, (), gap=1)
    )


def _is_outdated(reading: Reading, seen: "Seen") -> bool:
    """Return whether frames are missing or late, so that the hand is unknown."""
    is_forgotten = reading.state is State.STALE and reading.header["state"] != State.STALE
    return bool(seen.silent_s > SILENT_S or is_forgotten)


def headline(seen: "Seen", last: LastSecond) -> Text:
    """Return a line that rates the last second."""
    came, due = last.counts
    if seen.silent_s > SILENT_S or due <= 0:
        return Text(f" no frame for {seen.silent_s:.1f} s ", "bold white on red")
    share = came / due
    word = "IN TIME" if share >= MIN_IN_TIME else "MOSTLY IN TIME" if share >= FAIR_IN_TIME else "LATE"
    style = {"IN TIME": "black on green", "LATE": "bold white on red"}.get(word, "black on yellow")
    return Text.assemble((f" {word} ", style), f"  {came} of {due} frames of the last second were in time")


def _what_comes(reading: Reading, names: Sequence[str]) -> Text:
    """Return a line with the touching fingers, the next finger to touch, and the lost fingers."""
    contacts, tracked = reading.contacts, is_tracked(reading.contacts)
    if not tracked.any():
        return Text("the hand is away: the recording restarts", "dim")
    touches = tracked & (contacts["signed_distance"] <= 0.0)
    touching, lost = (
        [_name(row, names) for row in np.flatnonzero(rows).tolist()] for rows in (touches, ~tracked)
    )
    left_s = np.where(tracked & ~touches, contacts["time_to_contact"], np.inf)
    row = int(np.argmin(left_s))
    parts = [f"touching: {', '.join(touching)}"] if touching else []
    if math.isfinite(left_s[row]):
        parts.append(f"next: {_name(row, names)} in {MS_PER_S * left_s[row]:.0f} ms")
    if lost:
        parts.append(f"{', '.join(lost)} lost in the recording")
    return Text("; ".join(parts) or "no finger is about to touch the part")


def _name(row: int, names: Sequence[str]) -> str:
    return names[row] if row < len(names) else f"{row}"


def _cells(contact: Any) -> dict[str, Any]:
    """Return the cells with the bar, the distance and the time to contact of a finger."""
    if not is_tracked(contact):
        return {"bar": Drawn(lambda width: Text("lost in the recording"[:width], "dim"), MIN_BAR)}
    distance, left_s = MM_PER_M * float(contact["signed_distance"]), float(contact["time_to_contact"])
    cells: dict[str, Any] = {"mm": f"{distance:.1f}"}
    if distance <= 0.0:
        bar = Drawn(lambda width: Text(" touches".ljust(width), TOUCH_STYLE), MIN_BAR)
        return {**cells, "bar": bar, "touch in": "now"}
    style = "yellow" if math.isfinite(left_s) else "green"
    return {
        **cells,
        "bar": Drawn(lambda width: Text(filled(min(distance / SCALE_MM, 1.0) * width), style), MIN_BAR),
        "touch in": f"{MS_PER_S * left_s:.0f} ms" if math.isfinite(left_s) else "-",
    }


def closing_lines(report: dict[str, Any], touches: TouchWatch, drums: "DrumThread") -> list[Text]:
    """Return three results of the demo with their limits, and commands to try next."""
    due, fingers, limit = report["ticks"] + report["missed"], drums.bench.fingers, Limits().peak_force
    share, held = report["ticks"] / max(due, 1), sum(each.touches for each in fingers)
    peak = max((each.peak_force for each in fingers), default=0.0)
    faults: Counter[str] = sum((each.reasons for each in fingers), Counter())
    reasons = [f"{count} x {reason}" for reason, count in faults.items()]
    lines = [
        _judged(
            share >= MIN_IN_TIME,
            f"{math.floor(1e3 * share) / 10:.1f} % of {due} frames in time (limit {MIN_IN_TIME:.0%})",
            "another program uses the processor",
        ),
        _judged(
            touches.farthest <= FARTHEST_TOUCH,
            f"{counted(touches.touches, 'touch', 'touches')} as predicted {MS_PER_S * FORESEEN_S:.0f} ms "
            f"before, within {MM_PER_M * touches.farthest:.2f} mm (limit {MM_PER_M * FARTHEST_TOUCH:.0f} mm)",
            "frames were late" if share < MIN_IN_TIME else "the hand changed its motion",
        ),
        _judged(
            peak <= limit and not reasons,
            f"{counted(held, 'touch', 'touches')} held with {peak:.1f} N at most (limit {limit:.0f} N)",
            "; ".join(reasons) or "a drum pressed too hard",
        ),
    ]
    return [
        *lines,
        Text("Next:"),
        *(Text.assemble(f"  {command:34}", (what, "dim")) for command, what in NEXT),
    ]


def _judged(is_well: bool, sentence: str, reason: str) -> Text:
    mark, style = ("✓", "green") if is_well else ("✗", "red")
    return Text.assemble((mark, style), f" {sentence}", "" if is_well else f": {reason}")
