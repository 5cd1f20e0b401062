"""The least that a drum's controller does with frames, for the demo: where each drum goes, and why.

A drum is retracted, or stands where its finger will touch, or holds there while the finger does. On doubt it
holds or retreats, never advances: of a frame that is late no drum is set, and one that is stale retracts
them, those that hold after a moment. There is no motor and no limit of force here.
"""

import math
import threading
from dataclasses import dataclass, field
from enum import Enum
from types import TracebackType

from rich.text import Text

from proximity.errors import ProximityError
from proximity.message import ContactFlag, Mode, State
from proximity.transport import Reading, Subscriber

TOUCH_M = 30e-6
"""Nearer than this the finger touches, and the drum holds."""
RELEASE_M = 1e-3
"""Farther than this it has let go again."""
FREEZE_NS = 250_000_000
"""A drum that holds stays so long when nothing is known any more (PAPER 10)."""
TURN_S = 0.005
MM = 1e3  # in a metre


class DrumState(Enum):
    """What a drum does."""

    RETRACTED = "retracted"
    AHEAD = "ahead"
    HOLDING = "holding"


@dataclass(slots=True)
class Drum:
    """The drum of one finger."""

    state: DrumState = DrumState.RETRACTED
    way: float = math.nan  # m that the finger has until the drum
    known_ns: int = 0  # instant of the last reading that said where the finger is
    is_kept: bool = False  # stays as it was, because nothing newer is known
    touch_count: int = 0

    def take(self, distance: float, mode: int, now_ns: int) -> None:
        """Go where a finger's distance says that its drum belongs.

        Parameters
        ----------
        distance : float, m
            Signed, of the fingertip.
        mode : Mode
            What the service advises.
        now_ns : int
            Instant of the reading.
        """
        self.known_ns, self.is_kept = now_ns, False
        self.way = max(distance, 0.0)
        if distance <= (RELEASE_M if self.state is DrumState.HOLDING else TOUCH_M):
            self.touch_count += self.state is not DrumState.HOLDING
            self.state = DrumState.HOLDING
        elif mode in (Mode.POSITION, Mode.FORCE):
            self.state = DrumState.AHEAD
        else:
            self.state = DrumState.RETRACTED

    def doubt(self, now_ns: int) -> None:
        """Retract, or hold a moment longer: nothing is known of the finger.

        Parameters
        ----------
        now_ns : int
            Instant of the reading.
        """
        self.is_kept = self.state is DrumState.HOLDING and now_ns - self.known_ns <= FREEZE_NS
        if not self.is_kept:
            self.state = DrumState.RETRACTED


@dataclass(slots=True)
class DrumStub:
    """The drums of all fingers, and what frames were good for."""

    drums: list[Drum] = field(default_factory=list)
    used: int = 0  # frames
    late: int = 0  # frames that moved no drum because they were late
    stale: int = 0  # … because nothing was known of any finger, or not yet

    @property
    def seen(self) -> int:
        """Frames that were acted upon, or deliberately not."""
        return self.used + self.late + self.stale

    @property
    def touch_count(self) -> int:
        """How often a finger came to a drum."""
        return sum(drum.touch_count for drum in self.drums)

    def act(self, reading: Reading) -> None:
        """Set every drum by what is known now.

        Parameters
        ----------
        reading : Reading
            New, or older than at the turn before.
        """
        contacts = reading.contacts
        if len(self.drums) != len(contacts):
            self.drums = [Drum() for _ in contacts]
        if reading.is_new:
            self.used += reading.is_valid
            self.late += reading.state is State.LATE
            self.stale += not reading.is_valid and reading.state is not State.LATE
        for drum, contact in zip(self.drums, contacts, strict=True):
            if reading.state is State.LATE:
                drum.is_kept = True
            elif reading.is_valid and contact["flags"] & ContactFlag.TRACKED:
                drum.take(float(contact["signed_distance"]), int(contact["mode"]), reading.now_ns)
            else:
                drum.doubt(reading.now_ns)

    def told(self) -> list[Text]:
        """Return what each drum does, in words."""
        return [_words(drum) for drum in self.drums]


class Controller:
    """Runs a `DrumStub` beside, with a subscriber of its own, as a controller does.

    Parameters
    ----------
    subscriber : Subscriber
        Used by its thread only.
    """

    stub: DrumStub

    def __init__(self, subscriber: Subscriber) -> None:
        self.stub = DrumStub()
        self._subscriber = subscriber
        self._failure: ProximityError | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="controller", daemon=True)

    @property
    def overtaken(self) -> int:
        """Frames that a newer one had overtaken when it was this thread's turn."""
        return self._subscriber.counts.received - self.stub.seen

    def _run(self) -> None:
        try:
            while not self._is_over.is_set():
                self.stub.act(self._subscriber.wait(TURN_S))
        except ProximityError as failure:
            self._failure = failure

    def __enter__(self) -> "Controller":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_over.set()
        self._thread.join()
        if self._failure is not None and kind is None:
            raise self._failure


def _words(drum: Drum) -> Text:
    if drum.state is DrumState.RETRACTED:
        return Text("retracted", "green")
    kept = ", kept" if drum.is_kept else ""
    if drum.state is DrumState.HOLDING:
        return Text(f"holds{kept}", "bold red")
    return Text(f"{MM * drum.way:.1f} mm ahead{kept}", "yellow")
