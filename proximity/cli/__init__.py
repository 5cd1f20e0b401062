"""The command line: ``proximity query``, ``check``, ``compile``, ``replay``, ``serve``, …

Here people's units meet the library's metres; apart from that conversion the command line computes
nothing. Modules that `main` needs before it knows what is asked import neither NumPy nor Rich: ``--help``
and ``--version`` answer at once.
"""

import io
import sys
from typing import Annotated

import typer

import proximity
from proximity.cli.commands import (
    bench,
    check,
    compile,
    demo,
    drum,
    export,
    figures,
    other_programs,
    query,
    record,
    replay,
    serve,
    simulate,
    view,
    watch,
)
from proximity.cli.program import Command, Group

HELP = "\n\n".join(  # a paragraph a string: some versions of Typer keep line breaks, some do not
    (
        "Exact distance from points, rays and segments to CAD parts.",
        "Reads STL, OBJ, PLY, OFF, glTF/GLB, 3MF and STEP, and what compile wrote. Every part of a file is "
        "measured on its own; "
        "signed distance is negative inside. Coordinates and answers are in millimetres, or in what --units "
        "says.",
        "Exit codes: 0 answered; 1 check --strict found a part without an inside, replay a bound that does "
        "not hold, bench a scene that does not fit its gate, or record, watch, drum or demo no frame; 2 the "
        "files, the points, the addresses or the options cannot be used, or the log of serve lacks frames; "
        "130 interrupted; 141 the reader of "
        "the output went first.",
    )
)

app = typer.Typer(
    cls=Group,
    help=HELP,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("query", cls=Command, epilog=query.EXAMPLES, help=query.HELP, no_args_is_help=True)(query.command)
app.command("check", cls=Command, epilog=check.EXAMPLES, help=check.HELP, no_args_is_help=True)(check.command)
app.command("replay", cls=Command, epilog=replay.EXAMPLES, help=replay.HELP, no_args_is_help=True)(
    replay.command
)
app.command("compile", cls=Command, epilog=compile.EXAMPLES, help=compile.HELP, no_args_is_help=True)(
    compile.command
)
app.command("serve", cls=Command, epilog=serve.EXAMPLES, help=serve.HELP, no_args_is_help=True)(serve.command)
app.command("record", cls=Command, epilog=record.EXAMPLES, help=record.HELP, no_args_is_help=True)(
    record.command
)
app.command("export", cls=Command, epilog=export.EXAMPLES, help=export.HELP, no_args_is_help=True)(
    export.command
)
app.command("watch", cls=Command, epilog=watch.EXAMPLES, help=watch.HELP, no_args_is_help=True)(watch.command)
app.command("view", cls=Command, epilog=view.EXAMPLES, help=view.HELP, no_args_is_help=True)(view.command)
app.command("demo", cls=Command, epilog=demo.EXAMPLES, help=demo.HELP)(demo.command)
app.command("drum", cls=Command, epilog=drum.EXAMPLES, help=drum.HELP, no_args_is_help=True)(drum.command)
app.command("header", cls=Command, epilog=other_programs.HEADER_EXAMPLES, help=other_programs.HEADER_HELP)(
    other_programs.header
)
app.command(
    "key", cls=Command, epilog=other_programs.KEY_EXAMPLES, help=other_programs.KEY_HELP, no_args_is_help=True
)(other_programs.key)
app.command("bench", cls=Command, epilog=bench.EXAMPLES, help=bench.HELP, no_args_is_help=True)(bench.command)
app.command("figures", cls=Command, epilog=figures.EXAMPLES, help=figures.HELP)(figures.command)
app.command("simulate", cls=Command, epilog=simulate.EXAMPLES, help=simulate.HELP)(simulate.command)


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
