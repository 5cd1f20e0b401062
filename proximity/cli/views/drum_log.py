"""Log of drum controllers, one row a sample, as a table for other programs."""

import csv
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from proximity.decaff.simulated_drums.service_drums import DrumBench
from proximity.errors import RecordingError
from proximity.transport import Reading

TITLES = (
    "now_ns", "finger", "state", "mode", "drum_rad", "force_N", "motor_torque_Nm",
    "target_rad", "target_force_N", "target_torque_Nm", "torque_cap_Nm", "motor_speed_cap_rad_s",
)  # fmt: skip
"""Where a drum is and what its motor does; then what its controller wants."""


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
            self._write([TITLES])

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
