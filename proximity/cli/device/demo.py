"""Command ``proximity demo``, which shows a sample scene, a recorded hand, a service and its drums."""

import sys
import time
from contextlib import ExitStack
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

import proximity
from proximity.cli import progress
from proximity.cli.options import SECONDS, option, sample
from proximity.cli.output import report
from proximity.cli.program import EXIT_INTERRUPTED, EXIT_NOTHING
from proximity.system.stop_signals import stopped_by_signals

if TYPE_CHECKING:
    from proximity.service.hosting import RunningService

TURN_S = 0.02
DRUM_RATE_HZ = 250.0
WATCHDOG_NS = 200_000_000  # 10 ms for a real drum; simulated ones tolerate a busy machine
SWITCH_S = 1e-3  # maximum delay of the drums while the display is drawn in the same process
SCENE = "demo.toml"
FIRST_LINE = "A recorded hand approaches a bracket. Starting its service and the drums of a glove ..."


def demo(
    limit: Annotated[
        float, option("S", "Stop after this many seconds; Ctrl-C stops earlier.", callback=SECONDS)
    ] = 20.0,
) -> None:
    """Demonstrate the whole chain with a recorded hand at the sample bracket, without any
    configuration.

    A service tracks the hand 1000 times a second, in a separate process. Controllers of simulated
    drums read its frames, as in `proximity drum`. This terminal shows both until Ctrl-C or --limit,
    and then a summary; a pipe receives only the summary. Temporary files are removed.

    Examples:
      proximity demo
      proximity demo --limit 5 | cat
    """
    if progress.is_terminal():
        typer.echo(FIRST_LINE, err=True)
    from proximity.cli.device.demo_view import LastSecond, TouchWatch, closing_lines, picture
    from proximity.cli.device.drum_loop import DrumThread
    from proximity.cli.service.watch_view import Follower
    from proximity.cli.tables import Console, Screen
    from proximity.decaff.controller.settings import Limits
    from proximity.decaff.simulated_drums import DrumBench
    from proximity.transport import open_subscriber

    sys.setswitchinterval(SWITCH_S)
    to_drums, to_watch = _addresses()
    progress.prepare_kernels()
    bench = DrumBench(DRUM_RATE_HZ, limits=Limits(watchdog_ns=WATCHDOG_NS))
    with progress.spinner("preparing the drums"):
        bench.warm_up()
    with stopped_by_signals() as stop, ExitStack() as opened:
        with progress.spinner("starting the service"):
            listening = [opened.enter_context(open_subscriber(each)) for each in (to_drums, to_watch)]
            service = opened.enter_context(_start({to_drums, to_watch}, stop))
        touches, last, console = TouchWatch(), LastSecond(), Console()
        drums = opened.enter_context(DrumThread(bench, listening[0], DRUM_RATE_HZ, touches.add))
        follower = Follower(listening[1])
        screen = opened.enter_context(Screen(console, is_silent=not console.is_terminal))
        ends = time.monotonic() + limit
        while True:
            reading, seen = follower.look(TURN_S)
            last.add(time.monotonic(), reading, seen)
            shown = partial(picture, reading, seen, last, drums)
            screen.show(str, lambda size, shown=shown: shown())  # type: ignore[misc]
            is_running = service.is_running and drums.is_running
            if stop.is_set() or not is_running or time.monotonic() >= ends:
                break
        done = service.stop()
    for text in closing_lines(done, touches, drums):
        console.print(text, highlight=False, soft_wrap=not console.is_terminal)
    if not drums.received:
        raise typer.Exit(EXIT_NOTHING)


def _start(publish: set[str], stop: Event) -> "RunningService":
    """Start the service of the sample scene."""
    from proximity.service.hosting import start_service

    try:
        return start_service(sample(SCENE), publish=sorted(publish), say=report)
    except proximity.ServiceError:
        if stop.is_set():  # Ctrl-C in a terminal also stops a starting service
            raise typer.Exit(EXIT_INTERRUPTED) from None
        raise


def _addresses() -> tuple[str, str]:
    """Return separate addresses for the drums and for the display, since datagrams have only one reader."""
    from proximity.web.running_page import own_addresses

    own = own_addresses()
    return own.frames, own.frames if own.frames.startswith("shm:") else own.poses
