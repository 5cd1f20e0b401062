"""Command ``proximity view``, which shows parts in a browser with distances at the mouse or at fingertips."""

import json
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import (
    ALLOW,
    CONTACT,
    LIMIT,
    POINTS_UNITS,
    SCENE_FILE,
    Reading,
    argument,
    flag,
    option,
    refuse,
    sample,
    with_option_groups,
    within,
)
from proximity.cli.output import report
from proximity.cli.parts.points import read_points
from proximity.cli.program import stop_after
from proximity.system.stop_signals import stop_at_input, stopped_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from proximity import Scene
    from proximity.scene.clashes import MeasuredPair
    from proximity.web.page_process import PageSettings


@dataclass(frozen=True)
class Listening:
    """Options of the web server."""

    port: Annotated[int, option("N", "Port to listen on; 0: any free port.", callback=within(0, 65535))] = 0
    bind: Annotated[
        str,
        option("ADDRESS", "Address to listen on. Other than 127.0.0.1 requires --cert, --cert-key."),
    ] = "127.0.0.1"
    name: Annotated[
        list[str] | None,
        option("NAME", "Host name by which other machines reach this one. Can be given several times."),
    ] = None
    cert: Annotated[Path | None, option("FILE", "Certificate for TLS, PEM.")] = None
    cert_key: Annotated[Path | None, option("FILE", "Private key of the certificate, PEM.")] = None


@dataclass(frozen=True)
class Clashes:
    """Options of the list of clashes."""

    clashes: Annotated[bool, flag("--clashes", "List the parts that overlap, the deepest first.")] = False
    contact: CONTACT = None
    allow: ALLOW = None

    def finder(self, units: str) -> "Callable[[Scene], list[MeasuredPair]] | None":
        """Return a function that finds the clashes in a scene, or None if they are not listed."""
        has_more = self.contact is not None or self.allow is not None
        refuse((has_more and not self.clashes, "--contact, --allow", "requires --clashes"))
        if not self.clashes:
            return None
        from proximity.cli.parts.measured_pairs import find_clashes
        from proximity.formats import metres_per_unit

        contact = None if self.contact is None else self.contact * metres_per_unit(units)

        def find(scene: "Scene") -> "list[MeasuredPair]":
            with progress.spinner("measuring clashes"):
                return find_clashes(scene, contact, self.allow)

        return find


@dataclass(frozen=True)
class Hands:
    """Options of the hand at the beginning, and of its fingertips."""

    replay: Annotated[Path | None, option("HAND", "Start with this recorded hand (CSV).")] = None
    hand: Annotated[bool, flag("--hand", "Start with a hand that follows the mouse.")] = False
    fit: Annotated[bool, flag("--fit", "Move the recorded hand so that it touches the parts.")] = False
    radius: Annotated[
        float | None,
        option(
            "MM",
            "Radius of the fingertips; 7 mm if not given.",
            callback=within(0.0, 1e3, "mm", is_open=True),
        ),
    ] = None


@dataclass(frozen=True)
class Program:
    """Options for a program that starts this one."""

    beside: Annotated[str | None, option("ADDRESS", "", hidden=True)] = None
    framed: Annotated[bool, flag("--framed", "", hidden=True)] = False
    json: Annotated[bool, flag("--json", "", hidden=True)] = False
    until_stdin: Annotated[bool, flag("--until-stdin", "", hidden=True)] = False


