"""Loop of ``proximity drum``, its display, and the summary of its drums.

The drums have a separate thread, because drawing a table takes longer than a drum's watchdog allows.
"""

import csv
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, TextIO

from rich.table import Table
from rich.text import Text

from proximity.cli.output import MM_PER_M, report
from proximity.cli.service.watch_view import LINE_FINGERS
from proximity.cli.tables import Screen
from proximity.decaff.controller.controller import DrumState
from proximity.decaff.simulated_drums import DrumBench, FingerBench
from proximity.errors import RecordingError
from proximity.transport import Counts, Reading, Subscriber

LOG_TITLES = (
    "now_ns", "finger", "state", "mode", "drum_rad", "force_N", "motor_torque_Nm",
    "target_rad", "target_force_N", "target_torque_Nm", "torque_cap_Nm", "motor_speed_cap_rad_s",
)  # fmt: skip
"""Titles for the state of drum and motor, and then for the targets of the controller."""
COLUMNS = {  # titles and formats
    "finger": "{finger}",
    "drum": "{state}",
    "drum mm": "{drum_mm:.1f}",
    "angle °": "{angle:.1f}",
    "finger mm": "{finger_mm:.1f}",
    "force N": "{force_n:.2f}",
    "torque mNm": "{torque_mnm:.1f}",
    "touches": "{touches}",
    "faults": "{faults}",
}
LINE = "{finger}: {state}, drum at {drum_mm:.1f} mm ({angle:.1f}°), finger at {finger_mm:.1f} mm"
LINE_OF_FORCE = LINE + ", {force_n:.2f} N by {torque_mnm:.1f} mNm"
FOR_PEOPLE = ("angle", "force_n", "torque_mnm")
"""Fields that are valid for one instant only, which are omitted from JSON."""
OTHER_LINES = 5  # lines of a terminal besides those of the fingers
STYLES = {DrumState.RETRACTED: "green", DrumState.APPROACH: "yellow", DrumState.FAULT: "black on red"}
TOUCHING_STYLE = "bold red"


class DrumThread:
    """Thread that controls drums with a separate subscriber.

    An exception in the thread turns the motors off, and is raised at the end of the ``with`` block. Missed
    samples are skipped.

    *bench*: drums of all fingers, which other threads only read. *look*: function that the thread calls with
    the reading after each step.
    """

    def __init__(
        self,
        bench: DrumBench,
        subscriber: Subscriber,
        rate: float,
        look: Callable[[Reading], None] = lambda reading: None,
    ) -> None:
        self.bench = bench
        self._subscriber, self._period, self._look = subscriber, 1.0 / rate, look
        self._failure: BaseException | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="drums", daemon=True)

    @property
    def is_running(self) -> bool:
        """Whether the thread has not failed so far."""
        return self._failure is None

    @property
    def received(self) -> int:
        """Number of received frames."""
        return self._subscriber.counts.received

    def reported(self) -> list[Text]:
        """Return the state of each drum in words."""
        return [_short_words(finger) for finger in self.bench.fingers]

    def _run(self) -> None:
        due = time.monotonic()
        try:
            while not self._is_over.is_set():
                reading = self._subscriber.read()
                self.bench.step(reading, time.monotonic_ns())
                self._look(reading)
                now = time.monotonic()
                due += self._period * max(1.0, (now - due) // self._period + 1.0)
                time.sleep(max(0.0, due - now))
        except BaseException as failure:  # raised again in __exit__
            self.bench.switch_off(f"the controllers ended: {failure}")
            self._failure = failure

    def __enter__(self) -> "DrumThread":
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *unused: object) -> None:
        self._is_over.set()
        self._thread.join()
        if self._failure is not None and kind is None:
            raise self._failure


def show_drums(screen: Screen, reading: Reading, bench: DrumBench) -> None:
    """Show the drums on the screen, and report their warnings on stderr."""
    for warning in bench.warnings():
        report(warning)
    screen.show(
        lambda: line(reading, bench), lambda size: table(reading, bench, max(1, size.height - OTHER_LINES))
    )


def line(reading: Reading, bench: DrumBench) -> str:
    """Return the state of the drums as one line of text."""
    fingers = [
        (LINE_OF_FORCE if finger.plant.force > 0.0 else LINE).format(**_fields(number, finger))
        for number, finger in enumerate(bench.fingers[:LINE_FINGERS])
    ]
    more = len(bench.fingers) - LINE_FINGERS
    shown = "; ".join([*fingers, *([f"and {more} more"] if more > 0 else [])])
    return f"{time.strftime('%H:%M:%S')} {reading.state.name}: {shown or 'no frame yet'}"


