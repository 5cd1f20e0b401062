"""Instruments of a calibration, which are a potentiometer on the hand, and encoder and motor of the drum.

Laboratory instruments, the simulated glove, a person who types numbers, and a real motor all implement the
same interface. A real motor is on during a swing only. The messages of its bus arrive at uneven intervals, so
that a record contains only the samples with a new answer. Each of these has its own time and the mean of the
commands until the next one.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.motors.motor_drum import MotorDrum
from proximity.errors import DecaffError, MotorError


@dataclass(frozen=True, slots=True, eq=False)
class DrumRecord:
    """Record of a swung drum, with N samples. Angles and torques are positive away from the finger."""

    times: np.ndarray  # (N,) s, increasing, of the commands and the angles
    commanded: np.ndarray  # (N,) N m at the drum
    angles: np.ndarray  # (N,) rad of the drum
    torques: np.ndarray  # (N,) N m at the drum, by the motor's current


class DrumPort(Protocol):
    """Drum with an encoder, and optionally with a motor that accepts torques at a fixed rate."""

    rate: float  # Hz, of torques; 0 if the drum has no motor

    def angle(self) -> float:
        """Return the angle read by the encoder, rad."""

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Command torques at the drum, N m, one per sample and zero afterwards. Return the readings."""


class HandPort(Protocol):
    """Potentiometer of the glove on a hand."""

    def counts(self) -> np.ndarray:
        """Return the counts read during a short interval, (K,) float64.

        A single value is returned if only that is known.
        """

    def latency(self) -> tuple[float, float]:
        """Return the latency measured by a step test, s, and the sampling interval of the test, s."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Instruments of a calibration."""

    name: str  # readings of other instruments are never mixed with these
    hand: HandPort
    drum: DrumPort
    is_simulated: bool = False  # for practice


RATE = 500.0  # Hz of torques, within the limits of the bus and this program
MAX_GAP = 0.02  # s, maximum between two answers, as the motion in a longer gap is unknown
LOOK_S = 0.01  # s, between two readings of the motor while a person works
RATIO_OFF = 0.01  # share by which gear ratios may differ


class MotorPort:
    """Drum port of a motor, read from the beginning to the end of a ``with`` block."""

    rate = RATE

    def __init__(self, motor: MotorDrum, drum: Drum) -> None:
        self._motor = motor
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._failure: MotorError | None = None
        self._thread = threading.Thread(target=self._watch, name="reads the motor", daemon=True)
        ratio = motor.settings.ratio
        if abs(ratio / drum.gear.ratio - 1.0) > RATIO_OFF:
            raise DecaffError(
                f"the motor's address has a ratio of {ratio:g} and the drum one of {drum.gear.ratio:g}, "
                "expected the same: add ratio= to the address, or choose another --drum or --glove"
            )

    def __enter__(self) -> "MotorPort":
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._over.set()
        self._thread.join()

    def home(self) -> None:
        """Move the motor to its home position, and switch it off again."""
        self._check()
        with self._lock, self._off_at_once():
            self._motor.home()
            self._motor.rest()

    def angle(self) -> float:
        """Return the encoder's reading, rad of the drum."""
        self._check()
        with self._lock:
            self._motor.refresh()
            return self._motor.angle

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Switch the motor on, command torques at the drum, N m, and switch it off again.

        Return the readings.
        """
        self._check()
        with self._lock, self._off_at_once():
            self._motor.resume()
            rows = self._swung(torques)
            self._motor.rest()
        return _record(rows)

    @contextmanager
    def _off_at_once(self) -> Iterator[None]:
        """Switch the motor off if the block ends with an exception, including an interrupt by Ctrl-C."""
        try:
            yield
        except BaseException:
            self._motor.switch_off()
            raise

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _watch(self) -> None:
        """Read the motor during the pauses of other readers until the port is closed."""
        while self._failure is None and not self._over.wait(LOOK_S):
            with self._lock:
                try:
                    self._motor.look()
                except MotorError as failure:
                    self._failure = failure

    def _swung(self, torques: np.ndarray) -> list[tuple[float, float, float, float, int]]:
        """Command torques, and return one row per sample.

        A row contains time, command, angle, torque computed from the current, and the number of answers.
        """
        rows, started, due = [], time.monotonic(), time.monotonic()
        while (now := time.monotonic() - started) < len(torques) / RATE:
            self._check()
            given = self._motor.push(float(torques[int(now * RATE)]))
            reading = self._motor.reading
            rows.append((now, given, self._motor.angle, self._motor.drum_torque, reading.answers))
            due = max(due + 1.0 / RATE, time.monotonic())
            time.sleep(due - time.monotonic() if due > time.monotonic() else 0.0)
        return rows


def _record(rows: list[tuple[float, float, float, float, int]]) -> DrumRecord:
    """Return a record of the samples with a new answer.

    The command of each is the mean of the commands until the next one.
    """
    times, commanded, angles, torques, answers = (np.array(column) for column in zip(*rows, strict=True))
    fresh = np.flatnonzero(np.diff(answers, prepend=answers[0] - 1) > 0)
    gap = float(np.diff(np.append(times[fresh], times[-1])).max())
    if gap > MAX_GAP:
        raise DecaffError(
            f"the motor did not answer for {1e3 * gap:.0f} ms of a swing, expected an answer each "
            f"{1e3 / RATE:g} ms: stop other programs, or raise the bus's rate"
        )
    spans = np.diff(times, append=times[-1] + 1.0 / RATE)
    means = np.add.reduceat(commanded * spans, fresh) / np.add.reduceat(spans, fresh)
    return DrumRecord(times[fresh], means, angles[fresh], torques[fresh])
