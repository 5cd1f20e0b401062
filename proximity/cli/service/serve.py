"""Command ``proximity serve``, which runs the service of a scene file until it is stopped."""

import contextlib
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import LIMIT, argument, flag, option, refuse, within
from proximity.cli.output import counted, number, print_block, report, write_document
from proximity.cli.program import EXIT_UNUSABLE
from proximity.errors import ServiceError
from proximity.system.stop_signals import stop_at_input

if TYPE_CHECKING:
    from proximity.service.hosting import Beginning
    from proximity.web import RunningPage

ORDINARY = "ordinary priority, memory not locked, any core; --realtime requests more"
UNUSED_POSES = {"future": "from the future", "backwards": "backwards in time", "too_old": "too old"}


def serve(
    scene: Annotated[Path, argument("SCENE", "Scene file (TOML): parts, fingers, input, addresses.")],
    rate: Annotated[float | None, option("HZ", "Ticks per second; overrides SCENE.")] = None,
    publish: Annotated[
        list[str] | None,
        option("ADDRESS", "Address to publish to; overrides SCENE. Can be given several times."),
    ] = None,
    log: Annotated[Path | None, option("FILE", "Append all frames to this log; overrides SCENE.")] = None,
    real_time: Annotated[
        bool | None,
        flag(
            "--realtime/--no-realtime",
            ("Request real-time priority, locked memory and a dedicated core; overrides SCENE."),
            show_default=False,
        ),
    ] = None,
    limit: LIMIT = None,
    ticks: Annotated[int | None, option("N", "Stop after this many ticks.")] = None,
    web: Annotated[
        bool, flag("--web", "Start the page of proximity view as well, and print its address.")
    ] = False,
    port: Annotated[
        int | None,
        option("N", "Port of the page of --web; any free port if not given.", callback=within(0, 65535)),
    ] = None,
    as_json: Annotated[
        bool, flag("--json", "Write one JSON document at the start and one at the end: the report.")
    ] = False,
    until_stdin: Annotated[
        bool, flag("--until-stdin", "Stop when a line arrives on standard input, or when it is closed.")
    ] = False,
) -> None:
    """Serve the fingers and parts of SCENE: poses in, contacts out, every period.

    SCENE is a TOML file; meshes/demo.toml explains every key. The service runs until Ctrl-C or SIGTERM,
    until the end of a recording that is not repeated, or until --limit or --ticks; its last frames have
    the state STOPPING. You can edit SCENE and the files of its parts while the service runs: a valid edit
    takes effect between two ticks; an invalid edit is reported with its line, and the previous scene
    stays in use.

    The report on standard output has the number of ticks, the missed ones, their durations and their
    lateness. Exit codes: 0: stopped normally. 2: SCENE is invalid, an address is in use, or the log
    lacks frames.

    Examples:
      proximity serve meshes/demo.toml
      proximity serve cell.toml --rate 500 --publish udp://192.168.7.2:9100 --log run.frames
      proximity serve cell.toml --realtime --limit 60 --json
    """
    refuse(
        (ticks is not None and ticks < 1, "--ticks", f"{ticks} ticks: expected 1 or more"),
        (port is not None and not web, "--port", "requires --web"),
    )
    from proximity.service.hosting import serve

    overrides = {
        "rate_hz": rate,
        "publish": publish or None,
        "log": log,
        "real_time": real_time,
    }
    page = _PageStarter(scene, overrides, port or 0) if web else None
    stop = threading.Event()
    if until_stdin:
        stop_at_input(stop)
    progress.prepare_kernels()

    def begun(beginning: "Beginning") -> None:
        _write_beginning(beginning, as_json=as_json)
        if page is not None:
            page.start()

    try:
        ended = serve(
            scene, stop=stop, tick_count=ticks, seconds=limit, say=report, begun=begun, **overrides
        ).as_dict()
    finally:
        if page is not None:
            page.stop()
    if as_json:
        write_document({"event": "ended", **ended}, indent=None)
    else:
        _print_end(ended)
    if ended["log_lost"]:
        report(f"the log lacks {ended['log_lost']} of {ended['log_lost'] + ended['log_written']} frames")
        raise typer.Exit(EXIT_UNUSABLE)


