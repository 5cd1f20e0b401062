"""The command line ``proximity``: ``query``, ``check``, ``compile``, ``replay``, ``serve``, …

Here people's units meet the library's metres; apart from that conversion the command line computes nothing. A
command's module is imported when the command is called or listed, and imports NumPy, Rich and the library
only in the command: ``--help``, ``--version`` and mistakes in the arguments are answered at once.
"""

import io
import os
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer

import proximity
from proximity.cli.program import Command, Group, help_and_examples

HELP = "\n\n".join(  # a paragraph a string: some versions of Typer keep line breaks, some do not
    (
        "Exact distance from points, rays and segments to CAD parts.",
        "Reads STL, OBJ, PLY, OFF, glTF/GLB, 3MF, STEP and compiled scenes (see compile). Every part of a "
        "file is measured separately. Signed distance is negative inside. Coordinates and answers are in "
        "millimetres; --units chooses another unit.",
        "Exit codes: 0: done. 1: the command ran, but the result is negative: check --strict found a part "
        "without an inside, a bound or a certified time of replay did not hold, a scene does not fit the "
        "--gate of bench, a condition of study failed, record, watch, drum or demo received no frame, or "
        "calibrate received too little "
        "input. 2: a file, a point, an address or an option cannot be used, or the log of serve lacks "
        "frames. 130: interrupted. 141: the reader of the output ended first.",
    )
)

MODULE_OF = {
    "query": "parts.query", "check": "parts.check", "clearance": "parts.clearance",
    "picture": "parts.picture", "replay": "lab.replay",
    "compile": "parts.check", "serve": "service.serve", "record": "service.record",
    "export": "service.record", "watch": "service.watch", "view": "parts.view", "demo": "device.demo",
    "drum": "device.drum", "header": "service.sources", "client": "service.sources",
    "controller": "service.sources", "calibrate": "device.calibrate", "key": "service.sources",
    "bench": "lab.bench", "figures": "lab.figures", "simulate": "lab.simulate", "study": "lab.study",
    "experiment": "lab.experiment",
}  # fmt: skip
"""Where each command is, in the order in which the help lists them."""
RUN_BARE = ("demo", "header", "figures", "simulate")
"""Those that do something without an argument; of the others that prints their help."""
SETTINGS = {"help_option_names": ["-h", "--help"]}


class Commands(Mapping[str, Any]):
    """The commands by their names; each is made when it is first asked for."""

    _made: ClassVar[dict[str, Any]] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            module = import_module(f"proximity.cli.{MODULE_OF[name]}")
            function = getattr(module, name)
            app = function
            if not isinstance(function, typer.Typer):  # experiment is a group of its own
                text, examples = help_and_examples(function)
                app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
                app.command(
                    name,
                    cls=Command,
                    help=text,
                    epilog=examples,
                    no_args_is_help=name not in RUN_BARE,
                    context_settings=SETTINGS,
                )(function)
            self._made[name] = typer.main.get_command(app)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(MODULE_OF)

    def __len__(self) -> int:
        return len(MODULE_OF)


class Program(Group):
    """The group of all commands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands: Any = Commands()


app = typer.Typer(
    cls=Program, help=HELP, no_args_is_help=True, pretty_exceptions_enable=False, context_settings=SETTINGS
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
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
    # A thread on every core takes longer to start than a query, and no command multiplies large matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a part's name may not fit the terminal's encoding
    app(prog_name="proximity")
