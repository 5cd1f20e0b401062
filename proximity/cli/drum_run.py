"""The loop of ``proximity drum``, what it shows, and what it tells in the end."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from proximity.decaff.drum_bench import DrumBench, FingerBench
from proximity.transport import Counts, Reading, Subscriber

LINE_EVERY_S = 1.0
DRAWN_EVERY_S = 0.1
FIRST_AFTER_S = 0.1
LINE_FINGERS = 8
OTHER_LINES = 5  # of a terminal, beside the fingers
MM = 1e3  # in a metre


class DrumScreen:
    """Shows drums: a table on a terminal, one line a second elsewhere.

    Parameters
    ----------
    console : Console
        Where to.
    is_silent : bool
        Shows nothing.
    """

    def __init__(self, console: Console, *, is_silent: bool = False) -> None:
        self._is_silent = is_silent
        is_drawn = console.is_terminal and not is_silent
        self._console = console
        self._live = Live(console=console, auto_refresh=False) if is_drawn else None
        self._due = time.monotonic() + FIRST_AFTER_S

    def show(self, reading: Reading, bench: DrumBench) -> None:
        """Show the drums if it is time for it.

        Parameters
        ----------
        reading : Reading
            The newest.
        bench : DrumBench
            Of all fingers.
        """
        now = time.monotonic()
        if self._is_silent or now < self._due:
            return
        self._due = now + (LINE_EVERY_S if self._live is None else DRAWN_EVERY_S)
        if self._live is None:
            sys.stdout.write(line(reading, bench) + "\n")
            sys.stdout.flush()
        else:
            rows = max(1, self._console.size.height - OTHER_LINES)
            self._live.update(table(reading, bench, rows), refresh=True)

    def __enter__(self) -> "DrumScreen":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()


def run(
    bench: DrumBench, subscriber: Subscriber, rate: float, screen: DrumScreen, is_over: Callable[[], bool]
) -> None:
    """Step the controllers at a rate; samples that are missed are left out, not made up for.

    Parameters
    ----------
    bench : DrumBench
        Of all fingers.
    subscriber : Subscriber
        Of the service.
    rate : float, Hz
        Of the controllers.
    screen : DrumScreen
        Shows them.
    is_over : callable
        Tells when to end.
    """
    period, due = 1.0 / rate, time.monotonic()
    while not is_over():
        reading = subscriber.read()
        bench.step(reading)
        screen.show(reading, bench)
        now = time.monotonic()
        due += period * max(1.0, (now - due) // period + 1.0)
        time.sleep(max(0.0, due - now))


def line(reading: Reading, bench: DrumBench) -> str:
    """Return one line of text.

    Parameters
    ----------
    reading : Reading
        The newest.
    bench : DrumBench
        Of all fingers.
    """
    fingers = [f"{i}: {', '.join(_words(finger))}" for i, finger in enumerate(bench.fingers)]
    more = len(fingers) - LINE_FINGERS
    shown = fingers[:LINE_FINGERS] + ([f"and {more} more"] if more > 0 else [])
    return f"{time.strftime('%H:%M:%S')} {reading.state.name}: {'; '.join(shown) or 'no frame yet'}"


def table(reading: Reading, bench: DrumBench, row_count: int) -> Table:
    """Return what a terminal shows.

    Parameters
    ----------
    reading : Reading
        The newest.
    bench : DrumBench
        Of all fingers.
    row_count : int
        Most fingers that are shown.
    """
    shown = Table(title=f"{reading.state.name}, {len(bench.fingers)} fingers", title_justify="left", box=None)
    for name in ("finger", "drum", "drum mm", "finger mm", "force N", "touches", "faults"):
        shown.add_column(name, justify="left" if name == "drum" else "right", no_wrap=True)
    for i, finger in enumerate(bench.fingers[:row_count]):
        cells = (f"{MM * finger.plant.place:.1f}", f"{MM * finger.path.place(finger.bend):.1f}")
        force = f"{finger.plant.force:.2f}"
        shown.add_row(str(i), _state(finger), *cells, force, str(finger.touches), str(finger.faults))
    return shown


def summary(bench: DrumBench, address: str, counts: Counts, seconds: float) -> dict[str, Any]:
    """Return what became of the drums, for JSON.

    Parameters
    ----------
    bench : DrumBench
        Of all fingers.
    address : str
        Of the service.
    counts : Counts
        Of its frames.
    seconds : float, s
        How long the drums ran.
    """
    fingers = [
        {
            "finger": i,
            "state": _state(finger),
            "drum_mm": round(MM * finger.plant.place, 3),
            "finger_mm": round(MM * finger.path.place(finger.bend), 3),
            "has_bend": finger.has_bend,
            "touches": finger.touches,
            "peak_force_n": round(finger.peak_force, 4),
            "faults": finger.faults,
            "dropped": finger.controller.frames.dropped,
            "awaited": finger.controller.frames.awaited,
            "samples": dict(finger.samples),
        }
        for i, finger in enumerate(bench.fingers)
    ]
    return {
        "address": address,
        "seconds": round(seconds, 3),
        "frames": counts.received,
        "lost": counts.lost,
        "refused": counts.refused + counts.flawed.total(),
        "fingers": fingers,
    }


def _state(finger: FingerBench) -> str:
    return "retracted" if finger.action is None else finger.action.state.value


def _words(finger: FingerBench) -> list[str]:
    told = [_state(finger), f"drum at {MM * finger.plant.place:.1f} mm"]
    if not finger.has_bend:
        return [*told, "no bend is told"]
    told.append(f"finger at {MM * finger.path.place(finger.bend):.1f} mm")
    return [*told, f"{finger.plant.force:.2f} N"] if finger.plant.force > 0.0 else told