def table(reading: Reading, bench: DrumBench, row_count: int) -> Table:
    """Return the state of the drums as a table for a terminal."""
    shown = Table(title=f"{reading.state.name}, {len(bench.fingers)} fingers", title_justify="left", box=None)
    for name in COLUMNS:
        shown.add_column(name, justify="left" if name == "drum" else "right", no_wrap=True)
    for number, finger in enumerate(bench.fingers[:row_count]):
        fields, styles = _fields(number, finger), {"drum": _style_of(finger)}
        shown.add_row(*(Text(cell.format(**fields), styles.get(name, "")) for name, cell in COLUMNS.items()))
    return shown


def summary(bench: DrumBench, address: str, counts: Counts, seconds: float) -> dict[str, Any]:
    """Return the summary of the drums, for JSON."""
    fingers = [
        {name: value for name, value in _fields(number, finger).items() if name not in FOR_PEOPLE}
        | {"samples": dict(finger.samples)}  # copied, since it grows while the drums run
        for number, finger in enumerate(bench.fingers)
    ]
    return {
        "address": address,
        "seconds": round(seconds, 3),
        "frames": counts.received,
        "lost": counts.lost,
        "refused": counts.unused,
        "fingers": fingers,
    }


def _fields(number: int, finger: FingerBench) -> dict[str, Any]:
    """Return the values of a finger for the display and the summary.

    Lengths are in mm, angles in radians and, for people, also in degrees.
    """
    plant, frames = finger.plant, finger.controller.frames
    return {
        "finger": number,
        "state": _state_of(finger).value,
        "drum_mm": round(MM_PER_M * plant.position, 3),
        "drum_rad": round(plant.angle, 5),
        "angle": math.degrees(plant.angle),
        "finger_mm": round(MM_PER_M * finger.path.position(finger.bend), 3),
        "force_n": plant.force,
        "torque_mnm": MM_PER_M * plant.torque,
        "has_bend": finger.has_bend,
        "touches": finger.touches,
        "peak_force_n": round(finger.peak_force, 4),
        "peak_torque_nm": round(finger.peak_torque, 6),
        "faults": finger.faults,
        "dropped": int(frames.dropped),
        "awaited": int(frames.awaited),
    }


def _state_of(finger: FingerBench) -> DrumState:
    """Return the state of a drum. It is retracted before its first sample."""
    return DrumState.RETRACTED if finger.action is None else finger.action.state


def _style_of(finger: FingerBench) -> str:
    return STYLES.get(_state_of(finger), TOUCHING_STYLE)


def _short_words(finger: FingerBench) -> Text:
    """Return the state of a drum in at most twenty letters."""
    words, plant = [_state_of(finger).value], finger.plant
    if _state_of(finger) is DrumState.APPROACH:
        gap = max(0.0, plant.position - finger.path.position(finger.bend))
        words.append(f"{MM_PER_M * gap:.1f} mm")
    elif plant.force > 0.0:
        words.append(f"{plant.force:.2f} N")
    return Text(", ".join(words), _style_of(finger))


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as failure:
        raise RecordingError(f"{path}: cannot be written ({failure.strerror or failure})") from failure


class DrumLog:
    """CSV file with a line for each finger and sample. It replaces an existing file.

    A path of None writes no file.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path or Path()
        self._stream: TextIO | None = None
        if path is not None:
            with _written(path):
                self._stream = path.open("w", encoding="utf-8", newline="")
            self._write([LOG_TITLES])

    def append(self, reading: Reading, bench: DrumBench) -> None:
        """Write a line for each finger."""
        rows: list[Any] = []
        for number, finger in enumerate(bench.fingers):
            action, plant = finger.action, finger.plant
            if self._stream is not None and action is not None:
                numbers = (
                    plant.angle, plant.force, plant.torque, action.angle, action.force, action.torque,
                    action.torque_cap, action.motor_speed_cap,
                )  # fmt: skip
                words = reading.now_ns, number, action.state.value, action.mode.name.lower()
                rows.append([*words, *(f"{value:.9g}" for value in numbers)])
        self._write(rows)

    def _write(self, rows: list[Any]) -> None:
        if self._stream is not None:
            with _written(self._path):
                csv.writer(self._stream, lineterminator="\n").writerows(rows)

    def __enter__(self) -> "DrumLog":
        return self

    def __exit__(self, kind: type[BaseException] | None, *unused: object) -> None:
        with suppress(RecordingError) if kind else nullcontext(), _written(self._path):
            if self._stream is not None:
                self._stream.close()
