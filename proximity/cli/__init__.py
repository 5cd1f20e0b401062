"""The command line ``proximity``, with commands such as ``query``, ``check`` and ``serve``.

The command line converts between the units of the user and the library's metres, and computes nothing else.
The module of a command is imported when the command is called or listed. It imports NumPy, Rich and the
library only when the command runs, so that ``--help``, ``--version`` and errors in the arguments take no
time.
"""

import io
import os
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer

import proximity
from proximity.cli.program import SETTINGS, Group, add_command

HELP = (
    "Exact distances to CAD parts (STL, OBJ, PLY, OFF, glTF, 3MF, STEP).\n"
    "Coordinates and answers are in millimetres; the distance is negative inside."
)
PANELS = {
    "ask": {
        "query": ("parts.query", "distances of points and rays; a scan compared with a part"),
        "check": ("parts.check", "the contents of a file, part by part, and its defects"),
        "clearance": ("parts.clearance", "gaps and clashes of parts, at a pose or over a motion"),
        "verify": ("parts.verify", "requirements in a file, such as gaps; with receipts"),
        "thickness": ("parts.thickness", "the thinnest walls of parts, and a limit for them"),
        "picture": ("parts.picture", "a PNG of the parts, of points and of a slice"),
        "view": ("parts.view", "the parts in the browser, with a probe and hands"),
        "compile": ("parts.check", "a file that opens in milliseconds, with the same answers"),
        "library": ("service.sources", "the engine in your own program: C, C++, C#, browsers"),
    },
    "serve": {
        "serve": ("service.serve", "a service for fingers: poses in, distances out"),
        "watch": ("service.watch", "the fingers of a service, live"),
        "record": ("service.record", "the frames of a service in a log"),
        "export": ("service.record", "a log as CSV or Parquet"),
        "client": ("service.sources", "what your own program reads a service with; keys"),
    },
    "glove": {
        "drum": ("device.drum", "the drums of the fingers, simulated or with motors"),
        "calibrate": ("device.calibrate", "the glove of one finger, step by step"),
        "controller": ("service.sources", "the controller of a drum, as C for a microcontroller"),
    },
    "research": {
        "bench": ("lab.bench", "whether every tick of a scene fits a haptic period"),
        "simulate": ("lab.simulate", "a press on a wall, compared with a real wall"),
        "figures": ("lab.figures", "figures of the paper on the glove, and our own"),
        "claims": ("lab.figures", "each claim of that paper compared with our models"),
        "study": ("lab.study", "a job for every combination of factors, on all cores"),
        "experiment": ("lab.experiment", "walls compared in an experiment with people"),
    },
    "demo": {"demo": ("device.demo", "a service, its drums and a recorded hand, without setup")},
}
"""Module and summary of each command, in the order of the help."""
COMMANDS = {name: where for panel in PANELS.values() for name, where in panel.items()}
RUN_BARE = ("demo", "figures", "claims", "simulate")
"""Commands that run without arguments. Other commands print their help then."""
MEANT = {
    **dict.fromkeys(("distance", "distances", "measure", "closest", "nearest", "ray", "sdf"), "query"),
    **dict.fromkeys(("gap", "gaps", "collision", "collide", "interference", "overlap"), "clearance"),
    **dict.fromkeys(("clash", "clashes", "clearances"), "clearance --clashes"),
    **dict.fromkeys(("motion", "hinge", "slide"), "clearance --hinge"),
    **dict.fromkeys(("compare", "deviation", "scan"), "query --points"),
    **dict.fromkeys(("rays", "cast", "hits"), "query --rays"),
    **dict.fromkeys(("wall", "walls", "thin", "thinness"), "thickness"),
    **dict.fromkeys(("penetration", "depth", "crossing"), "clearance"),
    **dict.fromkeys(("info", "inspect", "validate", "list", "stats"), "check"),
    **dict.fromkeys(("requirements", "assert", "receipt"), "verify"),
    **dict.fromkeys(("convert", "prepare", "save"), "compile"),
    **dict.fromkeys(("draw", "render", "image", "screenshot", "slice"), "picture"),
    **dict.fromkeys(("show", "open", "page", "gui"), "view"),
    **dict.fromkeys(("start", "run", "service"), "serve"),
    **dict.fromkeys(("listen", "monitor", "subscribe"), "watch"),
    **dict.fromkeys(("log", "frames"), "record"),
    **dict.fromkeys(("latency", "benchmark", "certificate", "time"), "bench"),
    **dict.fromkeys(("plot", "figure", "paper"), "figures"),
    "header": "client header", "key": "client key",
    "sdk": "library", "engine": "library", "sweep": "study", "press": "simulate",
}  # fmt: skip
"""Other words for commands. If one is used, the command is suggested."""


class Commands(Mapping[str, Any]):
    """Mapping from names to commands, which are created when they are first used."""

    _made: ClassVar[dict[str, Any]] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            app = getattr(import_module(f"proximity.cli.{COMMANDS[name][0]}"), name)
            if not isinstance(app, typer.Typer):  # a Typer is a group already
                app = add_command(typer.Typer(add_completion=False), app, name, is_bare=name in RUN_BARE)
            self._made[name] = typer.main.get_command(app)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class Program(Group):
    """Command group that contains all commands."""

    meant: ClassVar[dict[str, str]] = MEANT

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands: Any = Commands()

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write one line for each command, in panels that fit one screen."""
        formatter.write(f"{HELP}\n\n")
        for panel, commands in PANELS.items():
            for row, (name, (_, words)) in enumerate(commands.items()):
                title = typer.style(f"{'' if row else panel:10}", bold=True)
                formatter.write(f"{title}{typer.style(f'{name:12}', fg='cyan')}{words}\n")
        formatter.write("\nHelp: proximity COMMAND --help. Also: --version, --install-completion.\n")


app = typer.Typer(
    cls=Program, no_args_is_help=True, pretty_exceptions_enable=False, context_settings=SETTINGS
)


def _print_version(is_given: bool) -> None:
    if is_given:
        typer.echo(f"proximity {proximity.__version__}")
        raise typer.Exit()


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line on ``sys.argv`` and exit with its code."""
    # Starting a thread on every core takes longer than a query, and no command multiplies large matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a part's name may not fit the terminal's encoding
    app(prog_name="proximity")
