"""``proximity serve``: run the service that a scene file describes until it is asked to stop."""

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli.options import LIMIT, check_limit, check_port
from proximity.cli.program import EXIT_UNUSABLE
from proximity.errors import ServiceError
from proximity.system.stop_signals import stop_at_input

if TYPE_CHECKING:
    from proximity.service.hosting import Beginning
    from proximity.web import RunningPage

HELP = "\n\n".join(
    (
        "Serve the fingers and parts that SCENE describes: poses in, contacts out, every period.",
        "SCENE is a TOML file; meshes/demo.toml explains every key. The service runs until Ctrl-C or "
        "SIGTERM, until a recording ends that is not repeated, or until --limit or --ticks; its last frames "
        "have the state STOPPING. You can edit SCENE and the files of its parts while the service runs: a "
        "valid edit takes effect between two ticks; an invalid edit is reported with its line, and the "
        "previous scene stays in use.",
        "The report on standard output has the number of ticks, how many were missed, how long they took "
        "and how late they began. Exit codes: 0: stopped as asked. 2: SCENE cannot be used, an address is "
        "in use, or the log lacks frames.",
    )
)

EXAMPLES = """
Examples:
  proximity serve meshes/demo.toml
  proximity serve cell.toml --rate 500 --publish udp://192.168.7.2:9100 --log run.frames
  proximity serve cell.toml --realtime --limit 60 --json
"""


SCENE = Annotated[
    Path, typer.Argument(metavar="SCENE", help="Scene file (TOML): parts, fingers, input, addresses.")
]
RATE = Annotated[
    float | None, typer.Option("--rate", metavar="HZ", help="Ticks per second; overrides SCENE.")
]
PUBLISH = Annotated[
    list[str] | None,
    typer.Option(
        "--publish",
        metavar="ADDRESS",
        help="Address to publish to; overrides SCENE. Can be given several times.",
    ),
]
LOG = Annotated[
    Path | None, typer.Option("--log", metavar="FILE", help="Append all frames to this log; overrides SCENE.")
]
REAL_TIME = Annotated[
    bool | None,
    typer.Option(
        "--realtime/--no-realtime",
        help="Ask the system for real-time priority, locked memory and a core of its own; overrides SCENE.",
        show_default=False,
    ),
]
TICKS = Annotated[int | None, typer.Option("--ticks", metavar="N", help="Stop after this many ticks.")]
WEB = Annotated[
    bool, typer.Option("--web", help="Start the page of proximity view as well, and print its address.")
]
PORT = Annotated[
    int | None,
    typer.Option("--port", metavar="N", help="Port of the page of --web; any free port if not given."),
]
AS_JSON = Annotated[
    bool, typer.Option("--json", help="Write one JSON document at the start and one at the end: the report.")
]
UNTIL_STDIN = Annotated[
    bool,
    typer.Option("--until-stdin", help="Stop when a line arrives on standard input, or when it is closed."),
]


def command(
    scene: SCENE,
    rate: RATE = None,
    publish: PUBLISH = None,
    log: LOG = None,
    real_time: REAL_TIME = None,
    limit: LIMIT = None,
    ticks: TICKS = None,
    web: WEB = False,
    port: PORT = None,
    as_json: AS_JSON = False,
    until_stdin: UNTIL_STDIN = False,
) -> None:
    """Serve until asked to stop, and print the report."""
    _check(limit, ticks, port, is_web=web)
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.cli import progress
    from proximity.cli.views import serve_report
    from proximity.service.hosting import serve

    overrides = {"rate_hz": rate, "publish": publish or None, "log": log, "real_time": real_time}
    page = _PageBeside(scene, overrides, port or 0) if web else None
    stop = threading.Event()
    if until_stdin:
        stop_at_input(stop)
    progress.prepare_kernels()

    def begun(beginning: "Beginning") -> None:
        serve_report.write_beginning(beginning, as_json=as_json)
        if page is not None:
            page.start()

    try:
        report = serve(
            scene,
            stop=stop,
            tick_count=ticks,
            seconds=limit,
            say=_say,
            begun=begun,
            **overrides,
        )
    finally:
        if page is not None:
            page.stop()
    serve_report.write(report, as_json=as_json)
    if report.log_lost:
        _say(f"the log lacks {report.log_lost} of {report.log_lost + report.log_written} frames")
        raise typer.Exit(EXIT_UNUSABLE)


def _check(limit: float | None, ticks: int | None, port: int | None, *, is_web: bool) -> None:
    """Refuse numbers out of range."""
    check_limit(limit)
    if ticks is not None and ticks < 1:
        raise typer.BadParameter(f"{ticks} ticks: expected 1 or more", param_hint="--ticks")
    if port is not None and not is_web:
        raise typer.BadParameter(f"{port}: expected --web, of whose page it is the port", param_hint="--port")
    check_port(port or 0)


class _PageBeside:
    """A page in a process of its own, to which the service publishes at an address of its own."""

    def __init__(self, scene: Path, given: dict[str, Any], port: int) -> None:
        from proximity.service.config import read_scene_file
        from proximity.web.served_scene import own_addresses

        self._scene, self._port, self._address = str(scene), str(port), own_addresses().frames
        given["publish"] = [*(given["publish"] or read_scene_file(scene).service.publish), self._address]
        self._page: RunningPage | None = None
        self._is_over = False
        self._starting = threading.Thread(target=self._start, name="starts the page", daemon=True)

    def start(self) -> None:
        """Start it beside the loop, and say where it is."""
        self._starting.start()

    def stop(self) -> None:
        """End it."""
        self._is_over = True
        if self._page is not None:
            with contextlib.suppress(ServiceError):
                self._page.stop()

    def _start(self) -> None:
        from proximity.web import RunningPage

        words = [self._scene, "--beside", self._address, "--port", self._port]
        try:
            self._page = RunningPage(words, self._scene, _say)
        except ServiceError as failure:
            _say(str(failure))
            return
        if self._is_over:
            self.stop()
        _say(f"the page is at {self._page.url}")


def _say(sentence: str) -> None:
    typer.echo(f"proximity: {' '.join(sentence.split())}", err=True)
