"""Shared behaviour of all commands, such as negative numbers as arguments, errors and exit codes.

Errors of the library and of writing the output become one line on stderr and exit code 2. All other
exceptions are bugs and keep their traceback.
"""

import errno
import inspect
import os
import re
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from proximity.cli.output import report
from proximity.errors import ProximityError

EXIT_NOTHING = 1  # no frame arrived
EXIT_UNUSABLE = 2  # same as for a usage error
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells count
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE: the reader, such as `head`, ended first

_NO_SUCH_OPTION: Any = vars(sys.modules[typer.BadParameter.__module__])["NoSuchOption"]
"""Click's exception for an unknown option, or that of the copy of Click in newer versions of Typer."""

SETTINGS = {"help_option_names": ["-h", "--help"]}
NEGATIVE = re.compile(r"-(\d|\.\d|(inf|infinity|nan)$)", re.IGNORECASE)
"""Pattern of the start of a negative number, even of a misspelt one such as -1,5. No option starts like
this."""
DISK_IS_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""Error numbers of a full or defective disk."""


def stop_after(limit: float | None, stop: threading.Event) -> None:
    """Set an event after a time limit in seconds. None: no limit."""
    if limit is not None:
        timer = threading.Timer(limit, stop.set)
        timer.daemon = True
        timer.start()


def help_and_examples(command: Callable[..., Any]) -> tuple[str, str]:
    """Return the help and the examples of a command from its docstring.

    Each paragraph of the help is one line.
    """
    text, _, examples = (inspect.getdoc(command) or "").partition("\n\nExamples:\n")
    paragraphs = (" ".join(paragraph.split()) for paragraph in text.split("\n\n"))
    # escape brackets, which are Rich's markup
    return "\n\n".join(paragraphs).replace("[", "\\["), f"\nExamples:\n{examples}\n"


def add_command(
    app: typer.Typer, function: Callable[..., Any], name: str = "", *, is_bare: bool = False
) -> typer.Typer:
    """Add a function to *app* as a command. Its docstring is the help.

    *is_bare*: whether it runs without arguments.
    """
    text, examples = help_and_examples(function)
    app.command(
        name or function.__name__,
        cls=Command,
        help=text,
        epilog=examples,
        no_args_is_help=not is_bare,
        context_settings=SETTINGS,
    )(function)
    return app


def group_of(name: str, help: str, *functions: Callable[..., Any], bare: Iterable[str] = ()) -> typer.Typer:
    """Return a group with a command for each function.

    *bare*: names of those that run without arguments.
    """
    app = typer.Typer(
        name=name, cls=Group, help=help, no_args_is_help=True, add_completion=False, context_settings=SETTINGS
    )
    for function in functions:
        add_command(app, function, is_bare=function.__name__ in bare)
    return app


class _Plain(NamedTuple):
    """Fast conversion of text, paths and defaults.

    Typer's conversion by Pydantic takes a third of the time of a query.
    """

    of_typer: Callable[[], Any]
    kind: Any

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the same value as Typer's converters."""
        kind, is_many = self.kind.annotation, param.multiple or param.nargs == -1
        if value is None:
            return () if is_many else None
        if kind is str or (kind is type(value) and (value == param.default or not self.kind.is_ranged)):
            return value
        if kind is Path and isinstance(value, str):
            return Path(value)
        if kind in (list[str], tuple[str, str, str]):
            return list(value) if is_many else tuple(value)
        return self.of_typer().coerce(value, param=param, ctx=ctx)


def _no_type(ctx: Any) -> None:
    """Return no type for the help of a flag or an argument."""


class _Plainly:
    """Command or group whose values are converted by `_Plain`."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return all arguments and options. Only options with a value have a type in the help."""
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            if param.param_type_name == "argument" or param.is_flag:
                param.display_type_rich = _no_type
            of_typer = getattr(param, "get_runtime_param", None)  # missing in some versions
            if of_typer is not None and not isinstance(of_typer, partial):
                param.get_runtime_param = partial(_Plain, of_typer, param.type_descriptor)
        return params


class Command(_Plainly, TyperCommand):
    """Command that accepts ``-2.5`` as a number, and prints its examples line by line."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, and the examples below it.

        They are written here, since some versions of Typer join their lines.
        """
        examples, self.epilog = self.epilog, None
        try:
            super().format_help(ctx, formatter)
        finally:
            self.epilog = examples
        formatter.write(examples or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse *args*, in which negative numbers may be at any position.

        They are prefixed by a space, so that they are not options.
        """
        try:
            return super().parse_args(ctx, [f" {arg}" if NEGATIVE.match(arg) else arg for arg in args])
        except _NO_SUCH_OPTION as error:
            error.possibilities = get_close_matches(error.option_name, error.possibilities or (), cutoff=0.8)
            raise


class Group(_Plainly, TyperGroup):
    """Group of commands that converts expected errors to exit codes."""

    meant: ClassVar[dict[str, str]] = {"wasm": "library wasm", "javascript": "client js"}
    """Other words for commands. If one is used, the command is suggested."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the arguments name. For an unknown word, suggest one."""
        word = args[0].lower()
        if self.get_command(ctx, args[0]) is None and word in self.meant:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {self.meant[word]!r}?")
        return super().resolve_command(ctx, args)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Parse the arguments. Print help or version if requested."""
        with _expected_ends():
            return super().make_context(*args, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        if sys.stdout is None:
            _fail("standard output is closed, expected a terminal, a file or a pipe to write to")
        with _expected_ends():
            answer = super().invoke(ctx)
            sys.stdout.flush()  # flushed here, where a closed pipe is still handled
            return answer


@contextmanager
def _expected_ends() -> Iterator[None]:
    """Convert errors of the library and of writing the output to exit codes.

    A closed pipe is such an error.
    """
    try:
        yield
    except ProximityError as error:
        _fail(str(error), error)
    except BrokenPipeError as gone:
        _discard_output()
        raise typer.Exit(EXIT_BROKEN_PIPE) from gone
    except SystemExit as end:
        # Rich, which prints the help, exits with 1 on a closed pipe
        if isinstance(end.__context__, BrokenPipeError):
            raise typer.Exit(EXIT_BROKEN_PIPE) from end
        raise
    except OSError as failure:
        if failure.errno not in DISK_IS_FULL:
            raise
        _discard_output()
        _fail(f"the output cannot be written ({failure.strerror})", failure)
    except ImportError as broken:
        if not _is_interrupt(broken):
            raise
        raise typer.Exit(EXIT_INTERRUPTED) from broken


def _is_interrupt(error: BaseException | None) -> bool:
    """Return whether an error was caused by Ctrl-C.

    Compiled modules convert it to another error while they are imported.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _fail(sentence: str, reason: BaseException | None = None) -> NoReturn:
    """Report an error in one line on stderr and exit."""
    report(sentence)
    raise typer.Exit(EXIT_UNUSABLE) from reason


def _discard_output() -> None:
    """Redirect stdout to the null device, so that the interpreter's last flush cannot fail."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, sys.stdout.fileno())
    os.close(nothing)
