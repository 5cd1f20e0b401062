"""``proximity demo``: sample scene and hand, a service, a controller and a look at both, in one terminal."""

import os
import secrets
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import proximity
from proximity.cli.options import LONGEST_S
from proximity.cli.stopping import until_told

if TYPE_CHECKING:
    from proximity.cli.drum_stub import DrumStub
    from proximity.cli.watch_view import Seen

HELP = "\n\n".join(
    (
        "Show it all working: a recorded hand at the sample bracket, without any configuration.",
        "A service follows the hand 1000 times a second, in a process of its own. A small controller of "
        "drums listens to it, and this terminal shows both until Ctrl-C or --seconds. It ends with what each "
        "of them has done. Nothing is left behind.",
    )
)

EXAMPLES = """
Examples:
  proximity demo
  proximity demo --seconds 5 | cat
"""

SECONDS = 20.0
TURN_S = 0.02
EXIT_NOTHING = 1
SCENE = "demo.toml"


def command(
    seconds: Annotated[
        float, typer.Option("--seconds", metavar="S", help="How long, unless Ctrl-C ends it before.")
    ] = SECONDS,
) -> None:
    """Run the demo."""
    if not 0.0 < seconds <= LONGEST_S:
        raise typer.BadParameter(f"{seconds:g} seconds: expected 0 to {LONGEST_S:g}", param_hint="--seconds")
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from rich.console import Console

    from proximity.cli import waiting
    from proximity.cli.drum_stub import Controller
    from proximity.cli.watching import Follower, Screen
    from proximity.serving import start_service
    from proximity.transport import open_subscriber

    # Its own name: demos beside each other, and a service that runs already, do not meet.
    address = f"iox2://proximity-demo-{os.getpid()}-{secrets.token_hex(4)}"
    waiting.prepare_kernels()
    with until_told() as stop, ExitStack() as opened:
        with waiting.spinner("starting the service"):
            service = opened.enter_context(start_service(sample(SCENE), publish=[address], say=_say))
        controller = opened.enter_context(Controller(opened.enter_context(open_subscriber(address))))
        follower = Follower(opened.enter_context(open_subscriber(address)))
        screen, ends = opened.enter_context(Screen(Console())), time.monotonic() + seconds
        while True:
            reading, seen = follower.look(TURN_S)
            screen.show(reading, seen, controller.stub.told())
            if stop.is_told or not service.is_running or time.monotonic() >= ends:
                break
        report = service.stop()
    for text in _summary(report, seen, controller.stub):
        typer.echo(text)
    if not controller.stub.used:
        raise typer.Exit(EXIT_NOTHING)


def sample(name: str) -> Path:
    """Return where a sample file is: beside the package in a checkout, inside of it where it was installed.

    Parameters
    ----------
    name : str
        Of a file in the folder ``meshes``.
    """
    package = Path(proximity.__file__).parent
    for folder in (package / "samples", package.parent / "meshes"):
        if (folder / name).is_file():
            return folder / name
    raise proximity.ServiceError(f"the sample {name} is neither in {package} nor in meshes beside it")


def _say(sentence: str) -> None:
    typer.echo(f"proximity: {sentence}", err=True)


def _summary(report: dict[str, Any], seen: "Seen", stub: "DrumStub") -> list[str]:
    """What service, watch and controller have done, a line each."""
    compute, late = report["compute"], report["lateness"]
    counts = seen.counts
    refused = counts.refused + counts.flawed.total()
    return [
        f"service     {report['ticks']} frames, {report['missed']} ticks missed; computing p50 "
        f"{_us(compute['p50_ns'])}, p99 {_us(compute['p99_ns'])}; woken late p50 {_us(late['p50_ns'])}, "
        f"p99 {_us(late['p99_ns'])}",
        f"this watch  {counts.received} frames seen, {counts.lost} lost, {refused} refused",
        f"controller  {stub.used} frames used, {stub.late} late and {stub.stale} stale left out; "
        f"{stub.touch_count} touches held",
    ]


def _us(ns: float) -> str:
    return f"{ns / 1e3:.0f} µs"