def _write_beginning(beginning: "Beginning", *, as_json: bool) -> None:
    """Report scene, addresses, rate and permitted real-time settings.

    The report is text on stderr, or a document on stdout.
    """
    service = beginning.settings.service
    begun = {
        "event": "begun",
        "pid": os.getpid(),
        "scene": beginning.settings.path,
        "publish": list(service.publish),
        "rate_hz": service.rate_hz,
        "log": service.log,
        "real_time": service.real_time,
        "finger_count": beginning.finger_count,
        "part_count": len(beginning.part_names),
        "part_names": list(beginning.part_names),
        "face_count": beginning.face_count,
        "notes": list(beginning.notes),
    }
    if as_json:
        write_document(begun, indent=None)
        return
    fingers, parts = counted(beginning.finger_count, "finger"), counted(len(beginning.part_names), "part")
    at = f"at {parts}, {counted(beginning.face_count, 'face')}"
    report(f"serving {begun['scene']}: {fingers} {at if beginning.part_names else 'measured by a sensor'}")
    logged = f", logged in {service.log}" if service.log else ""
    report(f"{number(service.rate_hz)} Hz to {', '.join(service.publish)}{logged}")
    for note in [*([] if service.real_time else [ORDINARY]), *beginning.notes]:
        report(note)


def _print_end(ended: dict[str, Any]) -> None:
    states = ", ".join(f"{count} {state}" for state, count in ended["states"].items() if count)
    unused = ", ".join(f"{ended[key]} {why}" for key, why in UNUSED_POSES.items() if ended[key])
    ticks = f"{ended['ticks']} at {number(1e9 / ended['period_ns'])} Hz, {ended['missed']} missed"
    lines = [("ticks", ticks), ("states", states or "none")]
    for name in ("compute", "lateness"):
        p50, p99, p999, longest = (
            f"{ended[name][each] / 1e3:.1f}" for each in ("p50_ns", "p99_ns", "p999_ns", "max_ns")
        )
        lines.append((name, f"p50 {p50}, p99 {p99}, p99.9 {p999}, max {longest} µs"))
    for address, count in ended["publish_failures"].items():
        taken = f"{counted(count, 'frame')} not sent" if count else "all frames"
        lines.append(("published", f"{address}: {taken}"))
    if ended["log_written"] or ended["log_lost"]:
        lines.append(("log", f"{ended['log_written']} frames, {ended['log_lost']} lost"))
    if unused:
        lines.append(("poses", f"of fingers and parts, not used: {unused}"))
    print_block([*lines, *(("note", note) for note in ended["notes"])])


class _PageStarter(threading.Thread):
    """Thread that starts a page in a separate process.

    The service publishes to the page at a separate address.
    """

    def __init__(self, scene: Path, given: dict[str, Any], port: int) -> None:
        super().__init__(name="starts the page", daemon=True)
        from proximity.service.config import read_scene_file
        from proximity.web.running_page import own_addresses

        frames, self._scene = own_addresses().frames, str(scene)
        given["publish"] = [*(given["publish"] or read_scene_file(scene).service.publish), frames]
        self._words = [self._scene, "--beside", frames, "--port", str(port)]
        self._page: RunningPage | None = None
        self._is_over = False

    def run(self) -> None:
        """Start the page while the loop runs. Report its address."""
        from proximity.web import RunningPage

        try:
            self._page = RunningPage(self._words, self._scene, report)
        except ServiceError as failure:
            report(str(failure))
            return
        if self._is_over:
            self.stop()
        report(f"the page is at {self._page.url}")

    def stop(self) -> None:
        """Stop the page."""
        self._is_over = True
        if self._page is not None:
            with contextlib.suppress(ServiceError):
                self._page.stop()