@with_option_groups
def view(
    files: Annotated[list[Path], argument("FILES", "Parts, a scene file (.toml), a log (.frames).")],
    listening: Listening,
    program: Program,
    clashes: Clashes,
    hands: Hands,
    points: Annotated[
        str | None,
        option("FILE", "Show points (text, PLY, STL, OBJ) in colours of their distance; - is stdin."),
    ] = None,
    points_units: POINTS_UNITS = None,
    browser: Annotated[
        bool, flag("--browser/--no-browser", "Whether to open a browser.", show_default=False)
    ] = True,
    out: Annotated[
        Path | None,
        option(
            "FILE",
            "Write a standalone page (.html) instead of showing one.",
            "--save",
        ),
    ] = None,
    limit: LIMIT = None,
    *,
    reading: Reading,
) -> None:
    """Show FILES in the browser: the parts, and the distance at the mouse or at fingertips.

    FILES are one of these: parts (STL, OBJ, PLY, OFF, glTF, 3MF, STEP or a compiled scene); a scene
    file (.toml), whose parts and fingers are used; a log of frames (.frames), which is played back,
    together with the parts of the recording. Hands come from a headset with WebXR, the mouse, or a
    recording. --points reads points as query does, such as a scan of the part. --clashes lists the
    parts that overlap, as clearance does; the page shows the selected pair.

    The page computes the distances; the command only serves it. Ctrl-C stops it. Only this machine can
    connect, and only with the token in the printed address.

    Examples:
      proximity view part.step
      proximity view part.step --points scan.csv
      proximity view gearbox.step --clashes
      proximity view meshes/bracket.stl --replay meshes/hand.csv
      proximity view run.frames meshes/bracket.stl
      proximity view part.step --save part.html   # to mail, or to open from a disk
      proximity view cell.toml --no-browser --port 8787
    """
    is_scene_file = any(file.suffix.lower() == SCENE_FILE for file in files)
    refuse((is_scene_file and reading.scale != 1.0, "--scale", "files of a scene file are not scaled"))
    refuse((hands.hand and hands.replay, "--hand and --replay", "give one of them, not both"))
    refuse((out and out.suffix != ".html", "--save", f"{out} does not end in .html"))
    from proximity.web.page_process import PageSettings

    settings = PageSettings(
        files=tuple(map(str, files)),
        units=reading.units,
        reading=tuple(reading.options().items()),
        recording=str(sample("hand.csv") if hands.replay is None else hands.replay),
        is_recording_fitted=hands.fit or hands.replay is None,
        first_input="mouse" if hands.hand else "" if hands.replay is None else "replay",
        points_name=Path(points or "").name,
        points=b"" if points is None else _coordinates(points, points_units or reading.units),
        find_clashes=clashes.finder(reading.units),
        radius=None if hands.radius is None else hands.radius / 1e3,
        port=listening.port,
        bind=listening.bind,
        names=tuple(listening.name or ()),
        certificate=None if listening.cert is None else str(listening.cert),
        key=None if listening.cert_key is None else str(listening.cert_key),
        beside=program.beside,
        may_be_framed=program.framed,
    )
    if out is not None:
        from proximity.web.page_process import write_page

        typer.echo(f"{out}: {write_page(settings, out) / 1e6:.1f} MB")
        return
    _show(settings, program, limit, opens_browser=browser)


def _coordinates(path: str, units: str) -> bytes:
    """Return the points of a text file as bytes of float64, in metres."""
    from proximity.formats import metres_per_unit

    metres = metres_per_unit(units)
    read = read_points(path, units, note=lambda sentence: report(f"note: {sentence}"))
    return array("d", (metres * number for chunk in read for number in chunk.coordinates)).tobytes()


def _show(settings: "PageSettings", program: Program, limit: float | None, *, opens_browser: bool) -> None:
    from proximity.web.page_process import run_page
    from proximity.web.server.access import open_in_browser

    progress.prepare_kernels()
    with stopped_by_signals() as stop:
        stop_after(limit, stop)
        if program.until_stdin:
            stop_at_input(stop)

        def begun(beginning: dict[str, Any]) -> None:
            if program.json:
                typer.echo(json.dumps({"event": "begun", **beginning}))
            else:
                typer.echo(beginning["url"])
            if opens_browser:
                open_in_browser(beginning["url"])

        ended = run_page(settings, stop=stop, say=report, begun=begun)
    if program.json:
        typer.echo(json.dumps({"event": "report", **ended}))
