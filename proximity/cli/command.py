"""What every command shares: negative numbers among the arguments, and how a command ends.

Library errors become one line on stderr and exit code 2. Whatever else is raised is our bug and keeps its
traceback.
"""

import os
import sys
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from proximity.errors import ProximityError

EXIT_UNUSABLE = 2  # as for a usage error
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells count
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE: the reader, say `head`, went first


class Command(TyperCommand):
    """A command to which ``-2.5`` is a number, whose errors are one line, whose examples stay lines."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, and the examples below it line by line: some versions of Typer would join them."""
        examples, self.epilog = self.epilog, None
        try:
            super().format_help(ctx, formatter)
        finally:
            self.epilog = examples
        formatter.write(examples or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse *args* so that negative numbers are values, wherever they stand."""
        return super().parse_args(ctx, [_shielded(arg) for arg in args])

    def invoke(self, ctx: Any) -> Any:
        """Run the command and turn expected ends into exit codes."""
        try:
            answer = super().invoke(ctx)
            sys.stdout.flush()  # here, where a reader that has gone is still expected
            return answer
        except ProximityError as error:
            typer.echo(f"proximity: {_one_line(error)}", err=True)
            raise typer.Exit(EXIT_UNUSABLE) from error
        except typer.BadParameter as error:
            error.ctx = error.ctx or ctx  # prints how the command is used
            raise
        except KeyboardInterrupt as interrupt:
            raise typer.Exit(EXIT_INTERRUPTED) from interrupt
        except BrokenPipeError as gone:
            _discard_output()
            raise typer.Exit(EXIT_BROKEN_PIPE) from gone


class Group(TyperGroup):
    """The program: Ctrl-C before a command runs is quiet as well."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the program."""
        try:
            return super().main(*args, **options)
        except KeyboardInterrupt:
            sys.exit(EXIT_INTERRUPTED)


def _shielded(arg: str) -> str:
    """Put a space before a negative number: it reads the same, and no longer looks like an option."""
    if not arg.startswith("-"):
        return arg
    try:
        float(arg)
    except ValueError:
        return arg
    return " " + arg


def _one_line(error: ProximityError) -> str:
    return " ".join(str(error).split())


def _discard_output() -> None:
    """Point stdout at nothing, so that the interpreter's last flush cannot fail."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, sys.stdout.fileno())
    os.close(nothing)
