"""The command line ``proximity``: ``query``, ``check``, ``compile``, ``replay``, ``serve``, …

Here people's units meet the library's metres; apart from that conversion the command line computes
nothing. Modules that `main` needs before it knows what is asked import neither NumPy nor Rich: ``--help``
and ``--version`` answer at once.
"""

import io
import sys
from typing import Annotated

import typer

import proximity
from proximity.cli.commands.parts import check, compile, picture, query, view
from proximity.cli.commands.service import (
    calibrate,
    client,
    controller,
    demo,
    drum,
    export,
    header,
    key,
    record,
    serve,
    watch,
)
from proximity.cli.commands.studies import bench, experiment, figures, replay, simulate, study
from proximity.cli.program import Command, Group

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

app = typer.Typer(
    cls=Group,
    help=HELP,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = (
    query, check, picture, replay, compile, serve, record, export, watch, view, demo, drum, header,
    client, controller, calibrate, key, bench, figures, simulate, study,
)  # fmt: skip
"""In the order in which the help lists them."""
RUN_BARE = (demo, header, figures, simulate)
"""Those that do something without an argument; of the others that prints their help."""

for module in COMMANDS:
    app.command(
        module.__name__.rpartition(".")[2],
        cls=Command,
        epilog=module.EXAMPLES,
        help=module.HELP.replace("[", "\\["),  # what is in brackets is no mark of Rich's
        no_args_is_help=module not in RUN_BARE,
    )(module.command)

app.add_typer(experiment.app, name="experiment")


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
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a part's name may not fit the terminal's encoding
    app(prog_name="proximity")
