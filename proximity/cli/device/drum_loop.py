"""The loop of ``proximity drum``, the rows that it shows, and the summary of its drums.

To draw a table takes longer than a drum's watchdog waits: so the drums have a thread of their own.
"""

import csv
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from rich.table import Table
from rich.text import Text

from proximity.cli.lengths import MM_PER_M
from proximity.cli.output import report
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
"""Where a drum is and what its motor does; then what its controller wants."""
COLUMNS = {  # titles, and what stands below them
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
"""Fields that JSON lacks: they are those of an instant."""
OTHER_LINES = 5  # of a terminal, beside the fingers
STYLES = {DrumState.RETRACTED: "green", DrumState.APPROACH: "yellow", DrumState.FAULT: "black on red"}
TOUCHING_STYLE = "bold red"


def run(
    bench: DrumBench,
    subscriber: Subscriber,
    rate: float,
    look: Callable[[Reading], None],
    is_over: Callable[[], bool],
) -> None:
    """Step the controllers at a rate; samples that are missed are left out, not made up for."""
    period, due = 1.0 / rate, time.monotonic()
    while not is_over():
        reading = subscriber.read()
        bench.step(reading, time.monotonic_ns())
        look(reading)
        now = time.monotonic()
        due += period * max(1.0, (now - due) // period + 1.0)
        time.sleep(max(0.0, due - now))


class DrumsBeside:
    """Runs drums in a thread, with a subscriber of their own, while something else is shown.

    Whatever ends the thread before its time turns the motors off, and is raised as the ``with`` block ends.

    *bench*: of all fingers; used by the thread only, but for being looked at. *look*: is given the reading
    after each step, by the thread.
    """

    def __init__(
        self,
        bench: DrumBench,
        subscriber: Subscriber,
        rate: float,
        look: Callable[[Reading], None] = lambda reading: None,
    ) -> None:
        self.bench = bench
        self._subscriber, self._rate, self._look = subscriber, rate, look
        self._failure: BaseException | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="drums", daemon=True)

    @property
    def is_running(self) -> bool:
        """Whether nothing has failed."""
        return self._failure is None

    @property
    def received(self) -> int:
        """Frames that came."""
        return self._subscriber.counts.received

    def reported(self) -> list[Text]:
        """Return what each drum does, in words."""
        return [short_words(finger) for finger in self.bench.fingers]

    def _run(self) -> None:
        try:
            run(self.bench, self._subscriber, self._rate, self._look, self._is_over.is_set)
        except BaseException as failure:  # a thread that ends tells nobody else
            self.bench.switch_off(f"the controllers ended: {failure}")
            self._failure = failure

    def __enter__(self) -> "DrumsBeside":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_over.set()
        self._thread.join()
        if self._failure is not None and kind is None:
            raise self._failure


def show_drums(screen: Screen, reading: Reading, bench: DrumBench) -> None:
    """Show the drums, and say on stderr what they cannot do."""
    for warning in bench.warnings():
        report(warning)
    screen.show(
        lambda: line(reading, bench), lambda size: table(reading, bench, max(1, size.height - OTHER_LINES))
    )


def line(reading: Reading, bench: DrumBench) -> str:
    """Return one line of text."""
    fingers = [
        (LINE_OF_FORCE if finger.plant.force > 0.0 else LINE).format(**_fields(number, finger))
        for number, finger in enumerate(bench.fingers[:LINE_FINGERS])
    ]
    more = len(bench.fingers) - LINE_FINGERS
    shown = "; ".join([*fingers, *([f"and {more} more"] if more > 0 else [])])
    return f"{time.strftime('%H:%M:%S')} {reading.state.name}: {shown or 'no frame yet'}"


def table(reading: Reading, bench: DrumBench, row_count: int) -> Table:
    """Return what a terminal shows."""
    shown = Table(title=f"{reading.state.name}, {len(bench.fingers)} fingers", title_justify="left", box=None)
    for name in COLUMNS:
        shown.add_column(name, justify="left" if name == "drum" else "right", no_wrap=True)
    for number, finger in enumerate(bench.fingers[:row_count]):
        fields, styles = _fields(number, finger), {"drum": style_of(finger)}
        shown.add_row(*(Text(cell.format(**fields), styles.get(name, "")) for name, cell in COLUMNS.items()))
    return shown


def short_words(finger: FingerBench) -> Text:
    """Return what a drum does, in twenty letters."""
    state, words = state_of(finger), [state_of(finger).value]
    if state is DrumState.APPROACH:
        words.append(
            f"{MM_PER_M * max(0.0, finger.plant.position - finger.path.position(finger.bend)):.1f} mm"
        )
    elif finger.plant.force > 0.0:
        words.append(f"{finger.plant.force:.2f} N")
    return Text(", ".join(words), style_of(finger))


def summary(bench: DrumBench, address: str, counts: Counts, seconds: float) -> dict[str, Any]:
    """Return what became of the drums, for JSON."""
    fingers = [
        {name: value for name, value in _fields(number, finger).items() if name not in FOR_PEOPLE}
        | {"samples": dict(finger.samples)}  # grows while the drums run, so only here
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
    """What is reported of a finger: lengths in mm, angles in radians and, for people, in degrees."""
    plant, frames = finger.plant, finger.controller.frames
    return {
        "finger": number,
        "state": state_of(finger).value,
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


def state_of(finger: FingerBench) -> DrumState:
    """Return what a drum does; retracted before its first sample."""
    return DrumState.RETRACTED if finger.action is None else finger.action.state


def style_of(finger: FingerBench) -> str:
    """Return how a drum's state is shown."""
    return STYLES.get(state_of(finger), TOUCHING_STYLE)


class DrumLog:
    """A CSV file of a line a finger and sample; one that is there is replaced."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._stream: TextIO | None = None
        if path is not None:
            try:
                self._stream = path.open("w", encoding="utf-8", newline="")
            except OSError as failure:
                raise self._unwritable(failure) from failure
            self._write([LOG_TITLES])

    def append(self, reading: Reading, bench: DrumBench) -> None:
        """Write a sample of every finger."""
        if self._stream is None:
            return
        rows = []
        for number, finger in enumerate(bench.fingers):
            action, plant = finger.action, finger.plant
            if action is not None:
                rows.append(
                    (
                        reading.now_ns, number, action.state.value, action.mode.name.lower(),
                        *(f"{value:.9g}" for value in (
                            plant.angle, plant.force, plant.torque, action.angle, action.force,
                            action.torque, action.torque_cap, action.motor_speed_cap,
                        )),
                    )
                )  # fmt: skip
        self._write(rows)

    def _write(self, rows: list[Any]) -> None:
        assert self._stream is not None
        try:
            csv.writer(self._stream, lineterminator="\n").writerows(rows)
        except OSError as failure:
            raise self._unwritable(failure) from failure

    def _unwritable(self, failure: OSError) -> RecordingError:
        return RecordingError(f"{self._path}: cannot be written ({failure.strerror or failure})")

    def __enter__(self) -> "DrumLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._stream is None:
            return
        try:
            self._stream.close()
        except OSError as failure:
            if kind is None:
                raise self._unwritable(failure) from failure
